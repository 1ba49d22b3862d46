-- Ways through doors. A way leads from the position of its first room straight to a door, from there straight to a
-- door of the next room, and so on: the shortest one by these lines, which may cut a corner of a concave room.
-- Lines count the height between two places where both have one: the floor on which a room or a door stands.

-- Where these instances are for ways: the position seen from above, at the height on which they stand; one without
-- a shape is where its frame is.
create or replace function semap.way_points(p_ids bigint[])
returns table (instance_id bigint, x_m double precision, y_m double precision, z_m double precision)
language sql stable parallel safe set search_path = public, pg_temp as $$
  select instance_id, st_x(geometry), st_y(geometry), z_min_m
  from semap.abstraction where instance_id = any (p_ids) and type = 'Position2D'
  union all
  select i.instance_id, (p.pose).x_m, (p.pose).y_m, (p.pose).z_m
  from semap.instance i
  join semap.frames_in_root(array(select frame_id from semap.instance where instance_id = any (p_ids))) p
    using (frame_id)
  where i.instance_id = any (p_ids) and p.pose is not null
    and not exists (select from semap.abstraction a where a.instance_id = i.instance_id and a.type = 'Position2D')
$$;

-- The rooms of one map that a door joins, in both directions, without doors that have one of the attributes p_closed.
create or replace function semap.joined(
  p_reference_ids bigint[], p_target_ids bigint[] default null, p_closed jsonb default null
) returns table (reference_id bigint, target_id bigint, door_id bigint)
language sql stable parallel safe as $$
  select a.room_id, b.room_id, a.door_id
  from semap.door_room a join semap.door_room b on b.door_id = a.door_id and b.room_id <> a.room_id
  where a.room_id = any (p_reference_ids) and (p_target_ids is null or b.room_id = any (p_target_ids))
    and (p_closed is null or not exists (
           select from semap.instance d where d.instance_id = a.door_id and d.attributes @> p_closed))
$$;

-- The rooms that doors, openings, stairs and lifts connect with a room, itself among them.
create or replace function semap.rooms_connected(p_room_id bigint) returns setof bigint
language sql stable parallel safe as $$
  with recursive reached (room_id) as (
    select p_room_id
    union
    select other.room_id
    from reached r
    join semap.door_room a on a.room_id = r.room_id
    join semap.door_room other on other.door_id = a.door_id
  )
  select room_id from reached
$$;

-- The straight ways between the places of a map, each a door and the room that it is passed into, and to these from a
-- room (0): from which place to which, and how far [m].
create or replace function semap.passages(p_from bigint, p_door_ids bigint[], p_room_ids bigint[])
returns table (from_n integer, to_n integer, length_m double precision)
language sql stable parallel safe set search_path = public, pg_temp as $$
  with place as materialized (
    select p.n::integer, p.door_id, p.room_id
    from unnest(p_door_ids, p_room_ids) with ordinality p (door_id, room_id, n)
  ), point as materialized (
    select * from semap.way_points(p_door_ids || p_from)
  ), passage as (
    select a.n as from_n, b.n as to_n, pa.x_m - pb.x_m as dx, pa.y_m - pb.y_m as dy, pa.z_m - pb.z_m as dz
    from place a
    join semap.door_room out on out.room_id = a.room_id and out.door_id <> a.door_id
    join place b on b.door_id = out.door_id and b.room_id <> a.room_id
    join point pa on pa.instance_id = a.door_id join point pb on pb.instance_id = b.door_id
    union all
    select 0, b.n, pa.x_m - pb.x_m, pa.y_m - pb.y_m, pa.z_m - pb.z_m
    from semap.door_room out join place b on b.door_id = out.door_id and b.room_id <> p_from
    join point pa on pa.instance_id = p_from join point pb on pb.instance_id = b.door_id
    where out.room_id = p_from
  )
  select from_n, to_n, sqrt(dx * dx + dy * dy + coalesce(dz * dz, 0)) from passage
$$;

-- The shortest way from a room through each door into each room that it leads to: [m] at the door, and the door and
-- room before. Lengths are relaxed over all passages at once until none gets shorter (Bellman and Ford).
create or replace function semap.ways_from(p_from bigint, p_closed jsonb default null)
returns table (
  door_id bigint, room_id bigint, length_m double precision, before_door_id bigint, before_room_id bigint, step integer
)
language plpgsql stable parallel safe set search_path = public, pg_temp as $$
declare
  v_doors    bigint[];
  v_rooms    bigint[];
  v_from     integer[];
  v_to       integer[];
  v_lengths  double precision[];
  v_way      double precision[];
  v_before   integer[];
  v_fresh    boolean[];  -- got shorter in the round before
  v_round    record;
