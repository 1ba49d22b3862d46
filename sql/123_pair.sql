-- Pairs are compared where one of the two moved, appeared, or was edited: with all that may be in reach of it, found by
-- the index of boxes, and with all that it is known to be paired with. A pair has a row while there is something to
-- remember of it: `held` is the relation, `inside` what it follows once that has lasted.

-- Which pairs have to be compared after these things moved (or any other of the same query was taken away, for nearest);
-- is_nearest says of `nearest`, whose pairs depend on third ones, what holds.
create or replace function semap.pair_candidates(p_query_ids integer[], p_keys bigint[])
returns table (query_id integer, subject_key bigint, object_key bigint, is_nearest boolean)
language plpgsql stable
set enable_seqscan = off set enable_mergejoin = off set plan_cache_mode = force_generic_plan as $$
#variable_conflict use_column
begin
  if exists (select from semap.continuous_query q where q.query_id = any (p_query_ids) and q.predicate = 'nearest') then
    return query
      with concerned as materialized (
        select s.query_id, s.key, s.shape, q.count, q.distance_m
        from semap.continuous_query q
        join semap.pair_member s on s.query_id = q.query_id and not s.is_object
        where q.query_id = any (p_query_ids) and q.predicate = 'nearest'
          and (s.key = any (p_keys) or exists (
            select from semap.pair_member m where m.key = any (p_keys) and m.query_id = q.query_id and m.is_object))
      ), ranked as (
        select c.query_id, c.key as subject_key, n.key as object_key
        from concerned c cross join lateral semap.nearest_members(c.query_id, c.key, c.shape, c.count, c.distance_m) n (key)
      )
      select query_id, subject_key, object_key, true from ranked
      union all
      select p.query_id, p.subject_key, p.object_key, false
      from concerned c join semap.pair p on p.query_id = c.query_id and p.subject_key = c.key
      where not exists (select from ranked r
                        where r.query_id = p.query_id and r.subject_key = p.subject_key and r.object_key = p.object_key);
  end if;
  -- boxes alone are looked up: of the other conditions none fits an index. What moved finds the others as a subject, and as
  -- an object those subjects that stood still.
  return query
    with asked as materialized (
      select c.query_id, case when c.predicate in ('within_distance', 'approaching') then c.distance_m
                              when c.predicate = 'facing' then coalesce(c.distance_m, 'infinity')
                              else 0 end + 1e-9 as reach_m,
             (select count(*) from semap.pair_member s where s.query_id = c.query_id and not s.is_object)
             > (select count(*) from semap.pair_member s
                where s.key = any (p_keys) and s.query_id = c.query_id and not s.is_object) as have_others
      from semap.continuous_query c
      where c.query_id = any (p_query_ids) and c.predicate not in ('nearest', 'crosses')
    ), moved as materialized (
      select m.key, m.query_id, m.is_object, m.shape, q.reach_m,
             semap.pair_box(st_xmin(m.shape) - q.reach_m, st_ymin(m.shape) - q.reach_m,
                            st_xmax(m.shape) + q.reach_m, st_ymax(m.shape) + q.reach_m, m.query_id, not m.is_object) as box
      from asked q
      join semap.pair_member m on m.key = any (p_keys) and m.query_id = q.query_id
      where not m.is_object or q.have_others
    )
    select m.query_id, case when m.is_object then o.key else m.key end, case when m.is_object then m.key else o.key end, false
    from moved m
    cross join lateral (
      select o.key from semap.pair_member o
      where o.box &&& m.box and o.query_id is not distinct from m.query_id and o.is_object is distinct from m.is_object
        and o.key is distinct from m.key and st_dwithin(o.shape, m.shape, m.reach_m) offset 0) o
    where m.reach_m < 'infinity'
    union
    select m.query_id, case when m.is_object then o.key else m.key end, case when m.is_object then m.key else o.key end, false
    from moved m
    join semap.pair_member o on o.query_id = m.query_id and o.is_object = not m.is_object and o.key <> m.key
    where m.reach_m = 'infinity'
    union
    select p.query_id, p.subject_key, p.object_key, false from semap.pair p
    where p.subject_key = any (p_keys) and p.query_id = any (p_query_ids)
      and p.query_id not in (select c.query_id from semap.continuous_query c where c.predicate = 'nearest')
    union
    select p.query_id, p.subject_key, p.object_key, false from semap.pair p
    where p.object_key = any (p_keys) and p.query_id = any (p_query_ids)
      and p.query_id not in (select c.query_id from semap.continuous_query c where c.predicate = 'nearest');
