-- Poses: a translation [m] and a unit quaternion (x y z w) of a child frame in its parent frame, right-handed.
-- `parent_T_child` maps points of the child frame to the parent. The identity keeps every number as it is.
-- What is called for every instance is PL/pgSQL: a function in SQL that cannot be inlined costs ten times as much.

-- A number of a pose, with zero for what is too small to move anything: PostgreSQL refuses products that underflow.
create or replace function semap.snapped(p_part double precision) returns double precision
language sql immutable parallel safe as $$
  select case when abs(p_part) < 1e-30 then 0 else p_part end
$$;

-- A point of the child frame in the parent frame: v + 2 w (q x v) + 2 q x (q x v), moved.
create or replace function semap.carry(
  p_pose semap.pose, p_x_m double precision, p_y_m double precision, p_z_m double precision,
  out x_m double precision, out y_m double precision, out z_m double precision
) language sql immutable parallel safe as $$
  select p_x_m + 2 * ((p_pose).qw * cx + (p_pose).qy * cz - (p_pose).qz * cy) + (p_pose).x_m,
         p_y_m + 2 * ((p_pose).qw * cy + (p_pose).qz * cx - (p_pose).qx * cz) + (p_pose).y_m,
         p_z_m + 2 * ((p_pose).qw * cz + (p_pose).qx * cy - (p_pose).qy * cx) + (p_pose).z_m
  from (select (p_pose).qy * p_z_m - (p_pose).qz * p_y_m as cx,
               (p_pose).qz * p_x_m - (p_pose).qx * p_z_m as cy,
               (p_pose).qx * p_y_m - (p_pose).qy * p_x_m as cz) c
$$;

-- a_T_c from a_T_b and b_T_c.
create or replace function semap.compose(p_a_t_b semap.pose, p_b_t_c semap.pose) returns semap.pose
language plpgsql immutable parallel safe as $$
declare
  ax  double precision := p_a_t_b.qx;
  ay  double precision := p_a_t_b.qy;
  az  double precision := p_a_t_b.qz;
  aw  double precision := p_a_t_b.qw;
  ux  double precision := p_b_t_c.qx;
  uy  double precision := p_b_t_c.qy;
  uz  double precision := p_b_t_c.qz;
  uw  double precision := p_b_t_c.qw;
  x   double precision := p_b_t_c.x_m;
  y   double precision := p_b_t_c.y_m;
  z   double precision := p_b_t_c.z_m;
  cx  double precision := ay * z - az * y;
  cy  double precision := az * x - ax * z;
  cz  double precision := ax * y - ay * x;
  qx  double precision := aw * ux + ax * uw + ay * uz - az * uy;
  qy  double precision := aw * uy - ax * uz + ay * uw + az * ux;
  qz  double precision := aw * uz + ax * uy - ay * ux + az * uw;
  qw  double precision := aw * uw - ax * ux - ay * uy - az * uz;
  length  double precision := sqrt(qx * qx + qy * qy + qz * qz + qw * qw);
begin
  return row(semap.snapped(x + 2 * (aw * cx + ay * cz - az * cy) + p_a_t_b.x_m),
             semap.snapped(y + 2 * (aw * cy + az * cx - ax * cz) + p_a_t_b.y_m),
             semap.snapped(z + 2 * (aw * cz + ax * cy - ay * cx) + p_a_t_b.z_m),
             semap.snapped(qx / length), semap.snapped(qy / length),
             semap.snapped(qz / length), semap.snapped(qw / length))::semap.pose;
end $$;

-- child_T_parent from parent_T_child.
create or replace function semap.inverse(p_pose semap.pose) returns semap.pose
language sql immutable parallel safe as $$
  select row(-semap.snapped(turned.x_m), -semap.snapped(turned.y_m), -semap.snapped(turned.z_m), -(p_pose).qx,
             -(p_pose).qy, -(p_pose).qz, (p_pose).qw)::semap.pose
  from semap.carry(row(0, 0, 0, -(p_pose).qx, -(p_pose).qy, -(p_pose).qz, (p_pose).qw)::semap.pose,
                   (p_pose).x_m, (p_pose).y_m, (p_pose).z_m) turned
$$;

