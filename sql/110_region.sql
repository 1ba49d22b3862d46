-- The index of all regions is a grid: each cell of a map lists the regions that reach into it and
-- the edges that pass through it. A point is compared with the one cell that it lies in.

-- What holds at a point: the stateless regions that contain it (sql/132 follows the others), and the heights [z_min,
-- z_max) around its own for which that stays so. A region holds a point if its footprint contains it (the boundary does
-- not belong to it, as in ST_Contains) and its height band [z_min, z_max) its height; a point without a height is in a
-- region whatever the band, and has no heights around its own.
create or replace function semap.regions_at(
  p_map_id integer, p_cell_m double precision,
  p_x_m double precision, p_y_m double precision, p_z_m double precision
) returns table (region_ids integer[], z_min_m double precision, z_max_m double precision)
language sql stable parallel safe as $$
  select coalesce(array_agg(region_id order by region_id) filter (
           where not stateful and (p_z_m is null or (p_z_m >= c.z_min_m and p_z_m < c.z_max_m))
             and (whole or (select st_contains(r.footprint, st_point(p_x_m, p_y_m))
                            from semap.region r where r.region_id = c.region_id))), '{}'),
         case when p_z_m is not null then
           greatest('-infinity', max(c.z_min_m) filter (where c.z_min_m <= p_z_m),
                    max(c.z_max_m) filter (where c.z_max_m <= p_z_m)) end,
         case when p_z_m is not null then
           least('infinity', min(c.z_min_m) filter (where c.z_min_m > p_z_m),
                 min(c.z_max_m) filter (where c.z_max_m > p_z_m)) end
  from semap.region_cell c
  where c.map_id = p_map_id
    and c.cell_x = floor(p_x_m / p_cell_m)::integer and c.cell_y = floor(p_y_m / p_cell_m)::integer
$$;

-- An open rectangle around a point that no edge of a region reaches into, so that a state within it needs no look at
-- the map. It starts as the point's cell; each edge cuts it on the axis on which the edge is further away. A point on
-- an edge, or within an edge's box, has none (x_min infinite). Edges of regions that ask for a probability keep a
-- distance of some standard deviations, so that the rectangle is for states that are not much less exact than this one:
-- std_m.
create or replace function semap.safe_rectangle(
  p_map_id integer, p_cell_m double precision, p_x_m double precision, p_y_m double precision, p_std_m real
) returns table (
  x_min_m double precision, x_max_m double precision, y_min_m double precision, y_max_m double precision, std_m real
)
language sql stable parallel safe as $$
  select greatest(floor(p_x_m / p_cell_m) * p_cell_m, max(x_min_m)),
         least((floor(p_x_m / p_cell_m) + 1) * p_cell_m, min(x_max_m)),
         greatest(floor(p_y_m / p_cell_m) * p_cell_m, max(y_min_m)),
         least((floor(p_y_m / p_cell_m) + 1) * p_cell_m, min(y_max_m)),
         case when max(stds) > 0 then coalesce(p_std_m, 0) * 1.25 + 0.01 else 'infinity' end::real
  from (
    select stds,
           case when dx_m <= 0 and dy_m <= 0 then 'infinity'
                when dx_m >= dy_m and x_max_m <= p_x_m then x_max_m + wide_m end as x_min_m,
           case when dx_m >= dy_m and x_min_m >= p_x_m then x_min_m - wide_m end as x_max_m,
           case when dx_m < dy_m and y_max_m <= p_y_m then y_max_m + wide_m end as y_min_m,
           case when dx_m < dy_m and y_min_m >= p_y_m then y_min_m - wide_m end as y_max_m
    from (
      select e.*, wide_m, greatest(e.x_min_m - p_x_m, p_x_m - e.x_max_m, 0) - wide_m as dx_m,
             greatest(e.y_min_m - p_y_m, p_y_m - e.y_max_m, 0) - wide_m as dy_m
      from semap.region_edge e,
           lateral (select case when e.stds = 0 then 0 else e.stds * (coalesce(p_std_m, 0) * 1.25 + 0.01) end
                    as wide_m) w
      where e.map_id = p_map_id
        and e.cell_x = floor(p_x_m / p_cell_m)::integer and e.cell_y = floor(p_y_m / p_cell_m)::integer
      offset 0) e -- the distances are computed once and not wherever they are asked
    ) cut
$$;

-- The edges of a footprint as boxes: an edge along an axis as it is, any other in pieces of at most
-- half a metre (neighbouring short edges share one), widened by a nanometre against rounding.
create or replace function semap.footprint_edges(p_footprint public.geometry)
returns table (x_min_m double precision, x_max_m double precision, y_min_m double precision, y_max_m double precision)
language sql immutable parallel safe as $$
  with edge as materialized (
    select s.path, st_startpoint(s.geom) as a, st_endpoint(s.geom) as b
    from st_dumpsegments(p_footprint) s
  ), measured as materialized (
    select path, st_x(a) as ax, st_y(a) as ay, st_x(b) as bx, st_y(b) as by,
           st_x(a) = st_x(b) or st_y(a) = st_y(b) as along_axis, st_distance(a, b) as length_m
    from edge
  ), piece as (
    select path[1:array_length(path, 1) - 1] as ring, path[array_length(path, 1)] as ordinal, along_axis, length_m,
           ax + (bx - ax) * (k - 1) / n as ax, ay + (by - ay) * (k - 1) / n as ay,
           ax + (bx - ax) * k / n as bx, ay + (by - ay) * k / n as by, length_m / n as piece_m, k
    from measured, lateral (select case when along_axis then 1 else ceil(length_m / 0.5) end::integer as n) c,
         generate_series(1, n) k
  ), bucketed as (
    select *, along_axis and length_m > 0.5 as alone,
           floor(sum(piece_m) over (partition by ring order by ordinal, k) / 0.5) as bucket
    from piece
  )
  select least(min(ax), min(bx)) - 1e-9, greatest(max(ax), max(bx)) + 1e-9,
         least(min(ay), min(by)) - 1e-9, greatest(max(ay), max(by)) + 1e-9
  from bucketed where not alone group by ring, bucket
  union all
  select least(ax, bx), greatest(ax, bx), least(ay, by), greatest(ay, by) from bucketed where alone
$$;
