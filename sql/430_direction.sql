-- Directions: what is above, below, left or right of, in front of or behind a thing.
--
-- A direction is that of an axis of a frame (REP 103: x forward, y left, z up): of the thing's own frame ('object'),
-- of the map ('map'), or as a viewer sees it ('viewer'): there x is the level line of sight from the viewer to the
-- thing, so that in front of it is towards the viewer and left of it is the viewer's left; z stays up. A viewer
-- right above or below the thing looks along its own heading.
--
-- The regions are boxes in that frame, around the thing's extents there, which are those of its hull:
-- Projection  the face of the box on that side swept outwards by the reach
-- Halfspace   all that lies beyond the plane of that face, cut off at the reach, also sideways

-- The corners of the hull of an instance, as points with heights; of one without a body the corners of its outline
-- (or its position) at its lowest and greatest height. What reaches everywhere is cut off 100 km up and down.
create or replace function semap.corners_of(p_instance_id bigint) returns public.geometry
language plpgsql stable parallel safe as $$
declare
  v_corners  public.geometry;
begin
  select st_points(geometry) into v_corners
  from semap.abstraction where instance_id = p_instance_id and type = 'BoundingHull';
  if not found then
    select st_collect(
             st_translate(st_force3d(st_points(f.geometry)), 0, 0,
                          greatest(semap.bottom_m(p_instance_id, f.z_min_m), -1e5)),
             st_translate(st_force3d(st_points(f.geometry)), 0, 0, least(semap.top_m(p_instance_id, f.z_max_m), 1e5)))
      into v_corners
    from semap.abstraction f
    where f.instance_id = p_instance_id and f.type in ('FootprintHull', 'Position2D')
    order by f.type limit 1;
  end if;
  return v_corners;
end $$;

-- The convex hull of an instance as a closed TIN; null of what is but a point.
create or replace function semap.hull_of(p_instance_id bigint) returns public.geometry
language plpgsql stable parallel safe as $$
begin
  return coalesce(
    (select geometry from semap.abstraction where instance_id = p_instance_id and type = 'BoundingHull'),
    (select semap.extruded(f.geometry, greatest(semap.bottom_m(p_instance_id, f.z_min_m), -1e5),
                           least(semap.top_m(p_instance_id, f.z_max_m), 1e5))
     from semap.abstraction f where f.instance_id = p_instance_id and f.type = 'FootprintHull'));
end $$;

-- map_T_axes: the frame in which directions around an instance are meant.
create or replace function semap.direction_axes(p_instance_id bigint, p_frame text, p_viewer semap.pose default null)
returns semap.pose
language plpgsql stable parallel safe as $$
declare
  v_centre  public.geometry;
  v_x_m     double precision;
  v_y_m     double precision;
begin
  if p_frame = 'object' then
    return (select f.pose from semap.instance i, semap.frames_in_root(array[i.frame_id]) f
            where i.instance_id = p_instance_id);
  elsif p_frame = 'map' then
    return row(0, 0, 0, 0, 0, 0, 1)::semap.pose;
  elsif p_frame is distinct from 'viewer' then
    raise exception 'There is no frame of reference %.', p_frame
      using errcode = 'invalid_parameter_value', hint = 'Use object, map or viewer.';
  elsif (p_viewer).x_m is null then
    raise exception 'Nobody is given who looks.'
      using errcode = 'invalid_parameter_value', hint = 'Give the pose of the viewer in the map.';
  end if;
  select a.geometry into v_centre from semap.abstraction a
  where a.instance_id = p_instance_id and a.type in ('Position2D', 'Position3D') order by a.type limit 1;
  v_x_m := st_x(v_centre) - (p_viewer).x_m;
  v_y_m := st_y(v_centre) - (p_viewer).y_m;
  return semap.pose_from_yaw((p_viewer).x_m, (p_viewer).y_m, 0,
                             case when v_x_m ^ 2 + v_y_m ^ 2 > 1e-12 then atan2(v_y_m, v_x_m)
                                  else semap.yaw(p_viewer) end);
end $$;

-- The box of a direction region around the extents of a thing, in the frame of these.
create or replace function semap.region_box(p_extents box3d, p_region text, p_reach_m double precision) returns box3d
language plpgsql immutable parallel safe as $$
declare
  v_side    text := substring(p_region from '^(Front|Back|Left|Right|Top|Bot)(?:Projection|Halfspace)$');
  v_beside  double precision := case when p_region like '%Halfspace' then p_reach_m else 0 end;
