-- Pairs are followed on values: where tracks are, and what pairs were to each other, go in; what they are now, and what
-- began and ended, come out. Nothing is written here, so that the present (sql/147), the past (sql/128) and edits
-- (sql/126) are followed by the same functions. A pair is compared where one of the two moved, appeared, or was edited:
-- with all that may be in reach of it, and with all that it has a state with. A pair has a state while there is
-- something to remember.

-- Queries whose pairs are found by how far the two are apart.
create or replace view semap.pair_reach as
  select query_id, map_id, subject_kind, object_kind, reach_m
  from semap.query_predicate
  where in_pairs and enabled and follows_from in ('moment', 'trend');

-- Pairs of two tracks that may be in reach (p_reach_m) of each other, one of which moved: found in a grid in which each
-- subject is in one cell, and each object in all cells in which somebody may be who reaches it, four at most.
create or replace function semap.tracks_in_reach(
  p_query_id integer, p_reach_m double precision, p_moved semap.track_state[], p_others semap.track_state[]
) returns table (query_id integer, subject_key bigint, object_key bigint)
language plpgsql stable as $$
declare
  c_cells_wide  constant double precision := 3; -- so many reaches: a cell has few others, and an object few cells
  v_wide_m      double precision;
  v_cell_m      double precision;
begin
  if p_reach_m = 'infinity' then
    return query
      with member as materialized (
        select t.is_object, t.key, true as is_moved from semap.track_members(array[p_query_id], p_moved) t
        union all
        select t.is_object, t.key, false from semap.track_members(array[p_query_id], p_others) t
      )
      select p_query_id, s.key, o.key from member s join member o on o.is_object and o.key <> s.key
      where not s.is_object and (s.is_moved or o.is_moved);
    return;
  end if;
  select greatest(p_reach_m + 2 * coalesce(max(m.half_m), 0), 0.1) into v_wide_m
  from semap.track_side s cross join lateral semap.track_members(array[p_query_id], p_moved || p_others) m
  where s.query_id = p_query_id and semap.covers_ground(s.compared);
  v_cell_m := c_cells_wide * v_wide_m;
  return query
    with member as materialized (
      select t.*, true as is_moved from semap.track_members(array[p_query_id], p_moved) t
      union all
      select t.*, false from semap.track_members(array[p_query_id], p_others) t
    ), subject as materialized (
      select s.*, floor(s.x_m / v_cell_m)::bigint as cell_x, floor(s.y_m / v_cell_m)::bigint as cell_y
      from member s where not s.is_object
    ), object as materialized (
      select o.*, l.cell_x + dx as cell_x, l.cell_y + dy as cell_y
      from member o
      cross join lateral (
        select floor((o.x_m - v_wide_m) / v_cell_m)::bigint as cell_x, floor((o.x_m + v_wide_m) / v_cell_m) as to_x,
               floor((o.y_m - v_wide_m) / v_cell_m)::bigint as cell_y, floor((o.y_m + v_wide_m) / v_cell_m) as to_y) l
      cross join (values (0), (1)) x (dx) cross join (values (0), (1)) y (dy)
      where o.is_object and l.cell_x + dx <= l.to_x and l.cell_y + dy <= l.to_y
    )
    select p_query_id, s.key, o.key
    from subject s join object o on o.cell_x = s.cell_x and o.cell_y = s.cell_y
    where (s.is_moved or o.is_moved) and o.key <> s.key
      and abs(s.x_m - o.x_m) <= p_reach_m + s.half_m + o.half_m
      and abs(s.y_m - o.y_m) <= p_reach_m + s.half_m + o.half_m
      and (s.half_m + o.half_m > 0 or (s.x_m - o.x_m) ^ 2 + (s.y_m - o.y_m) ^ 2 <= (p_reach_m + 1e-6) ^ 2);
end $$;

