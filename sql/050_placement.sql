-- What an instance looks like in the map follows from its description and from where its frame stands. Any pose
-- carries hulls, boxes and positions as they are; extents along the axes and projections follow from the hull, since
-- that of a moved body is the moved hull. Only the outline of a body that is tilted is cut from the body anew.
-- Instances below a root other than `map` are not placed: they have no absolute abstractions.

-- A box along the axes as a closed TIN, its triangles wound outwards.
create or replace function semap.box_3d(
  p_x_min_m double precision, p_y_min_m double precision, p_z_min_m double precision,
  p_x_max_m double precision, p_y_max_m double precision, p_z_max_m double precision
) returns public.geometry
language sql immutable parallel safe as $$
  select public.st_affine(
    'TIN Z (((0 0 0,0 1 0,1 1 0,0 0 0)),((0 0 0,1 1 0,1 0 0,0 0 0)),((0 0 1,1 0 1,1 1 1,0 0 1)),
      ((0 0 1,1 1 1,0 1 1,0 0 1)),
      ((0 0 0,1 0 0,1 0 1,0 0 0)),((0 0 0,1 0 1,0 0 1,0 0 0)),((1 0 0,1 1 0,1 1 1,1 0 0)),((1 0 0,1 1 1,1 0 1,1 0 0)),
      ((1 1 0,0 1 0,0 1 1,1 1 0)),((1 1 0,0 1 1,1 1 1,1 1 0)),((0 1 0,0 0 0,0 0 1,0 1 0)),
      ((0 1 0,0 0 1,0 1 1,0 1 0)))'::public.geometry,
    p_x_max_m - p_x_min_m, 0, 0, 0, p_y_max_m - p_y_min_m, 0, 0, 0, p_z_max_m - p_z_min_m,
    p_x_min_m, p_y_min_m, p_z_min_m)
$$;

-- The area of a geometry as this schema keeps it: valid, only polygons, null without an area.
create or replace function semap.area_only(p_geometry public.geometry) returns public.geometry
language sql immutable parallel safe as $$
  select case when public.st_area(polygons) > 1e-12 then
           case when public.st_numgeometries(polygons) = 1 then public.st_geometryn(polygons, 1) else polygons end end
  from (select public.st_collectionextract(public.st_makevalid(p_geometry), 3) as polygons) p
$$;

-- The rectangle of the smallest area around a convex polygon: one of its sides lies along a side of the polygon
-- (Freeman and Shapira 1975). ST_OrientedEnvelope gives that of the smallest width before GEOS 3.12.
create or replace function semap.smallest_rectangle(p_hull public.geometry) returns public.geometry
language sql immutable parallel safe as $$
  select public.st_rotate(box, -angle_rad)
  from public.st_dumpsegments(public.st_exteriorring(p_hull)) side,
       lateral (select public.st_azimuth(public.st_startpoint(side.geom), public.st_endpoint(side.geom))
                as angle_rad) a,
       lateral (select public.st_envelope(public.st_rotate(p_hull, angle_rad)) as box) b
  order by public.st_area(box), angle_rad
  limit 1
$$;

-- The outline of a description seen from above under a pose that tilts it, cut from its geometries: an outline
-- that is upright under this pose counts alone; else the projections of its faces are united, or of its outlines
-- where it has no faces.
create or replace function semap.tilted_outline(p_description_id bigint, p_pose semap.pose)
returns table (footprint public.geometry, z_min_m double precision, z_max_m double precision)
language plpgsql stable set search_path = public, pg_temp as $$
begin
  return query
    select semap.area_only(semap.placed(g.body, composed.pose)), g.z_min_m + (composed.pose).z_m,
           g.z_max_m + (composed.pose).z_m
    from semap.geometry g,
         lateral (select semap.compose(p_pose, row(g.x_m, g.y_m, g.z_m, g.qx, g.qy, g.qz, g.qw)::semap.pose)
                  as pose) composed
    where g.description_id = p_description_id and g.type = 'POLYGON2D' and semap.is_upright(composed.pose)
    limit 1;
  if found then
    return;
  end if;
  return query
    select semap.area_only(st_union(face.shape)), null::double precision, null::double precision
    from semap.geometry g,
         lateral (select semap.placed(
                    st_force3d(g.body),
                    semap.compose(p_pose, row(g.x_m, g.y_m, g.z_m, g.qx, g.qy, g.qz, g.qw)::semap.pose)) as body) moved,
         lateral st_dump(moved.body) part,
         lateral (select st_force2d(case when geometrytype(part.geom) = 'TRIANGLE'
                                         then st_makepolygon(st_exteriorring(part.geom))
                                         else part.geom end) as shape) face
    where g.description_id = p_description_id
      and (g.type in ('TRIANGLEMESH3D', 'POLYGONMESH3D', 'POLYGON3D')
           or g.type = 'POLYGON2D' and not exists (
                select from semap.geometry m where m.description_id = p_description_id
                and m.type in ('TRIANGLEMESH3D', 'POLYGONMESH3D', 'POLYGON3D')))
      and st_area(face.shape) > 1e-12;
