-- How probable it is that something lies in an area, its position being known with a Gaussian error. What is computed,
-- and why it is right, stands in docs/explanation/uncertainty.md. PostgreSQL raises an error on a float that is too
-- small (exp(-1000), 1e-200 * 1e-200), so what does not count any more is left out before it is computed.

-- The standard normal distribution function, to about fifteen digits in both tails; 0 below -37.5. W. J. Cody, Rational
-- Chebyshev approximations for the error function, Math. Comp. 23 (1969), as in his Algorithm 715 (ACM TOMS 19, 1993).
create or replace function semap.normal_cdf(p_x double precision) returns double precision
language plpgsql immutable parallel safe as $$
declare
  v_y     double precision := abs(p_x);
  v_q     double precision;
  v_tail  double precision;
begin
  if p_x is null or p_x = 'NaN' then
    return p_x;
  elsif v_y <= 0.67448975 then
    v_q := case when v_y > 1e-16 then p_x * p_x else 0 end;
    return 0.5 + p_x
      * ((((0.065682337918207449113 * v_q + 2.2352520354606839287) * v_q + 161.02823106855587881) * v_q
          + 1067.6894854603709582) * v_q + 18154.981253343561249)
      / ((((v_q + 47.20258190468824187) * v_q + 976.09855173777669322) * v_q + 10260.932208618978205) * v_q
         + 45507.789335026729956);
  elsif v_y > 37.5 then
    return case when p_x > 0 then 1 else 0 end;
  elsif v_y <= 5.656854249492380 then
    v_tail :=
      ((((((((1.0765576773720192317e-8 * v_y + 0.39894151208813466764) * v_y + 8.8831497943883759412) * v_y
            + 93.506656132177855979) * v_y + 597.27027639480026226) * v_y + 2494.5375852903726711) * v_y
         + 6848.1904505362823326) * v_y + 11602.651437647350124) * v_y + 9842.7148383839780218)
      / ((((((((v_y + 22.266688044328115691) * v_y + 235.38790178262499861) * v_y + 1519.377599407554805) * v_y
            + 6485.558298266760755) * v_y + 18615.571640885098091) * v_y + 34900.952721145977266) * v_y
         + 38912.003286093271411) * v_y + 19685.429676859990727);
  else
    v_q := 1 / (v_y * v_y);
    v_tail := (0.398942280401432677940 - v_q
      * (((((0.02307344176494017303 * v_q + 0.21589853405795699) * v_q + 0.1274011611602473639) * v_q
           + 0.022235277870649807) * v_q + 0.001421619193227893466) * v_q + 2.9112874951168792e-5)
      / (((((v_q + 1.28426009614491121) * v_q + 0.468238212480865118) * v_q + 0.0659881378689285515) * v_q
          + 0.00378239633202758244) * v_q + 7.29751555083966205e-5)) / v_y;
  end if;
  -- exp(-y^2 / 2) in two factors, the first of which is without rounding
  v_q := trunc(v_y * 16) / 16;
  v_tail := exp(-v_q * v_q / 2) * exp(-(v_y - v_q) * (v_y + v_q) / 2) * v_tail;
  return case when p_x > 0 then 1 - v_tail else v_tail end;
end $$;

-- Where the standard normal distribution function has a value, to about sixteen digits; infinite at 0 and 1, null
-- outside of them. M. J. Wichura, Algorithm AS 241: The percentage points of the normal distribution, Appl. Statist. 37
-- (1988).
create or replace function semap.normal_quantile(p_probability double precision) returns double precision
language plpgsql immutable parallel safe as $$
declare
  v_q     double precision := p_probability - 0.5;
  v_r     double precision;
  v_tail  double precision;
