-- Which tracks a continuous query is about, where it says more than "any": of a concept, by uid, by a condition on
-- name, source and attributes. It is told when a track is inserted or changed, or the query is.

-- Each query with what its predicate says of it, and how far what it compares of two things may be apart for it to hold
-- (infinite: any distance).
create or replace view semap.query_predicate as
  select q.query_id, q.map_id, q.predicate, q.subject_kind, q.object_kind, q.in_pairs, q.enabled, p.follows_from,
         p.subject_compared, p.object_compared,
         case p.reach when 'any' then 'infinity' when 'distance' then coalesce(q.distance_m, 'infinity') else 0 end
           + 1e-9 as reach_m
  from semap.continuous_query q join semap.predicate p on p.name = q.predicate;

-- A query says what its predicate needs to be told and no more, of what it relates; and whether regions answer it.
create or replace function semap.query_said() returns trigger
language plpgsql as $$
declare
  v_predicate  semap.predicate;
  v_given      constant text[] := array(
    select name from (values ('distance_m', new.distance_m is not null), ('count', new.count is not null),
                             ('angle_rad', new.angle_rad is not null), ('speed_mps', new.speed_mps is not null),
                             ('direction', new.direction is not null)) g (name, is_given)
    where is_given);
begin
  select * into v_predicate from semap.predicate where name = new.predicate;
  if not (v_predicate.needs <@ v_given and v_given <@ (v_predicate.needs || v_predicate.takes)) then
    raise check_violation using
      message = format('%s is told %s', new.predicate, array_to_string(v_given, ', ', '')),
      hint = format('It needs %s and takes %s.', v_predicate.needs, v_predicate.takes);
  elsif new.subject_kind || ' ' || new.object_kind <> all (v_predicate.relates) then
    raise check_violation using
      message = format('%s does not relate %s to %s', new.predicate, new.subject_kind, new.object_kind),
      hint = format('It relates %s.', array_to_string(v_predicate.relates, ', '));
  end if;
  new.in_pairs := v_predicate.region_test is null or new.subject_kind <> 'track' or new.object_kind <> 'instance';
  if new.follows_amendments and new.in_pairs then
    raise check_violation using
      message = format('%s between %s and %s does not follow amendments', new.predicate, new.subject_kind,
                       new.object_kind),
      hint = 'Ask for a track in, on or near an instance, or leave follows_amendments out.';
  elsif tg_op = 'UPDATE' and old.follows_amendments and not new.follows_amendments then
    raise check_violation using
      message = format('the query %s has followed amendments already', old.name),
      hint = 'Add another query that does not, and delete this one.';
  end if;
  return new;
end $$;

create or replace trigger query_said before insert or update on semap.continuous_query
  for each row execute function semap.query_said();

-- Both sides of each query, with what they ask for.
create or replace view semap.query_side as
  select q.query_id, q.name as query_name, q.map_id, q.distance_m, q.abstraction, s.*, q.in_pairs, q.enabled, c.said
  from semap.continuous_query q
  join semap.predicate p on p.name = q.predicate
  cross join lateral (values
    (false, p.subject_compared, q.subject_kind, q.subject_concept_id, q.subject_uids, q.subject_condition_id),
    (true, p.object_compared, q.object_kind, q.object_concept_id, q.object_uids, q.object_condition_id)
  ) s (is_object, compared, kind, concept_id, uids, condition_id)
  left join semap.condition c on c.condition_id = s.condition_id;

-- Every track that a side of a query is about, whether it lives or not.
create or replace view semap.side_track as
  select s.*, t.track_id, t.uid, t.name
  from semap.query_side s
  join semap.track t on t.map_id = s.map_id
  where s.kind = 'track'
    and (s.concept_id is null or t.concept_id in (select semap.concepts_below(s.concept_id)))
    and (s.uids is null or t.uid = any (s.uids))
    and (s.condition_id is null or semap.condition_holds(
           s.condition_id, s.said, t.name, (select name from semap.source n where n.source_id = t.source_id),
           t.attributes));

-- Which tracks each side of a query that asks for more than any is about.
create or replace view semap.query_track_wanted as
  select query_id, is_object, track_id, map_id from semap.side_track
  where concept_id is not null or uids is not null or condition_id is not null;

-- Say anew which tracks these queries are about, of these tracks or (null) of all of their maps.
create or replace function semap.choose_tracks(p_query_ids integer[], p_track_ids bigint[]) returns void
language plpgsql as $$
begin
  delete from semap.query_track s
  where (p_query_ids is null or s.query_id = any (p_query_ids))
    and (p_track_ids is null or s.track_id = any (p_track_ids))
    and not exists (select from semap.query_track_wanted w
                    where w.query_id = s.query_id and w.is_object = s.is_object and w.track_id = s.track_id);
  insert into semap.query_track (query_id, is_object, track_id, map_id)
  select query_id, is_object, track_id, map_id from semap.query_track_wanted
  where (p_query_ids is null or query_id = any (p_query_ids)) and (p_track_ids is null or track_id = any (p_track_ids))
  on conflict do nothing;
end $$;
