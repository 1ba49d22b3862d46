-- Containment and contact of solids. What is exact: an answer is wrong by no more than the tolerance,
-- whatever the shapes are. Where something reaches out by less than the tolerance it counts as inside,
-- and what comes within the tolerance touches. The solids are closed and wound outwards.

-- Whether a point lies in a solid or within the tolerance of its boundary; exact up to the tolerance.
create or replace function semap.inside_3d(
  p_mesh public.geometry, p_point public.geometry, p_tolerance_m double precision default 1e-6
) returns boolean
language sql immutable strict parallel safe as $$
  select case when not st_expand(st_force3d(p_point), p_tolerance_m) &&& p_mesh then false
              else semap.winding_3d(p_mesh, p_point) > 0.5 or semap.surface_gap_3d(p_mesh, p_point) <= p_tolerance_m end
$$;

-- How the surface of one thing lies to a solid: one point [m] of each part, on the boundary (within the
-- tolerance), or with the solid's winding number; where the part lies on a face of the solid, whether
-- that faces the same way, or the opposite one, and how wide the part is. The arrays pair the
-- triangles that come within the tolerance of each other.
create or replace function semap.surface_parts(
  p_surface public.geometry, p_solid public.geometry, p_surface_nos integer[], p_solid_nos integer[],
  p_solid_closed boolean, p_tolerance_m double precision
) returns table (x_m double precision, y_m double precision, z_m double precision,
                 nx double precision, ny double precision, nz double precision, width_m double precision,
                 is_on boolean, faces_along boolean, faces_against boolean, winding double precision)
language plpgsql immutable strict parallel safe rows 1000 as $$
begin
  return query
  with point as materialized (
    select row_number() over () as number, p.*
    from semap.part_points(p_surface, p_solid, p_surface_nos, p_solid_nos, p_tolerance_m) p
  ), touched as materialized (
    select p.number, bool_or(p.nx * o.nx + p.ny * o.ny + p.nz * o.nz > 0.5) as along,
           bool_or(p.nx * o.nx + p.ny * o.ny + p.nz * o.nz < -0.5) as against
    from unnest(p_surface_nos, p_solid_nos) pair (a_no, b_no)
    join point p on p.triangle_no = a_no
    join semap.triangle_planes(p_solid) o on o.triangle_no = b_no,
         lateral (select p.x_m - ox as x, p.y_m - oy as y, p.z_m - oz as z) d
    where semap.triangle_gap_m(o.l, o.p, o.q, x * o.ux + y * o.uy + z * o.uz, x * o.vx + y * o.vy + z * o.vz,
                               x * o.nx + y * o.ny + z * o.nz) <= p_tolerance_m
    group by p.number
  ), free as materialized (
    select array_agg(number order by number) as numbers, array_agg(p.x_m order by number) as x_m,
           array_agg(p.y_m order by number) as y_m, array_agg(p.z_m order by number) as z_m
    from point p where number not in (select t.number from touched t)
  ), turned as (
    select numbers[w.point_no] as number, w.winding
    from free cross join semap.windings_3d(p_solid, free.x_m, free.y_m, free.z_m, p_solid_closed) w
  )
  select p.x_m, p.y_m, p.z_m, p.nx, p.ny, p.nz, p.width_m, t.number is not null,
         coalesce(t.along, false), coalesce(t.against, false), turned.winding
  from point p left join touched t using (number) left join turned using (number);
end $$;

-- The pairs of triangles of two meshes that come within a distance of each other, by their boxes, as
-- one array for each mesh.
create or replace function semap.near_pairs(
  p_a public.geometry, p_b public.geometry, p_within_m double precision, out a_nos integer[], out b_nos integer[]
)
language sql immutable strict parallel safe as $$
  select coalesce(array_agg(a_no), '{}'), coalesce(array_agg(b_no), '{}')
  from semap.near_triangles(p_a, p_b, p_within_m)
$$;

-- Whether a point is farther than the tolerance from a solid's surface, and inside or outside as wanted.
create or replace function semap.is_deep_3d(
  p_solid public.geometry, p_point public.geometry, p_inside boolean, p_tolerance_m double precision
) returns boolean
language sql immutable strict parallel safe as $$
  select case when semap.surface_gap_3d(p_solid, p_point) <= p_tolerance_m then false
              else (semap.winding_3d(p_solid, p_point) > 0.5) = p_inside end
$$;