-- Pairs of a track and an instance that may be in reach of each other, of which the track moved or the instance was
-- edited; and of two instances, one of which was edited.
create or replace function semap.instances_in_reach(
  p_query_ids integer[], p_moved semap.track_state[], p_others semap.track_state[], p_edited_ids bigint[]
) returns table (query_id integer, subject_key bigint, object_key bigint)
language plpgsql stable set plan_cache_mode = force_generic_plan as $$
#variable_conflict use_column
begin
  -- boxes alone are looked up: of the other conditions none fits an index
  return query
    select m.query_id, case when m.is_object then -i.instance_id else m.key end,
           case when m.is_object then m.key else -i.instance_id end
    from semap.track_members(p_query_ids, p_moved) m
    join semap.pair_reach r using (query_id)
    cross join lateral (
      select i.instance_id from semap.pair_instance i
      where i.box &&& semap.pair_box(st_xmin(m.shape) - r.reach_m, st_ymin(m.shape) - r.reach_m,
                                     st_xmax(m.shape) + r.reach_m,
                                     st_ymax(m.shape) + r.reach_m, m.query_id, not m.is_object)
        and i.query_id is not distinct from m.query_id and i.is_object is distinct from m.is_object
        and st_dwithin(i.shape, m.shape, r.reach_m) offset 0) i
    where 'instance' in (r.subject_kind, r.object_kind) and r.reach_m < 'infinity'
    union all
    select m.query_id, case when m.is_object then -i.instance_id else m.key end,
           case when m.is_object then m.key else -i.instance_id end
    from semap.track_members(p_query_ids, p_moved) m
    join semap.pair_reach r using (query_id)
    join semap.pair_instance i on i.query_id = m.query_id and i.is_object <> m.is_object
    where r.reach_m = 'infinity';
  if p_edited_ids is null then
    return;
  end if;
  return query
    select m.query_id, case when m.is_object then -i.instance_id else m.key end,
           case when m.is_object then m.key else -i.instance_id end
    from semap.pair_instance i
    join semap.track_members(p_query_ids, p_moved || p_others) m on m.query_id = i.query_id
      and m.is_object <> i.is_object
    join semap.pair_reach r on r.query_id = i.query_id
    where i.instance_id = any (p_edited_ids)
      and (r.reach_m = 'infinity' or st_dwithin(i.shape, m.shape, r.reach_m))
    union all
    select i.query_id, case when i.is_object then -o.instance_id else -i.instance_id end,
           case when i.is_object then -i.instance_id else -o.instance_id end
    from semap.pair_instance i
    join semap.pair_reach r using (query_id)
    cross join lateral (
      select o.instance_id from semap.pair_instance o
      where (r.reach_m = 'infinity'
             or o.box &&& semap.pair_box(st_xmin(i.shape) - r.reach_m, st_ymin(i.shape) - r.reach_m,
                                         st_xmax(i.shape) + r.reach_m,
                                         st_ymax(i.shape) + r.reach_m, i.query_id, not i.is_object)
                and st_dwithin(o.shape, i.shape, r.reach_m))
        and o.query_id = i.query_id and o.is_object <> i.is_object and o.instance_id <> i.instance_id) o
    where i.instance_id = any (p_edited_ids) and i.query_id = any (p_query_ids);
end $$;

-- The instances of a query that are nearest to a shape, seen from above; of two that are as near, that of the lesser
-- uid. Any few of them say how far away the last one can be at most; those that are no further are looked at.
create or replace function semap.nearest_instances(
  p_query_id integer, p_key bigint, p_shape public.geometry, p_count integer, p_distance_m double precision
) returns setof bigint
language plpgsql stable
set enable_seqscan = off set plan_cache_mode = force_generic_plan as $$
declare
  v_box       public.geometry := semap.pair_box(st_xmin(p_shape), st_ymin(p_shape), st_xmax(p_shape), st_ymax(p_shape),
                                                p_query_id, true);
  v_within_m  double precision;
