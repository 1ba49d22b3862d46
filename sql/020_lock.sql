-- Lock order of everything that maintains relations: first the regions (shared by writers of
-- track states, exclusive for an edit of the map), then the sources in the order of their ids.
-- Each statement of a trigger sees what was committed before its lock was granted, which holds
-- only at READ COMMITTED.

-- Keep every region as it is until the transaction ends; many may hold this at once.
create or replace function semap.hold_regions() returns void
language plpgsql as $$
begin
  if current_setting('transaction_isolation') <> 'read committed' then
    raise exception 'semap maintains relations at READ COMMITTED only, not at %',
      upper(current_setting('transaction_isolation'))
      using errcode = 'invalid_transaction_state', hint = 'Set the isolation level of this transaction to READ COMMITTED.';
  end if;
  perform pg_advisory_xact_lock_shared(7363, 0);
end $$;
comment on function semap.hold_regions is
  'Keep every region as it is until the transaction ends; many may hold this at once.';

-- Keep every writer of track states out until the transaction ends, to change regions.
create or replace function semap.change_regions() returns void
language plpgsql as $$
begin
  if current_setting('transaction_isolation') <> 'read committed' then
    raise exception 'semap maintains relations at READ COMMITTED only, not at %',
      upper(current_setting('transaction_isolation'))
      using errcode = 'invalid_transaction_state', hint = 'Set the isolation level of this transaction to READ COMMITTED.';
  end if;
  perform pg_advisory_xact_lock(7363, 0);
end $$;
comment on function semap.change_regions is
  'Keep every writer of track states out until the transaction ends, to change regions.';

-- Let one writer at a time touch the tracks of a source, until the transaction ends.
create or replace function semap.hold_source(p_source_id integer) returns void
language sql as $$ select pg_advisory_xact_lock(7364, p_source_id) $$;
comment on function semap.hold_source is
  'Let one writer at a time touch the tracks of a source, until the transaction ends.';
