-- How the surface of one solid lies to another solid: the surface is cut into parts that the other
-- surface does not pass through, so that each lies wholly inside, outside or on it, and one point of
-- each part is classified. A cut too many does no harm (it makes one more part); wherever a cut is in
-- doubt it is made, and only distances and winding numbers decide.

-- The lines in which the triangles of a solid meet the triangles of a surface, in the planes of these:
-- where one passes through, and the edges that lie within the tolerance of the plane. Lines that run
-- along the triangle or past it are left out, the others reach a little over their ends.
create or replace function semap.cut_lines(
  p_surface public.geometry, p_solid public.geometry, p_surface_nos integer[], p_solid_nos integer[],
  p_tolerance_m double precision
) returns table (triangle_no integer, line public.geometry)
language plpgsql immutable strict parallel safe rows 10000 as $$
#variable_conflict use_column
begin
  return query
  with placed as materialized (
    select f.triangle_no, l, p, q,
           ax * ux + ay * uy + az * uz as au, ax * vx + ay * vy + az * vz as av, ax * nx + ay * ny + az * nz as ad,
           bx * ux + by * uy + bz * uz as bu, bx * vx + by * vy + bz * vz as bv, bx * nx + by * ny + bz * nz as bd,
           cx * ux + cy * uy + cz * uz as cu, cx * vx + cy * vy + cz * vz as cv, cx * nx + cy * ny + cz * nz as cd
    from unnest(p_surface_nos, p_solid_nos) pair (a_no, b_no)
    join semap.triangle_planes(p_surface) f on f.triangle_no = a_no and thin_m > p_tolerance_m
    join semap.mesh_triangles(p_solid) o on o.triangle_no = b_no,
         lateral (select ax_m - ox as ax, ay_m - oy as ay, az_m - oz as az, bx_m - ox as bx, by_m - oy as by,
                         bz_m - oz as bz, cx_m - ox as cx, cy_m - oy as cy, cz_m - oz as cz) d
  ), line as (
    select triangle_no, l, p, q, au + (bu - au) * ad / (ad - bd) as au, av + (bv - av) * ad / (ad - bd) as av,
           au + (cu - au) * ad / (ad - cd) as bu, av + (cv - av) * ad / (ad - cd) as bv
    from (
      select triangle_no, l, p, q, au, av, ad, bu, bv, bd, cu, cv, cd from placed where (bd >= 0) = (cd >= 0)
      union all
      select triangle_no, l, p, q, bu, bv, bd, cu, cv, cd, au, av, ad from placed where (cd >= 0) = (ad >= 0)
      union all
      select triangle_no, l, p, q, cu, cv, cd, au, av, ad, bu, bv, bd from placed where (ad >= 0) = (bd >= 0)
    ) apex (triangle_no, l, p, q, au, av, ad, bu, bv, bd, cu, cv, cd)
    where (ad >= 0) <> (bd >= 0)
    union all
    select triangle_no, l, p, q, au, av, bu, bv from placed where greatest(abs(ad), abs(bd)) <= p_tolerance_m
    union all
    select triangle_no, l, p, q, bu, bv, cu, cv from placed where greatest(abs(bd), abs(cd)) <= p_tolerance_m
    union all
    select triangle_no, l, p, q, cu, cv, au, av from placed where greatest(abs(cd), abs(ad)) <= p_tolerance_m
  )
  select triangle_no, st_makeline(st_makepoint(au - eu, av - ev), st_makepoint(bu + eu, bv + ev))
  from line,
       lateral (select sqrt((bu - au) * (bu - au) + (bv - av) * (bv - av)) as length_m) measured,
       lateral (select (bu - au) / nullif(length_m, 0) * p_tolerance_m / 2 as eu,
                       (bv - av) / nullif(length_m, 0) * p_tolerance_m / 2 as ev) over_end
  where length_m > 0 and greatest(av, bv) > p_tolerance_m / 8
    and greatest((p - l) * av - q * (au - l),
                 (p - l) * bv - q * (bu - l)) > p_tolerance_m / 8 * sqrt((p - l) * (p - l) + q * q)
    and greatest(q * au - p * av, q * bu - p * bv) > p_tolerance_m / 8 * sqrt(p * p + q * q);
end $$;

-- One point of each part of those triangles of a surface that come near a solid (and how wide the part
-- is), and all corners of the surface, each with a triangle that it belongs to.
create or replace function semap.part_points(
  p_surface public.geometry, p_solid public.geometry, p_surface_nos integer[], p_solid_nos integer[],
  p_tolerance_m double precision
) returns table (triangle_no integer, x_m double precision, y_m double precision, z_m double precision,
                 nx double precision, ny double precision, nz double precision, width_m double precision)
