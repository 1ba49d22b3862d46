/*
holds = "the ground of tracks, the shape of instances share a point"
subject = "ground"
object = "ground"
has_boundary = true
*/

-- How the subject stands to the area of the object, and to its enter and leave thresholds.
create or replace function semap.intersects_stands(
  p_query semap.continuous_query, p_subject semap.compared, p_object semap.compared
) returns semap.standing
language plpgsql stable parallel safe as $$
declare
  c_at_height  constant boolean := case
    when p_query.dimensions = 2 then true
    -- so that noise does not part the grounds of two tracks
    when p_subject.key > 0 and p_object.key > 0 then (abs(p_subject.z_min_m - p_object.z_min_m) <= 1) is not false
    else (p_subject.z_min_m <= p_object.z_max_m and p_subject.z_max_m >= p_object.z_min_m) is not false end;
  v_stands     semap.standing;
begin
  v_stands.raw := c_at_height and st_intersects(p_object.shape, p_subject.shape) is true;
  v_stands.enters := v_stands.raw and (
    p_query.enter_margin_m = 0
    or st_intersects(semap.grown(p_object.shape, -p_query.enter_margin_m), p_subject.shape));
  v_stands.leaves := not c_at_height or not v_stands.raw and (
    p_query.leave_margin_m = 0
    or st_intersects(semap.grown(p_object.shape, p_query.leave_margin_m), p_subject.shape) is not true);
  return v_stands;
end $$;
