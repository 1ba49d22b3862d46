-- Meshes as solids: their triangles, and what follows from all of them by a sum. A solid is a closed
-- surface wound outwards (TIN Z, or POLYHEDRALSURFACE Z): it may be concave, have several parts, parts
-- that overlap, and cavities, which are wound inwards. A mesh that is not quite closed is taken as it
-- is: what its winding number (van Oosterom and Strackee 1983; Jacobson 2013) calls inside is inside.

-- The coordinates [m] of a point, zero for what is less than a femtometre: products of such remains of
-- rounding would underflow, which PostgreSQL takes for an error.
create or replace function semap.plain_coordinates(p_point public.geometry)
returns table (x double precision, y double precision, z double precision)
language sql immutable parallel safe rows 1 as $$
  select case when abs(x) < 1e-15 then 0 else x end, case when abs(y) < 1e-15 then 0 else y end,
         case when abs(z) < 1e-15 then 0 else z end
  from (select st_x(p_point) as x, st_y(p_point) as y, coalesce(st_z(p_point), 0) as z) stored
$$;

-- A geometry with its axes x y z named y z x, once or twice: the same shape seen along x (1) or y (2).
create or replace function semap.axes_turned(p_geometry public.geometry, p_times integer) returns public.geometry
language sql immutable strict parallel safe as $$
  select case p_times when 1 then st_affine(p_geometry, 0, 1, 0, 0, 0, 1, 1, 0, 0, 0, 0, 0)
                      when 2 then st_affine(p_geometry, 0, 0, 1, 1, 0, 0, 0, 1, 0, 0, 0, 0)
                      else p_geometry end
$$;

-- The faces of anything as triangles, as a collection of polygons Z: planar faces with more corners are
-- cut along their diagonals, as seen along the axis that they face most; the winding is kept.
create or replace function semap.triangulated(p_geometry public.geometry) returns public.geometry
language sql immutable strict parallel safe as $$
  select st_collect(piece order by f.path, t.path)
  from st_dump(st_force3d(p_geometry)) f,
       lateral (
         select sum((ay - by) * (az + bz)) as nx, sum((az - bz) * (ax + bx)) as ny, sum((ax - bx) * (ay + by)) as nz
         from (select st_x(geom) as ax, st_y(geom) as ay, st_z(geom) as az, lead(st_x(geom)) over w as bx,
                      lead(st_y(geom)) over w as by, lead(st_z(geom)) over w as bz
               from st_dumppoints(st_exteriorring(f.geom)) window w as (order by path)) edge
       ) newell,
       lateral (select case when abs(nz) >= abs(nx) and abs(nz) >= abs(ny) then 0 when abs(nx) >= abs(ny) then 1
                            else 2 end as axis,
                       case when abs(nz) >= abs(nx) and abs(nz) >= abs(ny) then nz when abs(nx) >= abs(ny) then nx
                            else ny end > 0 as up) a,
       lateral (select st_npoints(f.geom) = 4 as is_triangle) s,
       lateral st_dump(case when is_triangle then f.geom
                            else st_triangulatepolygon(semap.axes_turned(f.geom, axis)) end) t,
       lateral (select case when is_triangle then t.geom
                            else semap.axes_turned(case when up then st_forcepolygonccw(t.geom)
                                                        else st_forcepolygoncw(t.geom) end, 3 - axis) end as piece) r
  where geometrytype(f.geom) in ('POLYGON', 'TRIANGLE') and not st_isempty(f.geom)
$$;

-- A mesh whose faces are triangles: a TIN as it is, anything else triangulated.
create or replace function semap.as_triangles(p_mesh public.geometry) returns public.geometry
language sql immutable strict parallel safe as $$
  select case when geometrytype(p_mesh) = 'TIN' then p_mesh else semap.triangulated(p_mesh) end
$$;

-- Points and lines as triangles without area, so that they can be measured as meshes are; a mesh as it is.
create or replace function semap.as_mesh(p_geometry public.geometry) returns public.geometry
language sql immutable strict parallel safe as $$
  select case when st_dimension(p_geometry) >= 2 then p_geometry else (
    select st_collect(st_makepolygon(st_makeline(array[a, b, a, a])))
    from (select st_startpoint(geom) as a, st_endpoint(geom) as b from st_dumpsegments(st_force3d(p_geometry))
          union all
          select geom, geom from st_dump(st_force3d(p_geometry)) where geometrytype(geom) = 'POINT') segment) end
$$;

-- The triangles of a mesh in the order of its faces, corners [m]; a planar face with
-- more corners is cut into triangles, and what has no area (points, lines) has none.
create or replace function semap.mesh_triangles(p_mesh public.geometry)
returns table (triangle_no integer, ax_m double precision, ay_m double precision, az_m double precision,
               bx_m double precision, by_m double precision, bz_m double precision,
               cx_m double precision, cy_m double precision, cz_m double precision)