begin
  if v_side is null then
    raise exception 'There is no region %.', coalesce(p_region, 'null')
      using errcode = 'invalid_parameter_value',
            hint = 'Use {Front,Back,Left,Right,Top,Bot}{Projection,Halfspace}, such as TopProjection.';
  elsif p_reach_m is null or not p_reach_m > 0 or p_reach_m > 1e6 then
    raise exception 'A reach of % m.', coalesce(p_reach_m::text, 'unknown')
      using errcode = 'invalid_parameter_value', hint = 'Give one above 0 and up to 1,000,000 m.';
  end if;
  return st_3dmakebox(
    st_makepoint(
      case v_side when 'Front' then st_xmax(p_extents)
                  when 'Back' then st_xmin(p_extents) - p_reach_m else st_xmin(p_extents) - v_beside end,
      case v_side when 'Left' then st_ymax(p_extents)
                  when 'Right' then st_ymin(p_extents) - p_reach_m else st_ymin(p_extents) - v_beside end,
      case v_side when 'Top' then st_zmax(p_extents)
                  when 'Bot' then st_zmin(p_extents) - p_reach_m else st_zmin(p_extents) - v_beside end),
    st_makepoint(
      case v_side when 'Back' then st_xmin(p_extents)
                  when 'Front' then st_xmax(p_extents) + p_reach_m else st_xmax(p_extents) + v_beside end,
      case v_side when 'Right' then st_ymin(p_extents)
                  when 'Left' then st_ymax(p_extents) + p_reach_m else st_ymax(p_extents) + v_beside end,
      case v_side when 'Bot' then st_zmin(p_extents)
                  when 'Top' then st_zmax(p_extents) + p_reach_m else st_zmax(p_extents) + v_beside end));
end $$;

-- Points of the map in a frame (the inverse of semap.placed).
create or replace function semap.seen_from(p_points public.geometry, p_axes semap.pose) returns public.geometry
language plpgsql immutable parallel safe as $$
declare
  qx  double precision := p_axes.qx;
  qy  double precision := p_axes.qy;
  qz  double precision := p_axes.qz;
  qw  double precision := p_axes.qw;
begin
  return st_affine(
    st_translate(p_points, -p_axes.x_m, -p_axes.y_m, -p_axes.z_m),
    1 - 2 * (qy * qy + qz * qz), 2 * (qx * qy + qz * qw), 2 * (qx * qz - qy * qw),
    2 * (qx * qy - qz * qw), 1 - 2 * (qx * qx + qz * qz), 2 * (qy * qz + qx * qw),
    2 * (qx * qz + qy * qw), 2 * (qy * qz - qx * qw), 1 - 2 * (qx * qx + qy * qy), 0, 0, 0);
end $$;

-- A box of a frame as a closed TIN in the map.
create or replace function semap.box_in_map(p_box box3d, p_axes semap.pose) returns public.geometry
language plpgsql immutable parallel safe as $$
begin
  return semap.placed(
    semap.box_3d(st_xmin(p_box), st_ymin(p_box), st_zmin(p_box), st_xmax(p_box), st_ymax(p_box), st_zmax(p_box)),
    p_axes);
end $$;

-- One of the twelve direction regions of an instance, {Front,Back,Left,Right,Top,Bot}{Projection,Halfspace}, as a
-- closed TIN in the map; null where the instance has no shape there.
create or replace function semap.region_of(
  p_instance_id bigint, p_region text, p_reach_m double precision default 10, p_frame text default 'object',
  p_viewer semap.pose default null
) returns public.geometry
language sql stable parallel safe as $$
  select semap.box_in_map(
           semap.region_box(box3d(semap.seen_from(semap.corners_of(p_instance_id), axes)), p_region, p_reach_m), axes)
  from (select semap.direction_axes(p_instance_id, p_frame, p_viewer) as axes offset 0) a
$$;

-- The region in which a thing lies in a direction. The axes of a viewer point away from who looks, and in front of a
-- thing is on the viewer's side of it.
create or replace function semap.region_named(p_direction text, p_kind text, p_frame text) returns text
language plpgsql immutable parallel safe as $$
declare
  v_side  text := case p_direction
    when 'above' then 'Top' when 'below' then 'Bot' when 'left_of' then 'Left' when 'right_of' then 'Right'
    when 'in_front_of' then case when p_frame = 'viewer' then 'Back' else 'Front' end
    when 'behind' then case when p_frame = 'viewer' then 'Front' else 'Back' end end;