end $$;

-- The objects of a query that are nearest to a subject, seen from above; of two that are as near, that of the lesser uid.
-- Any few of them say how far away the last one can be at most; those that are no further are looked at.
create or replace function semap.nearest_members(
  p_query_id integer, p_key bigint, p_shape public.geometry, p_count integer, p_distance_m double precision
) returns setof bigint
language plpgsql stable
set enable_seqscan = off set plan_cache_mode = force_generic_plan as $$
declare
  v_box      public.geometry := semap.pair_box(st_xmin(p_shape), st_ymin(p_shape), st_xmax(p_shape), st_ymax(p_shape),
                                               p_query_id, true);
  v_within_m  double precision;
begin
  select case when count(*) = p_count then max(st_distance(f.shape, p_shape)) end into v_within_m
  from (select o.shape from semap.pair_member o
        where o.query_id is not distinct from p_query_id and o.is_object is not false and o.key <> p_key
          and o.shape is not null
        order by o.box <<->> v_box limit p_count) f;
  v_within_m := least(v_within_m, p_distance_m);
  if v_within_m is null then
    return query
      select o.key from semap.pair_member o
      where o.query_id = p_query_id and o.is_object and o.key <> p_key and o.shape is not null
      order by st_distance(o.shape, p_shape), o.uid limit p_count;
    return;
  end if;
  v_box := semap.pair_box(st_xmin(p_shape) - v_within_m, st_ymin(p_shape) - v_within_m,
                          st_xmax(p_shape) + v_within_m, st_ymax(p_shape) + v_within_m, p_query_id, true);
  return query
    select o.key from semap.pair_member o
    where o.box &&& v_box and o.query_id is not distinct from p_query_id and o.is_object is not false and o.key <> p_key
      and st_distance(o.shape, p_shape) <= v_within_m
    order by st_distance(o.shape, p_shape), o.uid limit p_count;
end $$;

-- Compare the pairs of these things and keep what they are to each other; give what began and ended by it. What appeared
-- now, and (cause `map`) what was edited, is where the boundary says at once. A pair's moment is the later of those of
-- its sides and of what moved (p_at); of two instances it is that of the edit.
create or replace function semap.settle_pairs(
  p_query_ids integer[], p_keys bigint[], p_appeared bigint[], p_at timestamptz, p_cause semap.change_cause
) returns semap.pair_change[]
language plpgsql
set enable_seqscan = off set enable_mergejoin = off set plan_cache_mode = force_generic_plan as $$
declare
  v_now      timestamptz := clock_timestamp();
  v_changes  semap.pair_change[];
