/*
holds = """\
  the subject is in the object: its position (of a track) or its shape; the object is its shape, or the \
  ground that a track covers"""
holds_in_regions = "the same with the object's boundary (`ST_Covers`)"
region_test = "covers"
object = "ground"
has_boundary = true
areas = { st_covers = 0, st_coveredby = 1 }
*/

-- How the subject stands to the area of the object, and to its enter and leave thresholds.
create or replace function semap.covers_stands(
  p_query semap.continuous_query, p_subject semap.compared, p_object semap.compared
) returns semap.standing
language plpgsql stable parallel safe as $$
declare
  c_at_height  constant boolean := semap.heights_within(p_query, p_subject, p_object);
  v_stands     semap.standing;
begin
  v_stands.raw := c_at_height and st_covers(p_object.shape, p_subject.shape) is true;
  v_stands.enters := v_stands.raw and (
    p_query.enter_margin_m = 0
    or st_covers(semap.grown(p_object.shape, -p_query.enter_margin_m), p_subject.shape));
  v_stands.leaves := not c_at_height or not v_stands.raw and (
    p_query.leave_margin_m = 0
    or st_covers(semap.grown(p_object.shape, p_query.leave_margin_m), p_subject.shape) is not true);
  return v_stands;
end $$;
