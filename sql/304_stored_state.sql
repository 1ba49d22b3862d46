-- Every state, be it a row or packed. What is looked for in a stretch of time, from a to b, has to say so twice, since no
-- index knows what a packed row holds:
--   stamp >= a and stamp <= b and from_stamp > a - interval '30 min' and from_stamp <= b and to_stamp >= a
create or replace view semap.stored_state as
  select track_id, stamp, x_m, y_m, z_m, std_m, is_last, heading_rad, speed_mps, length_m, width_m,
         stamp as from_stamp, stamp as to_stamp
  from semap.track_state
  union all
  select s.*, p.from_stamp, p.to_stamp
  from semap.track_state_packed p cross join lateral semap.states_in(p) s;
comment on view semap.stored_state is
  'Every state, be it a row or packed, with the stretch of time of the row that holds it.';
