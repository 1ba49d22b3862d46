-- Make the partitions of track_state for these days (UTC) ahead of their states. A day whose states
-- already lie in the default partition stays there.
create or replace function semap.ensure_partitions(p_days date[]) returns void
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_day   date;
  v_from  timestamptz;
  v_name  text;
begin
  perform pg_advisory_xact_lock(7365, 0);
  foreach v_day in array p_days loop
    v_from := v_day::timestamp at time zone 'UTC';
    v_name := 'track_state_' || to_char(v_day, 'YYYYMMDD');
    continue when to_regclass('semap.' || v_name) is not null;
    continue when exists (select from semap.track_state_default
                          where stamp >= v_from and stamp < v_from + interval '1 day');
    execute format('create table semap.%I partition of semap.track_state for values from (%L) to (%L)',
                   v_name, v_from, v_from + interval '1 day');
  end loop;
end $$;
comment on function semap.ensure_partitions is
  'Make the partitions of track_state for these days (UTC) ahead of their states.';
