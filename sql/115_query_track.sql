-- Which tracks a continuous query is about, where it says more than "any": of a concept, by uid, by a condition on name,
-- source and attributes. It is told when a track is inserted or changed, or the query is.

-- Which tracks each query with conditions on its subject is about, if regions keep it.
create or replace view semap.query_track_wanted as
  select q.query_id, t.track_id, q.map_id
  from semap.continuous_query q
  join semap.track t on t.map_id = q.map_id
  where not q.in_pairs
    and (q.subject_concept_id is not null or q.subject_uids is not null or q.subject_where is not null)
    and (q.subject_concept_id is null or t.concept_id in (select semap.concepts_below(q.subject_concept_id)))
    and (q.subject_uids is null or t.uid = any (q.subject_uids))
    and (q.subject_where is null or semap.condition_holds(q.subject_where, jsonb_build_object(
           'name', t.name, 'attributes', t.attributes,
           'source', (select name from semap.source n where n.source_id = t.source_id))));
comment on view semap.query_track_wanted is
  'Which tracks each query with conditions on its subject is about, if regions keep it.';

-- Say anew which tracks these queries are about, of these tracks or (null) of all of their maps.
create or replace function semap.choose_tracks(p_query_ids integer[], p_track_ids bigint[]) returns void
language plpgsql as $$
begin
  delete from semap.query_track s
  where (p_query_ids is null or s.query_id = any (p_query_ids)) and (p_track_ids is null or s.track_id = any (p_track_ids));
  insert into semap.query_track (query_id, track_id, map_id)
  select query_id, track_id, map_id from semap.query_track_wanted
  where (p_query_ids is null or query_id = any (p_query_ids)) and (p_track_ids is null or track_id = any (p_track_ids));
end $$;
comment on function semap.choose_tracks is
  'Say anew which tracks these queries are about, of these tracks or of all of their maps.';
