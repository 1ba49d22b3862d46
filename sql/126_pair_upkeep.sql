-- Pairs follow the map, the queries, and who is on it; and what is found of them is written.

-- What pairs of these queries are to each other: all, or those of these tracks and of what is nearest to anything.
create or replace function semap.known_pairs(p_query_ids integer[], p_track_ids bigint[] default null)
returns semap.relation_state[]
language sql stable as $$
  select coalesce(array_agg(semap.state_of_relation(p)), '{}')
  from semap.relation p
  where p.query_id = any (p_query_ids) and p.in_pairs
    and (p_track_ids is null or p.track_id = any (p_track_ids) or p.object_track_id = any (p_track_ids)
         or p.query_id in (select query_id from semap.query_predicate where follows_from = 'rank'))
$$;

-- Write what pairs of a map are to each other now, where that is not what it was.
create or replace function semap.keep_pairs(
  p_map_id integer, p_before semap.relation_state[], p_now semap.relation_state[]
) returns void
language sql as $$
  with gone as (
    delete from semap.relation p
    using unnest(p_before) b
    left join unnest(p_now) n on n.query_id = b.query_id and n.subject_key = b.subject_key
      and n.object_key = b.object_key
    where n.query_id is null
      and p.query_id = b.query_id and p.subject_key = b.subject_key and p.object_key = b.object_key
  )
  insert into semap.relation (query_id, map_id, in_pairs, track_id, subject_instance_id, instance_id, object_track_id,
                              confirmed, since, pending, pending_at, raw, raw_at, distance_m, distance_at)
  select n.query_id, p_map_id, true, case when n.subject_key > 0 then n.subject_key end,
         case when n.subject_key < 0 then -n.subject_key end,
         case when n.object_key < 0 then -n.object_key end, case when n.object_key > 0 then n.object_key end,
         n.confirmed, n.since, n.pending, n.pending_at, n.raw, n.raw_at, n.distance_m, n.distance_at
  from unnest(p_now) n
  left join unnest(p_before) b on n.query_id = b.query_id and n.subject_key = b.subject_key
    and n.object_key = b.object_key
  where n is distinct from b
  on conflict (query_id, subject_key, object_key) do update
  set confirmed = excluded.confirmed, since = excluded.since, pending = excluded.pending,
      pending_at = excluded.pending_at, raw = excluded.raw, raw_at = excluded.raw_at,
      distance_m = excluded.distance_m, distance_at = excluded.distance_at
$$;

-- Write changes of pairs to relation_change in the order of semap.described_changes, with these identities in that
-- order, and what is over to relation_past.
create or replace function semap.write_pair_changes(
  p_changes semap.pair_change[], p_uids uuid[], p_amendment text default null
) returns void
language plpgsql as $$
begin
  with told as materialized (
    select * from semap.described_changes(p_changes)
  ), changed as (
    insert into semap.relation_change (
      uid, map_id, query_id, query_name, track_id, track_name, subject_instance_id, subject_instance_name,
      instance_id, instance_name, object_track_id, object_track_name, kind, cause, stamp, transition_at, since, x_m,
      y_m,
      direction, amendment)
    select p_uids[place], map_id, query_id, query_name, track_id, track_name, subject_instance_id,
           subject_instance_name, instance_id, instance_name, object_track_id, object_track_name, kind, cause, stamp,
           transition_at, since, x_m, y_m, direction, p_amendment
    from told order by place
  )
  insert into semap.relation_past (map_id, query_id, query_name, track_id, track_name, subject_instance_id,
                                   subject_instance_name, instance_id, instance_name, object_track_id,
                                   object_track_name, since, until)
  select map_id, query_id, query_name, track_id, track_name, subject_instance_id, subject_instance_name,
         instance_id, instance_name, object_track_id, object_track_name, since, transition_at
  from told where kind = 'ended'
  order by transition_at, place;
end $$;

