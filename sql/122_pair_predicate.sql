-- What each predicate says of a subject and an object (see semap.observed_pairs).

-- Whether the heights of two things let a predicate hold. A track has one height; one that is not known is any. The
-- grounds of two tracks meet if their heights are no more than a metre apart, so that noise does not part them.
create or replace function semap.heights_meet(
  p_predicate text, p_distance_m double precision, p_subject_key bigint, p_object_key bigint,
  p_subject_z_min_m double precision, p_subject_z_max_m double precision,
  p_object_z_min_m double precision, p_object_z_max_m double precision
) returns boolean
language plpgsql immutable parallel safe as $$
declare
  v_by_m  double precision := case when p_predicate = 'within_distance' then p_distance_m else 0 end;
begin
  if p_predicate = 'intersects' and p_subject_key > 0 and p_object_key > 0 then
    return (abs(p_subject_z_min_m - p_object_z_min_m) <= 1) is not false;
  elsif p_predicate = 'intersects' or p_subject_key < 0 and p_object_key < 0
    and p_predicate not in ('contains', 'covers') then
    return (p_subject_z_min_m <= p_object_z_max_m + v_by_m
            and p_subject_z_max_m >= p_object_z_min_m - v_by_m) is not false;
  elsif p_predicate = 'within_distance' and p_subject_key < 0 then
    return (p_object_z_min_m >= p_subject_z_min_m - v_by_m
            and p_object_z_min_m < p_subject_z_max_m + v_by_m) is not false;
  elsif p_object_key > 0 then
    return true;
  elsif p_subject_key > 0 then
    return (p_subject_z_min_m >= p_object_z_min_m - v_by_m
            and p_subject_z_min_m < p_object_z_max_m + v_by_m) is not false;
  end if;
  return p_subject_z_min_m >= p_object_z_min_m and p_subject_z_max_m <= p_object_z_max_m;
end $$;

-- Whether a heading [rad] is within an angle of the bearing from one place to another; not where they are one place.
create or replace function semap.is_facing(
  p_from public.geometry, p_yaw_rad double precision, p_to public.geometry, p_angle_rad double precision
) returns boolean
language sql immutable parallel safe as $$
  select (x_m <> 0 or y_m <> 0)
     and abs(atan2(cos(p_yaw_rad) * y_m - sin(p_yaw_rad) * x_m,
                   cos(p_yaw_rad) * x_m + sin(p_yaw_rad) * y_m)) <= p_angle_rad
  from (select public.st_x(p_to) - public.st_x(p_from) as x_m, public.st_y(p_to) - public.st_y(p_from) as y_m) d
$$;

-- Where a pair stands: whether the predicate holds (of `approaching`: whether the two are within its distance), whether
-- it does so deep enough to begin, and whether it is far enough from that to end.
create or replace function semap.pair_stands(
  p_predicate text, p_dimensions smallint, p_reach_m double precision, p_enter_m double precision,
  p_leave_m double precision, p_angle_rad double precision, p_subject_key bigint, p_object_key bigint,
  p_subject_place public.geometry, p_subject public.geometry, p_subject_z_min_m double precision,
  p_subject_z_max_m double precision, p_yaw_rad double precision,
  p_object_place public.geometry, p_object public.geometry, p_object_z_min_m double precision,
  p_object_z_max_m double precision,
  out side boolean, out enters boolean, out leaves boolean, out distance_m double precision
) language plpgsql stable parallel safe as $$
declare
  v_at_height  boolean := true;
  v_core       public.geometry := p_object;
  v_reach      public.geometry := p_object;
begin
  if p_dimensions = 3 and p_predicate not in ('nearest', 'facing', 'approaching', 'on')
     and not (p_predicate = 'within_distance' and p_subject_key > 0 and p_object_key > 0) then
    v_at_height := semap.heights_meet(p_predicate, p_reach_m, p_subject_key, p_object_key, p_subject_z_min_m,
                                      p_subject_z_max_m, p_object_z_min_m, p_object_z_max_m);
  end if;

  if p_predicate in ('within_distance', 'approaching') then
    distance_m := st_distance(p_subject, p_object);
    if p_predicate = 'within_distance' and p_dimensions = 3 and p_subject_key > 0 and p_object_key > 0
       and p_subject_z_min_m <> p_object_z_min_m then
      distance_m := sqrt(distance_m ^ 2 + (p_subject_z_min_m - p_object_z_min_m) ^ 2);
    end if;
    side := v_at_height and distance_m <= p_reach_m;
    enters := side and distance_m <= p_reach_m - p_enter_m;
    leaves := not v_at_height or distance_m > p_reach_m + p_leave_m;
  elsif p_predicate = 'facing' then
    side := (p_reach_m is null or st_distance(p_subject, p_object) <= p_reach_m)
      and semap.is_facing(p_subject_place, p_yaw_rad, p_object_place, p_angle_rad);
  elsif p_predicate = 'on' then
    side := exists (select from semap.on_objects(array[-p_object_key], array[-p_subject_key]));
  elsif p_predicate <> 'crosses' then
    if p_enter_m > 0 then
      v_core := semap.grown(p_object, -p_enter_m);
    end if;
    if p_leave_m > 0 then
      v_reach := semap.grown(p_object, p_leave_m);
    end if;
    if p_predicate = 'contains' then
      side := v_at_height and st_contains(p_object, p_subject);
      enters := side and st_contains(v_core, p_subject);
      leaves := not v_at_height or not side and not st_contains(v_reach, p_subject);
    elsif p_predicate = 'covers' then
      side := v_at_height and st_covers(p_object, p_subject);
      enters := side and st_covers(v_core, p_subject);
      leaves := not v_at_height or not side and not st_covers(v_reach, p_subject);
    else
      side := v_at_height and st_intersects(p_object, p_subject);
      enters := side and st_intersects(v_core, p_subject);
      leaves := not v_at_height or not side and not st_intersects(v_reach, p_subject);
    end if;
  end if;
  side := coalesce(side, false);
  enters := coalesce(enters, side);
  leaves := coalesce(leaves, not side);
end $$;
