-- The error ellipse of a position: `std_m` is its standard deviation along the longer axis, `std_across_m` that along
-- the shorter one, `std_yaw_rad` the direction of the longer one in the map frame, from x towards y. A position whose
-- error is alike in all directions has `std_m` alone.

-- The error ellipse of a covariance [m^2], as the columns of a state have it: insert into semap.track_state (...,
-- std_m, std_across_m, std_yaw_rad) select ..., e.* from ..., semap.error_ellipse(...) e. Where the deviations are the
-- same to the digits that a state keeps, it is a circle. All null: nothing is known. Variances below 1e-30 count as
-- none.
create or replace function semap.error_ellipse(
  var_x_m2 double precision, cov_xy_m2 double precision, var_y_m2 double precision,
  out std_m real, out std_across_m real, out std_yaw_rad real
)
language plpgsql immutable parallel safe as $$
declare
  c_xx      constant double precision := case when var_x_m2 between 0 and 1e-30 then 0 else var_x_m2 end;
  c_yy      constant double precision := case when var_y_m2 between 0 and 1e-30 then 0 else var_y_m2 end;
  c_xy      constant double precision := case when abs(cov_xy_m2) <= 1e-30 then 0 else cov_xy_m2 end;
  c_trace   constant double precision := c_xx + c_yy;
  v_radius  double precision;
  v_det     double precision;
begin
  if num_nonnulls(var_x_m2, cov_xy_m2, var_y_m2) = 0 then
    return;
  elsif (c_xx >= 0 and c_yy >= 0 and c_trace < 1e30 and abs(c_xy) <= c_trace
         and c_xx * c_yy - c_xy * c_xy >= -1e-6 * c_trace * c_trace) is not true then
    raise exception 'The covariance (%, %; %) is none of a position.', var_x_m2, cov_xy_m2, var_y_m2
      using errcode = 'invalid_parameter_value', hint = 'Give xx, xy and yy in square metres, with xy^2 <= xx yy.';
  end if;
  v_radius := sqrt(((c_xx - c_yy) / 2) ^ 2 + c_xy * c_xy);
  v_det := c_xx * c_yy - c_xy * c_xy;
  std_m := sqrt(c_trace / 2 + v_radius);
  std_across_m := case when v_det > 0 then sqrt(v_det / (c_trace / 2 + v_radius)) else 0 end;
  if std_across_m < std_m then
    std_yaw_rad := atan2(2 * c_xy, c_xx - c_yy) / 2;
  else
    std_across_m := null;
  end if;
end $$;

-- The covariance of a position [m^2] by its error ellipse; null where nothing is known.
create or replace function semap.error_covariance(
  p_std_m double precision, p_std_across_m double precision, p_std_yaw_rad double precision,
  out xx double precision, out xy double precision, out yy double precision
)
language sql immutable parallel safe as $$
  select along * c * c + across * s * s, (along - across) * c * s, along * s * s + across * c * c
  from (select p_std_m ^ 2 as along, coalesce(p_std_across_m, p_std_m) ^ 2 as across,
               cos(coalesce(p_std_yaw_rad, 0)) as c, sin(coalesce(p_std_yaw_rad, 0)) as s) e
$$;

-- How far a position is from a boundary, across the longer axis of its error ellipse stretched until that is a circle
-- of std_m: divided by std_m, the distance in standard deviations. The shorter axis counts for at least a thousandth of
-- the longer one. For a straight boundary that is d * std_m / sqrt(n' C n).
create or replace function semap.stretched_distance_m(
  p_boundary public.geometry, p_x_m double precision, p_y_m double precision,
  p_std_m double precision, p_std_across_m double precision, p_std_yaw_rad double precision
) returns double precision
language plpgsql immutable parallel safe as $$ -- which keeps its plan
declare
  c_stretch  constant double precision := p_std_m / greatest(p_std_across_m, p_std_m / 1000);
  c_cos      constant double precision := cos(p_std_yaw_rad);
  c_sin      constant double precision := sin(p_std_yaw_rad);
begin
  -- first to the origin, so that nothing is lost where coordinates are large
  return public.st_distance(
    public.st_affine(public.st_translate(p_boundary, -p_x_m, -p_y_m),
                     c_cos, c_sin, -c_sin * c_stretch, c_cos * c_stretch, 0, 0),
    public.st_point(0, 0));
end $$;
