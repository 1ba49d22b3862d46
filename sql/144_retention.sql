-- What has grown old, by event time and by semap.retention. Each of these is one short step, in a transaction of its
-- own, that semap.store.operate.maintenance takes again and again; none does what the settings do not say, whoever
-- calls it. What is dropped goes by whole days (UTC). A partition is dropped as it is: to detach it before, without
-- waiting for all who use its table, is not possible where there is a default partition. Whoever drops waits only
-- shortly for a lock, and tries again.

-- The start of the oldest day of a kind that is kept; null where all is kept.
create or replace function semap.kept_since(p_kind text) returns timestamptz
language sql stable as $$
  select date_trunc('day', (clock_timestamp() - drop_after) at time zone 'UTC') at time zone 'UTC'
  from semap.retention where kind = p_kind
$$;

-- The partitions of state_chunk and line_observation that are of one day, with when they were made.
create or replace function semap.day_partitions()
returns table (of_table text, day date, partition regclass, made_at timestamptz)
language sql stable set search_path = pg_catalog, pg_temp as $$
  select p.relname::text, to_date(right(c.relname::text, 8), 'YYYYMMDD'), c.oid::regclass,
         substring(obj_description(c.oid, 'pg_class') from 'Made at (.*)')::timestamptz
  from pg_inherits i
  join pg_class p on p.oid = i.inhparent
  join pg_class c on c.oid = i.inhrelid
  where p.oid in ('semap.state_chunk'::regclass, 'semap.line_observation'::regclass)
    and c.relname ~ ('^' || p.relname || '_[0-9]{8}$')
$$;

-- Note that what is older than a moment has been dropped.
create or replace function semap.note_gone(p_kind text, p_before timestamptz) returns void
language sql as $$
  update semap.retention set gone_before = p_before
  where kind = p_kind and coalesce(gone_before, '-infinity') < p_before
$$;

-- Drop the partition of a day that is past: one without rows that was not made just now, or one that is not to be kept.
-- Says whether it did. Who writes to that very day waits while it is looked at.
create or replace function semap.drop_day(p_table text, p_day date) returns boolean
language plpgsql security definer set search_path = pg_catalog, pg_temp as $$
declare
  v_kind       text := case p_table when 'state_chunk' then 'states' else 'lines' end;
  v_partition  record;
  v_is_used    boolean := false;
begin
  select * into v_partition from semap.day_partitions() where of_table = p_table and day = p_day;
  if not found or p_day >= (clock_timestamp() at time zone 'UTC')::date then
    return false;
  end if;
  if p_day + 1 <= (semap.kept_since(v_kind) at time zone 'UTC')::date then
    perform semap.note_gone(v_kind, (p_day + 1)::timestamp at time zone 'UTC');
  elsif v_partition.made_at > clock_timestamp() - interval '1 hour' then
    return false; -- by somebody who is about to write to it
  else
    execute format('lock table %s in share row exclusive mode', v_partition.partition);
    execute format('select exists (select from %s)', v_partition.partition) into v_is_used;
  end if;
  if not v_is_used then
    execute format('drop table %s', v_partition.partition);
  end if;
  return not v_is_used;
end $$;

-- Delete at most so many rows of a kind that are not to be kept, and say how many there were; of states and lines those
-- that lie in no partition of their day, and packed ones, each of which counts as one row; reports of cameras go with
-- lines. Changes that rules may not have read for good stay: the worker gives those of its last minutes to the rules
-- again where its slot was lost.
create or replace function semap.drop_rows(p_kind text, p_most integer) returns bigint
language plpgsql security definer
set search_path = pg_catalog, pg_temp set plan_cache_mode = force_custom_plan as $$
declare
  v_before   timestamptz := semap.kept_since(p_kind);
  v_ids      uuid[];
  v_rows     bigint := 0;
  v_reports  bigint;
begin
  if v_before is null then
    return 0;
  end if;
  case p_kind
    when 'states' then
      delete from semap.state_chunk_default where ctid = any (array(
        select ctid from semap.state_chunk_default where from_stamp < v_before limit p_most));
      get diagnostics v_rows = row_count;
    when 'lines' then
      delete from semap.line_observation_default where ctid = any (array(
        select ctid from semap.line_observation_default where stamp < v_before limit p_most));
      get diagnostics v_rows = row_count;
      delete from semap.camera_report where ctid = any (array(
        select ctid from semap.camera_report where stamp < v_before limit p_most - v_rows));
      get diagnostics v_reports = row_count;
      v_rows := v_rows + v_reports;
    when 'changes' then
      delete from semap.relation_change where change_id = any (array(
        select c.change_id from semap.map m cross join lateral (
          select change_id from semap.relation_change
          where map_id = m.map_id and stamp < v_before
            and received_at < (select updated_at - interval '1 hour' from semap.progress where worker = 'rules')
          order by stamp limit p_most) c
        limit p_most));
      get diagnostics v_rows = row_count;
    when 'events' then
      v_ids := array(
        select e.event_id from semap.place m cross join lateral (
          select event_id from semap.event where map_id = m.map_id and stamp < v_before order by stamp limit p_most) e
        limit p_most);
      delete from semap.event_evidence where event_id = any (v_ids);
      delete from semap.event where event_id = any (v_ids);
      get diagnostics v_rows = row_count;
  end case;
  if v_rows > 0 then
    perform semap.note_gone(p_kind, v_before);
  end if;
  return v_rows;
end $$;