-- Write changes of pairs as they happen. What happens has an identity of its own, so that a replay gives the same one;
-- where it would happen twice at one moment (edits of the map) a random one.
create or replace function semap.record_pair_changes(p_changes semap.pair_change[]) returns void
language plpgsql as $$
begin
  if p_changes is null then
    return;
  end if;
  perform semap.write_pair_changes(p_changes, array(
    select case when t.cause = 'map' or exists (select from semap.relation_change h where h.uid = t.uid)
                  or row_number() over (partition by t.uid order by t.place) > 1 then gen_random_uuid() else t.uid end
    from semap.described_changes(p_changes) t order by t.place));
end $$;

-- Changes of pairs with all that the log says of them, in its order: that of their stamps.
create or replace function semap.described_changes(p_changes semap.pair_change[]) returns table (
  place bigint, uid uuid, map_id integer, query_id integer, query_name text, track_id bigint, track_name text,
  subject_instance_id bigint, subject_instance_name text, instance_id bigint, instance_name text,
  object_track_id bigint, object_track_name text, kind semap.change_kind, cause semap.change_cause,
  stamp timestamptz, transition_at timestamptz, since timestamptz, x_m double precision, y_m double precision,
  direction text
)
language sql stable as $$
  select row_number() over (
           order by c.stamp, c.part, c.transition_at, coalesce(s.name, si.name) collate "C", coalesce(s.uid, si.uid),
                    c.kind::semap.change_kind desc, coalesce(o.name, oi.name) collate "C", coalesce(o.uid, oi.uid),
                    c.query_id, c.n),
         semap.change_uid(f.query_name || coalesce('|' || c.x_m || '|' || c.y_m, ''), coalesce(s.uid, si.uid),
                          coalesce(o.uid, oi.uid), c.kind, c.cause::text, c.transition_at),
         f.map_id, c.query_id, f.query_name, s.track_id, s.name, si.instance_id, si.name, oi.instance_id, oi.name,
         o.track_id, o.name, c.kind::semap.change_kind, c.cause, c.stamp, c.transition_at, c.since, c.x_m, c.y_m,
         c.direction
  from (
    -- at one moment: who moved, who ended, and what is nearest after that
    select *, case when cause = 'disappeared' then 1
                   when count(*) filter (where cause = 'disappeared') over (partition by stamp order by n) > 0 then 2
                   else 0 end as part
    from unnest(p_changes) with ordinality
      as c (query_id, subject_key, object_key, kind, cause, stamp, transition_at, since, x_m, y_m, direction, n)) c
  join semap.pair_query f on f.query_id = c.query_id
  left join semap.track s on s.track_id = c.subject_key
  left join semap.track o on o.track_id = c.object_key
  left join semap.pair_instance si on si.instance_id = -c.subject_key and si.query_id = c.query_id and not si.is_object
  left join semap.pair_instance oi on oi.instance_id = -c.object_key and oi.query_id = c.query_id and oi.is_object
$$;

-- Note that these queries have a new form: what came before on their map is not a matter of it.
create or replace function semap.note_pair_queries(p_query_ids integer[]) returns void
language sql as $$
  insert into semap.pair_query as f (query_id, map_id, query_name, valid_from, valid_from_track_id)
  select q.query_id, q.map_id, q.name, p.through,
         coalesce((select max(n.track_id) from semap.track_now n where n.map_id = q.map_id), 0)
  from semap.continuous_query q join semap.pair_progress p using (map_id)
  where q.query_id = any (p_query_ids) and q.in_pairs and q.enabled
  on conflict (query_id) do update
  set query_name = excluded.query_name, valid_from = excluded.valid_from,
      valid_from_track_id = excluded.valid_from_track_id
$$;

-- Put instances that take part in these queries on a map where they are, of these or (null) of all: which are not what
-- they were. What rests on what depends on more than outlines, and is taken as changed.
create or replace function semap.place_instances(p_query_ids integer[], p_instance_ids bigint[]) returns bigint[]
language plpgsql as $$
declare
  v_changed  bigint[];
