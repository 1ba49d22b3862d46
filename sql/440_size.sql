-- Size and shape of instances, in the map frame. Areas and outlines are those of the footprint; heights are those of
-- the box along the axes, or of the footprint's band where there is no body.

-- A prism over an area as a closed TIN, its triangles wound outwards: exact, it adds no corners to the area's own.
create or replace function semap.extruded(
  p_area public.geometry, p_z_min_m double precision, p_z_max_m double precision
) returns public.geometry
language plpgsql immutable parallel safe set search_path = public, pg_temp as $$
begin
  if not p_z_min_m < p_z_max_m then
    raise exception 'Heights from % m to % m do not rise.', p_z_min_m, p_z_max_m
      using errcode = 'invalid_parameter_value', hint = 'Give a lower z_min than z_max.';
  end if;
  return (
    with part as materialized (
      select path[1] as part_no, st_forcepolygonccw(st_force2d(geom)) as shape
      from st_dump(p_area) where st_geometrytype(geom) = 'ST_Polygon' and not st_isempty(geom)
    ), cap as (
      select st_x(st_pointn(ring, 1)) as ax, st_y(st_pointn(ring, 1)) as ay,
             st_x(st_pointn(ring, 2)) as bx, st_y(st_pointn(ring, 2)) as by,
             st_x(st_pointn(ring, 3)) as cx, st_y(st_pointn(ring, 3)) as cy
      from part, lateral st_dump(st_triangulatepolygon(shape)) t,
           lateral (select st_exteriorring(st_forcepolygonccw(t.geom)) as ring) r
    ), edge as (
      select * from (
        select st_x(geom) as ax, st_y(geom) as ay, lead(st_x(geom)) over w as bx, lead(st_y(geom)) over w as by
        from part, lateral st_dumppoints(shape)
        window w as (partition by part_no, path[1] order by path[2])
      ) e where bx is not null
    ), face as (
      select format('((%s %s %s,%s %s %s,%s %s %s,%1$s %2$s %3$s))', ax, ay, az, bx, by, bz, cx, cy, cz) as corners
      from (
        select ax, ay, p_z_max_m as az, bx, by, p_z_max_m as bz, cx, cy, p_z_max_m as cz from cap
        union all
        select ax, ay, p_z_min_m, cx, cy, p_z_min_m, bx, by, p_z_min_m from cap
        union all
        select ax, ay, p_z_min_m, bx, by, p_z_min_m, bx, by, p_z_max_m from edge
        union all
        select ax, ay, p_z_min_m, bx, by, p_z_max_m, ax, ay, p_z_max_m from edge
      ) f
    )
    select st_geomfromewkt('TIN Z (' || string_agg(corners, ',') || ')') from face);
end $$;

