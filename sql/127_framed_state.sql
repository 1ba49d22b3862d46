-- States that came together. A row of semap.track_state_frame holds those of all tracks that a source follows, at one moment;
-- sql/146 takes it, and makes rows of semap.track_state of it soon after.

-- The states of a frame, as rows.
create or replace function semap.states_of_frame(p_frame semap.track_state_frame) returns setof semap.track_state
language sql immutable parallel safe rows 1000 as $$
  select s.track_id, (p_frame).stamp, s.x_m, s.y_m, s.z_m, s.std_m, false,
         s.heading_rad, s.speed_mps, s.length_m, s.width_m, s.std_across_m, s.std_yaw_rad
  from unnest((p_frame).track_ids, (p_frame).x_m, (p_frame).y_m, (p_frame).z_m, (p_frame).std_m, (p_frame).heading_rad,
              (p_frame).speed_mps, (p_frame).length_m, (p_frame).width_m, (p_frame).std_across_m, (p_frame).std_yaw_rad)
    s (track_id, x_m, y_m, z_m, std_m, heading_rad, speed_mps, length_m, width_m, std_across_m, std_yaw_rad)
$$;

-- The states that frames hold, as rows.
create or replace view semap.framed_state as
  select s.track_id, f.stamp, s.x_m, s.y_m, s.z_m, s.std_m, s.is_last,
         s.heading_rad, s.speed_mps, s.length_m, s.width_m, f.stamp as from_stamp, f.stamp as to_stamp,
         s.std_across_m, s.std_yaw_rad, f.source_id
  from semap.track_state_frame f cross join lateral semap.states_of_frame(f) s;
