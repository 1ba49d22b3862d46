-- The states that packed rows hold. The arrays of a row are taken out of where they are stored once, by adding nothing
-- to them, and what a state says is made out of them only where its stamp is wanted.
create or replace view semap.packed_state as
  select p.track_id,
         p.from_stamp + interval '1 us' * (
           (n - 1)::bigint * p.span_us / greatest(p.states - 1, 1)
           + ((a.off_high[n]::integer << 16) | (a.off_low[n]::integer & 65535)) - 32768) as stamp,
         semap.number_of(a.x_high[n], a.x_middle[n], a.x_low[n]) as x_m,
         semap.number_of(a.y_high[n], a.y_middle[n], a.y_low[n]) as y_m,
         a.z_m[n] as z_m, a.std_m[n] as std_m, coalesce(a.is_last[n], false) as is_last,
         a.heading_rad[n] as heading_rad, a.speed_mps[n] as speed_mps, a.length_m[n] as length_m,
         a.width_m[n] as width_m,
         p.from_stamp, p.to_stamp, a.std_across_m[n] as std_across_m, a.std_yaw_rad[n] as std_yaw_rad
  from semap.track_state_packed p
  cross join lateral (
    select p.off_high || '{}' as off_high, p.off_low || '{}' as off_low,
           p.x_high || '{}' as x_high, p.x_middle || '{}' as x_middle, p.x_low || '{}' as x_low,
           p.y_high || '{}' as y_high, p.y_middle || '{}' as y_middle, p.y_low || '{}' as y_low,
           p.z_m || '{}' as z_m, p.std_m || '{}' as std_m, p.is_last || '{}' as is_last,
           p.heading_rad || '{}' as heading_rad, p.speed_mps || '{}' as speed_mps,
           p.length_m || '{}' as length_m, p.width_m || '{}' as width_m,
           p.std_across_m || '{}' as std_across_m, p.std_yaw_rad || '{}' as std_yaw_rad
    offset 0) a
  cross join lateral generate_series(1, p.states) n;

-- Every state, be it in a frame, a row, or packed, with the stretch of time of the row that holds it. What is looked
-- for in a stretch of time, from a to b, has to say so twice, since no index knows what a packed row holds:
--   stamp >= a and stamp <= b and from_stamp > a - interval '30 min' and from_stamp <= b and to_stamp >= a
create or replace view semap.stored_state as
  select track_id, stamp, x_m, y_m, z_m, std_m, is_last, heading_rad, speed_mps, length_m, width_m,
         stamp as from_stamp, stamp as to_stamp, std_across_m, std_yaw_rad
  from semap.track_state
  union all
  select * from semap.packed_state
  union all
  select track_id, stamp, x_m, y_m, z_m, std_m, is_last, heading_rad, speed_mps, length_m, width_m,
         from_stamp, to_stamp, std_across_m, std_yaw_rad
  from semap.framed_state;