-- Whether every point of the content lies in the container or within the tolerance of it. Exact up to the
-- tolerance for any closed container, also a concave one; the content may be a solid, an open surface,
-- a line or a point. What touches from inside is contained. False where the boxes say so, at once.
create or replace function semap.contains_3d(
  p_container public.geometry, p_content public.geometry, p_tolerance_m double precision default 1e-6
) returns boolean
language plpgsql immutable strict parallel safe as $$
declare
  v_near         record;
  v_reaches_out  boolean;
  v_behind       public.geometry[];
begin
  if not st_expand(p_container, p_tolerance_m) ~~ p_content or st_isempty(p_content) then
    return false;
  elsif st_dimension(p_content) < 2 then
    return not exists (select from semap.line_points(p_content, p_container, p_tolerance_m) point
                       where not semap.inside_3d(p_container, point, p_tolerance_m));
  end if;

  v_near := semap.near_pairs(p_content, p_container, p_tolerance_m);
  select coalesce(bool_or(not is_on and winding < 0.5), true),
         array_agg(st_makepoint(x_m - depth_m * nx, y_m - depth_m * ny, z_m - depth_m * nz))
           filter (where faces_against and not faces_along)
  into v_reaches_out, v_behind
  from semap.surface_parts(p_content, p_container, v_near.a_nos, v_near.b_nos,
                           semap.is_closed_3d(p_container), p_tolerance_m),
       unnest(array[0.3 * width_m, 0.03 * width_m, 4 * p_tolerance_m]) depth_m;
  if v_reaches_out then
    return false;
  elsif not semap.is_closed_3d(p_content) then
    return true;
  end if;
  -- the container's own surface within the content is a cavity there, and so is what all of the
  -- content's surface faces against
  return not exists (select from semap.surface_parts(p_container, p_content, v_near.b_nos, v_near.a_nos, true,
                                                     p_tolerance_m)
                     where not is_on and winding > 0.5)
     and not exists (select from unnest(v_behind) point
                     where semap.is_deep_3d(p_content, point, true, p_tolerance_m)
                       and semap.is_deep_3d(p_container, point, false, p_tolerance_m));
end $$;

-- Whether the interiors of two solids share a volume that is deeper than the tolerance; touching does
-- not count. Exact up to the tolerance. False where the boxes say so, at once.
create or replace function semap.overlaps_3d(
  p_a public.geometry, p_b public.geometry, p_tolerance_m double precision default 1e-6
) returns boolean
language plpgsql immutable strict parallel safe as $$
declare
  v_near        record;
  v_reaches_in  boolean;
  v_behind      public.geometry[];
begin
  if not p_a &&& p_b then
    return false;
  end if;
  v_near := semap.near_pairs(p_b, p_a, p_tolerance_m);
  select bool_or(not is_on and winding > 0.5),
         array_agg(st_makepoint(x_m - depth_m * nx, y_m - depth_m * ny, z_m - depth_m * nz)) filter (where faces_along)
  into v_reaches_in, v_behind
  from semap.surface_parts(p_b, p_a, v_near.a_nos, v_near.b_nos, semap.is_closed_3d(p_a), p_tolerance_m),
       unnest(array[0.3 * width_m, 0.03 * width_m, 4 * p_tolerance_m]) depth_m;
  return coalesce(v_reaches_in, false)
      or exists (select from semap.surface_parts(p_a, p_b, v_near.b_nos, v_near.a_nos, semap.is_closed_3d(p_b),
                                                 p_tolerance_m)
                 where not is_on and winding > 0.5)
      or exists (select from unnest(v_behind) point
                 where semap.is_deep_3d(p_a, point, true, p_tolerance_m)
                   and semap.is_deep_3d(p_b, point, true, p_tolerance_m));
end $$;

-- Whether two surfaces (or lines, points) come within a distance of each other; exact up to rounding.
create or replace function semap.surfaces_within_3d(
  p_a public.geometry, p_b public.geometry, p_within_m double precision
) returns boolean
language plpgsql immutable strict parallel safe as $$
declare
  v_a      public.geometry := semap.as_mesh(p_a);
  v_b      public.geometry := semap.as_mesh(p_b);
  v_near   record := semap.near_pairs(semap.as_mesh(p_a), semap.as_mesh(p_b), p_within_m);
begin
  return v_near.a_nos <> '{}'
     and coalesce(semap.corner_gap_3d(v_a, v_b, v_near.a_nos, v_near.b_nos) <= p_within_m
               or semap.edge_gap_3d(v_a, v_b, v_near.a_nos, v_near.b_nos) <= p_within_m, false);