begin
  select array_agg(r.door_id order by r.door_id, r.room_id), array_agg(r.room_id order by r.door_id, r.room_id)
  into v_doors, v_rooms
  from semap.instance f
  join semap.instance d on d.map_id = f.map_id
  join semap.door_room r on r.door_id = d.instance_id
  where f.instance_id = p_from and (p_closed is null or not d.attributes @> p_closed);
  if v_doors is null then
    return;
  end if;
  select array_agg(p.from_n), array_agg(p.to_n), array_agg(p.length_m) into v_from, v_to, v_lengths
  from semap.passages(p_from, v_doors, v_rooms) p;
  v_way := array_fill(null::double precision, array[cardinality(v_doors)]);
  v_before := array_fill(null::integer, array[cardinality(v_doors)]);
  loop
    with shorter as (
      select distinct on (e.to_n) e.to_n, e.from_n, w.length_m
      from unnest(v_from, v_to, v_lengths) e (from_n, to_n, length_m),
           lateral (select case when e.from_n = 0 then e.length_m else v_way[e.from_n] + e.length_m end as length_m) w
      where case when e.from_n = 0 then v_fresh is null else v_fresh[e.from_n] end
        and w.length_m < coalesce(v_way[e.to_n], 'infinity')
      order by e.to_n, w.length_m, e.from_n
    )
    select array_agg(coalesce(s.length_m, v_way[n]) order by n) as way,
           array_agg(coalesce(s.from_n, v_before[n]) order by n) as before,
           array_agg(s.to_n is not null order by n) as fresh, count(s.to_n) as changed
    into v_round
    from generate_subscripts(v_doors, 1) n left join shorter s on s.to_n = n;
    exit when v_round.changed = 0;
    v_way := v_round.way;
    v_before := v_round.before;
    v_fresh := v_round.fresh;
  end loop;
  return query
    with recursive place as materialized (
      select p.n, p.before_n from unnest(v_before) with ordinality p (before_n, n)
    ), back (n, before_n, step) as (
      select p.n, p.before_n, 1 from place p where p.before_n = 0
      union all
      select p.n, p.before_n, b.step + 1 from back b join place p on p.before_n = b.n
    )
    select v_doors[b.n], v_rooms[b.n], v_way[b.n], v_doors[nullif(b.before_n, 0)],
           coalesce(v_rooms[nullif(b.before_n, 0)], p_from), b.step
    from back b;
end $$;

-- The shortest way between two rooms: the rooms in order, each with the door by which it is entered, the length of the
-- way there and of the whole way to the last room's position; no rows where there is no way.
create or replace function semap.route(p_from bigint, p_to bigint, p_closed jsonb default null)
returns table (
  step integer, room_id bigint, room text, door_id bigint, door text, length_m double precision,
  total_m double precision
)
language sql stable parallel safe set search_path = public, pg_temp as $$
  with recursive way as materialized (
    select * from semap.ways_from(p_from, p_closed)
  ), point as materialized (
    select * from semap.way_points(array[p_to] || array(select door_id from way where room_id = p_to))
  ), best as (
    select w.*, w.length_m + sqrt((d.x_m - t.x_m) ^ 2 + (d.y_m - t.y_m) ^ 2 + coalesce((d.z_m - t.z_m) ^ 2, 0))
      as total_m
    from way w join point d on d.instance_id = w.door_id join point t on t.instance_id = p_to
    where w.room_id = p_to and p_to <> p_from
    order by total_m, w.door_id limit 1
  ), back as (
    select * from best
    union all
    select w.*, b.total_m from back b join way w on w.door_id = b.before_door_id and w.room_id = b.before_room_id
  )
  select n.step, n.room_id, r.name, n.door_id, d.name, n.length_m, n.total_m
  from (
    select step, room_id, door_id, length_m, total_m from back
    union all
    select 0, p_from, null, 0, total_m from best
    union all
    select 0, p_from, null, 0, 0 where p_from = p_to
  ) n
  join semap.instance r on r.instance_id = n.room_id
  left join semap.instance d on d.instance_id = n.door_id
  order by n.step
$$;

-- The rooms that can be reached through doors, with the length of the shortest way to the position of each.
create or replace function semap.reachable(p_from bigint, p_closed jsonb default null)
returns table (room_id bigint, room text, doors integer, total_m double precision)
language sql stable parallel safe set search_path = public, pg_temp as $$
  with way as materialized (
    select * from semap.ways_from(p_from, p_closed) where room_id <> p_from
  ), point as materialized (
    select * from semap.way_points(array(select door_id from way) || array(select room_id from way))
  )
  select distinct on (w.room_id) w.room_id, r.name, w.step, l.total_m
  from way w
  join semap.instance r on r.instance_id = w.room_id
  join point d on d.instance_id = w.door_id join point t on t.instance_id = w.room_id
  cross join lateral (
    select w.length_m + sqrt((d.x_m - t.x_m) ^ 2 + (d.y_m - t.y_m) ^ 2 + coalesce((d.z_m - t.z_m) ^ 2, 0)) as total_m) l
  order by w.room_id, l.total_m, w.step
$$;