begin
  with compared as materialized (
    select c.query_id, c.subject_key, c.object_key, s.map_id, q.predicate, q.speed_mps, q.enter_confirm, q.leave_confirm,
           p.pair_id, coalesce(p.held, false) as held, coalesce(p.inside, false) as inside, p.inside_at, p.since,
           p.distance_m as before_m, p.distance_at as before_at, w.appears, w.appears or p_cause = 'map' as is_fresh,
           greatest(coalesce(greatest(s.stamp, o.stamp, p_at), v_now), p.since, p.inside_at, p.distance_at) as at,
           r.distance_m,
           case when q.predicate = 'nearest' then c.is_nearest else r.side end as side,
           case when q.predicate = 'nearest' then c.is_nearest else r.enters end as enters,
           case when q.predicate = 'nearest' then not c.is_nearest else r.leaves end as leaves
    from semap.pair_candidates(p_query_ids, p_keys) c
    join semap.continuous_query q on q.query_id = c.query_id
    -- members are looked up by what they are, whatever was known of the table when this was planned
    cross join lateral (select * from semap.pair_member m
                        where m.key = c.subject_key and m.query_id is not distinct from c.query_id
                          and m.is_object is not true offset 0) s
    cross join lateral (select * from semap.pair_member m
                        where m.key = c.object_key and m.query_id is not distinct from c.query_id
                          and m.is_object is not false offset 0) o
    left join semap.pair p
      on p.query_id = c.query_id and p.subject_key = c.subject_key and p.object_key = c.object_key
    cross join lateral (
      select (c.subject_key = any (p_appeared) or c.object_key = any (p_appeared)) is true as appears) w
    cross join lateral semap.pair_stands(
      q.predicate, q.dimensions, q.distance_m, q.enter_margin_m, q.leave_margin_m, q.angle_rad, c.subject_key, c.object_key,
      s.place, s.shape, s.z_min_m, s.z_max_m, s.yaw_rad, o.place, o.shape, o.z_min_m, o.z_max_m) r
  ), told as (
    -- of `approaching`, side has said so far that the two are near enough
    select c.*, c.predicate = 'approaching' and side as is_near,
           case when is_fresh then side and predicate <> 'approaching'
                when predicate = 'approaching' then
                  side and case when at > before_at then before_m - distance_m >= speed_mps * extract(epoch from at - before_at)
                                else inside end
                when inside then not leaves else enters end as now_inside
    from compared c
  ), timed as (
    select t.*, case when now_inside <> inside or is_fresh then at else inside_at end as now_inside_at from told t
  ), followed as (
    select t.*, case when is_fresh or now_inside = held then now_inside
                     when at >= now_inside_at + case when now_inside then enter_confirm else leave_confirm end then now_inside
                     else held end as now_held
    from timed t
  ), kept as (
    insert into semap.pair as p (map_id, query_id, track_id, subject_instance_id, instance_id, object_track_id,
                                 held, since, inside, inside_at, distance_m, distance_at)
    select map_id, query_id, case when subject_key > 0 then subject_key end, case when subject_key < 0 then -subject_key end,
           case when object_key < 0 then -object_key end, case when object_key > 0 then object_key end,
           now_held, case when not now_held then null when held then since else now_inside_at end,
           now_inside, now_inside_at,
           case when is_near then case when at > before_at or is_fresh or before_at is null then distance_m else before_m end end,
           case when is_near then case when at > before_at or is_fresh or before_at is null then at else before_at end end
    from followed where now_held or now_inside or is_near
    on conflict (query_id, subject_key, object_key) do update
    set held = excluded.held, since = excluded.since, inside = excluded.inside, inside_at = excluded.inside_at,
        distance_m = excluded.distance_m, distance_at = excluded.distance_at
    where (p.held, p.inside, p.inside_at, p.distance_m, p.distance_at)
          is distinct from (excluded.held, excluded.inside, excluded.inside_at, excluded.distance_m, excluded.distance_at)
  ), forgotten as (
    delete from semap.pair
    where pair_id = any (array(select pair_id from followed where pair_id is not null
                                                              and not (now_held or now_inside or is_near)))
  )
  select array_agg(row(query_id, subject_key, object_key, case when now_held then 'began' else 'ended' end,
                       case when appears and now_held then 'appeared' else p_cause end, at,
                       now_inside_at, case when now_held then now_inside_at else least(since, now_inside_at) end,
                       null, null, null)::semap.pair_change)
  into v_changes from followed where now_held <> held;
  return v_changes;
end $$;

