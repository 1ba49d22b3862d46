-- A track is named, said to be of another concept or to have other attributes, or goes on at another source: the
-- queries that ask for such are about it from then on, or no longer.

-- What ends in regions since their queries are no longer about a track (p_lost), and what begins since they are
-- (p_gained): each at the last stamp of the track.
create or replace function semap.crossings_of_choice(p_lost semap.query_track[], p_gained semap.query_track[])
returns semap.crossing[]
language sql stable as $$
  select array_agg(row(c.track_id, c.region_id, c.kind, 'map', t.stamp, t.stamp, null, null)::semap.crossing
                   order by c.track_id, c.region_id)
  from (
    select l.track_id, r.region_id, 'ended' as kind
    from unnest(p_lost) l join semap.relation n on n.track_id = l.track_id and n.query_id = l.query_id and n.confirmed
    join semap.region r on r.query_id = n.query_id and r.instance_id = n.instance_id
    union all
    select g.track_id, r.region_id, 'began'
    from unnest(p_gained) g
    join semap.track_now t on t.track_id = g.track_id and t.live
    join semap.region r on r.query_id = g.query_id
      and r.footprint && public.st_expand(public.st_point(t.x_m, t.y_m), 0.001)
    where (select raw from semap.stands(r, t.x_m, t.y_m, t.z_m, t.std_m))
  ) c
  join semap.track_now t on t.track_id = c.track_id
$$;

-- Bring the relations of these tracks in line with which queries are about them now. What a query is no longer about
-- leaves, and what it is about now and is inside enters, each at the last stamp of the track, with the cause map. Some
-- got another uid (p_renewed_ids), by which the nearest of two is chosen.
create or replace function semap.rechoose_tracks(p_track_ids bigint[], p_renewed_ids bigint[] default null) returns void
language plpgsql as $$
declare
  v_source_ids  integer[];
  v_before      semap.query_track[];
  v_gained      semap.query_track[];
  v_lost        semap.query_track[];
begin
  select array_agg(distinct t.source_id order by t.source_id) into v_source_ids
  from semap.track t
  where t.track_id = any (p_track_ids)
    and exists (select from semap.continuous_query q join semap.predicate p on p.name = q.predicate
                where q.map_id = t.map_id and (
                  num_nonnulls(q.subject_concept_id, q.subject_uids, q.subject_where,
                               q.object_concept_id, q.object_uids, q.object_where) > 0
                  or t.track_id = any (p_renewed_ids) and p.follows_from = 'rank'));
  if v_source_ids is null then
    return;
  end if;
  perform semap.lock_regions_shared();
  perform semap.lock_source(source_id) from unnest(v_source_ids) source_id;

  v_before := array(select s from semap.query_track s where s.track_id = any (p_track_ids));
  perform semap.choose_tracks(null, p_track_ids);
  v_lost := array(select b from unnest(v_before) b where not exists (
                    select from semap.query_track s
                    where (s.query_id, s.is_object, s.track_id) = (b.query_id, b.is_object, b.track_id)));
  v_gained := array(select s from semap.query_track s
                    where s.track_id = any (p_track_ids)
                      and not exists (select from unnest(v_before) b
                                      where (s.query_id, s.is_object, s.track_id) = (b.query_id, b.is_object,
                                                                                     b.track_id)));
  if cardinality(v_lost || v_gained) = 0 and p_renewed_ids is null then
    return;
  end if;
  perform semap.rechoose_in_pairs(p_track_ids, array(select track_id from unnest(v_gained)) || p_renewed_ids);
  perform semap.flush_positions(v_source_ids);
  perform semap.record_crossings(semap.crossings_of_choice(v_lost, v_gained));

  perform semap.settle_relations(array_agg(n))
  from unnest(v_lost) l join semap.relation n on n.track_id = l.track_id and n.query_id = l.query_id and not n.in_pairs;
  update semap.track_now t
  set safe_x_min_m = 'infinity', stateful_ids = h.stateful_ids
  from semap.regions_held(array(select track_id from unnest(v_lost || v_gained))) h
  where t.track_id = h.track_id;
end $$;

-- Bring the pairs of these tracks in line with which queries are about them now; some came to take part.
create or replace function semap.rechoose_in_pairs(p_track_ids bigint[], p_new_ids bigint[]) returns void
language plpgsql as $$
declare
  v_map_ids  integer[] := array(select distinct map_id from semap.track where track_id = any (p_track_ids)
                                order by map_id);
begin
  perform semap.lock_pairs(map_id) from unnest(v_map_ids) map_id;
  update semap.query_track t
  set valid_from = p.through,
      valid_from_track_id = (select max(track_id) from semap.track_now n where n.map_id = t.map_id)
  from semap.pair_progress p
  where t.track_id = any (p_new_ids) and p.map_id = t.map_id
    and t.query_id in (select query_id from semap.pair_side);
  perform semap.refresh_pairs(array_agg(query_id), '{}', p_new_ids)
  from semap.continuous_query where map_id = any (v_map_ids) and in_pairs and enabled;
end $$;

-- A track got another name, concept or source, or other attributes: the relations of queries that ask for them follow.
create or replace function semap.track_described() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_track_ids  bigint[];
begin
  select array_agg(n.track_id) into v_track_ids
  from new_track n join old_track o using (track_id)
  where (n.source_id, n.uid, n.name, n.concept_id, n.attributes)
    is distinct from (o.source_id, o.uid, o.name, o.concept_id, o.attributes);
  perform semap.rechoose_tracks(v_track_ids,
                                (select array_agg(n.track_id) from new_track n join old_track o using (track_id)
                                              where n.uid <> o.uid));
  return null;
end $$;

create or replace trigger track_described after update on semap.track
  referencing old table as old_track new table as new_track
  for each statement execute function semap.track_described();

-- A source got another name: queries may ask for tracks by it. Writers of states were kept out before (sql/020).
create or replace function semap.source_renamed() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_track_ids  constant bigint[] := array(select track_id from semap.track where source_id = new.source_id);
begin
  perform semap.rechoose_tracks(v_track_ids);
  return null;
end $$;

create or replace trigger source_renamed after update of name on semap.source
  for each row when (old.name <> new.name) execute function semap.source_renamed();

-- A concept moved in the taxonomy: queries of a concept above it are about its tracks, or no longer. It comes after the
-- trigger that brings the regions in line, which keeps all writers out.
create or replace function semap.tracks_of_concepts_moved() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  perform semap.rechoose_tracks(array_agg(t.track_id)) from semap.track t
  where t.concept_id is not null
    and exists (select from semap.continuous_query q where q.map_id = t.map_id
                  and num_nonnulls(q.subject_concept_id, q.object_concept_id) > 0);
  return null;
end $$;

create or replace trigger concept_moved_tracks after insert or update or delete on semap.concept_parent
  for each statement execute function semap.tracks_of_concepts_moved();
