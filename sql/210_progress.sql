-- Commit what a worker made: its events, its state and its place in the log, all or nothing. The
-- place must be where the worker believes it to be, so that of two workers only one goes on. Events
-- are numbered in the order given, without gaps; one that exists already is passed over. Listeners
-- on semap_event are woken. The events of maps that were deleted go first. Gives the number of the last
-- event.
create or replace function semap.commit_progress(
  p_worker text, p_before pg_lsn, p_lsn pg_lsn, p_rule_state jsonb, p_watermarks jsonb, p_gone_maps integer[],
  p_events jsonb
) returns bigint
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_seq   bigint;
  v_made  bigint;
begin
  select event_seq into v_seq from semap.progress where worker = p_worker and lsn = p_before for update;
  if not found then
    raise exception 'Another process has moved the progress of worker % on.', p_worker
      using errcode = 'serialization_failure';
  end if;

  -- what is acknowledged to the log must be on the disk, whatever the default of the server
  perform set_config('synchronous_commit', 'on', true);

  if cardinality(p_gone_maps) > 0 then
    delete from semap.event_evidence v using semap.event e
    where v.event_id = e.event_id and e.map_id = any (p_gone_maps);
    delete from semap.event where map_id = any (p_gone_maps);
  end if;

  if jsonb_array_length(p_events) > 0 then
    insert into semap.event (seq, event_id, map_id, rule_name, rule_version, type, stamp, cause,
                             track_id, track_name, instance_id, instance_name, since)
    select v_seq + row_number() over (order by listed.place), e.*
    from jsonb_array_elements(p_events) with ordinality as listed (event, place)
    cross join lateral jsonb_to_record(listed.event) as e (
      event_id uuid, map_id integer, rule_name text, rule_version integer, type text, stamp timestamptz, cause text,
      track_id bigint, track_name text, instance_id bigint, instance_name text, since timestamptz)
    where not exists (select from semap.event known where known.event_id = e.event_id);
    get diagnostics v_made = row_count;

    insert into semap.event_evidence (event_id, change_uid)
    select e.event_id, change_uid
    from jsonb_to_recordset(p_events) as e (event_id uuid, evidence uuid[]), unnest(e.evidence) change_uid
    on conflict do nothing;
    v_seq := v_seq + v_made;
    perform pg_notify('semap_event', v_seq::text);
  end if;

  update semap.progress
  set lsn = p_lsn, event_seq = v_seq, rule_state = p_rule_state, watermarks = p_watermarks,
      updated_at = clock_timestamp()
  where worker = p_worker;
  return v_seq;
end $$;
comment on function semap.commit_progress is
  'Commit what a worker made: its events, its state and its place in the log, all or nothing.';
