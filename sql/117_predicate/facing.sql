/*
holds = """\
  the subject's heading is within `angle_rad` of the bearing of the object; with `distance_m`, no further \
  away than that"""
subject = "pose"
reach = "distance"
needs = ["angle_rad"]
takes = ["distance_m"]

[rows]
name = "faces"
usage = "faces(t, d, radians(15))"
numbers = ["angle_rad"]
by_track = true
*/

-- Whether the subject faces the object, where it is near enough.
create or replace function semap.facing_stands(
  p_query semap.continuous_query, p_subject semap.compared, p_object semap.compared
) returns semap.standing
language plpgsql stable parallel safe as $$
declare
  c_faces  constant boolean := (
    (p_query.distance_m is null or st_distance(p_subject.shape, p_object.shape) <= p_query.distance_m)
    and semap.is_facing(p_subject.place, p_subject.yaw_rad, p_object.place, p_query.angle_rad)) is true;
begin
  return row(c_faces, c_faces, not c_faces, null)::semap.standing;
end $$;

-- Whether a track's heading is within an angle [rad] of the bearing of the object's position; null without a heading,
-- and where the two are at one place.
create or replace function semap_query.faces(p_subject record, p_object record, p_angle_rad double precision)
returns boolean
language plpgsql stable parallel safe as $$
declare
  v_x_m  double precision := public.st_x(p_object.position) - p_subject.x_m;
  v_y_m  double precision := public.st_y(p_object.position) - p_subject.y_m;
begin
  if p_subject.map_id <> p_object.map_id then
    return false;
  elsif v_x_m = 0 and v_y_m = 0 then
    return null;
  end if;
  -- the angle between the two, which does not care how often either goes round
  return abs(atan2(cos(p_subject.heading_rad) * v_y_m - sin(p_subject.heading_rad) * v_x_m,
                   cos(p_subject.heading_rad) * v_x_m + sin(p_subject.heading_rad) * v_y_m)) <= p_angle_rad;
end $$;