-- The pose between two: translation by proportion, rotation by slerp on the shorter way (Shoemake 1985).
create or replace function semap.interpolate(p_from semap.pose, p_to semap.pose, p_part double precision)
returns semap.pose
language sql immutable parallel safe as $$
  select row(semap.snapped((p_from).x_m + p_part * ((p_to).x_m - (p_from).x_m)),
             semap.snapped((p_from).y_m + p_part * ((p_to).y_m - (p_from).y_m)),
             semap.snapped((p_from).z_m + p_part * ((p_to).z_m - (p_from).z_m)),
             semap.snapped(qx / length), semap.snapped(qy / length),
             semap.snapped(qz / length), semap.snapped(qw / length))::semap.pose
  from (select (p_from).qx * (p_to).qx + (p_from).qy * (p_to).qy
             + (p_from).qz * (p_to).qz + (p_from).qw * (p_to).qw as cosine) c,
       lateral (select acos(least(1, abs(cosine))) as angle, case when cosine < 0 then -1 else 1 end as side) t,
       lateral (select case when angle < 1e-6 then 1 - p_part else sin((1 - p_part) * angle) / sin(angle) end as a,
                       side * case when angle < 1e-6 then p_part else sin(p_part * angle) / sin(angle) end as b) w,
       lateral (select a * (p_from).qx + b * (p_to).qx as qx, a * (p_from).qy + b * (p_to).qy as qy,
                       a * (p_from).qz + b * (p_to).qz as qz, a * (p_from).qw + b * (p_to).qw as qw) q,
       lateral (select sqrt(qx * qx + qy * qy + qz * qz + qw * qw) as length) l
$$;

-- Whether the child's z axis points up, so that an outline stays an outline.
create or replace function semap.is_upright(p_pose semap.pose) returns boolean
language sql immutable parallel safe as $$
  select abs(2 * ((p_pose).qx * (p_pose).qz - (p_pose).qw * (p_pose).qy)) < 1e-9
     and abs(2 * ((p_pose).qy * (p_pose).qz + (p_pose).qw * (p_pose).qx)) < 1e-9
     and (p_pose).qx * (p_pose).qx + (p_pose).qy * (p_pose).qy < 0.5
$$;

-- The pose of a yaw [rad] about z, counter-clockwise, at a point.
create or replace function semap.pose_from_yaw(
  p_x_m double precision, p_y_m double precision, p_z_m double precision default 0, p_yaw_rad double precision default 0
) returns semap.pose
language sql immutable parallel safe as $$
  select row(p_x_m, p_y_m, p_z_m, 0, 0, sin(p_yaw_rad / 2), cos(p_yaw_rad / 2))::semap.pose
$$;

-- The heading of a child frame: the yaw [rad] of its x axis in the parent's xy plane.
create or replace function semap.yaw(p_pose semap.pose) returns double precision
language sql immutable parallel safe as $$
  select atan2(2 * ((p_pose).qw * (p_pose).qz + (p_pose).qx * (p_pose).qy),
               1 - 2 * ((p_pose).qy * (p_pose).qy + (p_pose).qz * (p_pose).qz))
$$;

-- A geometry of the child frame in the parent frame; a flat one stays flat, its projection.
create or replace function semap.placed(p_geometry public.geometry, p_pose semap.pose) returns public.geometry
language plpgsql immutable parallel safe as $$
declare
  qx  double precision := p_pose.qx;
  qy  double precision := p_pose.qy;
  qz  double precision := p_pose.qz;
  qw  double precision := p_pose.qw;
begin
  if p_pose = row(0, 0, 0, 0, 0, 0, 1)::semap.pose then
    return p_geometry;
  elsif public.st_zmflag(p_geometry) = 2 then
    return public.st_affine(p_geometry,
      1 - 2 * (qy * qy + qz * qz), 2 * (qx * qy - qz * qw), 2 * (qx * qz + qy * qw),
      2 * (qx * qy + qz * qw), 1 - 2 * (qx * qx + qz * qz), 2 * (qy * qz - qx * qw),
      2 * (qx * qz - qy * qw), 2 * (qy * qz + qx * qw), 1 - 2 * (qx * qx + qy * qy),
      p_pose.x_m, p_pose.y_m, p_pose.z_m);
  end if;
  return public.st_affine(p_geometry,
    1 - 2 * (qy * qy + qz * qz), 2 * (qx * qy - qz * qw),
    2 * (qx * qy + qz * qw), 1 - 2 * (qx * qx + qz * qz),
    p_pose.x_m, p_pose.y_m);
end $$;