begin
  select case when count(*) = p_count then max(st_distance(f.shape, p_shape)) end into v_within_m
  from (select o.shape from semap.pair_instance o
        where o.query_id is not distinct from p_query_id and o.is_object is not false and -o.instance_id <> p_key
        order by o.box <<->> v_box limit p_count) f;
  v_within_m := least(v_within_m, p_distance_m);
  if v_within_m is null then
    return query
      select -o.instance_id from semap.pair_instance o
      where o.query_id = p_query_id and o.is_object and -o.instance_id <> p_key
      order by st_distance(o.shape, p_shape), o.uid limit p_count;
    return;
  end if;
  v_box := semap.pair_box(st_xmin(p_shape) - v_within_m, st_ymin(p_shape) - v_within_m,
                          st_xmax(p_shape) + v_within_m, st_ymax(p_shape) + v_within_m, p_query_id, true);
  return query
    select -o.instance_id from semap.pair_instance o
    where o.box &&& v_box and o.query_id is not distinct from p_query_id and o.is_object is not false
      and -o.instance_id <> p_key and st_distance(o.shape, p_shape) <= v_within_m
    order by st_distance(o.shape, p_shape), o.uid limit p_count;
end $$;

-- What is nearest to each subject that moved, or, where an object moved, was edited or is gone (p_gone_ids: of these
-- queries), to each: all pairs of these subjects that hold, and those of p_pairs that do so no more.
create or replace function semap.nearest_pairs(
  p_query_ids integer[], p_moved semap.track_state[], p_others semap.track_state[], p_edited_ids bigint[],
  p_gone_ids integer[], p_pairs semap.relation_state[]
) returns table (query_id integer, subject_key bigint, object_key bigint, is_nearest boolean)
language plpgsql stable set plan_cache_mode = force_generic_plan as $$
#variable_conflict use_column
declare
  v_ids  constant integer[] := array(select q.query_id from semap.query_predicate q
                                     where q.query_id = any (p_query_ids) and q.follows_from = 'rank');
begin
  if v_ids = '{}' then
    return;
  end if;
  return query
    with member as materialized (
      select t.*, true as is_moved from semap.track_members(v_ids, p_moved) t
      union all
      select t.*, false from semap.track_members(v_ids, p_others) t
    ), changed as (
      select m.query_id from member m where m.is_object and m.is_moved
      union select i.query_id from semap.pair_instance i where i.is_object and i.instance_id = any (p_edited_ids)
      union select unnest(p_gone_ids)
    ), subject as (
      select m.query_id, m.key, m.shape, m.is_moved from member m where not m.is_object
      union all
      select i.query_id, -i.instance_id, i.shape, (i.instance_id = any (p_edited_ids)) is true
      from semap.pair_instance i where i.query_id = any (v_ids) and not i.is_object
    ), concerned as materialized (
      select s.query_id, s.key, s.shape, q.count, q.distance_m, q.object_kind
      from subject s join semap.continuous_query q using (query_id)
      where s.is_moved or s.query_id in (table changed)
    ), object as materialized (
      select m.query_id, m.key, m.shape, k.uid from member m join semap.track k on k.track_id = m.key where m.is_object
    ), ranked as (
      select c.query_id, c.key as subject_key, n.key as object_key
      from concerned c cross join lateral semap.nearest_instances(c.query_id, c.key, c.shape, c.count,
                                                                  c.distance_m) n (key)
      where c.object_kind = 'instance'
      union all
      select c.query_id, c.key, n.key
      from concerned c
      cross join lateral (
        select o.key from object o
        where o.query_id = c.query_id and o.key <> c.key
          and (c.distance_m is null or st_distance(o.shape, c.shape) <= c.distance_m)
        order by st_distance(o.shape, c.shape), o.uid limit c.count) n
      where c.object_kind = 'track'
    )
    select r.query_id, r.subject_key, r.object_key, true from ranked r
    union all
    select p.query_id, p.subject_key, p.object_key, false
    from concerned c join unnest(p_pairs) p on p.query_id = c.query_id and p.subject_key = c.key
    where not exists (select from ranked r
                      where r.query_id = p.query_id and r.subject_key = p.subject_key and r.object_key = p.object_key);
end $$;

