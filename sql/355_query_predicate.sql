-- Spatial predicates of two rows of the views of semap_query, as continuous queries name them: is_in(t, r) of
-- from track t, room r. The first row is the subject. Things of different maps are in no relation.

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

-- Whether the subject is in front of the object; see semap_query.is_beside.
create or replace function semap_query.in_front_of(p_subject record, p_object record) returns boolean
language plpgsql stable parallel safe as $$
begin
  return semap_query.is_beside('in_front_of', p_subject, p_object);
end $$;

-- Whether the subject is behind the object; see semap_query.is_beside.
create or replace function semap_query.behind(p_subject record, p_object record) returns boolean
language plpgsql stable parallel safe as $$
begin
  return semap_query.is_beside('behind', p_subject, p_object);
end $$;

-- Whether the subject is left of the object; see semap_query.is_beside.
create or replace function semap_query.left_of(p_subject record, p_object record) returns boolean
language plpgsql stable parallel safe as $$
begin
  return semap_query.is_beside('left_of', p_subject, p_object);
end $$;

-- Whether the subject is right of the object; see semap_query.is_beside.
create or replace function semap_query.right_of(p_subject record, p_object record) returns boolean
language plpgsql stable parallel safe as $$
begin
  return semap_query.is_beside('right_of', p_subject, p_object);
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

-- Whether the straight way of a track from the state before its present one meets the object's footprint. A query that
-- is kept tells each crossing of its line or boundary as it happens; a way that stays inside an area crosses nothing
-- then.
create or replace function semap_query.crosses(p_subject record, p_object record) returns boolean
language plpgsql stable parallel safe as $$
declare
  v_before  public.geometry;
begin
  if p_subject.map_id <> p_object.map_id then
    return false;
  end if;
  select public.st_makepoint(s.x_m, s.y_m) into v_before
  from semap.states_around(p_subject.id, p_subject.stamp, 1, 0) s;
  return public.st_intersects(public.st_makeline(v_before, public.st_makepoint(p_subject.x_m, p_subject.y_m)),
                              p_object.footprint);
end $$;
