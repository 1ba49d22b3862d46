-- Distances between things, and what is near. Flat abstractions are measured seen from above, those of space in
-- three dimensions as solids: what lies inside another is at distance 0. A flat one and one of space are measured
-- seen from above. Distances are exact for the abstraction that is measured, up to rounding.

-- The shape of an instance that an abstraction names; 'Body' names its body in the map.
create or replace function semap.shape_of(p_instance_id bigint, p_abstraction text) returns public.geometry
language plpgsql stable parallel safe as $$
begin
  if p_abstraction = 'Body' then
    return semap.body_of(p_instance_id);
  end if;
  return (select geometry from semap.abstraction where instance_id = p_instance_id and type = p_abstraction);
end $$;

-- A corner of a mesh, or a point itself.
create or replace function semap.first_corner(p_shape public.geometry) returns public.geometry
language plpgsql immutable parallel safe as $$
begin
  return case when st_dimension(p_shape) = 0 then p_shape
              else st_pointn(st_exteriorring(st_geometryn(p_shape, 1)), 1) end;
end $$;

-- The shortest straight line from one body to another, of no length where one holds a point of the other. Of convex
-- bodies, which are in one piece, one corner tells whether they lie in one another.
create or replace function semap.shortest_line_3d(
  p_a public.geometry, p_b public.geometry, p_are_convex boolean default false
) returns public.geometry
language plpgsql immutable parallel safe as $$
declare
  v_line   public.geometry := st_3dshortestline(p_a, p_b);
  v_point  public.geometry;
begin
  if st_3dlength(v_line) = 0 or not st_expand(p_a, 1e-9) &&& p_b then
    return v_line;
  end if;
  if p_are_convex then
    select c.geom into v_point
    from (values (semap.first_corner(p_a), p_b), (semap.first_corner(p_b), p_a)) c (geom, holder)
    where st_dimension(c.holder) > 1 and c.holder &&& c.geom and semap.inside_3d(c.holder, c.geom, 0)
    limit 1;
  elsif semap.holds_part_3d(p_a, p_b) or semap.holds_part_3d(p_b, p_a) then
    select c.geom into v_point
    from (select (st_dumppoints(p_a)).geom, p_b as holder union all select (st_dumppoints(p_b)).geom, p_a) c
    where st_dimension(c.holder) > 1 and semap.inside_3d(c.holder, c.geom, 0)
    limit 1;
  end if;
  -- PostGIS 3.3 misses the contact of a corner that lies in the plane of a triangle but for rounding; a tenth
  -- of a micrometre aside it finds it
  if v_point is null and semap.intersects_3d(p_a, p_b, 1e-9) then
    select st_startpoint(line) into v_point
    from (values (1e-7, 0, 0), (0, 1e-7, 0), (0, 0, 1e-7), (-1e-7, 0, 0), (0, -1e-7, 0),
          (0, 0, -1e-7)) aside (x_m, y_m, z_m),
         lateral (select st_3dshortestline(st_translate(p_a, x_m, y_m, z_m), p_b) as line) l
    order by st_3dlength(line) limit 1;
  end if;
  return coalesce(st_makeline(v_point, v_point), v_line);
end $$;

-- The shortest ('min') or longest ('max') straight line from one shape to another: as solids if both are of space,
-- else seen from above.
create or replace function semap.line_between(
  p_a public.geometry, p_b public.geometry, p_mode text, p_are_convex boolean default false
) returns public.geometry
language plpgsql immutable parallel safe as $$
begin
  if p_mode is null or p_mode not in ('min', 'max') then
    raise exception 'There is no distance %.', coalesce(p_mode, 'null')
      using errcode = 'invalid_parameter_value', hint = 'Use min or max.';
  end if;
  if st_zmflag(p_a) = 2 and st_zmflag(p_b) = 2 then
    return case p_mode when 'min' then semap.shortest_line_3d(p_a, p_b, p_are_convex)
                       else st_3dlongestline(st_points(p_a), st_points(p_b)) end;
  end if;
  return case p_mode when 'min' then st_shortestline(st_force2d(p_a), st_force2d(p_b))
                     else st_longestline(st_points(st_force2d(p_a)), st_points(st_force2d(p_b))) end;