-- Which pairs have to be compared after these tracks moved or instances were edited; is_nearest says of `nearest`,
-- whose pairs depend on third ones, what holds.
create or replace function semap.pair_candidates(
  p_query_ids integer[], p_moved semap.track_state[], p_others semap.track_state[], p_edited_ids bigint[],
  p_gone_ids integer[], p_pairs semap.relation_state[]
) returns table (query_id integer, subject_key bigint, object_key bigint, is_nearest boolean)
language plpgsql stable as $$
#variable_conflict use_column
declare
  c_reaching  constant integer[] := array(select r.query_id from semap.pair_reach r
                                          where r.query_id = any (p_query_ids));
begin
  return query
    select t.*, false
    from semap.pair_reach r cross join lateral semap.tracks_in_reach(r.query_id, r.reach_m, p_moved, p_others) t
    where r.query_id = any (p_query_ids) and r.subject_kind = 'track' and r.object_kind = 'track';
  if exists (select from semap.pair_reach r where r.query_id = any (p_query_ids)
             and 'instance' in (r.subject_kind, r.object_kind)) then
    return query select distinct i.*, false
      from semap.instances_in_reach(p_query_ids, p_moved, p_others, p_edited_ids) i;
  end if;
  return query
    select n.* from semap.nearest_pairs(p_query_ids, p_moved, p_others, p_edited_ids, p_gone_ids, p_pairs) n;
  -- what it has a state with
  return query
    select p.query_id, p.subject_key, p.object_key, false
    from unnest(p_pairs) p
    join (select m.track_id as key from unnest(p_moved) m union all select -i from unnest(p_edited_ids) i) s
      on s.key = p.subject_key
    where p.query_id = any (c_reaching)
    union
    select p.query_id, p.subject_key, p.object_key, false
    from unnest(p_pairs) p
    join (select m.track_id as key from unnest(p_moved) m union all select -i from unnest(p_edited_ids) i) o
      on o.key = p.object_key
    where p.query_id = any (c_reaching);
end $$;

-- What is seen of pairs at one moment, at which tracks moved (to p_moved, while the others are at p_others), instances
-- were edited, or objects of `nearest` went. What appeared now, and (cause `map`) what was edited, is where the
-- boundary says at once. A pair's moment is the later of those of its sides and of what moved (p_at); of two instances
-- it is that of the edit.
create or replace function semap.observed_pairs(
  p_query_ids integer[], p_moved semap.track_state[], p_others semap.track_state[], p_edited_ids bigint[],
  p_gone_ids integer[], p_appeared bigint[], p_at timestamptz, p_cause semap.change_cause,
  p_pairs semap.relation_state[]
) returns table (
  before semap.relation_state, seen semap.observation, enter_confirm interval, leave_confirm interval, appears boolean
)
language sql stable as $$
  with place as materialized (
    select p as state, p.track_id, p.stamp from unnest(p_moved || p_others) p
  ), candidate as materialized (
    select distinct c.query_id, c.subject_key, c.object_key, c.is_nearest
    from semap.pair_candidates(p_query_ids, p_moved, p_others, p_edited_ids, p_gone_ids, p_pairs) c
  ), compared as materialized (
    select q, d.follows_from, c.is_nearest, w.appears,
           coalesce(p, semap.relation_since(c.query_id, c.subject_key, c.object_key, false, null)) as before,
           greatest(coalesce(greatest(s.stamp, o.stamp, p_at), (select clock_timestamp())), p.since, p.pending_at,
                    p.distance_at) as at,
           case when si.instance_id is not null then semap.compared_instance(si)
                else semap.compared_track(s.state, d.subject_compared, q.distance_m) end as subject,
           case when oi.instance_id is not null then semap.compared_instance(oi)
                else semap.compared_track(o.state, d.object_compared, q.distance_m) end as object
    from candidate c
    join semap.continuous_query q on q.query_id = c.query_id
    join semap.predicate d on d.name = q.predicate
    left join unnest(p_pairs) p
      on p.query_id = c.query_id and p.subject_key = c.subject_key and p.object_key = c.object_key
    left join place s on s.track_id = c.subject_key
    left join place o on o.track_id = c.object_key
    left join semap.pair_instance si on si.instance_id = -c.subject_key and si.query_id = c.query_id
      and not si.is_object
    left join semap.pair_instance oi on oi.instance_id = -c.object_key and oi.query_id = c.query_id and oi.is_object
    cross join lateral (
      select (c.subject_key = any (p_appeared) or c.object_key = any (p_appeared)) is true as appears) w
    where (s.track_id is not null or si.instance_id is not null)
      and (o.track_id is not null or oi.instance_id is not null)
  ), stood as materialized (
    select c.*, appears or p_cause = 'map' as is_fresh,
           case when follows_from = 'rank' then row(is_nearest, is_nearest, not is_nearest, null)::semap.standing
                else semap.pair_stands(q, subject, object) end as stands
    from compared c
  ), observed as (
    select s.*, (q).enter_confirm, (q).leave_confirm,
           case when follows_from = 'trend' and (stands).raw then (stands).distance_m end as distance_m,
           case when is_fresh then (stands).raw and follows_from <> 'trend'
                when follows_from = 'trend' then
                  (stands).raw and case when at > (before).distance_at
                                        then (before).distance_m - (stands).distance_m
                                            >= (q).speed_mps * extract(epoch from at - (before).distance_at)
                                        else (before).pending end
                when (before).pending then not (stands).leaves else (stands).enters end as raw
    from stood s
  )
  select before, row(at, null, null, raw, raw, not raw, is_fresh, distance_m)::semap.observation,
         enter_confirm, leave_confirm, appears
  from observed