language plpgsql immutable strict parallel safe rows 10000 as $$
#variable_conflict use_column
begin
  if p_surface_nos = '{}' then
    return query
    select distinct on (x, y, z) path[1], x, y, z, null::double precision, null::double precision,
           null::double precision, 0::double precision
    from st_dumppoints(semap.as_triangles(p_surface)), semap.plain_coordinates(geom) where path[3] < 4;
    return;
  end if;
  return query
  with plane as materialized (select * from semap.triangle_planes(p_surface)
  ), cut as (
    select triangle_no, st_collect(line) as lines
    from semap.cut_lines(p_surface, p_solid, p_surface_nos, p_solid_nos, p_tolerance_m) group by triangle_no
  ), part as (
    select triangle_no, st_x(middle) as u, st_y(middle) as v, sqrt(st_area(cell)) as width_m
    from (
      select f.triangle_no, l, p, q, cell.geom as cell, st_pointonsurface(cell.geom) as middle
      from cut join plane f using (triangle_no),
           lateral st_dump(st_polygonize(array[st_unaryunion(st_collect(lines, st_makeline(array[
             st_makepoint(0, 0), st_makepoint(l, 0), st_makepoint(p, q), st_makepoint(0, 0)])),
             p_tolerance_m / 8)])) cell
    ) made
    where st_y(middle) > 0 and (p - l) * st_y(middle) - q * (st_x(middle) - l) > 0
      and q * st_x(middle) - p * st_y(middle) > 0
    union all
    select triangle_no, (l + p) / 3, q / 3, sqrt(l * q / 2)
    from plane
    where thin_m > p_tolerance_m and triangle_no in (select unnest(p_surface_nos))
      and triangle_no not in (select triangle_no from cut)
  )
  select triangle_no, ox + u * ux + v * vx, oy + u * uy + v * vy, oz + u * uz + v * vz, nx, ny, nz, width_m
  from part join plane using (triangle_no)
  union all
  (select distinct on (x, y, z) triangle_no, x, y, z, null::double precision, null, null, 0::double precision
   from semap.mesh_triangles(p_surface),
        lateral (values (ax_m, ay_m, az_m), (bx_m, by_m, bz_m), (cx_m, cy_m, cz_m)) as corner (x, y, z));
end $$;

-- Points of a line or of points to compare with a solid: all vertices, and the middle between any two
-- places of a segment where it may pass through the solid's surface (its planes, edges and corners).
create or replace function semap.line_points(
  p_line public.geometry, p_solid public.geometry, p_tolerance_m double precision
) returns setof public.geometry
language sql immutable strict parallel safe rows 100 as $$
  with segment as materialized (
    select row_number() over () as number, segment.geom, a.x, a.y, a.z, b.x - a.x as dx, b.y - a.y as dy,
           b.z - a.z as dz
    from st_dumpsegments(p_line) segment, semap.plain_coordinates(st_startpoint(segment.geom)) a,
         semap.plain_coordinates(st_endpoint(segment.geom)) b
  ), near as (
    select s.number, x, y, z, dx, dy, dz, corner
    from segment s join st_dump(semap.as_triangles(p_solid)) face on st_expand(face.geom, p_tolerance_m) &&& s.geom,
         lateral (select array_agg(array[place.x - s.x, place.y - s.y, place.z - s.z] order by path) as corner
                  from st_dumppoints(face.geom) point, semap.plain_coordinates(point.geom) place) c
  ), place as (
    select number, 0::double precision as t from segment
    union select number, 1 from segment
    union
    select number, t
    from near, generate_series(1, 3) k,
         lateral (select corner[k][1] as ax, corner[k][2] as ay, corner[k][3] as az,
                  corner[k + 1][1] - corner[k][1] as ex,
                         corner[k + 1][2] - corner[k][2] as ey, corner[k + 1][3] - corner[k][3] as ez,
                         corner[2][1] - corner[1][1] as ux, corner[2][2] - corner[1][2] as uy,
                         corner[2][3] - corner[1][3] as uz,
                         corner[3][1] - corner[1][1] as vx, corner[3][2] - corner[1][2] as vy,
                         corner[3][3] - corner[1][3] as vz) e,
         lateral (select dy * ez - dz * ey as mx, dz * ex - dx * ez as my, dx * ey - dy * ex as mz,
                         uy * vz - uz * vy as nx, uz * vx - ux * vz as ny, ux * vy - uy * vx as nz offset 0) n,
         unnest(array[
           (ax * dx + ay * dy + az * dz) / nullif(dx * dx + dy * dy + dz * dz, 0),
           (mx * (ay * ez - az * ey) + my * (az * ex - ax * ez) + mz * (ax * ey - ay * ex))
             / nullif(mx * mx + my * my + mz * mz, 0),
           (ax * nx + ay * ny + az * nz) / nullif(dx * nx + dy * ny + dz * nz, 0)]) t
    where t > 0 and t < 1
  ), part as (
    select number, (t + coalesce(lead(t) over (partition by number order by t), t)) / 2 as middle from place
  )
  select st_makepoint(x + middle * dx, y + middle * dy, z + middle * dz) from part join segment using (number)
  union all
  select geom from st_dumppoints(p_line)
$$;