begin
  with wanted as materialized (
    select * from semap.pair_instance_wanted w
    where w.query_id = any (p_query_ids) and (p_instance_ids is null or w.instance_id = any (p_instance_ids))
  ), changed as (
    select array_agg(distinct w.instance_id) as ids
    from wanted w
    left join semap.pair_instance m on m.instance_id = w.instance_id and m.query_id = w.query_id
      and m.is_object = w.is_object
    where m.instance_id is null or w.compared in ('body', 'top')
       or (st_asbinary(w.place), st_asbinary(w.shape), w.z_min_m, w.z_max_m, w.yaw_rad)
          is distinct from (st_asbinary(m.place), st_asbinary(m.shape), m.z_min_m, m.z_max_m, m.yaw_rad)
  ), placed as (
    insert into semap.pair_instance as m (query_id, is_object, map_id, instance_id, uid, name, place, shape, box,
                                          z_min_m, z_max_m, yaw_rad)
    select query_id, is_object, map_id, instance_id, uid, name, place, shape,
           semap.pair_box(st_xmin(shape), st_ymin(shape), st_xmax(shape), st_ymax(shape), query_id, is_object),
           z_min_m, z_max_m, yaw_rad
    from wanted
    on conflict (instance_id, query_id, is_object) do update
    set uid = excluded.uid, name = excluded.name, place = excluded.place, shape = excluded.shape, box = excluded.box,
        z_min_m = excluded.z_min_m, z_max_m = excluded.z_max_m, yaw_rad = excluded.yaw_rad
  )
  select ids into v_changed from changed;
  return v_changed;
end $$;

-- Who takes part in these queries on a map no more, by query: those of pair_instance, and tracks that have pairs.
create or replace function semap.gone_from_pairs(p_map_id integer, p_query_ids integer[], p_instance_ids bigint[])
returns table (query_id integer, subject_keys bigint[], object_keys bigint[])
language sql stable as $$
  select g.query_id, array_agg(g.key) filter (where not g.is_object), array_agg(g.key) filter (where g.is_object)
  from (
    select m.query_id, m.is_object, -m.instance_id as key
    from semap.pair_instance m
    where m.map_id = p_map_id and m.query_id = any (p_query_ids)
      and (p_instance_ids is null or m.instance_id = any (p_instance_ids))
      and not exists (select from semap.pair_instance_wanted w
                      where w.query_id = m.query_id and w.is_object = m.is_object and w.instance_id = m.instance_id)
    union
    select p.query_id, k.is_object, k.key
    from semap.relation p
    cross join lateral (values (false, p.track_id), (true, p.object_track_id)) k (is_object, key)
    where p.map_id = p_map_id and p.query_id = any (p_query_ids) and p.in_pairs and k.key is not null
      and not exists (
        select from semap.track_side s
        where s.query_id = p.query_id and s.is_object = k.is_object
          and (not s.is_chosen or exists (select from semap.query_track t
                                          where t.query_id = s.query_id and t.is_object = k.is_object
                                            and t.track_id = k.key)))) g
  group by g.query_id
$$;

-- End what takes part in these queries on a map no more, while tracks are at these places: the pairs without it, and
-- the queries in which something else may be nearest now.
create or replace function semap.end_gone_pairs(
  p_map_id integer, p_query_ids integer[], p_instance_ids bigint[], p_places semap.track_state[],
  inout pairs semap.relation_state[], out nearest_ids integer[]
)
language plpgsql as $$
declare
  v_gone  record;
  v_step  record;
begin
  for v_gone in select * from semap.gone_from_pairs(p_map_id, p_query_ids, p_instance_ids) order by query_id loop
    v_step := semap.ended_pairs(array[v_gone.query_id], v_gone.subject_keys, v_gone.object_keys, p_places, null, 'map',
                                pairs);
    pairs := v_step.pairs;
    perform semap.record_pair_changes(v_step.changes);
    delete from semap.pair_instance
    where query_id = v_gone.query_id
      and (-instance_id = any (v_gone.subject_keys) and not is_object or -instance_id = any (v_gone.object_keys)
           and is_object);
    if v_gone.object_keys is not null then
      nearest_ids := nearest_ids || array(select query_id from semap.query_predicate where query_id = v_gone.query_id
                                          and follows_from = 'rank' and in_pairs and enabled);
    end if;
  end loop;
