-- Pairs that differ from what they follow from (sql/505, 507) are made anew, as part of the repair of a map (sql/510).

-- Keep for a repair who takes part in which query of a map (semap_side), and which of its pairs hold by its log, with
-- whether both sides still take part (semap_open).
create or replace function semap.keep_open_pairs(p_map_id integer) returns void
language plpgsql as $$
begin
  drop table if exists pg_temp.semap_side;
  create temporary table semap_side on commit drop as
    select query_id, key, is_object from semap.wanted_members(p_map_id);
  create index on pg_temp.semap_side (key);
  drop table if exists pg_temp.semap_open;
  create temporary table semap_open on commit drop as
    select c.*, k.*,
           exists (select from pg_temp.semap_side s where s.key = k.subject_key and s.query_id = c.query_id
                   and not s.is_object)
           and exists (select from pg_temp.semap_side s where s.key = k.object_key and s.query_id = c.query_id
                       and s.is_object)
             as is_there
    from semap.folded_changes(p_map_id) f
    cross join lateral (select (f.change).*) c
    cross join lateral (select coalesce(c.track_id, -c.subject_instance_id) as subject_key,
                               coalesce(c.object_track_id, -c.instance_id) as object_key) k
    where f.is_newest and c.kind = 'began'
      and (c.track_id is null or c.instance_id is null
           or exists (select from semap.continuous_query q where q.query_id = c.query_id and q.in_pairs));
  create index on pg_temp.semap_open (subject_key);
  analyze pg_temp.semap_side, pg_temp.semap_open;
end $$;

-- Make pairs of a map what its log says that they are, since that is what clients and rules believe; what holds with
-- something that takes no part ends. Says which were written.
create or replace function semap.pair_as_logged(p_map_id integer)
returns table (query_id integer, subject_key bigint, object_key bigint)
language plpgsql as $$
#variable_conflict use_column
begin
  perform semap.keep_open_pairs(p_map_id);
  insert into semap.relation_change (
    uid, map_id, query_id, query_name, track_id, track_name, subject_instance_id, subject_instance_name,
    instance_id, instance_name, object_track_id, object_track_name, kind, cause, stamp, transition_at, since)
  select gen_random_uuid(), map_id, query_id, query_name, track_id, track_name, subject_instance_id,
         subject_instance_name,
         instance_id, instance_name, object_track_id, object_track_name, 'ended', 'map', m.at, m.at, transition_at
  from pg_temp.semap_open a
  cross join lateral (
    select greatest(coalesce(max(t.stamp), clock_timestamp()), a.transition_at) as at
    from semap.track_now t where t.track_id in (a.track_id, a.object_track_id)) m
  where not is_there
  order by m.at, change_id;

  return query
  with unsaid as (
    delete from semap.relation p
    where p.map_id = p_map_id and p.in_pairs and p.confirmed
      and not exists (select from pg_temp.semap_open o
                      where o.is_there and o.query_id = p.query_id and o.subject_key = p.subject_key
                        and o.object_key = p.object_key)
      and (p.since >= coalesce((select gone_before from semap.retention where kind = 'changes'), '-infinity')
           or exists (select from semap.query_predicate q where q.query_id = p.query_id and q.follows_from = 'way'))
    returning p.query_id, p.subject_key, p.object_key
  ), said as (
    insert into semap.relation as p (query_id, map_id, in_pairs, track_id, subject_instance_id, instance_id,
                                     object_track_id, confirmed, since, pending, pending_at, raw, raw_at)
    select query_id, map_id, true, track_id, subject_instance_id, instance_id, object_track_id, true, transition_at,
           true, transition_at, true, transition_at
    from pg_temp.semap_open where is_there
    on conflict (query_id, subject_key, object_key) do update
    set confirmed = true, since = excluded.since, pending = p.pending or not p.confirmed,
        pending_at = case when p.confirmed then p.pending_at else excluded.pending_at end,
        raw = p.raw or not p.confirmed, raw_at = case when p.confirmed then p.raw_at else excluded.raw_at end
    where p.since is distinct from excluded.since
    returning p.query_id, p.subject_key, p.object_key
  )
  select * from unsaid union select * from said;
end $$;

-- Make members of pairs on a map anew where they differ, and compare again who is in a pair that differs, as after an
-- edit. Says how many relations began or ended by it.
create or replace function semap.repair_pairs(p_map_id integer) returns bigint
language plpgsql as $$
declare
  v_before   bigint := (select coalesce(max(change_id), 0) from semap.relation_change where map_id = p_map_id);
  v_changed  record;
  v_keys     bigint[];
  v_edited   bigint[];
  v_pairs    semap.relation_state[];
  v_step     record;
begin
  perform semap.pair_as_logged(p_map_id);
  delete from semap.relation p
  where p.map_id = p_map_id and p.in_pairs and not (
    exists (select from pg_temp.semap_side s where s.key = p.subject_key and s.query_id = p.query_id
            and not s.is_object)
    and exists (select from pg_temp.semap_side s where s.key = p.object_key and s.query_id = p.query_id
                and s.is_object));

  v_keys := array(select distinct key from semap.pair_member_differences(p_map_id));
  delete from semap.pair_instance where map_id = p_map_id and -instance_id = any (v_keys);
  v_edited := semap.place_instances(
    array(select query_id from semap.continuous_query where map_id = p_map_id and in_pairs and enabled),
    array(select -key from unnest(v_keys) key where key < 0));
  perform semap.keep_followed(p_map_id, array(select key from unnest(v_keys) key where key > 0),
                              array(select s from semap.tracks_followed(p_map_id) s));
  update semap.pair_instance m
  set valid_from = n.newest, valid_from_track_id = n.newest_id
  from (select max(p.through) as newest, max(t.track_id) as newest_id
        from semap.track_now t join semap.pair_progress p using (map_id) where t.map_id = p_map_id) n
  where m.map_id = p_map_id and m.instance_id = any (v_edited) and n.newest is not null;

  for v_changed in
    select query_id, array_agg(distinct subject_key) as keys from semap.pair_differences(p_map_id)
    group by query_id order by query_id
  loop
    v_pairs := semap.known_pairs(array[v_changed.query_id]);
    v_step := semap.follow_moment(
      array[v_changed.query_id], semap.followed_places(p_map_id, v_changed.keys),
      array(select p from unnest(semap.followed_places(p_map_id)) p where p.track_id <> all (v_changed.keys)),
      array(select -k from unnest(v_changed.keys) k where k < 0), null, null, null, 'map', v_pairs);
    perform semap.keep_pairs(p_map_id, v_pairs, v_step.pairs);
    perform semap.record_pair_changes(v_step.changes);
  end loop;
  -- what the log says of the past stays, and is no matter of what these queries are from now on
  if exists (select from semap.pair_history_differences(p_map_id))
    or exists (select from semap.crossing_differences(p_map_id)) then
    perform semap.note_pair_queries(array(select query_id from semap.continuous_query where map_id = p_map_id
                                        and in_pairs));
  end if;
  return (select count(*) from semap.relation_change
          where map_id = p_map_id and change_id > v_before and kind in ('began', 'ended') and amendment is null);
end $$;
