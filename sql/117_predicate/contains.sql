/*
holds = """\
  the subject is in the object: its position (of a track) or its shape; the object is its shape, or the \
  ground that a track covers"""
holds_in_regions = "the track is in the interior of the object (`ST_Contains`)"
region_test = "contains"
object = "ground"
has_boundary = true
areas = { st_contains = 0, st_within = 1 }

[rows]
name = "is_in"
usage = "is_in(t, r)"
of_instance = true
*/

-- How the subject stands to the area of the object, and to its enter and leave thresholds.
create or replace function semap.contains_stands(
  p_query semap.continuous_query, p_subject semap.compared, p_object semap.compared
) returns semap.standing
language plpgsql stable parallel safe as $$
declare
  c_at_height  constant boolean := semap.heights_within(p_query, p_subject, p_object);
  v_stands     semap.standing;
begin
  v_stands.raw := c_at_height and st_contains(p_object.shape, p_subject.shape) is true;
  v_stands.enters := v_stands.raw and (
    p_query.enter_margin_m = 0
    or st_contains(semap.grown(p_object.shape, -p_query.enter_margin_m), p_subject.shape));
  v_stands.leaves := not c_at_height or not v_stands.raw and (
    p_query.leave_margin_m = 0
    or st_contains(semap.grown(p_object.shape, p_query.leave_margin_m), p_subject.shape) is not true);
  return v_stands;
end $$;

-- Whether the subject is in the object: its position, or the footprint of an instance, in the object's footprint, and
-- within its heights; a track whose height is not known is at any height.
create or replace function semap_query.is_in(p_subject record, p_object record) returns boolean
language plpgsql stable parallel safe as $$
begin
  if p_subject.map_id <> p_object.map_id then
    return false;
  elsif p_subject.kind = 'track' then
    return public.st_contains(p_object.footprint, p_subject.position)
       and (p_subject.z_m is null or p_subject.z_m >= p_object.z_min_m and p_subject.z_m < p_object.z_max_m);
  end if;
  return p_subject.id <> p_object.id and public.st_contains(p_object.footprint, p_subject.footprint)
     and p_subject.z_min_m >= p_object.z_min_m and p_subject.z_max_m <= p_object.z_max_m;
end $$;
