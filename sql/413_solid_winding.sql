-- Winding numbers of many points at once, by the triangles that a ray from each point passes through.

-- Where upward rays from points, numbered 1, 2, ..., leave a mesh (turn 1) or enter it (-1); doubtful
-- where one comes too near an edge to be sure. The mesh is put on a grid as seen along the ray, whose
-- slant has no simple relation to walls and floors; sheared along it, the rays are upright.
create or replace function semap.ray_hits(
  p_mesh public.geometry, p_x_m double precision[], p_y_m double precision[], p_z_m double precision[]
) returns table (point_no integer, turn double precision, doubtful boolean)
language plpgsql immutable strict parallel safe rows 1000 as $$
#variable_conflict use_column
begin
  return query
  with sheared as (
    select ax_m - 0.2137521 * az_m as ax, ay_m - 0.3719053 * az_m as ay, az_m as az,
           bx_m - 0.2137521 * bz_m as bx, by_m - 0.3719053 * bz_m as by, bz_m as bz,
           cx_m - 0.2137521 * cz_m as cx, cy_m - 0.3719053 * cz_m as cy, cz_m as cz
    from semap.mesh_triangles(p_mesh)
  ), flat as materialized (
    select *, least(ax, bx, cx) as x0, greatest(ax, bx, cx) as x1, least(ay, by, cy) as y0,
           greatest(ay, by, cy) as y1, (bx - ax) * (cy - ay) - (by - ay) * (cx - ax) as area
    from sheared
  ), grid as materialized (
    -- as many cells as triangles, but no triangle in more than a few of them on the average
    select x0 - near_m as x0, y0 - near_m as y0, near_m,
           (x1 - x0 + 2 * near_m) / n as dx, (y1 - y0 + 2 * near_m) / n as dy
    from (select min(x0) as x0, max(x1) as x1, min(y0) as y0, max(y1) as y1,
                 1e-11 * (1 + max(greatest(abs(x0), abs(x1), abs(y0), abs(y1)))) as near_m,
                 greatest(1, least(256, sqrt(count(*)), sqrt(4 * count(*) * (max(x1) - min(x0)) * (max(y1) - min(y0))
                   / nullif(sum((x1 - x0) * (y1 - y0)), 0))))::integer as n from flat) whole
  ), celled as (
    select i, j, flat.*, near_m
    from flat cross join grid,
         generate_series(floor((flat.x0 - near_m - grid.x0) / dx)::integer,
                         floor((flat.x1 + near_m - grid.x0) / dx)::integer) i,
         generate_series(floor((flat.y0 - near_m - grid.y0) / dy)::integer,
                         floor((flat.y1 + near_m - grid.y0) / dy)::integer) j
  ), point as (
    select number::integer as number, x, y, z, floor((x - x0) / dx)::integer as i, floor((y - y0) / dy)::integer as j
    from (select number, x - 0.2137521 * z as x, y - 0.3719053 * z as y, z
          from unnest(p_x_m, p_y_m, p_z_m) with ordinality given (x, y, z, number)) slanted cross join grid
    where x between x0 and x0 + dx * 256 and y between y0 and y0 + dy * 256
  ), met as (
    select number, z, near_m, sign(area) as turn, (wa * az + wb * bz + wc * cz) / nullif(area, 0) as hit_z,
           least(sign(area) * wa / nullif(abs(cx - bx) + abs(cy - by), 0),
                 sign(area) * wb / nullif(abs(ax - cx) + abs(ay - cy), 0),
                 sign(area) * wc / nullif(abs(bx - ax) + abs(by - ay), 0)) as within_m
    from point join celled using (i, j), lateral (
      select (cx - bx) * (y - by) - (cy - by) * (x - bx) as wa, (ax - cx) * (y - cy) - (ay - cy) * (x - cx) as wb,
             (bx - ax) * (y - ay) - (by - ay) * (x - ax) as wc) w
    where x between x0 - near_m and x1 + near_m and y between y0 - near_m and y1 + near_m
  )
  select number, turn, abs(within_m) <= near_m or hit_z is null
  from met where within_m >= -near_m and (hit_z is null or hit_z > z or within_m <= near_m);
end $$;

-- The winding number of a mesh around each of the points 1, 2, ...: from rays where the mesh is closed
-- and the ray is in no doubt, or else the sum of the solid angles of all triangles.
create or replace function semap.windings_3d(
  p_mesh public.geometry, p_x_m double precision[], p_y_m double precision[], p_z_m double precision[],
  p_closed boolean
) returns table (point_no integer, winding double precision)
language plpgsql immutable strict parallel safe rows 1000 as $$
#variable_conflict use_column
begin
  return query
  with hit as (
    select h.point_no, sum(turn) as turns, bool_or(doubtful) as doubtful
    from semap.ray_hits(p_mesh, p_x_m, p_y_m, p_z_m) h
    where p_closed
    group by h.point_no
  )
  select number::integer,
         case when p_closed and not coalesce(doubtful, false) then coalesce(turns, 0)
              else semap.winding_3d(p_mesh, st_makepoint(x, y, z)) end
  from unnest(p_x_m, p_y_m, p_z_m) with ordinality given (x, y, z, number)
  left join hit on hit.point_no = number;
end $$;
