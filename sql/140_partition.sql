-- Make the partitions of state_chunk and line_observation for these days (UTC) ahead of their rows. A day that has
-- rows in a default partition stays there, and so do all where there are more than 400 days. A partition is made on
-- its own and then attached, so that writers and readers of other days go on meanwhile. Attaching locks the default
-- partition of its table: whoever locks both tables takes state_chunk first.
create or replace function semap.ensure_partitions(p_days date[]) returns void
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_day    date;
  v_from   timestamptz;
  v_table  text;
  v_name   text;
begin
  if cardinality(p_days) > 400 then
    return;
  end if;
  perform pg_advisory_xact_lock(7365, 0);
  foreach v_day in array p_days loop
    v_from := v_day::timestamp at time zone 'UTC';
    foreach v_table in array array['state_chunk', 'line_observation'] loop
      v_name := v_table || '_' || to_char(v_day, 'YYYYMMDD');
      continue when to_regclass('semap.' || v_name) is not null;
      begin
        execute format('create table semap.%I (like semap.%I including all)', v_name, v_table);
        execute format('alter table semap.%I attach partition semap.%I for values from (%L) to (%L)',
                       v_table, v_name, v_from, v_from + interval '1 day');
        execute format('comment on table semap.%I is %L', v_name, 'Made at ' || clock_timestamp());
      exception when check_violation then
        null; -- rows of this day lie in the default partition
      end;
    end loop;
  end loop;
end $$;
