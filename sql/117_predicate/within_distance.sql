/*
holds = "they are at most `distance_m` apart"
holds_in_regions = "it is at most `distance_m` from the object (`ST_DWithin`)"
region_test = "dwithin"
reach = "distance"
has_boundary = true
needs = ["distance_m"]

[rows]
name = "is_near"
usage = "is_near(t, d, 1)"
numbers = ["distance_m"]
of_instances = "BoundingHull"
*/

-- How far apart the two are: two tracks whose heights are known, in space; else seen from above, where their heights
-- allow it.
create or replace function semap.within_distance_stands(
  p_query semap.continuous_query, p_subject semap.compared, p_object semap.compared
) returns semap.standing
language plpgsql stable parallel safe as $$
declare
  v_at_height  boolean := true;
  v_stands     semap.standing;
begin
  v_stands.distance_m := st_distance(p_subject.shape, p_object.shape);
  if p_query.dimensions = 2 then
    null;
  elsif p_object.key < 0 then
    v_at_height := semap.heights_meet(p_query, p_subject, p_object, p_query.distance_m);
  elsif p_subject.key < 0 then
    v_at_height := (p_object.z_min_m >= p_subject.z_min_m - p_query.distance_m
                    and p_object.z_min_m < p_subject.z_max_m + p_query.distance_m) is not false;
  elsif p_subject.z_min_m <> p_object.z_min_m then
    v_stands.distance_m := sqrt(v_stands.distance_m ^ 2 + (p_subject.z_min_m - p_object.z_min_m) ^ 2);
  end if;
  v_stands.raw := v_at_height and v_stands.distance_m <= p_query.distance_m;
  v_stands.enters := v_stands.raw and v_stands.distance_m <= p_query.distance_m - p_query.enter_margin_m;
  v_stands.leaves := not v_at_height or v_stands.distance_m > p_query.distance_m + p_query.leave_margin_m;
  return v_stands;
end $$;

-- Whether two things are at most a distance [m] apart, heights counting: the convex hulls of instances as solids, and
-- the positions of tracks. Of a track whose height is not known only the distance seen from above counts.
create or replace function semap_query.is_near(p_subject record, p_object record, p_distance_m double precision)
returns boolean
language plpgsql stable parallel safe as $$
declare
  v_subject  public.geometry := p_subject.position;
  v_object   public.geometry := p_object.position;
begin
  if p_subject.map_id <> p_object.map_id or (p_subject.kind, p_subject.id) = (p_object.kind, p_object.id) then
    return false;
  end if;
  -- by IF and not by CASE, since a track has no column that an instance alone has
  if p_subject.kind = 'instance' then
    v_subject := coalesce(semap.hull_of(p_subject.id), p_subject.position_3d, p_subject.position);
  end if;
  if p_object.kind = 'instance' then
    v_object := coalesce(semap.hull_of(p_object.id), p_object.position_3d, p_object.position);
  end if;
  if public.st_zmflag(v_subject) = 2 and public.st_zmflag(v_object) = 2 then
    return semap.gap_3d(v_subject, v_object) <= p_distance_m;
  end if;
  -- seen from above a hull is the hull of its corners
  return public.st_distance(public.st_convexhull(public.st_points(public.st_force2d(v_subject))),
                            public.st_convexhull(public.st_points(public.st_force2d(v_object)))) <= p_distance_m;
end $$;