$$;

-- Compare pairs at one moment (see semap.observed_pairs): what pairs are to each other from then on, and what began and
-- ended.
create or replace function semap.follow_moment(
  p_query_ids integer[], p_moved semap.track_state[], p_others semap.track_state[], p_edited_ids bigint[],
  p_gone_ids integer[], p_appeared bigint[], p_at timestamptz, p_cause semap.change_cause,
  inout pairs semap.relation_state[], out changes semap.pair_change[]
)
language plpgsql stable set enable_mergejoin = off as $$ -- by query alone, which compares all pairs with all
begin
  with followed as materialized (
    select o.*, (before).query_id, (before).subject_key, (before).object_key,
           semap.debounce(before, seen, enter_confirm, leave_confirm) as state
    from semap.observed_pairs(p_query_ids, p_moved, p_others, p_edited_ids, p_gone_ids, p_appeared, p_at, p_cause,
                              pairs) o
  )
  select array(select p from unnest(pairs) p
               where not exists (select from followed f where f.query_id = p.query_id and f.subject_key = p.subject_key
                                                          and f.object_key = p.object_key)
               union all
               select f.state from followed f
               where (f.state).confirmed or (f.state).pending or (f.state).distance_m is not null),
         (select array_agg(row(query_id, subject_key, object_key,
                               case when (state).confirmed then 'began' else 'ended' end,
                               case when appears and (state).confirmed then 'appeared' else p_cause end,
                               (seen).at, (state).pending_at,
                               case when (state).confirmed then (state).since
                                    else least((before).since, (state).pending_at) end,
                               null, null, null)::semap.pair_change)
          from followed where (state).confirmed <> (before).confirmed)
  into pairs, changes;
end $$;

-- Part these things from all that they are paired with, as subjects and as objects of these queries or (null) of all,
-- at a moment (null: that of each pair): the pairs that are left, what ended, and the queries whose nearest ones have
-- to be looked up without them.
create or replace function semap.ended_pairs(
  p_query_ids integer[], p_subject_keys bigint[], p_object_keys bigint[], p_places semap.track_state[],
  p_at timestamptz, p_cause semap.change_cause, inout pairs semap.relation_state[], out changes semap.pair_change[]
)
language plpgsql stable as $$
declare
  v_now  timestamptz := clock_timestamp();