end $$;

-- The distance [m] of each pair of things, least ('min') or greatest ('max'), and the points that are so far apart.
-- The abstractions are those of p_abstraction, unless one is named for either side; 'Body' measures bodies.
create or replace function semap.distances(
  p_reference_ids bigint[], p_target_ids bigint[] default null, p_abstraction text default 'Footprint',
  p_mode text default 'min', p_reference_abstraction text default null, p_target_abstraction text default null
) returns table (
  reference_id bigint, target_id bigint, distance_m double precision,
  reference_point public.geometry, target_point public.geometry
)
language plpgsql stable parallel safe as $$
declare
  v_reference  text := coalesce(p_reference_abstraction, p_abstraction);
  v_target     text := coalesce(p_target_abstraction, p_abstraction);
begin
  perform semap.dimensions_of(name) from unnest(array[v_reference, v_target]) name where name <> 'Body';
  perform semap.line_between('point(0 0)', 'point(0 0)', p_mode);
  return query
    with r as materialized (
      select o.instance_id, o.map_id, semap.shape_of(o.instance_id, v_reference) as shape
      from semap.operands(p_reference_ids, p_target_ids) o
    ), t as materialized (
      select o.instance_id, o.map_id, semap.shape_of(o.instance_id, v_target) as shape
      from semap.operands(p_target_ids, p_reference_ids) o
    )
    select r.instance_id, t.instance_id,
           case when st_zmflag(line) = 2 then st_3dlength(line) else st_length(line) end,
           st_startpoint(line), st_endpoint(line)
    from r join t on t.map_id = r.map_id and t.instance_id <> r.instance_id
    -- computed once (tests/operators/test_operator_plan)
    cross join lateral (select semap.line_between(r.shape, t.shape, p_mode, 'Body' not in (v_reference, v_target))
                        as line offset 0) l
    where r.shape is not null and t.shape is not null;
end $$;

-- The distance [m] of two convex solids: 0 where one lies in the other.
create or replace function semap.gap_3d(p_a public.geometry, p_b public.geometry) returns double precision
language plpgsql immutable parallel safe as $$
declare
  v_gap_m  double precision := st_3ddistance(p_a, p_b);
begin
  -- one may lie in the other; and PostGIS 3.3 misses a corner that lies in the plane of a triangle but for rounding
  if v_gap_m > 0 and st_expand(p_a, 1e-9) &&& p_b and semap.intersects_3d(p_a, p_b, 1e-9) then
    return 0;
  end if;
  return v_gap_m;
end $$;

-- Whether two abstractions are both of space; refuses one that is flat beside one that is not.
create or replace function semap.both_in_space(p_a text, p_b text) returns boolean
language plpgsql immutable parallel safe as $$
begin
  if semap.dimensions_of(p_a) <> semap.dimensions_of(p_b) then
    raise exception '% is not compared with %.', p_a, p_b
      using errcode = 'invalid_parameter_value', hint = 'Name two flat abstractions, or two of space.';
  end if;
  return semap.dimensions_of(p_a) = 3;
end $$;

-- Things whose distance [m] from a reference lies between two limits, both of them included; fully: of which every
-- point lies at least p_min_m and at most p_max_m from every point of the reference. The abstractions are both flat,
-- or both of space.
create or replace function semap.within_range(
  p_reference_ids bigint[], p_target_ids bigint[] default null, p_min_m double precision default 0,
  p_max_m double precision default 5, p_fully boolean default false, p_abstraction text default 'Footprint',
  p_reference_abstraction text default null, p_target_abstraction text default null
) returns table (reference_id bigint, target_id bigint, distance_m double precision)
language plpgsql stable parallel safe as $$
declare
  v_reference  text := coalesce(p_reference_abstraction, p_abstraction);
  v_target     text := coalesce(p_target_abstraction, p_abstraction);
  v_in_space   boolean := semap.both_in_space(v_reference, v_target);
  v_backwards  boolean := p_reference_ids is null and p_target_ids is not null;