begin
  if p_probability in (0, 1) then
    return case when p_probability = 1 then 'infinity' else '-infinity' end;
  elsif p_probability between 0 and 1 is not true then
    return null;
  elsif abs(v_q) <= 0.425 then
    v_r := 0.180625 - case when abs(v_q) > 1e-16 then v_q * v_q else 0 end;
    return v_q
      * (((((((2509.0809287301226727 * v_r + 33430.575583588128105) * v_r + 67265.770927008700853) * v_r
             + 45921.953931549871457) * v_r + 13731.693765509461125) * v_r + 1971.5909503065514427) * v_r
          + 133.14166789178437745) * v_r + 3.3871328727963666080)
      / (((((((5226.4952788528545610 * v_r + 28729.085735721942674) * v_r + 39307.895800092710610) * v_r
             + 21213.794301586595867) * v_r + 5394.1960214247511077) * v_r + 687.18700749205790830) * v_r
          + 42.313330701600911252) * v_r + 1);
  end if;
  v_r := sqrt(-ln(case when v_q < 0 then p_probability else 1 - p_probability end));
  if v_r <= 5 then
    v_r := v_r - 1.6;
    v_tail :=
      (((((((7.74545014278341407640e-4 * v_r + 0.0227238449892691845833) * v_r + 0.241780725177450611770) * v_r
           + 1.27045825245236838258) * v_r + 3.64784832476320460504) * v_r + 5.76949722146069140550) * v_r
        + 4.63033784615654529590) * v_r + 1.42343711074968357734)
      / (((((((1.05075007164441684324e-9 * v_r + 5.47593808499534494600e-4) * v_r + 0.0151986665636164571966) * v_r
             + 0.148103976427480074590) * v_r + 0.689767334985100004550) * v_r + 1.67638483018380384940) * v_r
          + 2.05319162663775882187) * v_r + 1);
  else
    v_r := v_r - 5;
    v_tail :=
      (((((((2.01033439929228813265e-7 * v_r + 2.71155556874348757815e-5) * v_r + 0.00124266094738807843860) * v_r
           + 0.0265321895265761230930) * v_r + 0.296560571828504891230) * v_r + 1.78482653991729133580) * v_r
        + 5.46378491116411436990) * v_r + 6.65790464350110377720)
      / (((((((2.04426310338993978564e-15 * v_r + 1.42151175831644588870e-7) * v_r + 1.84631831751005468180e-5) * v_r
             + 7.86869131145613259100e-4) * v_r + 0.0148753612908506148525) * v_r + 0.136929880922735805310) * v_r
          + 0.599832206555887937690) * v_r + 1);
  end if;
  return case when v_q < 0 then -v_tail else v_tail end;
end $$;

-- How far a position is from the boundary of an area [m], its holes being outside: positive inside, negative outside.
create or replace function semap.signed_distance_m(
  p_shape public.geometry, p_x_m double precision, p_y_m double precision
) returns double precision
language sql immutable parallel safe as $$
  select case when st_contains(p_shape, st_point(p_x_m, p_y_m))
              then st_distance(st_boundary(p_shape), st_point(p_x_m, p_y_m))
              else 0 - st_distance(p_shape, st_point(p_x_m, p_y_m)) end
$$;

-- How much of the standard normal distribution in the plane lies in the triangle (0, 0), (p_h, 0), (p_h, p_t), which is
-- negative where p_t is; p_h is not. This is atan(t / h) / 2 pi - T(h, t / h), T being the function of D. B. Owen
-- (Tables for computing bivariate normal probabilities, 1956), here by Gauss-Legendre quadrature with 24 points for t
-- <= h.
create or replace function semap.triangle_probability(p_h double precision, p_t double precision)
returns double precision
language plpgsql immutable parallel safe as $$
declare
  a  double precision;
  b  double precision;
  c  double precision;
