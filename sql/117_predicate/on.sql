/*
holds = "it rests on it, as the operator `on` has it"
holds_in_regions = "it is above the object's outline, from 10 cm below its top to 50 cm above"
relates = ["track instance", "instance instance"]
why_not = "nothing stands on a track, whose top is not known"
region_test = "contains"
subject = "body"
object = "top"

[rows]
name = "is_on"
usage = "is_on(c, d)"
of_instance = true
*/

-- Whether the one instance rests on the other.
create or replace function semap.on_stands(
  p_query semap.continuous_query, p_subject semap.compared, p_object semap.compared
) returns semap.standing
language plpgsql stable parallel safe as $$
declare
  c_rests  constant boolean := exists (select from semap.on_objects(array[-p_object.key], array[-p_subject.key]));
begin
  return row(c_rests, c_rests, not c_rests, null)::semap.standing;
end $$;

-- Whether the subject stands on the object: an instance as semap.on_objects has it; a track that is over the object's
-- footprint and, where its height is known, from 10 cm below the object's top to 50 cm above.
create or replace function semap_query.is_on(p_subject record, p_object record) returns boolean
language plpgsql stable parallel safe as $$
begin
  if p_subject.map_id <> p_object.map_id then
    return false;
  elsif p_subject.kind = 'track' then
    return public.st_covers(p_object.footprint, p_subject.position)
       and (p_subject.z_m is null
            or p_subject.z_m >= p_object.z_max_m - 0.1 and p_subject.z_m < p_object.z_max_m + 0.5);
  end if;
  return exists (select from semap.on_objects(array[p_object.id], array[p_subject.id]));
end $$;
