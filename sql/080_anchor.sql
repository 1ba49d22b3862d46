-- A geometry of the map in a system of the earth: the map's own anchor system, or another one by its EPSG code.
create or replace function semap.to_earth(p_geometry public.geometry, p_map_id integer, p_epsg integer default null)
returns public.geometry
language sql stable parallel safe as $$
  select case when p_epsg is null or p_epsg = epsg then placed else public.st_transform(placed, p_epsg) end
  from (
    select epsg,
           public.st_setsrid(semap.placed(case when public.st_zmflag(p_geometry) = 2 or semap.is_upright(pose)
                                               then p_geometry else public.st_force3d(p_geometry) end, pose),
                             epsg) as placed
    from (select epsg, row(x_m, y_m, z_m, qx, qy, qz, qw)::semap.pose as pose
          from semap.map_anchor where map_id = p_map_id) anchor
  ) on_earth
$$;

-- A geometry of the earth (with its SRID) in the frame of a map.
create or replace function semap.from_earth(p_geometry public.geometry, p_map_id integer) returns public.geometry
language sql stable parallel safe as $$
  select public.st_setsrid(
           semap.placed(public.st_transform(p_geometry, epsg),
                        semap.inverse(row(x_m, y_m, z_m, qx, qy, qz, qw)::semap.pose)), 0)
  from semap.map_anchor where map_id = p_map_id
$$;
