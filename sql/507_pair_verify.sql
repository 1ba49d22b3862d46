-- Pairs (sql/121-126) against what they follow from: who takes part in queries about them, and what holds between any
-- two who do. Nothing is taken from pair_instance or followed_state, nor found by an index. The log is compared as that
-- of regions is (sql/505).

-- Who takes part in the queries about pairs of a map, on which side and where, by the map and the presents of tracks
-- alone.
create or replace function semap.wanted_members(p_map_id integer) returns table (
  key bigint, query_id integer, is_object boolean, query_name text, track_id bigint, instance_id bigint,
  uid uuid, name text, stamp timestamptz, place public.geometry, shape public.geometry, box public.geometry,
  z_min_m double precision, z_max_m double precision, yaw_rad double precision
)
language sql stable as $$
  select -w.instance_id, w.query_id, w.is_object, w.query_name, null, w.instance_id, w.uid, w.name, null, w.place,
         w.shape,
         semap.pair_box(st_xmin(w.shape), st_ymin(w.shape), st_xmax(w.shape), st_ymax(w.shape), w.query_id,
                        w.is_object),
         w.z_min_m, w.z_max_m, w.yaw_rad
  from semap.pair_instance_wanted w where w.map_id = p_map_id
  union all
  select w.track_id, w.query_id, w.is_object, w.query_name, w.track_id, null, w.uid, w.name, n.stamp,
         st_point(n.x_m, n.y_m),
         s.shape,
         semap.pair_box(floor(st_xmin(s.shape) / 2) * 2, floor(st_ymin(s.shape) / 2) * 2,
                        ceil(st_xmax(s.shape) / 2) * 2, ceil(st_ymax(s.shape) / 2) * 2, w.query_id, w.is_object),
         n.z_m, n.z_m, n.heading_rad
  from semap.pair_track_wanted w
  join semap.tracks_followed(p_map_id) n on n.track_id = w.track_id
  cross join lateral (select semap.track_shape(w.compared, w.distance_m, n.x_m, n.y_m, n.heading_rad,
                                                n.length_m, n.width_m) as shape offset 0) s
  where w.map_id = p_map_id
$$;

-- Instances that take part in queries about pairs, with what these compare of each, against what the queries and the
-- map say; and where tracks are as pairs see them, against their states.
create or replace function semap.pair_member_differences(p_map_id integer)
returns table (key bigint, query_id integer, is_object boolean, thing text, stored text, wanted text)
language sql stable as $$
  select -coalesce(m.instance_id, w.instance_id), coalesce(m.query_id, w.query_id), coalesce(m.is_object, w.is_object),
         format('%s of %s: %s', case when coalesce(m.is_object, w.is_object) then 'object' else 'subject' end,
                coalesce(w.query_name, m.query_id::text), coalesce(w.name, m.name)),
         case when m.instance_id is null then 'none' when w.instance_id is null then 'one'
              else format('%s at %s', m.name, st_astext(m.place)) end,
         case when w.instance_id is null then 'none' when m.instance_id is null then 'one'
              when (m.name, st_asbinary(m.place)) is distinct from (w.name, st_asbinary(w.place))
                then format('%s at %s', w.name, st_astext(w.place))
              else 'another shape, box, height, heading or identity' end
  from (select * from semap.pair_instance where map_id = p_map_id) m
  full join (select *, semap.pair_box(st_xmin(shape), st_ymin(shape), st_xmax(shape), st_ymax(shape), query_id,
                                      is_object) as box
             from semap.pair_instance_wanted where map_id = p_map_id) w using (instance_id, query_id, is_object)
  where m.instance_id is null or w.instance_id is null
     or (m.uid, m.name, st_asbinary(m.place), st_asbinary(m.shape), st_asbinary(m.box), m.z_min_m, m.z_max_m, m.yaw_rad)
        is distinct from
        (w.uid, w.name, st_asbinary(w.place), st_asbinary(w.shape), st_asbinary(w.box), w.z_min_m, w.z_max_m, w.yaw_rad)
  union all
  select coalesce(f.track_id, n.track_id), null, null, 'track ' || t.name,
         case when f.track_id is null then 'none' else format('at %s, %s at %s', f.x_m, f.y_m, f.stamp) end,
         case when n.track_id is null then 'none' else format('at %s, %s at %s', n.x_m, n.y_m, n.stamp) end
  from (select (f.state).* from semap.followed_state f where f.map_id = p_map_id) f
  full join (select * from semap.tracks_followed(p_map_id)
             where exists (select from semap.pair_side where map_id = p_map_id)) n using (track_id)
  join semap.track t using (track_id)
  where (f is distinct from n)
    and (n.track_id is not null or exists (select from semap.pair_side where map_id = p_map_id))
$$;