begin
  if p_t < 0 then
    return -semap.triangle_probability(p_h, -p_t);
  elsif least(p_h, p_t) < 1e-100 then
    return 0;
  elsif p_t > p_h then
    -- with its mirror image it makes a rectangle
    return (case when p_h > 9 then 0.5 else semap.normal_cdf(p_h) - 0.5 end)
         * (case when p_t > 9 then 0.5 else semap.normal_cdf(p_t) - 0.5 end) - semap.triangle_probability(p_t, p_h);
  end if;
  a := case when p_t / 1e100 > p_h then 0 else p_t / p_h end;
  if p_h > 9 or a < 1e-100 then
    return atan(a) / (2 * pi());
  end if;
  b := a * a;
  c := p_t * p_t / 2;
  return (atan(a) - a * exp(-p_h * p_h / 2) * (
      0.127938195346752157 * exp(-c * 0.004103285523211336) / (1 + b * 0.004103285523211336)
    + 0.125837456346828296 * exp(-c * 0.036526421504397714) / (1 + b * 0.036526421504397714)
    + 0.121670472927803391 * exp(-c * 0.099251890030139390) / (1 + b * 0.099251890030139390)
    + 0.115505668053725601 * exp(-c * 0.188176807258507682) / (1 + b * 0.188176807258507682)
    + 0.107444270115965635 * exp(-c * 0.297484581451966704) / (1 + b * 0.297484581451966704)
    + 0.097618652104113888 * exp(-c * 0.420025381681005637) / (1 + b * 0.420025381681005637)
    + 0.086190161531953276 * exp(-c * 0.547783818959808643) / (1 + b * 0.547783818959808643)
    + 0.073346481411080306 * exp(-c * 0.672403257001144884) / (1 + b * 0.672403257001144884)
    + 0.059298584915436781 * exp(-c * 0.785732486514490019) / (1 + b * 0.785732486514490019)
    + 0.044277438817419806 * exp(-c * 0.880359134935928860) / (1 + b * 0.880359134935928860)
    + 0.028531388628933663 * exp(-c * 0.950095757825914233) / (1 + b * 0.950095757825914233)
    + 0.012341229799987200 * exp(-c * 0.990397602845399791) / (1 + b * 0.990397602845399791))) / (2 * pi());
end $$;

-- (1 - exp(-r^2 / 2)) / r^2, of which the standard normal distribution in a triangle with the origin is the integral
-- over the opposite edge.
create or replace function semap.mass_to(p_r2 double precision) returns double precision
language sql immutable parallel safe as $$
  select (1 - exp(-p_r2 / 2)) / p_r2
$$;

-- How much of the standard normal distribution in the plane lies in the triangle of the origin and an edge, negative
-- where the edge goes around the origin clockwise; these add up to what lies in a ring.
create or replace function semap.edge_probability(
  p_u1 double precision, p_v1 double precision, p_u2 double precision, p_v2 double precision
) returns double precision
language plpgsql immutable parallel safe as $$
declare
  v_du      double precision := p_u2 - p_u1;
  v_dv      double precision := p_v2 - p_v1;
  v_length  double precision := sqrt(v_du * v_du + v_dv * v_dv);
  v_cross   double precision := p_u1 * p_v2 - p_u2 * p_v1;
  v_h       double precision;
  v_t1      double precision;
  v_t2      double precision;
  a         double precision;
  b         double precision;
  c         double precision;
begin
  if v_cross = 0 or v_length = 0 then
    return 0;
  end if;
  v_h := abs(v_cross) / v_length;
  v_t1 := (p_u1 * v_du + p_v1 * v_dv) / v_length;
  v_t2 := (p_u2 * v_du + p_v2 * v_dv) / v_length;
  if v_h > 9 or v_t1 > 9 or v_t2 < -9 then
    -- nearly all of the distribution is nearer than the edge: what counts is the angle under which the edge is seen
    return atan2(v_cross, p_u1 * p_u2 + p_v1 * p_v2) / (2 * pi());
  elsif v_length < 0.5 and v_h * v_h + v_t1 * v_t1 > 1 then
    -- a short edge not near the origin: Gauss-Legendre quadrature with six points, exact to 1e-16
    a := p_u1 * p_u1 + p_v1 * p_v1;
    b := 2 * v_t1 * v_length;
    c := v_length * v_length;
    return v_cross / (2 * pi())
      * (0.085662246189585173 * (semap.mass_to(a + 0.033765242898423986 * (b + 0.033765242898423986 * c))
                               + semap.mass_to(a + 0.966234757101576014 * (b + 0.966234757101576014 * c)))
       + 0.180380786524069304 * (semap.mass_to(a + 0.169395306766867743 * (b + 0.169395306766867743 * c))
                               + semap.mass_to(a + 0.830604693233132257 * (b + 0.830604693233132257 * c)))
       + 0.233956967286345524 * (semap.mass_to(a + 0.380690406958401546 * (b + 0.380690406958401546 * c))
                               + semap.mass_to(a + 0.619309593041598454 * (b + 0.619309593041598454 * c))));
  end if;
  return sign(v_cross) * (semap.triangle_probability(v_h, v_t2) - semap.triangle_probability(v_h, v_t1));