end $$;

-- Bring the pairs of these queries on a map in line with these instances or (null) all, and with these tracks, which
-- came to take part; and compare again who is not what it was; everybody, where the queries ask something else now.
create or replace function semap.refresh_map_pairs(
  p_map_id integer, p_query_ids integer[], p_instance_ids bigint[], p_track_ids bigint[], p_is_other boolean
) returns void
language plpgsql as $$
declare
  v_places   semap.track_state[];
  v_before   constant semap.relation_state[] := semap.known_pairs(p_query_ids);
  v_pairs    semap.relation_state[];
  v_nearest  integer[];
  v_step     record;
  v_edited   bigint[];
  v_moved    semap.track_state[];
begin
  perform semap.begin_following(p_map_id);
  v_places := semap.followed_places(p_map_id);
  select pairs, nearest_ids into v_pairs, v_nearest
  from semap.end_gone_pairs(p_map_id, p_query_ids, p_instance_ids, v_places, v_before);
  delete from semap.pair_query where query_id = any (p_query_ids)
    and query_id not in (select query_id from semap.pair_side);
  v_edited := semap.place_instances(p_query_ids, p_instance_ids);
  if p_is_other then
    v_edited := array(select distinct instance_id from semap.pair_instance where query_id = any (p_query_ids));
    v_moved := v_places;
    v_places := null;
    perform semap.note_pair_queries(p_query_ids);
  else
    v_moved := array(select p from unnest(v_places) p where p.track_id = any (p_track_ids));
    v_places := array(select p from unnest(v_places) p where p.track_id = any (p_track_ids) is not true);
    perform semap.note_pair_queries(v_nearest); -- whose past was with what is gone
    update semap.pair_query f set query_name = q.name
    from semap.continuous_query q where q.query_id = f.query_id and q.query_id = any (p_query_ids)
      and f.query_name <> q.name;
  end if;
  update semap.pair_instance m
  set valid_from = p.through, valid_from_track_id = n.track_id
  from (select map_id, max(track_id) as track_id from semap.track_now where map_id = p_map_id group by map_id) n
  join semap.pair_progress p using (map_id)
  where m.query_id = any (p_query_ids) and m.instance_id = any (v_edited) and m.map_id = p_map_id;
  -- from which side somebody came to a line that was drawn anew is not known
  v_pairs := array(
    select p from unnest(v_pairs) p join semap.query_predicate q using (query_id)
    where not (q.follows_from = 'way' and (p_is_other or -p.object_key = any (v_edited)
                                           or p.subject_key = any (p_track_ids)) is true));
  v_step := semap.follow_moment(
    array(select query_id from semap.query_predicate
          where query_id = any (p_query_ids) and in_pairs and enabled and follows_from <> 'way'),
    v_moved, v_places, v_edited, v_nearest, null, null, 'map', v_pairs);
  perform semap.keep_pairs(p_map_id, v_before, v_step.pairs);
  perform semap.record_pair_changes(v_step.changes);
end $$;

-- Bring the pairs of these queries in line with these instances or (null) all, and with these tracks.
create or replace function semap.refresh_pairs(
  p_query_ids integer[], p_instance_ids bigint[], p_track_ids bigint[] default null, p_is_other boolean default false
) returns void
language sql as $$
  select semap.refresh_map_pairs(map_id, array_agg(query_id), p_instance_ids, p_track_ids, p_is_other)
  from (select query_id, map_id from semap.pair_query where query_id = any (p_query_ids)
        union select query_id, map_id from semap.continuous_query where query_id = any (p_query_ids)) q
  group by map_id order by map_id;
  -- what comes while nothing is asked about pairs is not followed: the next query begins anew
  delete from semap.pair_progress p
  where not exists (select from semap.continuous_query q where q.map_id = p.map_id and q.in_pairs and q.enabled)
