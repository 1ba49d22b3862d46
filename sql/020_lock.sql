-- Locks, in the order in which a transaction takes them, so that nobody waits in a circle:
--
--   1. regions (7363, 0): shared by whoever writes states, lines, sources, tracks; held alone by an edit of the map, by
--      whoever deletes, ends or renames tracks or sources by hand, by a repair, and by
--      a verification until it has its snapshot
--   2. sources (7364, source), each by one writer at a time; of several, in the order of their ids
--   3. pairs (7373, map), where a map has queries about pairs; of several, in the order of their ids
--   4. doors (7367, map), where lines or an edit move them
--   5. amendments of tracks (7368, 0)
--   6. rows: first those of the trigger's own tables by track, then source, source_count and recording
--   7. states that are compacted (7374, source): by the worker, which holds nothing else, or by whoever keeps the
--      writers of the source out already
--
-- Whoever takes a later one first and regions after it has to take regions at the beginning of the transaction.
-- Once held, regions are never waited for again, whoever is queued. The others stand by themselves and are never taken
-- while one of these is held, or by a connection that waits for none of these meanwhile:
--
--   7365, 0          partitions, made in a transaction of its own before states are written
--   7366             migrations and the rule worker's slot
--   7368, hash       a recording that is being brought in, by its map and source, as long as its connection lasts; only
--                    tried, never waited for
--   7369, job        a job, as long as it runs
--   7370, 0          maintenance, only tried
--   7371, 0          who delivers webhooks, only tried
--   7372             the number of webhooks
--   7375, 0          who answers queries that are asked for in SQL, shared, as long as its connection lasts
--   7376, hash       a bridge, by its map and name, as long as its connection lasts; only tried, never waited for
--
-- A trigger's statements see what was committed before its lock was granted, which holds only at READ COMMITTED.

-- Refuse a transaction whose statements do not see what was committed before their locks.
create or replace function semap.require_read_committed() returns void
language plpgsql as $$
begin
  if current_setting('transaction_isolation') <> 'read committed' then
    raise exception 'semap maintains relations at READ COMMITTED only, not at %.',
      upper(current_setting('transaction_isolation'))
      using errcode = 'invalid_transaction_state',
            hint = 'Set the isolation level of this transaction to READ COMMITTED.';
  end if;
end $$;

-- Keep every region as it is until the transaction ends; many may hold this at once.
create or replace function semap.lock_regions_shared() returns void
language plpgsql as $$
begin
  perform semap.require_read_committed();
  perform pg_advisory_xact_lock_shared(7363, 0);
end $$;

-- Keep every writer of track states out until the transaction ends, to change regions.
create or replace function semap.lock_regions_exclusive() returns void
language plpgsql as $$
begin
  perform semap.require_read_committed();
  perform pg_advisory_xact_lock(7363, 0);
end $$;

-- Let one writer at a time touch the tracks of a source, until the transaction ends.
create or replace function semap.lock_source(p_source_id integer) returns void
language sql as $$ select pg_advisory_xact_lock(7364, p_source_id) $$;

-- Taken before the rows of a statement that may change regions or end tracks, so that what is read for
-- it is read after every writer of states has ended, and no row is locked before. What came late before it is
-- corrected before it (sql/148).
create or replace function semap.lock_regions() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  perform semap.lock_regions_exclusive();
  if exists (select from semap.late_state) then
    begin
      perform semap.correct_all();
    exception when others then -- which is no reason to keep the map as it is
      raise warning 'What came late before this edit is not corrected: %', sqlerrm;
    end;
  end if;
  return null;
end $$;

do $$
declare
  v_table  text;
begin
  foreach v_table in array array['map', 'map_anchor', 'concept', 'concept_parent', 'concept_iri', 'frame',
                                 'frame_pose', 'description',
                                 'geometry', 'abstraction', 'instance', 'door_room', 'condition',
                                 'continuous_query'] loop
    execute format('create or replace trigger lock_regions before insert or update or delete on semap.%I'
                   ' for each statement execute function semap.lock_regions()', v_table);
  end loop;
end $$;

create or replace trigger lock_regions_to_rename before update of name, jump_m, jump_mps on semap.source
  for each statement when (pg_trigger_depth() = 0) execute function semap.lock_regions();
create or replace trigger lock_regions before delete on semap.source
  for each statement when (pg_trigger_depth() = 0) execute function semap.lock_regions();
create or replace trigger lock_regions before delete on semap.track
  for each statement when (pg_trigger_depth() = 0) execute function semap.lock_regions();
create or replace trigger lock_regions_to_end before update of ended_at on semap.track
  for each statement when (pg_trigger_depth() = 0
                           and current_setting('semap.source_is_locked', true) is distinct from 'on')
  execute function semap.lock_regions();

-- Taken before the rows of a new source or track: their keys hold rows of map and source, for which an edit may wait,
-- and a query that is added meanwhile has to see them, or they it. And before states of objects (sql/150), as before
-- those of tracks.
create or replace function semap.keep_regions() returns trigger
language plpgsql as $$
begin
  perform semap.lock_regions_shared();
  return null;
end $$;

create or replace trigger keep_regions before insert on semap.source
  for each statement execute function semap.keep_regions();
create or replace trigger keep_regions before insert on semap.track
  for each statement execute function semap.keep_regions();
create or replace trigger lock_regions_to_describe
  before update of source_id, map_id, name, concept_id, attributes, uid on semap.track
  for each statement when (pg_trigger_depth() = 0
                           and current_setting('semap.source_is_locked', true) is distinct from 'on')
  execute function semap.lock_regions();
