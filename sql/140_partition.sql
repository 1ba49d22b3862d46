-- Attach tables that were made for days of state_chunk and line_observation. Who writes looks up the partition of a
-- row before locking it, so that a row of a day whose partition came in between would be refused: writers of all days
-- are kept out meanwhile. Whoever locks both tables takes state_chunk first. As who holds what is needed here may wait
-- for what is held here, it is not waited for as long as a deadlock takes to be seen.
create or replace function semap.attach_partitions(p_tables text[], p_days date[]) returns void
language plpgsql set lock_timeout = '200ms' as $$
declare
  v_name  text;
  v_from  timestamptz;
begin
  lock table semap.state_chunk, semap.line_observation in share row exclusive mode;
  for n in 1 .. cardinality(p_tables) loop
    v_name := p_tables[n] || to_char(p_days[n], '_YYYYMMDD');
    v_from := p_days[n]::timestamp at time zone 'UTC';
    begin
      execute format('alter table semap.%I attach partition semap.%I for values from (%L) to (%L)',
                     p_tables[n], v_name, v_from, v_from + interval '1 day');
      execute format('comment on table semap.%I is %L', v_name, 'Made at ' || clock_timestamp());
    exception when check_violation then
      execute format('drop table semap.%I', v_name); -- rows of this day lie in the default partition
    end;
  end loop;
end $$;

-- Make the partitions of state_chunk and line_observation for these days (UTC) ahead of their rows; false where the
-- tables were in use for so long that none was made. A day that has rows in a default partition stays there, and so do
-- all where there are more than 400 days. A partition is made on its own and then attached, which is short.
create or replace function semap.ensure_partitions(p_days date[]) returns boolean
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_table   text;
  v_day     date;
  v_tables  text[] := '{}';
  v_days    date[] := '{}';
begin
  if cardinality(p_days) > 400 then
    return true;
  end if;
  perform pg_advisory_xact_lock(7365, 0);
  foreach v_table in array array['state_chunk', 'line_observation'] loop
    foreach v_day in array p_days loop
      continue when to_regclass(format('semap.%I', v_table || to_char(v_day, '_YYYYMMDD'))) is not null;
      execute format('create table semap.%I (like semap.%I including all)',
                     v_table || to_char(v_day, '_YYYYMMDD'), v_table);
      v_tables := v_tables || v_table;
      v_days := v_days || v_day;
    end loop;
  end loop;
  if v_tables = '{}' then
    return true;
  end if;
  for v_attempt in 1 .. 10 loop
    begin
      perform semap.attach_partitions(v_tables, v_days);
      return true;
    exception when lock_not_available then
      perform pg_sleep(0.2 * random());
    end;
  end loop;
  raise lock_not_available; -- so that no table is left
exception when lock_not_available then
  return false;
end $$;
