-- Lock order of everything that maintains relations: first the regions (shared by writers of track
-- states, exclusive for an edit of the map), then the source of the states, then rows.
-- Each statement of a trigger sees what was committed before its lock was granted, which holds
-- only at READ COMMITTED.

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
comment on function semap.require_read_committed is
  'Refuse a transaction whose statements do not see what was committed before their locks.';

-- Keep every region as it is until the transaction ends; many may hold this at once.
create or replace function semap.hold_regions() returns void
language plpgsql as $$
begin
  perform semap.require_read_committed();
  perform pg_advisory_xact_lock_shared(7363, 0);
end $$;
comment on function semap.hold_regions is
  'Keep every region as it is until the transaction ends; many may hold this at once.';

-- Keep every writer of track states out until the transaction ends, to change regions.
create or replace function semap.change_regions() returns void
language plpgsql as $$
begin
  perform semap.require_read_committed();
  perform pg_advisory_xact_lock(7363, 0);
end $$;
comment on function semap.change_regions is
  'Keep every writer of track states out until the transaction ends, to change regions.';

-- Let one writer at a time touch the tracks of a source, until the transaction ends.
create or replace function semap.hold_source(p_source_id integer) returns void
language sql as $$ select pg_advisory_xact_lock(7364, p_source_id) $$;
comment on function semap.hold_source is
  'Let one writer at a time touch the tracks of a source, until the transaction ends.';

-- Taken before the rows of a statement that may change regions or end tracks, so that what is read for
-- it is read after every writer of states has ended, and no row is locked before.
create or replace function semap.lock_regions() returns trigger
language plpgsql as $$
begin
  perform semap.change_regions();
  return null;
end $$;
comment on function semap.lock_regions is
  'Taken before the rows of a statement that may change regions or end tracks.';

do $$
declare
  v_table  text;
begin
  foreach v_table in array array['map', 'map_anchor', 'concept', 'concept_parent', 'concept_iri', 'frame', 'frame_pose', 'description',
                                 'geometry', 'abstraction', 'instance', 'door_room', 'continuous_query'] loop
    execute format('create or replace trigger lock_regions before insert or update or delete on semap.%I'
                   ' for each statement execute function semap.lock_regions()', v_table);
  end loop;
end $$;

create or replace trigger lock_regions before delete on semap.source
  for each statement when (pg_trigger_depth() = 0) execute function semap.lock_regions();
create or replace trigger lock_regions before delete on semap.track
  for each statement when (pg_trigger_depth() = 0) execute function semap.lock_regions();
create or replace trigger lock_regions_to_end before update of ended_at on semap.track
  for each statement when (pg_trigger_depth() = 0 and current_setting('semap.source_is_held', true) is distinct from 'on')
  execute function semap.lock_regions();
