/*
holds = "the subject is on that side of the object, up to `distance_m` away; of a track by its heading"
holds_in_regions = """\
  it is on that side of the object's box, in the object's own frame (x forward, y left), up to `distance_m` \
  away"""
region_test = "contains"
object = "right"
has_boundary = true
needs = ["distance_m"]

[rows]
name = "right_of"
usage = "right_of(t, d)"
of_instance = true
always = { distance_m = 10.0 }
*/

-- How the subject stands to what lies to that side of the object.
create or replace function semap.right_of_stands(
  p_query semap.continuous_query, p_subject semap.compared, p_object semap.compared
) returns semap.standing
language plpgsql stable parallel safe as $$
begin
  return semap.stands_beside(p_query, p_subject, p_object);
end $$;

-- Whether the subject is right of the object; see semap_query.is_beside.
create or replace function semap_query.right_of(p_subject record, p_object record) returns boolean
language plpgsql stable parallel safe as $$
begin
  return semap_query.is_beside('right_of', p_subject, p_object);
end $$;
