-- Maps on the globe, for clients that know degrees only. A map with an anchor lies where that says. One without lies
-- where the equator meets the prime meridian, x to the east and y to the north: its metres in an azimuthal equidistant
-- projection about that point (54032 in spatial_ref_sys), true to scale for anything the size of a town.

-- A geometry of the map frame in the system p_target; p_pose and p_epsg are the anchor's, or null: a map without an
-- anchor lies at 0 N 0 E.
create or replace function semap.on_globe(
  p_geometry public.geometry, p_pose semap.pose, p_epsg integer, p_target integer
) returns public.geometry
language plpgsql immutable parallel safe as $$
begin
  if p_epsg is null then
    return public.st_transform(public.st_setsrid(p_geometry, 54032), p_target);
  end if;
  if public.st_zmflag(p_geometry) <> 2 and not semap.is_upright(p_pose) then
    p_geometry := public.st_force3d(p_geometry);
  end if;
  return public.st_transform(public.st_setsrid(semap.placed(p_geometry, p_pose), p_epsg), p_target);
end $$;

-- A geometry of the earth (with its SRID) in the map frame; p_pose and p_epsg are the anchor's, or null: a map without
-- an anchor lies at 0 N 0 E.
create or replace function semap.from_globe(p_geometry public.geometry, p_pose semap.pose, p_epsg integer)
returns public.geometry
language plpgsql immutable parallel safe as $$
begin
  if p_epsg is null then
    return public.st_setsrid(public.st_transform(p_geometry, 54032), 0);
  end if;
  return public.st_setsrid(semap.placed(public.st_transform(p_geometry, p_epsg), semap.inverse(p_pose)), 0);
end $$;