$$;

-- Bring pairs in line with these instances, which were added, edited or removed.
create or replace function semap.refresh_pairs_of(p_instance_ids bigint[]) returns void
language plpgsql as $$
begin
  if not exists (select from semap.continuous_query where in_pairs) then
    return;
  end if;
  perform semap.refresh_pairs(array_agg(query_id), p_instance_ids)
  from (select q.query_id from semap.continuous_query q
        where q.in_pairs and q.enabled
          and q.map_id in (select map_id from semap.instance where instance_id = any (p_instance_ids))
        union
        select m.query_id from semap.pair_instance m where m.instance_id = any (p_instance_ids)) concerned;
end $$;

-- End what these tracks of a map are to others, at a stamp (null: that of each pair). What is nearest without them is
-- so then.
create or replace function semap.end_pairs(
  p_map_id integer, p_track_ids bigint[], p_at timestamptz, p_cause semap.change_cause
) returns void
language plpgsql as $$
declare
  c_queries  constant integer[] := array(select query_id from semap.continuous_query where map_id = p_map_id
                                         and in_pairs and enabled);
  c_nearest  constant integer[] := array(select query_id from semap.query_predicate
                                         where query_id = any (c_queries) and follows_from = 'rank'
                                           and object_kind = 'track');
  v_before   semap.relation_state[];
  v_places   semap.track_state[];
  v_ranked   integer[];
  v_step     record;
  v_next     record;
begin
  if not exists (select from semap.followed_state where track_id = any (p_track_ids)) then
    return;
  end if;
  v_before := semap.known_pairs(c_queries, p_track_ids);
  v_places := semap.followed_places(p_map_id);
  v_step := semap.ended_pairs(null, p_track_ids, p_track_ids, v_places, p_at, p_cause, v_before);
  perform semap.record_pair_changes(v_step.changes);
  update semap.pair_progress set revision = revision + 1 where map_id = p_map_id;
  delete from semap.followed_state where track_id = any (p_track_ids);
  v_ranked := semap.ranked_without(c_nearest, array(select p from unnest(v_places) p
                                                    where p.track_id = any (p_track_ids)));
  if v_ranked <> '{}' then
    v_next := semap.follow_moment(
      v_ranked, null, array(select p from unnest(v_places) p where p.track_id <> all (p_track_ids)), null, v_ranked,
      null,
      p_at, case when p_cause = 'map' then 'map' else 'moved' end::semap.change_cause, v_step.pairs);
    perform semap.record_pair_changes(v_next.changes);
    v_step := v_next;
  end if;
  perform semap.keep_pairs(p_map_id, v_before, v_step.pairs);
end $$;

-- End what tracks are to others that ended, each at the end that it has now, where the pairs of their map were followed
-- up to that end; an end that is further on is met there.
create or replace function semap.end_pairs_of_ended(p_track_ids bigint[]) returns void
language plpgsql as $$
declare
  v_moment  record;
begin
  if not exists (select from semap.followed_state where track_id = any (p_track_ids)) then
    return;
  end if;
  perform semap.lock_pairs(map_id)
  from (select distinct map_id from semap.followed_state where track_id = any (p_track_ids) order by map_id) m;
  for v_moment in
    select k.map_id, greatest(k.ended_at, t.stamp) as stamp, array_agg(k.track_id) as track_ids
    from semap.track k join semap.track_now t using (track_id) join semap.pair_progress p on p.map_id = k.map_id
    where k.track_id = any (p_track_ids) and greatest(k.ended_at, t.stamp) <= p.through
    group by 1, 2 order by 2, 1
  loop
    perform semap.end_pairs(v_moment.map_id, v_moment.track_ids, v_moment.stamp, 'disappeared');
  end loop;
end $$;