end $$;

-- The absolute abstractions of these instances as they should be.
create or replace function semap.abstractions_wanted(p_instance_ids bigint[])
returns table (
  description_id bigint, instance_id bigint, type text, geometry public.geometry,
  z_min_m double precision, z_max_m double precision
)
language sql stable set search_path = public, pg_temp as $$
  with placed as materialized (
    select i.instance_id, i.relative_description_id as relative_id, i.absolute_description_id as absolute_id, p.pose,
           semap.is_upright(p.pose) as upright
    from semap.instance i
    join semap.frames_in_root(array(
           select frame_id from semap.instance where instance_id = any (p_instance_ids))) p using (frame_id)
    join semap.frame root on root.frame_id = p.root_id and root.name = 'map'
    where i.instance_id = any (p_instance_ids) and i.relative_description_id is not null and p.pose is not null
  ), moved as materialized (
    select p.instance_id, p.absolute_id, p.relative_id, p.pose, p.upright, a.type,
           semap.placed(a.geometry, p.pose) as shape,
           case when p.upright then a.z_min_m + (p.pose).z_m end as z_min_m,
           case when p.upright then a.z_max_m + (p.pose).z_m end as z_max_m
    from placed p join semap.abstraction a on a.description_id = p.relative_id
    where case when p.upright then a.type not in ('AxisAligned2D', 'AxisAligned3D')
               else a.type in ('Position3D', 'BoundingBox', 'BoundingHull') end
  ), extent as materialized (
    select instance_id, absolute_id, st_xmin(shape) as x_min, st_ymin(shape) as y_min, st_zmin(shape) as z_min,
           st_xmax(shape) as x_max, st_ymax(shape) as y_max, st_zmax(shape) as z_max
    from moved where moved.type = 'BoundingHull'
  ), tilted as materialized (
    select p.instance_id, p.absolute_id, o.footprint,
           coalesce(semap.area_only(st_convexhull(st_points(h.shape))),
                    semap.area_only(st_convexhull(o.footprint))) as hull,
           coalesce(o.z_min_m, nullif(e.z_min, e.z_max)) as z_min_m,
           coalesce(o.z_max_m, nullif(e.z_max, e.z_min)) as z_max_m
    from placed p
    left join moved h on h.instance_id = p.instance_id and h.type = 'BoundingHull'
    left join extent e on e.instance_id = p.instance_id
    left join lateral semap.tilted_outline(p.relative_id, p.pose) o on true
    where not p.upright
  ), flat as (
    select instance_id, absolute_id, type, shape, z_min_m, z_max_m from moved
    union all
    select instance_id, absolute_id, 'FootprintHull', hull, z_min_m, z_max_m from tilted
    union all
    select instance_id, absolute_id, 'Footprint', coalesce(footprint, hull), z_min_m, z_max_m from tilted
    union all
    select instance_id, absolute_id, 'FootprintBox', semap.area_only(semap.smallest_rectangle(hull)), z_min_m, z_max_m
    from tilted
    union all
    select instance_id, absolute_id, 'Position2D', st_centroid(hull), z_min_m, z_max_m from tilted
  )
  select absolute_id, instance_id, type, shape, z_min_m, z_max_m
  from flat where shape is not null
  union all
  select absolute_id, instance_id, 'AxisAligned2D', st_envelope(shape), z_min_m, z_max_m
  from flat where type = 'FootprintHull' and shape is not null
  union all
  select absolute_id, instance_id, 'AxisAligned3D', semap.box_3d(x_min, y_min, z_min, x_max, y_max, z_max),
         nullif(z_min, z_max), nullif(z_max, z_min)
  from extent
$$;

-- Bring the absolute abstractions of these instances in line with their descriptions and frames.
create or replace function semap.place_instances(p_instance_ids bigint[]) returns void
language plpgsql set search_path = public, pg_temp as $$
begin
  if p_instance_ids is null then
    return;
  end if;
  with wanted as materialized (
    select * from semap.abstractions_wanted(p_instance_ids)
  ), gone as (
    delete from semap.abstraction a
    where a.instance_id = any (p_instance_ids)
      and not exists (select from wanted w where w.description_id = a.description_id and w.type = a.type)
  )
  insert into semap.abstraction as a (description_id, instance_id, type, geometry, z_min_m, z_max_m)
  select description_id, instance_id, type, geometry, z_min_m, z_max_m from wanted
  on conflict (description_id, type) do update
  set instance_id = excluded.instance_id, geometry = excluded.geometry,
      z_min_m = excluded.z_min_m, z_max_m = excluded.z_max_m
  where (a.instance_id, st_asewkb(a.geometry), a.z_min_m, a.z_max_m)
        is distinct from (excluded.instance_id, st_asewkb(excluded.geometry), excluded.z_min_m, excluded.z_max_m);
end $$;

