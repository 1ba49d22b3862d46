-- Where an instance is among others, and what holds between it and them.

-- The rooms that an instance was in at a time ('infinity': now), the smallest first: those that contain its position,
-- as its frame carried it, by outline and height.
create or replace function semap.rooms_around(p_instance_id bigint, p_at timestamptz default 'infinity')
returns table (instance_id bigint, name text)
language sql stable parallel safe set search_path = public, pg_temp as $$
  with thing as (
    select i.map_id, n.pose as pose_now, t.pose as pose_then,
           (select geometry from semap.abstraction a where a.instance_id = i.instance_id and a.type = 'Position3D')
             as body,
           (select geometry from semap.abstraction a where a.instance_id = i.instance_id and a.type = 'Position2D')
             as flat
    from semap.instance i
    cross join lateral semap.frames_in_root(array[i.frame_id]) n
    cross join lateral semap.frames_in_root(array[i.frame_id], p_at) t
    where i.instance_id = p_instance_id
  ), place as (
    select map_id, semap.placed(coalesce(body, flat, st_point((pose_now).x_m, (pose_now).y_m)),
                                semap.compose(pose_then, semap.inverse(pose_now))) as point
    from thing where pose_now is not null and pose_then is not null
  )
  select r.instance_id, r.name
  from place p
  join semap.instance r on r.map_id = p.map_id and r.instance_id <> p_instance_id
    and r.concept_id in (select semap.concepts_below(semap.concept_named('Room')))
  join semap.abstraction a on a.instance_id = r.instance_id and a.type = 'Footprint'
    and st_contains(a.geometry, p.point)
  where st_z(p.point) is null or a.z_min_m is null or (st_z(p.point) >= a.z_min_m and st_z(p.point) < a.z_max_m)
  order by st_area(a.geometry), r.instance_id
$$;

-- What holds between an instance and each of the thousand that are nearest to it: the instance is `in`, `on` or `near`
-- the other, `contains`, `carries` or `intersects` it, or one is a door that `joins` the other. Distances are between
-- footprints. Where it is in, on, or contains the other, that it is near or intersects it is left out.
create or replace function semap.relations_of(p_instance_id bigint, p_near_m double precision)
returns table (relation text, instance_id bigint, distance_m double precision)
language plpgsql stable parallel safe set search_path = public, pg_temp as $$
declare
  v_others  bigint[];
  v_self    bigint[] := array[p_instance_id];
begin
  select array_agg(n.instance_id) into v_others
  from semap.instance i
  join semap.abstraction s on s.instance_id = i.instance_id and s.type = 'Footprint'
  cross join lateral (
    select a.instance_id
    from semap.abstraction a join semap.instance o on o.instance_id = a.instance_id
    where a.type = 'Footprint' and a.instance_id is not null and o.map_id = i.map_id and a.instance_id <> i.instance_id
      and st_dwithin(a.geometry, s.geometry, p_near_m)
    order by a.geometry <-> s.geometry limit 1000) n
  where i.instance_id = p_instance_id;
  return query
    with held as (
      select 'in' as relation, 1 as rank, o.reference_id as other_id
      from semap.in_objects(v_others, v_self, p_strict => true) o
      union all
      select 'contains', 1, o.target_id from semap.in_objects(v_self, v_others, p_strict => true) o
      union all
      select 'on', 1, o.reference_id from semap.on_objects(v_others, v_self) o
      union all
      select 'carries', 1, o.target_id from semap.on_objects(v_self, v_others) o
      union all
      select 'joins', 0, j.room_id from semap.door_room j where j.door_id = p_instance_id
      union all
      select 'joins', 0, j.door_id from semap.door_room j where j.room_id = p_instance_id
      union all
      select 'intersects', 2, o.target_id from semap.intersecting_objects(v_self, v_others) o
      union all
      select 'near', 3, o.target_id from semap.within_range(v_self, v_others, 0, p_near_m) o
    ), told as (
      select h.*, min(h.rank) filter (where h.rank > 0) over (partition by h.other_id) as best from held h
    )
    select t.relation, t.other_id,
           (select st_distance(a.geometry, b.geometry) from semap.abstraction a, semap.abstraction b
            where a.instance_id = p_instance_id and a.type = 'Footprint'
              and b.instance_id = t.other_id and b.type = 'Footprint')
    from told t
    where t.rank = 0 or t.rank = t.best;
end $$;