-- Write changes of pairs to relation_change in the order of their stamps, and what is over to relation_past. What happens
-- has an identity of its own, so that a replay gives the same one; where it would happen twice at one stamp (sources
-- that say the past of each other, edits of the map) a random one.
create or replace function semap.record_pair_changes(p_changes semap.pair_change[]) returns void
language plpgsql as $$
begin
  if p_changes is null then
    return;
  end if;
  with told as materialized (
    select c.*, s.map_id, s.query_name, s.track_id, s.instance_id as subject_instance_id, s.name as subject_name,
           s.uid as subject_uid, o.instance_id, o.track_id as object_track_id, o.name as object_name, o.uid as object_uid,
           semap.change_uid(s.query_name || '|' || coalesce(extract(epoch from s.stamp) || '', '')
                            || '|' || coalesce(extract(epoch from o.stamp) || '', '') || '|' || coalesce(c.x_m || '|' || c.y_m, ''),
                            s.uid, o.uid, c.kind, c.cause::text, c.edge_at) as uid
    from unnest(p_changes) with ordinality
      as c (query_id, subject_key, object_key, kind, cause, stamp, edge_at, since, x_m, y_m, direction, place)
    cross join lateral (select * from semap.pair_member m
                        where m.key = c.subject_key and m.query_id is not distinct from c.query_id
                          and m.is_object is not true offset 0) s
    cross join lateral (select * from semap.pair_member m
                        where m.key = c.object_key and m.query_id is not distinct from c.query_id
                          and m.is_object is not false offset 0) o
  ), changed as (
    insert into semap.relation_change (
      uid, map_id, query_id, query_name, track_id, track_name, subject_instance_id, subject_instance_name,
      instance_id, instance_name, object_track_id, object_track_name, kind, cause, stamp, edge_at, since, x_m, y_m, direction)
    select case when t.cause = 'map' or exists (select from semap.relation_change h where h.uid = t.uid)
                  or row_number() over (partition by t.uid order by t.place) > 1 then gen_random_uuid() else t.uid end,
           map_id, query_id, query_name, track_id, case when track_id is not null then subject_name end,
           subject_instance_id, case when subject_instance_id is not null then subject_name end,
           instance_id, case when instance_id is not null then object_name end,
           object_track_id, case when object_track_id is not null then object_name end,
           kind::semap.change_kind, cause, stamp, edge_at, since, x_m, y_m, direction
    from told t
    order by stamp, edge_at, subject_name collate "C", subject_uid, cause = 'disappeared', kind::semap.change_kind desc,
             object_name collate "C", object_uid, query_id, place
  )
  insert into semap.relation_past (map_id, query_id, query_name, track_id, track_name, subject_instance_id,
                                   subject_instance_name, instance_id, instance_name, object_track_id, object_track_name,
                                   since, until)
  select map_id, query_id, query_name, track_id, case when track_id is not null then subject_name end,
         subject_instance_id, case when subject_instance_id is not null then subject_name end,
         instance_id, case when instance_id is not null then object_name end,
         object_track_id, case when object_track_id is not null then object_name end, since, edge_at
  from told where kind = 'ended'
  order by edge_at, place;
end $$;

-- Note that these queries have a new form: what came before on their map is not a matter of it.
create or replace function semap.note_pair_forms(p_query_ids integer[]) returns void
language sql as $$
  insert into semap.pair_form as f (query_id, map_id, formed_stamp, formed_track_id)
  select q.query_id, q.map_id, p.through, max(n.track_id)
  from semap.continuous_query q join semap.track_now n using (map_id) join semap.pair_progress p using (map_id)
  where q.query_id = any (p_query_ids) and q.in_pairs
  group by q.query_id, q.map_id, p.through
  on conflict (query_id) do update set formed_stamp = excluded.formed_stamp, formed_track_id = excluded.formed_track_id
$$;

-- Part these things from all that they are paired with, as subjects and as objects of these queries or (null) of all;
-- their members go. Gives the queries whose nearest ones have to be looked up again without them.
create or replace function semap.part_pairs(
  p_query_ids integer[], p_subject_keys bigint[], p_object_keys bigint[], p_at timestamptz, p_cause semap.change_cause
) returns integer[]
language plpgsql as $$
declare
  v_now      timestamptz := clock_timestamp();
  v_changes  semap.pair_change[];
  v_nearest  integer[];