end $$;

-- The edges of an area, which lies to the left of each, in coordinates u = ux (x - x0) + uy (y - y0) and v likewise. A
-- coordinate below 1e-76 m becomes 0.
create or replace function semap.edges_seen_from(
  p_shape public.geometry, p_x0_m double precision, p_y0_m double precision,
  p_ux double precision, p_uy double precision, p_vx double precision, p_vy double precision
) returns table (u1 double precision, v1 double precision, u2 double precision, v2 double precision)
language sql immutable parallel safe as $$
  select p_ux * x1 + p_uy * y1, p_vx * x1 + p_vy * y1, p_ux * x2 + p_uy * y2, p_vx * x2 + p_vy * y2
  from (select st_x(a) - p_x0_m + 1e-60 - 1e-60 as x1, st_y(a) - p_y0_m + 1e-60 - 1e-60 as y1,
               st_x(b) - p_x0_m + 1e-60 - 1e-60 as x2, st_y(b) - p_y0_m + 1e-60 - 1e-60 as y2
        from (select st_startpoint(geom) as a, st_endpoint(geom) as b
              from st_dumpsegments(st_forcepolygonccw(p_shape))) s) e
$$;

-- How probable it is that a position lies in an area whose error, of this covariance [m^2], is along one direction
-- only. `least` and `most` are for lines a billionth of its standard deviation to either side, which may run along an
-- edge.
create or replace function semap.probability_on_line(
  p_shape public.geometry, p_x_m double precision, p_y_m double precision,
  p_cov_xx_m2 double precision, p_cov_xy_m2 double precision, p_cov_yy_m2 double precision,
  out probability double precision, out "least" double precision, out most double precision
)
language plpgsql immutable parallel safe as $$
declare
  c_along     constant double precision := (p_cov_xx_m2 + p_cov_yy_m2) / 2
                + sqrt(((p_cov_xx_m2 - p_cov_yy_m2) / 2) ^ 2 + p_cov_xy_m2 * p_cov_xy_m2);
  c_axis      constant double precision[] := case when p_cov_xx_m2 >= p_cov_yy_m2
                then array[c_along - p_cov_yy_m2, p_cov_xy_m2] else array[p_cov_xy_m2, c_along - p_cov_xx_m2] end;
  c_scale     constant double precision := sqrt(c_along / (c_axis[1] * c_axis[1] + c_axis[2] * c_axis[2]));
  c_std_x_m   constant double precision := c_scale * c_axis[1];
  c_std_y_m   constant double precision := c_scale * c_axis[2];
  c_variance  constant double precision := c_std_x_m * c_std_x_m + c_std_y_m * c_std_y_m;
begin
  -- the line comes in where an edge leads down, and goes out where one leads up
  select avg(held), min(held) - 1e-12, max(held) + 1e-12 into probability, "least", most
  from unnest(array[-1e-9 * c_variance, 1e-9 * c_variance]) as aside,
       lateral (select coalesce(sum(case when v1 > aside then -1 else 1 end
                                    * semap.normal_cdf(u1 + (u2 - u1) * ((aside - v1) / (v2 - v1)))), 0) as held
                from semap.edges_seen_from(p_shape, p_x_m, p_y_m, c_std_x_m / c_variance, c_std_y_m / c_variance,
                                           -c_std_y_m, c_std_x_m)
                where (v1 > aside) <> (v2 > aside)) s;
end $$;