begin
  -- s: the side that the search starts from, o: the other one; d: computed once (tests/operators/test_operator_plan)
  return query execute format(
    'select %1$s, d.distance_m'
    ' from semap.abstraction s join semap.instance si on si.instance_id = s.instance_id'
    ' cross join lateral (select a.instance_id, a.geometry from semap.abstraction a'
    '   where a.type = %2$L and a.instance_id is not null and %3$s offset 0) o'
    ' join semap.instance oi on oi.instance_id = o.instance_id and oi.map_id = si.map_id'
    ' cross join lateral (select %4$s as distance_m offset 0) d'
    ' where s.instance_id = any ($1) and s.type = %5$L and o.instance_id <> s.instance_id'
    '   and ($2 is null or o.instance_id in (select unnest($2)))'
    '   and d.distance_m between $3 and $4 and (not $5 or %6$s <= $4)',
    case when v_backwards then 'o.instance_id, s.instance_id' else 's.instance_id, o.instance_id' end,
    case when v_backwards then v_reference else v_target end,
    case when v_in_space then 'a.geometry &&& st_expand(box3d(s.geometry), $4)::public.geometry'
                         else 'a.geometry && st_expand(s.geometry, $4)' end,
    case when v_in_space then 'semap.gap_3d(s.geometry, o.geometry)' else 'st_distance(s.geometry, o.geometry)' end,
    case when v_backwards then v_target else v_reference end,
    case when v_in_space then 'st_3dmaxdistance(st_points(s.geometry), st_points(o.geometry))'
                         else 'st_maxdistance(s.geometry, o.geometry)' end)
    using case when v_backwards then p_target_ids
               else coalesce(p_reference_ids, array(select instance_id from semap.instance)) end,
          case when not v_backwards then p_target_ids end, p_min_m, p_max_m, p_fully;
end $$;

-- The statement that finds the nearest $1 of the targets $2 (null: all) to each shape s (instance_id, map_id, geometry)
-- of a query: among few targets by their keys, else by boxes: a box that grows until it meets enough things gives a
-- distance that as many keep to, and whatever is as near lies in the box of that. PostGIS' own index order (<<->>) is
-- not used: its distances are not those of solids, and where rounding brings them below those of boxes the query fails.
create or replace function semap.nearest_statement(p_abstraction text, p_shapes text, p_by_key boolean) returns text
language plpgsql immutable parallel safe as $$
declare
  v_in_space      boolean := semap.dimensions_of(p_abstraction) = 3;
  v_distance      text := case when v_in_space then 'semap.gap_3d(s.geometry, c.geometry)'
                               else 'st_distance(s.geometry, c.geometry)' end;
  v_is_candidate  text := 'a.instance_id is distinct from s.instance_id'
                          ' and ($2 is null or a.instance_id in (select unnest($2)))'
                          ' and exists (select from semap.instance i'
                          '             where i.instance_id = a.instance_id and i.map_id = s.map_id)';
  v_boxed         text := format(
    'select a.instance_id, a.geometry from (select * from semap.abstraction'
    '  where type = %L and instance_id is not null and geometry %s offset 0) a where %s',
    p_abstraction, case when v_in_space then '&&& st_expand(box3d(s.geometry), %1$s)::public.geometry'
                        else '&& st_expand(s.geometry, %1$s)' end, v_is_candidate);
  -- corners are quick to compare, and no nearer than the solids
  v_bound         text := case when v_in_space then 'st_3ddistance(st_points(s.geometry), st_points(c.geometry))'
                               else v_distance end;
  v_best          text := 'select c.instance_id, ' || v_distance || ' as distance_m from (%s) c order by 2, 1 limit $1';