-- Every instance gets a description of its own for its absolute abstractions.
create or replace function semap.instance_grounded() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  -- an insert that ends as an update of its row has one already
  if new.absolute_description_id is null
     and not exists (select from semap.instance where instance_id = new.instance_id) then
    insert into semap.description (map_id, is_absolute) values (new.map_id, true)
    returning description_id into new.absolute_description_id;
  end if;
  return new;
end $$;

create or replace trigger instance_grounded before insert on semap.instance
  for each row execute function semap.instance_grounded();

-- Instances were added, or got another frame or description: their abstractions follow.
create or replace function semap.instance_placed() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  if exists (select from new_row n join semap.frame f using (frame_id) where f.map_id <> n.map_id) then
    raise exception 'An instance stands on a frame of its own map.'
      using errcode = 'check_violation', hint = 'Name a frame of the same map.';
  end if;
  if tg_op = 'INSERT' then
    perform semap.place_instances(array_agg(instance_id)) from new_row where relative_description_id is not null;
  else
    perform semap.place_instances(array_agg(n.instance_id))
    from new_row n join old_row o using (instance_id)
    where (n.frame_id, n.relative_description_id) is distinct from (o.frame_id, o.relative_description_id);
  end if;
  return null;
end $$;

create or replace trigger instance_placed_inserted after insert on semap.instance
  referencing new table as new_row for each statement execute function semap.instance_placed();
create or replace trigger instance_placed_updated after update on semap.instance
  referencing old table as old_row new table as new_row for each statement execute function semap.instance_placed();

-- A frame moved: what stands on it moves with it.
create or replace function semap.frame_moved() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_frame_ids  bigint[];
begin
  if tg_op = 'INSERT' then
    select array_agg(distinct frame_id) into v_frame_ids from new_row;
  elsif tg_op = 'DELETE' then
    select array_agg(distinct frame_id) into v_frame_ids from old_row;
  else
    select array_agg(distinct frame_id) into v_frame_ids
    from (select frame_id from old_row union select frame_id from new_row) moved;
  end if;
  perform semap.place_instances(array_agg(i.instance_id))
  from semap.frames_below(v_frame_ids) below (frame_id) join semap.instance i using (frame_id)
  where i.relative_description_id is not null;
  -- what turns on the spot looks the same, but faces elsewhere
  if exists (select from semap.continuous_query where in_pairs and enabled) then
    perform semap.refresh_pairs_of(array_agg(i.instance_id))
    from semap.frames_below(v_frame_ids) below (frame_id) join semap.instance i using (frame_id);
  end if;
  return null;
end $$;

create or replace trigger frame_moved_updated after update on semap.frame
  referencing old table as old_row new table as new_row for each statement execute function semap.frame_moved();
create or replace trigger frame_moved_inserted after insert on semap.frame_pose
  referencing new table as new_row for each statement execute function semap.frame_moved();
create or replace trigger frame_moved_updated after update on semap.frame_pose
  referencing old table as old_row new table as new_row for each statement execute function semap.frame_moved();
create or replace trigger frame_moved_deleted after delete on semap.frame_pose
  referencing old table as old_row for each statement execute function semap.frame_moved();

-- A description looks different now: so do its instances.
create or replace function semap.description_reshaped() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  if tg_op = 'INSERT' then
    perform semap.place_instances(array_agg(i.instance_id)) from semap.instance i
    where i.relative_description_id in (select description_id from new_row where instance_id is null);
  elsif tg_op = 'DELETE' then
    perform semap.place_instances(array_agg(i.instance_id)) from semap.instance i
    where i.relative_description_id in (select description_id from old_row where instance_id is null);
  else
    perform semap.place_instances(array_agg(i.instance_id)) from semap.instance i
    where i.relative_description_id in (select description_id from old_row where instance_id is null
                                        union select description_id from new_row where instance_id is null);
  end if;
  return null;
end $$;

create or replace trigger description_reshaped_inserted after insert on semap.abstraction
  referencing new table as new_row for each statement execute function semap.description_reshaped();
create or replace trigger description_reshaped_updated after update on semap.abstraction
  referencing old table as old_row new table as new_row
  for each statement execute function semap.description_reshaped();
create or replace trigger description_reshaped_deleted after delete on semap.abstraction
  referencing old table as old_row for each statement execute function semap.description_reshaped();

-- With an instance go its absolute description, a relative one that nothing else uses and that has no name, and
-- its frame where nothing else stands on it.
create or replace function semap.instance_deleted_with_its_own() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  delete from semap.description d
  where d.description_id in (select absolute_description_id from old_row)
     or (d.name is null
         and d.description_id in (select relative_description_id from old_row)
         and not exists (select from semap.instance i where i.relative_description_id = d.description_id));
  delete from semap.frame f
  where f.frame_id in (select frame_id from old_row) and f.parent_id is not null
    and not exists (select from semap.frame c where c.parent_id = f.frame_id)
    and not exists (select from semap.instance i where i.frame_id = f.frame_id);
  return null;
end $$;

create or replace trigger instance_deleted_with_its_own after delete on semap.instance
  referencing old table as old_row for each statement execute function semap.instance_deleted_with_its_own();