language plpgsql immutable strict parallel safe rows 1000 as $$
#variable_conflict use_column
begin
  return query
  select path[1],
         min(x) filter (where path[3] = 1), min(y) filter (where path[3] = 1), min(z) filter (where path[3] = 1),
         min(x) filter (where path[3] = 2), min(y) filter (where path[3] = 2), min(z) filter (where path[3] = 2),
         min(x) filter (where path[3] = 3), min(y) filter (where path[3] = 3), min(z) filter (where path[3] = 3)
  from st_dumppoints(semap.as_triangles(p_mesh)), semap.plain_coordinates(geom)
  group by path[1];
end $$;

-- The winding number of a mesh around a point: 1 inside, 0 outside, between them on the boundary (half
-- on a face); the sum of the solid angles of all triangles over 4 pi.
create or replace function semap.winding_3d(p_mesh public.geometry, p_point public.geometry)
returns double precision
language sql immutable strict parallel safe as $$
  select coalesce(sum(atan2(
           ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx),
           a * b * c + (ax * bx + ay * by + az * bz) * c + (bx * cx + by * cy + bz * cz) * a
                     + (cx * ax + cy * ay + cz * az) * b)) / (2 * pi()), 0)
  from semap.plain_coordinates(p_point) p,
       semap.mesh_triangles(p_mesh) t,
       lateral (select ax_m - x as ax, ay_m - y as ay, az_m - z as az,
                       bx_m - x as bx, by_m - y as by, bz_m - z as bz,
                       cx_m - x as cx, cy_m - y as cy, cz_m - z as cz offset 0) d,
       lateral (select sqrt(ax * ax + ay * ay + az * az) as a, sqrt(bx * bx + by * by + bz * bz) as b,
                       sqrt(cx * cx + cy * cy + cz * cz) as c) l
$$;

-- The volume of a solid [m3], exact up to rounding: the signed tetrahedra between its triangles and one
-- of its corners; negative if it is wound inwards, and without meaning if it is not closed.
create or replace function semap.volume_3d(p_mesh public.geometry) returns double precision
language sql immutable strict parallel safe as $$
  select coalesce(sum(  (ax_m - x) * ((by_m - y) * (cz_m - z) - (bz_m - z) * (cy_m - y))
                      + (ay_m - y) * ((bz_m - z) * (cx_m - x) - (bx_m - x) * (cz_m - z))
                      + (az_m - z) * ((bx_m - x) * (cy_m - y) - (by_m - y) * (cx_m - x))) / 6, 0)
  -- computed once (tests/operators/test_operator_plan)
  from (select st_xmin(p_mesh) as x, st_ymin(p_mesh) as y, st_zmin(p_mesh) as z offset 0) corner,
       semap.mesh_triangles(p_mesh)
$$;

-- The area of a surface [m2], exact up to rounding.
create or replace function semap.area_3d(p_mesh public.geometry) returns double precision
language sql immutable strict parallel safe as $$
  select coalesce(sum(sqrt(  ((by_m - ay_m) * (cz_m - az_m) - (bz_m - az_m) * (cy_m - ay_m)) ^ 2
                           + ((bz_m - az_m) * (cx_m - ax_m) - (bx_m - ax_m) * (cz_m - az_m)) ^ 2
                           + ((bx_m - ax_m) * (cy_m - ay_m) - (by_m - ay_m) * (cx_m - ax_m)) ^ 2)) / 2, 0)
  from semap.mesh_triangles(p_mesh)
$$;

-- Whether a mesh bounds a solid: each edge is gone along as often in one direction as in the other, by
-- corners that are equal to the last bit.
create or replace function semap.is_closed_3d(p_mesh public.geometry) returns boolean
language sql immutable strict parallel safe as $$
  select exists (select from semap.mesh_triangles(p_mesh))
     and not exists (
       select from semap.mesh_triangles(p_mesh) t,
            lateral (values (ax_m, ay_m, az_m, bx_m, by_m, bz_m), (bx_m, by_m, bz_m, cx_m, cy_m, cz_m),
                            (cx_m, cy_m, cz_m, ax_m, ay_m, az_m)) as edge (ax, ay, az, bx, by, bz),
            lateral (select (ax, ay, az) < (bx, by, bz) as up) d
       group by case when up then ax else bx end, case when up then ay else by end,
                case when up then az else bz end, case when up then bx else ax end,
                case when up then by else ay end, case when up then bz else az end
       having count(*) filter (where up) <> count(*) filter (where not up))
$$;