begin
  if v_side is null then
    raise exception 'There is no direction %.', coalesce(p_direction, 'null')
      using errcode = 'invalid_parameter_value', hint = 'Use above, below, left_of, right_of, in_front_of or behind.';
  elsif p_kind is null or p_kind not in ('projection', 'halfspace') then
    raise exception 'There is no kind % of region.', coalesce(p_kind, 'null')
      using errcode = 'invalid_parameter_value', hint = 'Use projection or halfspace.';
  end if;
  return v_side || initcap(p_kind);
end $$;

-- Ids of what has its box, by the hull or without one by the outline or the position, within a shape's box.
create or replace function semap.boxed_by(p_shape public.geometry) returns table (instance_id bigint)
language sql stable parallel safe rows 10 as $$
  select a.instance_id from semap.abstraction a
  where a.type = 'BoundingHull' and a.instance_id is not null and a.geometry &&& p_shape
  union all
  select a.instance_id from semap.abstraction a
  where a.type = 'FootprintHull' and a.instance_id is not null and a.geometry && p_shape
    and not exists (select from semap.abstraction h where h.instance_id = a.instance_id and h.type = 'BoundingHull')
  union all
  select a.instance_id from semap.abstraction a
  where a.type = 'Position2D' and a.instance_id is not null and a.geometry && p_shape
    and not exists (select from semap.abstraction h where h.instance_id = a.instance_id
                                                      and h.type in ('BoundingHull', 'FootprintHull'))
$$;

-- Whether the convex hull of corners surely meets the inside of a box whose extents it shares: one of them is inside,
-- or it spans the box along one axis only, or it is itself a box along the axes; null where that is not sure.
create or replace function semap.surely_meets(p_corners public.geometry, p_extents box3d, p_box box3d) returns boolean
language plpgsql immutable parallel safe as $$
declare
  v_is_wide_x  boolean := st_xmax(p_extents) - st_xmin(p_extents) > 1e-9;
  v_is_wide_y  boolean := st_ymax(p_extents) - st_ymin(p_extents) > 1e-9;
  v_is_wide_z  boolean := st_zmax(p_extents) - st_zmin(p_extents) > 1e-9;
begin
  if (st_xmin(p_extents) >= st_xmin(p_box) and st_xmax(p_extents) <= st_xmax(p_box))::integer
     + (st_ymin(p_extents) >= st_ymin(p_box) and st_ymax(p_extents) <= st_ymax(p_box))::integer
     + (st_zmin(p_extents) >= st_zmin(p_box) and st_zmax(p_extents) <= st_zmax(p_box))::integer >= 2 then
    return true;
  end if;
  return nullif(
    (select bool_or(x between st_xmin(p_box) + 1e-6 and st_xmax(p_box) - 1e-6
                    and y between st_ymin(p_box) + 1e-6 and st_ymax(p_box) - 1e-6
                    and z between st_zmin(p_box) + 1e-6 and st_zmax(p_box) - 1e-6)
            -- each corner is one of the eight of its extents, and all of these are there
            or bool_and(least(x - st_xmin(p_extents), st_xmax(p_extents) - x) < 1e-9
                        and least(y - st_ymin(p_extents), st_ymax(p_extents) - y) < 1e-9
                        and least(z - st_zmin(p_extents), st_zmax(p_extents) - z) < 1e-9)
               and count(distinct (v_is_wide_x and st_xmax(p_extents) - x < 1e-9,
                                   v_is_wide_y and st_ymax(p_extents) - y < 1e-9,
                                   v_is_wide_z and st_zmax(p_extents) - z < 1e-9))
                   = (1 + v_is_wide_x::integer) * (1 + v_is_wide_y::integer) * (1 + v_is_wide_z::integer)
     from (select st_x(geom) as x, st_y(geom) as y, st_z(geom) as z from st_dumppoints(p_corners)) corner), false);
end $$;

-- Whether a thing lies in a region, a box of a frame: wholly (strict), or with some of it (relaxed; to touch it from
-- outside is not enough), within 1e-6 m. Exact for the thing's convex hull: its extents decide almost always, and
-- where they do not the hull is intersected with the region.
create or replace function semap.lies_in_region(
  p_instance_id bigint, p_corners public.geometry, p_region box3d, p_axes semap.pose, p_strict boolean
) returns boolean
language plpgsql stable parallel safe as $$
declare
  v_points  public.geometry := semap.seen_from(p_corners, p_axes);
  v_thing   box3d := box3d(v_points);
  v_inner   box3d;
  v_region  public.geometry;
  v_hull    public.geometry;