-- How probable it is that a position with a Gaussian error of this covariance [m^2] lies in a polygon or polygons,
-- whose holes are outside: the integral, edge by edge, and between what bounds it is, whatever was rounded. Without an
-- error it is 1 or 0, as ST_Contains says. Deviations below a nanometre count as none; where one is below a millionth
-- of the other, the position is on a line.
create or replace function semap.probability_inside(
  p_shape public.geometry, p_x_m double precision, p_y_m double precision,
  p_cov_xx_m2 double precision, p_cov_xy_m2 double precision, p_cov_yy_m2 double precision,
  out probability double precision, out "least" double precision, out most double precision
)
language plpgsql immutable parallel safe set plan_cache_mode = force_generic_plan as $$
declare
  -- below 1e-30 is 0, so that no product of two is too small
  c_xx        constant double precision := case when p_cov_xx_m2 between 0 and 1e-30 then 0 else p_cov_xx_m2 end;
  c_yy        constant double precision := case when p_cov_yy_m2 between 0 and 1e-30 then 0 else p_cov_yy_m2 end;
  c_xy        constant double precision := case when abs(p_cov_xy_m2) <= 1e-30 then 0 else p_cov_xy_m2 end;
  c_trace     constant double precision := c_xx + c_yy;
  c_det       constant double precision := c_xx * c_yy - c_xy * c_xy;
  v_shape     public.geometry := p_shape;
  v_distance  double precision;
  v_skew      double precision;
  v_error     double precision;
begin
  if p_shape is null or p_x_m is null or p_y_m is null then
    return;
  elsif not (c_xx >= 0 and c_yy >= 0 and c_trace < 1e30 and c_det >= -1e-6 * c_trace * c_trace) then
    raise exception 'The covariance (%, %; %) is none of a position.', p_cov_xx_m2, p_cov_xy_m2, p_cov_yy_m2
      using errcode = 'invalid_parameter_value', hint = 'Give xx, xy and yy in square metres, with xy^2 <= xx yy.';
  elsif c_trace + c_xy is null or c_trace < 1e-18 then
    probability := st_contains(p_shape, st_point(p_x_m, p_y_m))::integer;
    "least" := probability;
    most := probability;
    return;
  elsif geometrytype(p_shape) not in ('POLYGON', 'MULTIPOLYGON') then
    raise exception 'A % holds no position.', geometrytype(p_shape)
      using errcode = 'invalid_parameter_value', hint = 'Give a polygon or a multipolygon.';
  end if;
  v_distance := semap.signed_distance_m(p_shape, p_x_m, p_y_m);
  if abs(v_distance) > 9 * sqrt(c_trace) then
    -- the distribution beyond nine standard deviations is less than 1e-17
    probability := (v_distance > 0)::integer;
    "least" := probability - 1e-15;
    most := probability + 1e-15;
  elsif c_det <= 1e-12 * c_trace * c_trace then
    select l.probability, l."least", l.most into probability, "least", most
    from semap.probability_on_line(p_shape, p_x_m, p_y_m, c_xx, c_xy, c_yy) l;
  else
    if st_npoints(v_shape) > 50 then
      v_shape := st_clipbybox2d(v_shape, st_makeenvelope(p_x_m - 9 * sqrt(c_xx), p_y_m - 9 * sqrt(c_yy),
                                                         p_x_m + 9 * sqrt(c_xx), p_y_m + 9 * sqrt(c_yy))::box2d);
    end if;
    -- in coordinates in which the error is alike in all directions, and of one; v_error is what is rounded
    v_skew := sqrt(c_xx * c_yy / c_det);
    select coalesce(sum(semap.edge_probability(u1, v1, u2, v2)), 0),
           coalesce(sum(4e-15 * v_skew * (v_skew + greatest(abs(u1), abs(v1), abs(u2), abs(v2)))), 0)
    into probability, v_error
    from semap.edges_seen_from(v_shape, p_x_m, p_y_m, 1 / sqrt(c_xx), 0, -c_xy / sqrt(c_xx * c_det),
                               sqrt(c_xx / c_det));
    "least" := probability - v_error - 1e-15;
    most := probability + v_error + 1e-15;
  end if;
  probability := least(1, greatest(0, probability));
  "least" := least(1, greatest(0, "least"));
  most := least(1, greatest(0, most));
end $$;