begin
  with stood as (
    select p, (p_query_ids is null or p.query_id = any (p_query_ids))
              and (p.subject_key = any (p_subject_keys) or p.object_key = any (p_object_keys)) as is_gone
    from unnest(pairs) p
  ), ended as (
    select (g.p).*, greatest(coalesce(greatest(s.stamp, o.stamp, p_at), v_now), (g.p).since, (g.p).pending_at) as at
    from stood g
    left join unnest(p_places) s on s.track_id = (g.p).subject_key
    left join unnest(p_places) o on o.track_id = (g.p).object_key
    where g.is_gone and (g.p).confirmed
  )
  select array(select s.p from stood s where not s.is_gone is true),
         (select array_agg(row(query_id, subject_key, object_key, 'ended', p_cause, at, at, since, null, null,
                               null)::semap.pair_change) from ended)
  into pairs, changes;
end $$;

-- The queries, of these, that rank tracks among which these were: what is nearest without them has to be looked up.
create or replace function semap.ranked_without(p_query_ids integer[], p_gone semap.track_state[]) returns integer[]
language sql stable as $$
  select array(select distinct m.query_id from semap.track_members(p_query_ids, p_gone) m where m.is_object)
$$;

-- Follow tracks from where they are (p_places) through these states, in the order of their stamps, in all pairs of
-- these queries: where they are then, what pairs are to each other, and what began and ended. At each moment all are
-- where they are before any two are compared. A state without a place says only that its track has ended.
create or replace function semap.follow_pairs(
  p_query_ids integer[], p_states semap.track_state[],
  inout places semap.track_state[], inout pairs semap.relation_state[], out changes semap.pair_change[]
)
language plpgsql stable as $$
declare
  c_lines    constant integer[] := array(select query_id from semap.query_predicate
                                         where query_id = any (p_query_ids) and follows_from = 'way');
  c_others   constant integer[] := array(select query_id from semap.query_predicate
                                         where query_id = any (p_query_ids) and follows_from <> 'way');
  c_nearest  constant integer[] := array(select query_id from semap.query_predicate
                                         where query_id = any (p_query_ids) and follows_from = 'rank'
                                           and object_kind = 'track');
  v_moment   record;
  v_others   semap.track_state[];
  v_ranked   integer[];
  v_step     record;
begin
  pairs := coalesce(pairs, '{}');
  for v_moment in
    select s.stamp, array_agg(s) filter (where s.x_m is not null) as moved,
           array_agg(s.track_id) filter (where s.x_m is not null and t.track_id is null) as unplaced,
           array_agg(s.track_id) filter (where s.is_last) as ended
    from unnest(p_states) s left join unnest(places) t using (track_id)
    group by s.stamp order by s.stamp
  loop
    if c_lines <> '{}' then
      v_step := semap.cross_lines(c_lines, places, v_moment.moved, pairs);
      pairs := v_step.pairs;
      changes := changes || v_step.changes;
    end if;
    v_others := array(select p from unnest(places) p left join unnest(v_moment.moved) m using (track_id)
                      where m.track_id is null);
    if c_others <> '{}' and v_moment.moved is not null then
      v_step := semap.follow_moment(
        c_others, v_moment.moved, v_others, null, null,
        -- one that ended before, or came in since
        array(select m.track_id from unnest(v_moment.moved) m left join unnest(places) p using (track_id)
              where p.track_id is null),
        v_moment.stamp, 'moved', pairs);
      pairs := v_step.pairs;
      changes := changes || v_step.changes;
    end if;
    places := v_others || v_moment.moved;
    if v_moment.ended is not null then
      v_step := semap.ended_pairs(null, v_moment.ended, v_moment.ended, places, v_moment.stamp, 'disappeared', pairs);
      pairs := v_step.pairs;
      changes := changes || v_step.changes;
      v_ranked := semap.ranked_without(
        c_nearest, array(select p from unnest(places) p where p.track_id = any (v_moment.ended)));
      places := array(select p from unnest(places) p where p.track_id <> all (v_moment.ended));
      if v_ranked <> '{}' then
        v_step := semap.follow_moment(v_ranked, null, places, null, v_ranked, null, v_moment.stamp, 'moved', pairs);
        pairs := v_step.pairs;
        changes := changes || v_step.changes;
      end if;
    end if;
  end loop;
end $$;