begin
  if st_xmin(v_thing) >= st_xmin(p_region) - 1e-6 and st_xmax(v_thing) <= st_xmax(p_region) + 1e-6
     and st_ymin(v_thing) >= st_ymin(p_region) - 1e-6 and st_ymax(v_thing) <= st_ymax(p_region) + 1e-6
     and st_zmin(v_thing) >= st_zmin(p_region) - 1e-6 and st_zmax(v_thing) <= st_zmax(p_region) + 1e-6 then
    return true;
  elsif p_strict
     or st_xmax(v_thing) <= st_xmin(p_region) + 1e-6 or st_xmin(v_thing) >= st_xmax(p_region) - 1e-6
     or st_ymax(v_thing) <= st_ymin(p_region) + 1e-6 or st_ymin(v_thing) >= st_ymax(p_region) - 1e-6
     or st_zmax(v_thing) <= st_zmin(p_region) + 1e-6 or st_zmin(v_thing) >= st_zmax(p_region) - 1e-6 then
    return false;
  elsif semap.surely_meets(v_points, v_thing, p_region) then
    return true;
  end if;
  -- a little smaller, so that what touches the region from outside does not count
  v_inner := st_3dmakebox(
    st_makepoint(st_xmin(p_region) + least(2e-6, (st_xmax(p_region) - st_xmin(p_region)) / 4),
                 st_ymin(p_region) + least(2e-6, (st_ymax(p_region) - st_ymin(p_region)) / 4),
                 st_zmin(p_region) + least(2e-6, (st_zmax(p_region) - st_zmin(p_region)) / 4)),
    st_makepoint(st_xmax(p_region) - least(2e-6, (st_xmax(p_region) - st_xmin(p_region)) / 4),
                 st_ymax(p_region) - least(2e-6, (st_ymax(p_region) - st_ymin(p_region)) / 4),
                 st_zmax(p_region) - least(2e-6, (st_zmax(p_region) - st_zmin(p_region)) / 4)));
  v_region := semap.box_in_map(v_inner, p_axes);
  v_hull := semap.hull_of(p_instance_id);
  -- the first is quick and right where it says yes
  return v_hull is null or st_3ddwithin(v_region, v_hull, 1e-9) or semap.intersects_3d(v_region, v_hull, 1e-9);
end $$;

-- What lies in a direction of the references (above, below, left_of, right_of, in_front_of, behind), up to the reach,
-- in the frame of the thing ('object'), the map ('map') or who looks ('viewer'). gap_m: how far beyond the face of
-- the reference it begins (negative: it reaches back beside it).
create or replace function semap.directed(
  p_direction text, p_reference_ids bigint[], p_target_ids bigint[] default null, p_frame text default 'object',
  p_viewer semap.pose default null, p_kind text default 'projection', p_strict boolean default false,
  p_reach_m double precision default 10
) returns table (reference_id bigint, target_id bigint, gap_m double precision)
language plpgsql stable parallel safe as $$
declare
  v_region         text := semap.region_named(p_direction, p_kind, p_frame);
  v_reference_ids  bigint[] := p_reference_ids;
begin
  if p_reference_ids is null and p_target_ids is not null then
    -- no region reaches farther than this from its thing: the reach along each axis, from its box in any frame
    v_reference_ids := array(
      select a.instance_id
      from semap.operands(p_target_ids, null) t
      join semap.instance i on i.map_id = t.map_id
      join semap.abstraction a on a.instance_id = i.instance_id
        and a.type in ('BoundingHull', 'FootprintHull', 'Position2D')
      where st_expand(box2d(a.geometry), 2 * p_reach_m
                                         + sqrt((st_xmax(a.geometry) - st_xmin(a.geometry)) ^ 2
                                                + (st_ymax(a.geometry) - st_ymin(a.geometry)) ^ 2
                                                + (st_zmax(a.geometry) - st_zmin(a.geometry)) ^ 2))::public.geometry
            && semap.corners_of(t.instance_id));
  end if;
  return query
    with reference as materialized (
      select o.instance_id, o.map_id, x.axes,
             box3d(semap.seen_from(semap.corners_of(o.instance_id), x.axes)) as extents
      from semap.operands(v_reference_ids, p_target_ids) o
      cross join lateral (select semap.direction_axes(o.instance_id, p_frame, p_viewer) as axes) x
    ), region as materialized (
      select r.*, semap.region_box(r.extents, v_region, p_reach_m) as box
      from reference r where r.extents is not null
    ), pair as materialized (
      select g.instance_id, g.axes, g.extents, g.box, t.instance_id as other_id,
             semap.corners_of(t.instance_id) as corners
      from region g
      cross join lateral (
        select distinct b.instance_id
        from semap.boxed_by(st_expand(box3d(semap.box_in_map(g.box, g.axes)), 1e-6)::public.geometry) b) t
      join semap.instance ti on ti.instance_id = t.instance_id and ti.map_id = g.map_id
      where t.instance_id <> g.instance_id and (p_target_ids is null or t.instance_id in (select unnest(p_target_ids)))
    )
    select p.instance_id, p.other_id,
           case substring(v_region from 1 for 3)
             when 'Fro' then st_xmin(c.box) - st_xmax(p.extents) when 'Bac' then st_xmin(p.extents) - st_xmax(c.box)
             when 'Lef' then st_ymin(c.box) - st_ymax(p.extents) when 'Rig' then st_ymin(p.extents) - st_ymax(c.box)
             when 'Top' then st_zmin(c.box) - st_zmax(p.extents) when 'Bot' then st_zmin(p.extents) - st_zmax(c.box) end
    from pair p
    cross join lateral (select box3d(semap.seen_from(p.corners, p.axes)) as box) c
    where semap.lies_in_region(p.other_id, p.corners, p.box, p.axes, p_strict);
