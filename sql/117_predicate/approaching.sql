/*
holds = """\
  their distance fell by `speed_mps` or more since the last comparison, and was and is at most `distance_m`"""
relates = ["track instance", "track track", "instance track"]
why_not = "of two instances neither approaches, since they move when the map is edited"
follows_from = "trend"
reach = "distance"
needs = ["speed_mps", "distance_m"]

[rows]
name = "approaches"
usage = "approaches(t, d, 0.5, 10)"
numbers = ["speed_mps", "distance_m"]
by_track = true
*/

-- How far apart the two are, and whether that is near enough for one to approach the other.
create or replace function semap.approaching_stands(
  p_query semap.continuous_query, p_subject semap.compared, p_object semap.compared
) returns semap.standing
language plpgsql stable parallel safe as $$
declare
  v_stands  semap.standing;
begin
  v_stands.distance_m := st_distance(p_subject.shape, p_object.shape);
  v_stands.raw := v_stands.distance_m <= p_query.distance_m;
  v_stands.enters := v_stands.raw;
  v_stands.leaves := not v_stands.raw;
  return v_stands;
end $$;

-- Whether the distance from a track to the object falls by a speed [m/s] or more, while they are at most a distance [m]
-- apart: to the nearest point of an instance's footprint (of its position where it has none), or to another track's
-- position, which may move, too. A row has no state before, so that heading and speed say how the distance changes,
-- where a query that is kept compares the distances at successive states. False where they meet; null where the track's
-- heading or speed is not known.
create or replace function semap_query.approaches(
  p_subject record, p_object record, p_speed_mps double precision, p_distance_m double precision
) returns boolean
language plpgsql stable parallel safe as $$
declare
  v_shape   public.geometry := case when p_object.kind = 'track' then p_object.position
                                    else coalesce(p_object.footprint, p_object.position) end;
  v_line    public.geometry := public.st_shortestline(public.st_force2d(p_subject.position),
                                                      public.st_force2d(v_shape));
  v_x_mps   double precision := p_subject.speed_mps * cos(p_subject.heading_rad);
  v_y_mps   double precision := p_subject.speed_mps * sin(p_subject.heading_rad);
  v_line_m  double precision := public.st_length(v_line);
begin
  if p_subject.map_id <> p_object.map_id or v_line_m = 0 or v_line_m > p_distance_m then
    return false;
  end if;
  if p_object.kind = 'track' then
    v_x_mps := v_x_mps - coalesce(p_object.speed_mps * cos(p_object.heading_rad), 0);
    v_y_mps := v_y_mps - coalesce(p_object.speed_mps * sin(p_object.heading_rad), 0);
  end if;
  return (v_x_mps * (public.st_x(public.st_endpoint(v_line)) - p_subject.x_m)
          + v_y_mps * (public.st_y(public.st_endpoint(v_line)) - p_subject.y_m)) / v_line_m >= p_speed_mps;
end $$;
