-- Triangles as they lie to each other: which come near, and how near.

-- The boxes [m] of the triangles of a mesh that reach into a region, in blocks of near ones.
create or replace function semap.triangle_boxes(p_mesh public.geometry, p_region box3d)
returns table (triangle_no integer, block integer, x0 double precision, x1 double precision,
               y0 double precision, y1 double precision, z0 double precision, z1 double precision)
language plpgsql immutable strict parallel safe rows 1000 as $$
#variable_conflict use_column
begin
  return query
  with box as (
    select triangle_no, least(ax_m, bx_m, cx_m) as x0, greatest(ax_m, bx_m, cx_m) as x1,
           least(ay_m, by_m, cy_m) as y0, greatest(ay_m, by_m, cy_m) as y1,
           least(az_m, bz_m, cz_m) as z0, greatest(az_m, bz_m, cz_m) as z1
    from semap.mesh_triangles(p_mesh)
  ), reaching as (
    select *, greatest(1, round(cbrt(2 * sqrt(count(*) over ()))))::integer as slices
    from box
    where x0 <= st_xmax(p_region) and x1 >= st_xmin(p_region) and y0 <= st_ymax(p_region)
      and y1 >= st_ymin(p_region) and z0 <= st_zmax(p_region) and z1 >= st_zmin(p_region)
  ), along_x as (select *, ntile(slices) over (order by x0 + x1) as i from reaching
  ), along_y as (select *, ntile(slices) over (partition by i order by y0 + y1) as j from along_x
  ), along_z as (select *, ntile(slices) over (partition by i, j order by z0 + z1) as k from along_y)
  select triangle_no, (i * slices + j) * slices + k, x0, x1, y0, y1, z0, z1 from along_z;
end $$;

-- The pairs of triangles of two meshes whose boxes come within a distance of each other.
create or replace function semap.near_triangles(
  p_a public.geometry, p_b public.geometry, p_within_m double precision
) returns table (a_no integer, b_no integer)
language plpgsql immutable strict parallel safe rows 10000 as $$
#variable_conflict use_column
begin
  return query
  with a as materialized (select * from semap.triangle_boxes(p_a, st_expand(box3d(p_b), p_within_m))
  ), b as materialized (select * from semap.triangle_boxes(p_b, st_expand(box3d(p_a), p_within_m))
  ), a_block as materialized (
    select block, min(x0) - p_within_m as x0, max(x1) + p_within_m as x1, min(y0) - p_within_m as y0,
           max(y1) + p_within_m as y1, min(z0) - p_within_m as z0, max(z1) + p_within_m as z1
    from a group by block
  ), b_block as materialized (
    select block, min(x0) as x0, max(x1) as x1, min(y0) as y0, max(y1) as y1, min(z0) as z0, max(z1) as z1
    from b group by block
  ), met as materialized (
    select a_block.block as a_block, b_block.block as b_block
    from a_block join b_block on a_block.x0 <= b_block.x1 and a_block.x1 >= b_block.x0
      and a_block.y0 <= b_block.y1 and a_block.y1 >= b_block.y0
      and a_block.z0 <= b_block.z1 and a_block.z1 >= b_block.z0
  )
  select a.triangle_no, b.triangle_no
  from met join a on a.block = met.a_block join b on b.block = met.b_block
  where a.x0 <= b.x1 + p_within_m and a.x1 >= b.x0 - p_within_m
    and a.y0 <= b.y1 + p_within_m and a.y1 >= b.y0 - p_within_m
    and a.z0 <= b.z1 + p_within_m and a.z1 >= b.z0 - p_within_m;
end $$;