-- Each two things of a map that are a pair by what is stored, or may be one by where they are now, with how they stand
-- to each other: all members of a query with all. `enters`: it holds beyond doubt; `leaves`: it does not; between the
-- two lie margins. What approaches depends on the way: of that is known only whether the two are within reach
-- (is_near).
create or replace function semap.standing_pairs(p_map_id integer) returns table (
  query_id integer, subject_key bigint, object_key bigint, follows_from text, pair semap.relation, have_members boolean,
  subject_name text, object_name text, query_name text, enters boolean, leaves boolean, is_near boolean,
  begins_by_now boolean, ends_by_now boolean
)
language sql stable as $$
  with member as materialized (
    select * from semap.wanted_members(p_map_id)
  ), query as materialized (
    select q as query, q.query_id, q.name, q.count, q.distance_m, q.enter_confirm, q.leave_confirm, p.follows_from,
           p.reach_m
    from semap.continuous_query q join semap.query_predicate p using (query_id)
    where q.map_id = p_map_id and q.in_pairs and q.enabled
  ), ranked as (
    select s.query_id, s.key as subject_key, o.key as object_key, q.count, q.distance_m as within_m, d.distance_m,
           row_number() over (partition by s.query_id, s.key order by d.distance_m, o.uid) as place
    from query q
    join member s on s.query_id = q.query_id and not s.is_object
    join member o on o.query_id = q.query_id and o.is_object and o.key <> s.key and o.shape is not null
    cross join lateral (select st_distance(o.shape, s.shape) as distance_m) d
    where q.follows_from = 'rank'
  ), nearest as materialized (
    select r.query_id, r.subject_key, r.object_key from ranked r
    where place <= count and (within_m is null or distance_m <= within_m)
  ), stored as materialized (
    select p.query_id, p.subject_key, p.object_key, p from semap.relation p
    where p.map_id = p_map_id and p.in_pairs
  ), looked_at as (
    select n.query_id, n.subject_key, n.object_key from nearest n
    union
    select s.query_id, s.subject_key, s.object_key from stored s
    union
    select q.query_id, s.key, o.key
    from query q
    join member s on s.query_id = q.query_id and not s.is_object
    join member o on o.query_id = q.query_id and o.is_object and o.key <> s.key
    where q.follows_from in ('moment', 'trend')
      and (q.reach_m = 'infinity' or st_dwithin(s.shape, o.shape, q.reach_m))
  )
  select l.query_id, l.subject_key, l.object_key, q.follows_from, p.p, s.key is not null and o.key is not null,
         s.name, o.name, q.name,
         coalesce(case q.follows_from when 'rank' then n.query_id is not null when 'trend' then false
                  else r.enters end, false),
         coalesce(case q.follows_from when 'rank' then n.query_id is null when 'trend' then not r.raw
                  else r.leaves end, true),
         q.follows_from = 'trend' and coalesce(r.raw, false),
         greatest(s.stamp, o.stamp) < (p.p).pending_at + q.enter_confirm is not true,
         greatest(s.stamp, o.stamp) < (p.p).pending_at + q.leave_confirm is not true
  from looked_at l
  left join query q on q.query_id = l.query_id
  left join member s on s.query_id = l.query_id and s.key = l.subject_key and not s.is_object
  left join member o on o.query_id = l.query_id and o.key = l.object_key and o.is_object
  left join stored p on p.query_id = l.query_id and p.subject_key = l.subject_key and p.object_key = l.object_key
  left join nearest n on n.query_id = l.query_id and n.subject_key = l.subject_key and n.object_key = l.object_key
  left join lateral semap.pair_stands(
    q.query, row(s.key, s.place, s.shape, s.z_min_m, s.z_max_m, s.yaw_rad)::semap.compared,
    row(o.key, o.place, o.shape, o.z_min_m, o.z_max_m, o.yaw_rad)::semap.compared) r
    on s.key is not null and o.key is not null
$$;

-- Pairs against where their two sides are now, as far as that is beyond doubt; and pairs of what takes no part.
create or replace function semap.pair_differences(p_map_id integer)
returns table (query_id integer, subject_key bigint, object_key bigint, thing text, stored text, wanted text)
language sql stable as $$
  select s.query_id, s.subject_key, s.object_key,
         format('%s, %s (%s)', case when s.subject_key > 0 then 'track '
                else '' end || coalesce(s.subject_name, 'something'),
                case when s.object_key > 0 then 'track ' else '' end || coalesce(s.object_name, 'something'),
                coalesce(s.query_name, 'a query that is gone')),
         case when (s.pair).query_id is null then 'no pair' when s.follows_from = 'way' and not (s.pair).confirmed
           then 'a side of a line'
              when (s.pair).confirmed and (s.pair).pending then 'holds since ' || (s.pair).since
              when (s.pair).confirmed then 'about to end' when (s.pair).pending
                then 'about to begin' else 'followed' end,
         d.wanted
  from semap.standing_pairs(p_map_id) s
  cross join lateral (
    select case
      when not s.have_members then 'no pair, since one of them takes no part'
      when s.follows_from = 'way' then case when (s.pair).confirmed then 'never held' end
      when s.enters and (s.pair).pending is not true then 'holds, or about to begin'
      when s.leaves and (s.pair).pending then 'does not hold, or about to end'
      when (s.pair).pending and not (s.pair).confirmed and s.begins_by_now then 'holds by now'
      when (s.pair).confirmed and not (s.pair).pending and s.ends_by_now then 'ended by now'
      when s.is_near and (s.pair).distance_at is null then 'followed, with the distance between the two'
      when (s.pair).query_id is not null and not (s.pair).confirmed and not (s.pair).pending
        and not s.is_near then 'no pair'
    end as wanted) d
  where d.wanted is not null
$$;