begin
  with gone as (
    delete from semap.pair
    where (subject_key = any (p_subject_keys) or object_key = any (p_object_keys))
      and (p_query_ids is null or query_id = any (p_query_ids))
    returning *
  ), ended as (
    select g.*, greatest(coalesce(greatest(s.stamp, o.stamp, p_at), v_now), g.since, g.inside_at) as at
    from gone g
    join semap.pair_member s on s.key = g.subject_key and s.query_id = g.query_id and not s.is_object
    join semap.pair_member o on o.key = g.object_key and o.query_id = g.query_id and o.is_object
    where g.held
  )
  select array_agg(row(query_id, subject_key, object_key, 'ended', p_cause, at, at, since, null, null, null)::semap.pair_change)
  into v_changes from ended;
  perform semap.record_pair_changes(v_changes);

  with gone as (
    delete from semap.pair_member
    where (key = any (p_subject_keys) and not is_object or key = any (p_object_keys) and is_object)
      and (p_query_ids is null or query_id = any (p_query_ids))
    returning query_id, is_object
  )
  select array_agg(distinct query_id) into v_nearest
  from gone join semap.continuous_query q using (query_id)
  where is_object and q.predicate = 'nearest' and q.in_pairs and q.enabled;
  if p_cause = 'map' then
    perform semap.note_pair_forms(v_nearest); -- whose past was with what is gone
  end if;
  return v_nearest;
end $$;

-- Let tracks go that ended or are deleted, at a stamp (null: that of each pair). What is nearest without them is so then.
create or replace function semap.let_tracks_go(p_track_ids bigint[], p_at timestamptz, p_cause semap.change_cause)
returns void
language plpgsql as $$
declare
  v_nearest  integer[] := semap.part_pairs(null, p_track_ids, p_track_ids, p_at, p_cause);
begin
  if v_nearest is not null then
    perform semap.record_pair_changes(semap.settle_pairs(
      v_nearest, array(select key from semap.pair_member where query_id = any (v_nearest) and not is_object), null,
      p_at, case when p_cause = 'map' then 'map' else 'moved' end::semap.change_cause));
  end if;
end $$;

-- Follow tracks through these states in all pairs of their map, stamp after stamp. At each, all are where they are
-- before any two are compared.
create or replace function semap.compare_pairs(p_map_id integer, p_states semap.arrival[]) returns void
language plpgsql as $$
declare
  v_query_ids  integer[];
  v_lines      integer[];
  v_moment     record;
  v_crossed    semap.pair_change[];
begin
  select array_agg(query_id) filter (where predicate <> 'crosses'), array_agg(query_id) filter (where predicate = 'crosses')
  into v_query_ids, v_lines
  from semap.continuous_query where map_id = p_map_id and in_pairs and enabled;

  for v_moment in
    select stamp, array_agg(track_id) filter (where is_seen) as track_ids, array_agg(state) filter (where is_seen) as states,
           array_agg(track_id) filter (where appears and is_seen) as appeared,
           array_agg(track_id) filter (where is_last) as ended
    from (select a.track_id, a.stamp, a.is_last, a as state, a.x_m is not null as is_seen, lag(a.is_last, 1, not a.live) over one_track as appears
          from unnest(p_states) a
          window one_track as (partition by a.track_id order by a.stamp)) s
    group by stamp order by stamp
  loop
    v_crossed := null;
    if v_lines is not null then
      v_crossed := semap.cross_lines(v_lines, v_moment.states);
    end if;
    perform semap.place_tracks(v_moment.states, v_moment.appeared);
    if v_query_ids is not null then
      v_crossed := v_crossed || semap.settle_pairs(v_query_ids, v_moment.track_ids, v_moment.appeared, v_moment.stamp, 'moved');
    end if;
    perform semap.record_pair_changes(v_crossed);
    if v_moment.ended is not null then
      perform semap.let_tracks_go(v_moment.ended, v_moment.stamp, 'disappeared');
    end if;
  end loop;
end $$;