-- The pairs of triangles of two meshes between which the least distance may lie: those whose boxes come
-- as near as the nearest must, and as a distance [m] that the least does not exceed.
create or replace function semap.closest_triangles(
  p_a public.geometry, p_b public.geometry, p_most_m double precision
)
returns table (a_no integer, b_no integer, least_m double precision)
language plpgsql immutable strict parallel safe rows 100 as $$
#variable_conflict use_column
begin
  return query
  with a as materialized (select * from semap.triangle_boxes(p_a, st_expand(box3d(p_a), 1e-9))
  ), b as materialized (select * from semap.triangle_boxes(p_b, st_expand(box3d(p_b), 1e-9))
  ), a_block as materialized (
    select block, min(x0) as x0, max(x1) as x1, min(y0) as y0, max(y1) as y1, min(z0) as z0, max(z1) as z1
    from a group by block
  ), b_block as materialized (
    select block, min(x0) as x0, max(x1) as x1, min(y0) as y0, max(y1) as y1, min(z0) as z0, max(z1) as z1
    from b group by block
  ), met as materialized (
    select a.block as a_block, b.block as b_block,
           greatest(a.x0 - b.x1, b.x0 - a.x1, 0) ^ 2 + greatest(a.y0 - b.y1, b.y0 - a.y1, 0) ^ 2
             + greatest(a.z0 - b.z1, b.z0 - a.z1, 0) ^ 2 as least_m2,
           greatest(a.x1 - b.x0, b.x1 - a.x0) ^ 2 + greatest(a.y1 - b.y0, b.y1 - a.y0) ^ 2
             + greatest(a.z1 - b.z0, b.z1 - a.z0) ^ 2 as most_m2
    from a_block a cross join b_block b
  ), pair as materialized (
    select a.triangle_no as a_no, b.triangle_no as b_no,
           greatest(a.x0 - b.x1, b.x0 - a.x1, 0) ^ 2 + greatest(a.y0 - b.y1, b.y0 - a.y1, 0) ^ 2
             + greatest(a.z0 - b.z1, b.z0 - a.z1, 0) ^ 2 as least_m2,
           greatest(a.x1 - b.x0, b.x1 - a.x0) ^ 2 + greatest(a.y1 - b.y0, b.y1 - a.y0) ^ 2
             + greatest(a.z1 - b.z0, b.z1 - a.z0) ^ 2 as most_m2
    from met join a on a.block = a_block join b on b.block = b_block
    where met.least_m2 <= least(p_most_m * p_most_m * 1.000001, (select min(most_m2) from met))
  )
  select pair.a_no, pair.b_no, sqrt(least_m2) from pair
  where least_m2 <= least(p_most_m * p_most_m * 1.000001, (select min(most_m2) from pair));
end $$;

-- Each triangle in its own plane: its corners are (0, 0), (l, 0) and (p, q) [m] on the axes u and v from
-- the origin o, n is its normal outwards, and thin_m its least height; u, v, n of one without area are null.
create or replace function semap.triangle_planes(p_mesh public.geometry)
returns table (triangle_no integer, ox double precision, oy double precision, oz double precision,
               ux double precision, uy double precision, uz double precision,
               vx double precision, vy double precision, vz double precision,
               nx double precision, ny double precision, nz double precision,
               l double precision, p double precision, q double precision, thin_m double precision)
language plpgsql immutable strict parallel safe rows 1000 as $$
#variable_conflict use_column
begin
  return query
  select triangle_no, ax_m, ay_m, az_m, ux, uy, uz,
         ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux, nx, ny, nz,
         l, cx * ux + cy * uy + cz * uz, twice / nullif(l, 0),
         twice / nullif(greatest(l, sqrt(cx * cx + cy * cy + cz * cz),
                                 sqrt((cx - bx) * (cx - bx) + (cy - by) * (cy - by) + (cz - bz) * (cz - bz))), 0)
  from semap.mesh_triangles(p_mesh),
       lateral (select bx_m - ax_m as bx, by_m - ay_m as by, bz_m - az_m as bz,
                       cx_m - ax_m as cx, cy_m - ay_m as cy, cz_m - az_m as cz) side,
       lateral (select sqrt(bx * bx + by * by + bz * bz) as l, by * cz - bz * cy as mx, bz * cx - bx * cz as my,
                       bx * cy - by * cx as mz offset 0) normal,
       lateral (select nullif(greatest(sqrt(mx * mx + my * my + mz * mz), 1e-9 * l * l), 1e-9 * l * l)
                as twice offset 0) area,
       lateral (select bx / nullif(l, 0) as ux, by / nullif(l, 0) as uy, bz / nullif(l, 0) as uz,
                       mx / twice as nx, my / twice as ny, mz / twice as nz) unit;
