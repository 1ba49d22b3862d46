-- A line that a source saw may be the leaf of a door. It is, where it lies in the leaf's range of motion, shows enough
-- of the leaf, and points at its hinge as exactly as both are known. What else lies there does not: legs are short, and
-- the faces of walls, jambs and furniture miss the hinge or reach out of the range.

-- The leaves that a line may be, each with the angle to its closed reference. A height that is not known fits any door.
-- The hinge is known to 3 cm, and a leaf is seen at its face: lines that miss it by more than three standard
-- deviations, or by 15 cm, are something else. A line whose direction is not known to 2 degrees says nothing: it is
-- what is left of a leaf behind somebody's legs, or the legs.
create or replace function semap.leaves_seen(
  p_map_id integer, p_x1_m double precision, p_y1_m double precision, p_x2_m double precision, p_y2_m double precision,
  p_z_m double precision, p_angle_std_rad double precision, p_offset_std_m double precision
) returns table (
  instance_id bigint, angle_rad double precision, angle_std_rad double precision, length_m double precision,
  miss_m double precision
)
language sql stable parallel safe rows 1 as $$
  select t.instance_id, t.angle_rad, p_angle_std_rad, t.length_m, abs(t.aside_m)
  from (
    select h.*, h.sense * atan2(sin(d.turned_rad), cos(d.turned_rad)) as angle_rad
    from (
      select u.*, (u.along_x_m * u.x_m + u.along_y_m * u.y_m) / u.length_m as along_m,
             (u.along_x_m * u.y_m - u.along_y_m * u.x_m) / u.length_m as aside_m
      from (
        select l.*, p_x2_m - p_x1_m as along_x_m, p_y2_m - p_y1_m as along_y_m,
               sqrt((p_x2_m - p_x1_m) ^ 2 + (p_y2_m - p_y1_m) ^ 2) as length_m,
               (p_x1_m + p_x2_m) / 2 - l.hinge_x_m as x_m, (p_y1_m + p_y2_m) / 2 - l.hinge_y_m as y_m
        from (
          select instance_id, hinge_x_m, hinge_y_m, closed_rad, sense, width_m, max_rad
          from semap.door_leaf
          where public.st_contains(range_of_motion,
                                   public.st_makeline(public.st_point(p_x1_m, p_y1_m), public.st_point(p_x2_m, p_y2_m)))
            and map_id = p_map_id and (p_z_m is null or p_z_m >= z_min_m and p_z_m < z_max_m)
          offset 0 -- each line looks into the index by itself, whatever is known of the table
        ) l
        offset 0 -- and here, so that each term is computed once
      ) u
      offset 0
    ) h
    cross join lateral (
      select atan2(sign(h.along_m) * h.along_y_m, sign(h.along_m) * h.along_x_m) - h.closed_rad as turned_rad) d
    offset 0
  ) t
  where p_angle_std_rad <= radians(2)
    and t.length_m >= greatest(0.25, 0.3 * t.width_m)
    and abs(t.along_m) >= t.length_m / 2 - 0.12
    and abs(t.aside_m) <= 0.15
    and t.aside_m ^ 2 <= 9 * (p_offset_std_m ^ 2 + (t.along_m * p_angle_std_rad) ^ 2 + 0.03 ^ 2)
    and t.angle_rad between radians(-15) and t.max_rad + radians(15)
$$;