-- Area, perimeter, sides of the smallest box, extents along the map's axes, height and volume of these instances.
-- The volume is that of the body where it is closed (exact; parts that overlap count twice), else of its convex
-- hull; without a body that of the footprint between its heights. volume_of says which: 'body', 'hull' or 'prism'.
create or replace function semap.sizes(p_ids bigint[])
returns table (
  instance_id bigint, area_m2 double precision, perimeter_m double precision, length_m double precision,
  width_m double precision, extent_x_m double precision, extent_y_m double precision, height_m double precision,
  volume_m3 double precision, volume_of text
)
language sql stable parallel safe set search_path = public, pg_temp as $$
  with body as materialized (
    select g.description_id, bool_and(semap.is_closed_3d(g.body)) as is_closed,
           abs(sum(semap.volume_3d(g.body))) as volume_m3
    from semap.geometry g
    where g.type in ('TRIANGLEMESH3D', 'POLYGONMESH3D')
      and g.description_id in (select relative_description_id from semap.instance where instance_id = any (p_ids))
    group by g.description_id
  )
  select i.instance_id, st_area(f.geometry), st_perimeter(f.geometry),
         greatest(side.first_m, side.second_m), least(side.first_m, side.second_m),
         st_xmax(flat.geometry) - st_xmin(flat.geometry), st_ymax(flat.geometry) - st_ymin(flat.geometry),
         tall.height_m,
         case v.volume_of when 'body' then b.volume_m3 when 'hull' then abs(semap.volume_3d(h.geometry))
                          when 'prism' then st_area(f.geometry) * tall.height_m end,
         v.volume_of
  from semap.instance i
  left join semap.abstraction f on f.instance_id = i.instance_id and f.type = 'Footprint'
  left join semap.abstraction flat on flat.instance_id = i.instance_id and flat.type = 'AxisAligned2D'
  left join semap.abstraction small on small.instance_id = i.instance_id and small.type = 'FootprintBox'
  left join semap.abstraction box on box.instance_id = i.instance_id and box.type = 'AxisAligned3D'
  left join semap.abstraction h on h.instance_id = i.instance_id and h.type = 'BoundingHull'
  left join body b on b.description_id = i.relative_description_id
  left join lateral (
    select st_distance(st_pointn(ring, 1), st_pointn(ring, 2)) as first_m,
           st_distance(st_pointn(ring, 2), st_pointn(ring, 3)) as second_m
    from (select st_exteriorring(small.geometry) as ring) r) side on true
  cross join lateral (
    select coalesce(st_zmax(box.geometry) - st_zmin(box.geometry), f.z_max_m - f.z_min_m) as height_m) tall
  cross join lateral (
    select case when b.is_closed then 'body'
                when b.description_id is null and f.geometry is not null and tall.height_m is not null then 'prism'
                when h.geometry is not null then 'hull' end as volume_of) v
  where i.instance_id = any (p_ids)
$$;

-- One measure of these instances: 'area' [m2], 'volume' [m3] or 'height' [m]; those without it are left out.
create or replace function semap.measured(p_ids bigint[], p_measure text)
returns table (instance_id bigint, measure double precision)
language plpgsql stable parallel safe set search_path = public, pg_temp as $$
begin
  case p_measure
    when 'area' then
      return query select a.instance_id, st_area(a.geometry) from semap.abstraction a
                   where a.instance_id = any (p_ids) and a.type = 'Footprint';
    when 'height' then
      return query select f.instance_id, coalesce(st_zmax(b.geometry) - st_zmin(b.geometry), f.z_max_m - f.z_min_m)
                   from semap.abstraction f
                   left join semap.abstraction b on b.instance_id = f.instance_id and b.type = 'AxisAligned3D'
                   where f.instance_id = any (p_ids) and f.type = 'Footprint'
                     and coalesce(st_zmax(b.geometry) - st_zmin(b.geometry), f.z_max_m - f.z_min_m) is not null;
    when 'volume' then
      return query select s.instance_id, s.volume_m3 from semap.sizes(p_ids) s where s.volume_m3 is not null;
    else
      raise exception 'There is no measure %.', p_measure
        using errcode = 'invalid_parameter_value', hint = 'Use area, volume or height.';
  end case;
end $$;

-- The instances given, or where none are given all on the maps of the others.
create or replace function semap.or_all_beside(p_ids bigint[], p_beside_ids bigint[]) returns bigint[]
language sql stable parallel safe as $$
  select coalesce(p_ids, array(
    select instance_id from semap.instance
    where map_id in (select map_id from semap.instance where instance_id = any (p_beside_ids))))
$$;

-- Pairs of instances of one map, the target with more than p_factor times the reference's area, volume or height.
create or replace function semap.larger_than(
  p_reference_ids bigint[], p_target_ids bigint[] default null, p_measure text default 'area',
  p_factor double precision default 1
) returns table (
  reference_id bigint, target_id bigint, reference_measure double precision, target_measure double precision
)
language sql stable parallel safe set search_path = public, pg_temp as $$
  with target as materialized (
    select m.instance_id, m.measure, i.map_id
    from semap.measured(semap.or_all_beside(p_target_ids, p_reference_ids), p_measure) m
    join semap.instance i using (instance_id))
  select r.instance_id, t.instance_id, r.measure, t.measure
  from semap.measured(p_reference_ids, p_measure) r join semap.instance i using (instance_id)
  join target t on t.map_id = i.map_id and t.instance_id <> r.instance_id and t.measure > p_factor * r.measure
$$;