end $$;

-- The distance [m] from a point (u, v) at the height d over the plane of a triangle to the triangle
-- (0, 0), (l, 0), (p, q): over its inside the height, beside it that to the nearest of its edges.
create or replace function semap.triangle_gap_m(
  l double precision, p double precision, q double precision, u double precision, v double precision, d double precision
) returns double precision
language sql immutable parallel safe
return sqrt(d * d + case
  when v >= 0 and q * u >= p * v and (p - l) * v >= q * (u - l) then 0
  else least(
    v * v + greatest(-u, u - l, 0) * greatest(-u, u - l, 0),
    (u - p * greatest(0, least(1, (u * p + v * q) / (p * p + q * q)))) ^ 2
      + (v - q * greatest(0, least(1, (u * p + v * q) / (p * p + q * q)))) ^ 2,
    (u - l - (p - l) * greatest(0, least(1, ((u - l) * (p - l) + v * q) / ((p - l) * (p - l) + q * q)))) ^ 2
      + (v - q * greatest(0, least(1, ((u - l) * (p - l) + v * q) / ((p - l) * (p - l) + q * q)))) ^ 2) end);

-- The distance [m] from a point to a surface; exact up to rounding.
create or replace function semap.surface_gap_3d(p_mesh public.geometry, p_point public.geometry)
returns double precision
language sql immutable strict parallel safe as $$
  select min(semap.triangle_gap_m(l, p, q, dx * ux + dy * uy + dz * uz, dx * vx + dy * vy + dz * vz,
                                  dx * nx + dy * ny + dz * nz))
  from semap.plain_coordinates(p_point), semap.triangle_planes(p_mesh),
       lateral (select x - ox as dx, y - oy as dy, z - oz as dz offset 0) d
$$;

-- The least distance [m] between two surfaces from a corner of one to a triangle of the other, among the
-- triangles that are given as pairs, or 0 where an edge goes through a triangle; exact up to rounding.
-- (ST_3DDistance of PostGIS 3.3 is wrong for points over some triangles.)
create or replace function semap.corner_gap_3d(
  p_a public.geometry, p_b public.geometry, p_a_nos integer[], p_b_nos integer[]
) returns double precision
language plpgsql immutable strict parallel safe as $$
begin
  return (
  with given as materialized (select a_no, b_no from unnest(p_a_nos, p_b_nos) pair (a_no, b_no)
  ), facing as (
    select f.*, o.ax_m, o.ay_m, o.az_m, o.bx_m, o.by_m, o.bz_m, o.cx_m, o.cy_m, o.cz_m
    from given join semap.triangle_planes(p_a) f on f.triangle_no = a_no
    join semap.mesh_triangles(p_b) o on o.triangle_no = b_no
    union all
    select f.*, o.ax_m, o.ay_m, o.az_m, o.bx_m, o.by_m, o.bz_m, o.cx_m, o.cy_m, o.cz_m
    from given join semap.triangle_planes(p_b) f on f.triangle_no = b_no
    join semap.mesh_triangles(p_a) o on o.triangle_no = a_no
  )
  select min(least(
    semap.triangle_gap_m(l, p, q, au, av, ad), semap.triangle_gap_m(l, p, q, bu, bv, bd),
    semap.triangle_gap_m(l, p, q, cu, cv, cd),
    case when (ad > 0) <> (bd > 0) then
      semap.triangle_gap_m(l, p, q, au + (bu - au) * ad / (ad - bd), av + (bv - av) * ad / (ad - bd), 0) end,
    case when (bd > 0) <> (cd > 0) then
      semap.triangle_gap_m(l, p, q, bu + (cu - bu) * bd / (bd - cd), bv + (cv - bv) * bd / (bd - cd), 0) end,
    case when (cd > 0) <> (ad > 0) then
      semap.triangle_gap_m(l, p, q, cu + (au - cu) * cd / (cd - ad), cv + (av - cv) * cd / (cd - ad), 0) end))
  from facing,
       lateral (select ax_m - ox as ax, ay_m - oy as ay, az_m - oz as az, bx_m - ox as bx, by_m - oy as by,
                       bz_m - oz as bz, cx_m - ox as cx, cy_m - oy as cy, cz_m - oz as cz) moved,
       lateral (select ax * ux + ay * uy + az * uz as au, ax * vx + ay * vy + az * vz as av,
                       ax * nx + ay * ny + az * nz as ad, bx * ux + by * uy + bz * uz as bu,
                       bx * vx + by * vy + bz * vz as bv, bx * nx + by * ny + bz * nz as bd,
                       cx * ux + cy * uy + cz * uz as cu, cx * vx + cy * vy + cz * vz as cv,
                       cx * nx + cy * ny + cz * nz as cd offset 0) turned);
