-- States that came together. A row of semap.track_state_frame holds those of all tracks that a source follows, at one moment;
-- sql/146 takes it, and makes rows of semap.track_state of it soon after.

-- The states that frames hold, as rows.
create or replace view semap.framed_state as
  select s.track_id, f.stamp, s.x_m, s.y_m, s.z_m, s.std_m, false as is_last,
         s.heading_rad, s.speed_mps, s.length_m, s.width_m, f.stamp as from_stamp, f.stamp as to_stamp,
         s.std_across_m, s.std_yaw_rad, f.source_id
  from semap.track_state_frame f
  cross join lateral unnest(
    f.track_ids, f.x_m, f.y_m, f.z_m, f.std_m, f.heading_rad, f.speed_mps, f.length_m, f.width_m, f.std_across_m, f.std_yaw_rad)
    s (track_id, x_m, y_m, z_m, std_m, heading_rad, speed_mps, length_m, width_m, std_across_m, std_yaw_rad);
comment on view semap.framed_state is
  'The states that frames hold, as rows.';