end $$;

-- What lies above the references; see semap.directed.
create or replace function semap.above(
  p_reference_ids bigint[], p_target_ids bigint[] default null, p_frame text default 'object',
  p_viewer semap.pose default null, p_kind text default 'projection', p_strict boolean default false,
  p_reach_m double precision default 10
) returns table (reference_id bigint, target_id bigint, gap_m double precision)
language sql stable parallel safe as $$
  select * from semap.directed('above', p_reference_ids, p_target_ids, p_frame, p_viewer, p_kind, p_strict, p_reach_m)
$$;

-- What lies below the references; see semap.directed.
create or replace function semap.below(
  p_reference_ids bigint[], p_target_ids bigint[] default null, p_frame text default 'object',
  p_viewer semap.pose default null, p_kind text default 'projection', p_strict boolean default false,
  p_reach_m double precision default 10
) returns table (reference_id bigint, target_id bigint, gap_m double precision)
language sql stable parallel safe as $$
  select * from semap.directed('below', p_reference_ids, p_target_ids, p_frame, p_viewer, p_kind, p_strict, p_reach_m)
$$;

-- What lies left of the references; see semap.directed.
create or replace function semap.left_of(
  p_reference_ids bigint[], p_target_ids bigint[] default null, p_frame text default 'object',
  p_viewer semap.pose default null, p_kind text default 'projection', p_strict boolean default false,
  p_reach_m double precision default 10
) returns table (reference_id bigint, target_id bigint, gap_m double precision)
language sql stable parallel safe as $$
  select * from semap.directed('left_of', p_reference_ids, p_target_ids, p_frame, p_viewer, p_kind, p_strict, p_reach_m)
$$;

-- What lies right of the references; see semap.directed.
create or replace function semap.right_of(
  p_reference_ids bigint[], p_target_ids bigint[] default null, p_frame text default 'object',
  p_viewer semap.pose default null, p_kind text default 'projection', p_strict boolean default false,
  p_reach_m double precision default 10
) returns table (reference_id bigint, target_id bigint, gap_m double precision)
language sql stable parallel safe as $$
  select * from semap.directed('right_of', p_reference_ids, p_target_ids, p_frame, p_viewer, p_kind, p_strict,
                               p_reach_m)
$$;

-- What lies in front of the references; see semap.directed.
create or replace function semap.in_front_of(
  p_reference_ids bigint[], p_target_ids bigint[] default null, p_frame text default 'object',
  p_viewer semap.pose default null, p_kind text default 'projection', p_strict boolean default false,
  p_reach_m double precision default 10
) returns table (reference_id bigint, target_id bigint, gap_m double precision)
language sql stable parallel safe as $$
  select * from semap.directed('in_front_of', p_reference_ids, p_target_ids, p_frame, p_viewer, p_kind, p_strict,
                               p_reach_m)
$$;

-- What lies behind the references; see semap.directed.
create or replace function semap.behind(
  p_reference_ids bigint[], p_target_ids bigint[] default null, p_frame text default 'object',
  p_viewer semap.pose default null, p_kind text default 'projection', p_strict boolean default false,
  p_reach_m double precision default 10
) returns table (reference_id bigint, target_id bigint, gap_m double precision)
language sql stable parallel safe as $$
  select * from semap.directed('behind', p_reference_ids, p_target_ids, p_frame, p_viewer, p_kind, p_strict, p_reach_m)
$$;
