-- What predicates of two rows of the views of semap_query (sql/117_predicate) have in common.

-- Whether the subject is in a direction of the object (in_front_of, behind, left_of, right_of), in the object's own
-- frame: in the projection of its box to that side, up to 10 m. A track is where its position is, within the sides of
-- the projection and not on them, at any height if its own is not known; an instance counts with any part of it.
create or replace function semap_query.is_beside(p_direction text, p_subject record, p_object record) returns boolean
language plpgsql stable parallel safe as $$
declare
  v_axes     semap.pose;
  v_corners  public.geometry;
  v_box      public.box3d;
  v_point    public.geometry;
begin
  if p_subject.map_id <> p_object.map_id then
    return false;
  elsif p_subject.kind = 'instance' then
    return exists (select from semap.directed(p_direction, array[p_object.id], array[p_subject.id]));
  end if;
  v_axes := semap.direction_axes(p_object.id, 'object');
  v_corners := semap.corners_of(p_object.id);
  if v_corners is null then
    return false;
  end if;
  v_point := semap.seen_from(
    public.st_makepoint(p_subject.x_m, p_subject.y_m,
                        coalesce(p_subject.z_m, (public.st_zmin(v_corners) + public.st_zmax(v_corners)) / 2)), v_axes);
  v_box := public.box3d(semap.seen_from(v_corners, v_axes));
  v_box := semap.region_box(v_box, semap.region_named(p_direction, 'projection', 'object'), 10);
  return public.st_x(v_point) > public.st_xmin(v_box) and public.st_x(v_point) < public.st_xmax(v_box)
     and public.st_y(v_point) > public.st_ymin(v_box) and public.st_y(v_point) < public.st_ymax(v_box)
     and public.st_z(v_point) >= public.st_zmin(v_box) and public.st_z(v_point) < public.st_zmax(v_box);
end $$;