end $$;

-- The least distance [m] between an edge of one surface and an edge of the other, among the triangles
-- that are given as pairs; exact up to rounding (Ericson 2005, Real-Time Collision Detection, 5.1.9).
create or replace function semap.edge_gap_3d(
  p_a public.geometry, p_b public.geometry, p_a_nos integer[], p_b_nos integer[]
) returns double precision
language plpgsql immutable strict parallel safe as $$
begin
  return (
  select min(sqrt((rx + s * dx - t * ex) ^ 2 + (ry + s * dy - t * ey) ^ 2 + (rz + s * dz - t * ez) ^ 2))
  from unnest(p_a_nos, p_b_nos) pair (a_no, b_no)
  join semap.mesh_triangles(p_a) a on a.triangle_no = a_no
  join semap.mesh_triangles(p_b) b on b.triangle_no = b_no,
       lateral (values (a.ax_m, a.ay_m, a.az_m, a.bx_m, a.by_m, a.bz_m),
                (a.bx_m, a.by_m, a.bz_m, a.cx_m, a.cy_m, a.cz_m),
                       (a.cx_m, a.cy_m, a.cz_m, a.ax_m, a.ay_m, a.az_m)) as d (fx, fy, fz, tx, ty, tz),
       lateral (values (b.ax_m, b.ay_m, b.az_m, b.bx_m, b.by_m, b.bz_m),
                (b.bx_m, b.by_m, b.bz_m, b.cx_m, b.cy_m, b.cz_m),
                       (b.cx_m, b.cy_m, b.cz_m, b.ax_m, b.ay_m, b.az_m)) as e (gx, gy, gz, hx, hy, hz),
       lateral (select tx - fx as dx, ty - fy as dy, tz - fz as dz, hx - gx as ex, hy - gy as ey, hz - gz as ez,
                       fx - gx as rx, fy - gy as ry, fz - gz as rz) side,
       lateral (select dx * dx + dy * dy + dz * dz as dd, ex * ex + ey * ey + ez * ez as ee,
                dx * ex + dy * ey + dz * ez as de,
                       dx * rx + dy * ry + dz * rz as dr, ex * rx + ey * ry + ez * rz as er offset 0) dot,
       lateral (select greatest(0, least(1, coalesce((de * er - dr * ee)
                         / nullif(greatest(dd * ee - de * de, 1e-14 * dd * ee), 1e-14 * dd * ee),
                         0))) as s0) first,
       lateral (select greatest(0, least(1, coalesce((de * s0 + er) / nullif(ee, 0), 0))) as t) second,
       lateral (select greatest(0, least(1, coalesce((de * t - dr) / nullif(dd, 0), 0))) as s) third);
end $$;
