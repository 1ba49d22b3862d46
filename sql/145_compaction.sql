-- Chunks of many tracks at one stamp, which is how states come, are compacted to chunks of one track each, once: a
-- track is then read without the others, and takes a fifth of the room of a row of columns. It is done in the
-- background, by the worker, for some minutes of a source at once, and in one transaction, so that each reader sees
-- each state once.

-- Compact the oldest states of a source whose positions are flushed: of one half hour of the clock, of 240 stamps at
-- most and of so many at least, unless no more are to come in that half hour. Says of how many states.
create or replace function semap.compact_states(p_source_id integer, p_least_stamps integer default 240) returns bigint
language plpgsql security definer set search_path = pg_catalog, pg_temp set work_mem = '256MB' as $$
declare
  c_most_stamps  constant integer := 240;
  c_most_states  constant bigint := 2000000;
  v_count        semap.source_count;
  v_from         timestamptz;
  v_to           timestamptz;
  v_stamps       integer;
  v_states       bigint;
begin
  perform pg_advisory_xact_lock(7374, p_source_id);
  select * into v_count from semap.source_count where source_id = p_source_id;
  v_count.flushed_stamp := coalesce(v_count.flushed_stamp, 'infinity'); -- it is gone
  select min(from_stamp) into v_from
  from semap.state_chunk where source_id = p_source_id and track_id is null and from_stamp <= v_count.flushed_stamp;
  if v_from is null then
    return 0;
  end if;
  select max(from_stamp), count(*), max(total) into v_to, v_stamps, v_states from (
    select from_stamp, sum(states) as states, sum(sum(states)) over (order by from_stamp) as total
    from semap.state_chunk
    where source_id = p_source_id and track_id is null and from_stamp >= v_from and from_stamp <= v_count.flushed_stamp
      and from_stamp < semap.half_hour(v_from) + interval '30 min'
    group by from_stamp order by from_stamp limit c_most_stamps) s
  where total - states < c_most_states;
  if v_stamps < p_least_stamps and v_states < c_most_states
     and v_count.newest_stamp < semap.half_hour(v_from) + interval '30 min'
     and v_count.received_at > clock_timestamp() - interval '30 min' then
    return 0;
  end if;
  with taken as (
    delete from semap.state_chunk c
    where source_id = p_source_id and track_id is null and from_stamp >= v_from and from_stamp <= v_to
    returning c as chunk
  )
  insert into semap.state_chunk
  select c.* from (select array_agg(chunk order by (chunk).from_stamp) as chunks from taken) t
  cross join lateral semap.chunks_of_tracks(t.chunks) c;
  return v_states;
end $$;

-- Compact all states of these sources. Whoever calls it keeps their writers out.
create or replace function semap.compact_all(p_source_ids integer[]) returns void
language plpgsql as $$
declare
  v_source_id  integer;
begin
  perform semap.flush_positions(p_source_ids);
  foreach v_source_id in array p_source_ids loop
    while semap.compact_states(v_source_id, 0) > 0 loop
    end loop;
  end loop;
end $$;

-- Compact what there is to compact of all sources: of how many states.
create or replace function semap.compact() returns bigint
language sql security definer set search_path = pg_catalog, pg_temp as $$
  select coalesce(sum(semap.compact_states(source_id)), 0) from (
    select distinct source_id from semap.state_chunk where track_id is null) s
$$;
