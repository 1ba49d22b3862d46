-- What the comparisons of predicates (sql/117_predicate) share, and the one function that chooses among them.

-- Whether the heights of two things let them relate. A track has one height; one that is not known is any, and what a
-- track is compared with ignores heights. By p_by_m may they differ.
create or replace function semap.heights_meet(
  p_query semap.continuous_query, p_subject semap.compared, p_object semap.compared,
  p_by_m double precision default 0
) returns boolean
language plpgsql immutable parallel safe as $$
begin
  if p_query.dimensions = 2 or p_object.key > 0 then
    return true;
  elsif p_subject.key > 0 then
    return (p_subject.z_min_m >= p_object.z_min_m - p_by_m
            and p_subject.z_min_m < p_object.z_max_m + p_by_m) is not false;
  end if;
  return (p_subject.z_min_m <= p_object.z_max_m + p_by_m
          and p_subject.z_max_m >= p_object.z_min_m - p_by_m) is not false;
end $$;

-- The same where the subject has to be in the object: of two instances, with all of its heights.
create or replace function semap.heights_within(
  p_query semap.continuous_query, p_subject semap.compared, p_object semap.compared
) returns boolean
language plpgsql immutable parallel safe as $$
begin
  if p_query.dimensions = 3 and p_subject.key < 0 and p_object.key < 0 then
    return p_subject.z_min_m >= p_object.z_min_m and p_subject.z_max_m <= p_object.z_max_m;
  end if;
  return semap.heights_meet(p_query, p_subject, p_object);
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

-- How the subject stands to what lies to a side of the object.
create or replace function semap.stands_beside(
  p_query semap.continuous_query, p_subject semap.compared, p_object semap.compared
) returns semap.standing
language plpgsql stable parallel safe as $$
declare
  c_at_height  constant boolean := semap.heights_meet(p_query, p_subject, p_object);
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

-- How a subject stands to an object, by the function of the query's predicate; null where it does not follow from the
-- two alone.
do $$
begin
  execute format(
    'create or replace function semap.pair_stands('
    'p_query semap.continuous_query, p_subject semap.compared, p_object semap.compared) returns semap.standing'
    ' language sql stable parallel safe as %L',
    (select 'select case p_query.predicate '
            || string_agg(format('when %L then semap.%I(p_query, p_subject, p_object)', name, name || '_stands'), ' '
                          order by name) || ' end'
     from semap.predicate where follows_from in ('moment', 'trend')));
  comment on function semap.pair_stands is 'How a subject stands to an object, by the function of the predicate.';
end $$;