end $$;

-- Whether a part of the surface (line, points) of something whose surface stays away from that of a
-- closed solid lies inside: one corner of each part decides.
create or replace function semap.holds_part_3d(p_solid public.geometry, p_other public.geometry) returns boolean
language plpgsql immutable strict parallel safe as $$
declare
  v_x_m  double precision[];
  v_y_m  double precision[];
  v_z_m  double precision[];
begin
  if not semap.is_closed_3d(p_solid) then
    return false;
  end if;
  select array_agg(x), array_agg(y), array_agg(z) into v_x_m, v_y_m, v_z_m
  from (select distinct x, y, z from st_dumppoints(p_other), semap.plain_coordinates(geom)
        where geom &&& p_solid) corner;
  return exists (select from semap.windings_3d(p_solid, v_x_m, v_y_m, v_z_m, true) where winding > 0.5);
end $$;

-- Whether two things share a point, or come within the tolerance of each other; closed meshes are taken
-- as solids. Exact up to the tolerance. False where the boxes say so, at once.
create or replace function semap.intersects_3d(
  p_a public.geometry, p_b public.geometry, p_tolerance_m double precision default 1e-6
) returns boolean
language sql immutable strict parallel safe as $$
  select case when not st_expand(p_a, p_tolerance_m) &&& p_b then false
              else semap.surfaces_within_3d(p_a, p_b, p_tolerance_m)
                or semap.holds_part_3d(p_a, p_b) or semap.holds_part_3d(p_b, p_a) end
$$;

-- The distance [m] to a surface from that corner of another which is nearest to the middle of its box: a
-- bound for the least distance. Infinite to what has no area.
create or replace function semap.gap_from_facing_corner_3d(p_surface public.geometry, p_other public.geometry)
returns double precision
language sql immutable strict parallel safe as $$
  select coalesce((
    select semap.surface_gap_3d(p_surface, geom)
    from (select box3d(p_surface) as bounds offset 0) whole, -- computed once (decision 0022)
         semap.plain_coordinates(st_makepoint((st_xmin(bounds) + st_xmax(bounds)) / 2,
                                              (st_ymin(bounds) + st_ymax(bounds)) / 2,
                                              (st_zmin(bounds) + st_zmax(bounds)) / 2)) middle,
         st_dumppoints(p_other), semap.plain_coordinates(geom) corner
    order by (corner.x - middle.x) ^ 2 + (corner.y - middle.y) ^ 2 + (corner.z - middle.z) ^ 2
    limit 1), 'infinity')
$$;

-- The least distance [m] between two surfaces (or lines, points); exact up to rounding.
create or replace function semap.surface_distance_3d(p_a public.geometry, p_b public.geometry)
returns double precision
language plpgsql immutable strict parallel safe as $$
declare
  v_a       public.geometry := semap.as_mesh(p_a);
  v_b       public.geometry := semap.as_mesh(p_b);
  v_a_nos   integer[];
  v_b_nos   integer[];
  v_gaps_m  double precision[];
  v_corner  double precision;
begin
  select array_agg(a_no), array_agg(b_no), array_agg(least_m) into v_a_nos, v_b_nos, v_gaps_m
  from semap.closest_triangles(
    v_a, v_b, least(semap.gap_from_facing_corner_3d(v_a, v_b), semap.gap_from_facing_corner_3d(v_b, v_a)));
  v_corner := coalesce(semap.corner_gap_3d(v_a, v_b, v_a_nos, v_b_nos), 'infinity');
  -- an edge can only be nearer where the boxes of the triangles are
  select array_agg(a_no), array_agg(b_no) into v_a_nos, v_b_nos
  from unnest(v_a_nos, v_b_nos, v_gaps_m) pair (a_no, b_no, gap_m) where gap_m < v_corner;
  return nullif(least(v_corner, semap.edge_gap_3d(v_a, v_b, v_a_nos, v_b_nos)), 'infinity');
end $$;

-- The least distance [m] between two things, closed meshes taken as solids: 0 where one is within the
-- other, or where they come within a nanometre. Exact up to rounding.
create or replace function semap.distance_3d(p_a public.geometry, p_b public.geometry) returns double precision
language sql immutable strict parallel safe as $$
  select case when semap.intersects_3d(p_a, p_b, 1e-9) then 0 else semap.surface_distance_3d(p_a, p_b) end
$$;