begin
  if p_by_key then
    return format('select s.instance_id, n.instance_id, n.distance_m, n.rank from (%s) s', p_shapes) || format(
      ' cross join lateral (select f.*, (row_number() over (order by distance_m, instance_id))::integer as rank'
      ' from (%s) f) n',
      format(v_best, format('select a.instance_id, a.geometry from semap.abstraction a'
                            ' where a.instance_id = any ($2) and a.type = %L and %s', p_abstraction, v_is_candidate)));
  end if;
  return format('select s.instance_id, n.instance_id, n.distance_m, n.rank from (%s) s', p_shapes)
    || ' cross join lateral (select coalesce(('
    || '   select e.radius_m from (select 0.1 * 1.5 ^ generate_series(0, 45) as radius_m) e'
    || '   where (select count(*) from (' || format(v_boxed, 'e.radius_m')
    || ' limit $1) few) >= $1 limit 1), 1e9) as radius_m offset 0) r'
    || ' cross join lateral (select max(distance_m) * (1 + 1e-12) + 1e-9 as reach_m from ('
    ||   replace(format(v_best, format(v_boxed, 'r.radius_m')), v_distance, v_bound) || ') f offset 0) b'
    || ' cross join lateral ('
    || '   select f.*, (row_number() over (order by distance_m, instance_id))::integer as rank from ('
    ||   format(v_best, format(v_boxed, 'b.reach_m')) || ') f) n';
end $$;

-- The p_count targets that are nearest to each reference, nearest first; of those as near as one another the ones
-- of lower ids. The abstractions are both flat, or both of space.
create or replace function semap.nearest(
  p_reference_ids bigint[], p_target_ids bigint[] default null, p_count integer default 1,
  p_abstraction text default 'Footprint', p_reference_abstraction text default null,
  p_target_abstraction text default null
) returns table (reference_id bigint, target_id bigint, distance_m double precision, rank integer)
language plpgsql stable parallel safe as $$
declare
  v_reference  text := coalesce(p_reference_abstraction, p_abstraction);
  v_target     text := coalesce(p_target_abstraction, p_abstraction);
begin
  perform semap.both_in_space(v_reference, v_target);
  return query execute semap.nearest_statement(
    v_target,
    format('select r.instance_id, o.map_id, r.geometry from semap.operands($3, $2) o'
           ' join semap.abstraction r on r.instance_id = o.instance_id and r.type = %L', v_reference),
    cardinality(p_target_ids) <= 1000)
    using p_count, p_target_ids, p_reference_ids;
end $$;

-- The p_count targets of a map that are nearest to a point, or any other shape, nearest first. A flat abstraction is
-- measured seen from above; one of space wants a point with a height.
create or replace function semap.nearest_to(
  p_point public.geometry, p_map_id integer, p_count integer default 1, p_target_ids bigint[] default null,
  p_abstraction text default 'Footprint'
) returns table (target_id bigint, distance_m double precision, rank integer)
language plpgsql stable parallel safe as $$
begin
  if semap.dimensions_of(p_abstraction) = 3 and st_zmflag(p_point) <> 2 then
    raise exception 'The point has no height, which % wants.', p_abstraction
      using errcode = 'invalid_parameter_value', hint = 'Give POINT Z (x y z), or name a flat abstraction.';
  end if;
  return query execute
    'select n.target_id, n.distance_m, n.rank from (' ||
    semap.nearest_statement(
      p_abstraction, 'select null::bigint as instance_id, $3 as map_id, $4 as geometry',
      cardinality(p_target_ids) <= 1000) ||
    ') n (reference_id, target_id, distance_m, rank)'
    using p_count, p_target_ids, p_map_id,
          case when semap.dimensions_of(p_abstraction) = 3 then p_point else st_force2d(p_point) end;
end $$;