-- Pairs of instances of one map, the target with less than p_factor times the reference's area, volume or height.
create or replace function semap.smaller_than(
  p_reference_ids bigint[], p_target_ids bigint[] default null, p_measure text default 'area',
  p_factor double precision default 1
) returns table (
  reference_id bigint, target_id bigint, reference_measure double precision, target_measure double precision
)
language sql stable parallel safe set search_path = public, pg_temp as $$
  with target as materialized (
    select m.instance_id, m.measure, i.map_id
    from semap.measured(semap.or_all_beside(p_target_ids, p_reference_ids), p_measure) m
    join semap.instance i using (instance_id))
  select r.instance_id, t.instance_id, r.measure, t.measure
  from semap.measured(p_reference_ids, p_measure) r join semap.instance i using (instance_id)
  join target t on t.map_id = i.map_id and t.instance_id <> r.instance_id and t.measure < p_factor * r.measure
$$;

-- The footprints grown by a distance [m], for a robot of that radius; below zero they shrink, and what is left of
-- nothing is left out. p_join is the shape of corners: 'round' (to 1/8 of a quarter circle), 'mitre' or 'bevel'.
create or replace function semap.padded(p_ids bigint[], p_distance_m double precision, p_join text default 'round')
returns table (instance_id bigint, footprint public.geometry)
language plpgsql stable parallel safe set search_path = public, pg_temp as $$
begin
  if p_join not in ('round', 'mitre', 'bevel') then
    raise exception 'There is no join %.', p_join
      using errcode = 'invalid_parameter_value', hint = 'Use round, mitre or bevel.';
  elsif not abs(p_distance_m) <= 1e6 then
    raise exception 'A footprint is not grown by % m.', p_distance_m
      using errcode = 'invalid_parameter_value', hint = 'Give a distance of at most a thousand kilometres.';
  end if;
  return query
    select * from (
      select a.instance_id, semap.area_only(st_buffer(a.geometry, p_distance_m, 'join=' || p_join)) as grown
      from semap.abstraction a where a.instance_id = any (p_ids) and a.type = 'Footprint') g
    where g.grown is not null;
end $$;

-- The area that the footprints of these instances cover together; null without one.
create or replace function semap.united(p_ids bigint[]) returns public.geometry
language sql stable parallel safe set search_path = public, pg_temp as $$
  select semap.area_only(st_union(geometry)) from semap.abstraction
  where instance_id = any (p_ids) and type = 'Footprint'
$$;

-- The area that lies in the footprint of each of these instances; null where there is none, or one has no footprint.
create or replace function semap.intersected(p_ids bigint[]) returns public.geometry
language plpgsql stable parallel safe set search_path = public, pg_temp as $$
declare
  v_common  public.geometry;
  v_shape   public.geometry;
  v_first   boolean := true;
begin
  for v_shape in
    select a.geometry from unnest(p_ids) id
    left join semap.abstraction a on a.instance_id = id and a.type = 'Footprint' order by id
  loop
    v_common := case when v_first then v_shape else semap.area_only(st_intersection(v_common, v_shape)) end;
    v_first := false;
    exit when v_common is null;
  end loop;
  return v_common;
end $$;

-- What is left of the footprints of the references without those of the targets, heights aside; nothing left, no row.
create or replace function semap.subtracted(p_reference_ids bigint[], p_target_ids bigint[])
returns table (reference_id bigint, footprint public.geometry)
language sql stable parallel safe set search_path = public, pg_temp as $$
  select * from (
    select r.instance_id, case when taken.shape is null then r.geometry
                               else semap.area_only(st_difference(r.geometry, taken.shape)) end as rest
    from semap.abstraction r
    join semap.instance ri using (instance_id)
    cross join lateral (
      select st_union(t.geometry) as shape
      from semap.abstraction t join semap.instance ti using (instance_id)
      where t.type = 'Footprint' and t.instance_id = any (p_target_ids) and t.instance_id <> r.instance_id
        and ti.map_id = ri.map_id and t.geometry && r.geometry) taken
    where r.type = 'Footprint' and r.instance_id = any (p_reference_ids)) left_over
  where rest is not null
$$;
