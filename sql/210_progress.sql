-- Write events after a number, in the order given and without gaps; one that exists already is passed over. Listeners
-- on semap_event are woken. Gives the number of the last event.
create or replace function semap.write_events(p_after bigint, p_events jsonb) returns bigint
language plpgsql set enable_seqscan = off as $$ -- few rows are found by their keys, and no table is read for them
declare
  v_made  bigint;
begin
  if coalesce(jsonb_array_length(p_events), 0) = 0 then
    return p_after;
  end if;

  insert into semap.event
  select e.*
  from (
    select event, row_number() over (order by place) as nth
    from (
      select distinct on (id) event, place
      from jsonb_array_elements(p_events) with ordinality as listed (event, place)
      cross join lateral (select (event ->> 'event_id')::uuid as id) i
      where not exists (select from semap.event known where known.event_id = id offset 0)
      order by id, place) new
  ) n
  cross join lateral jsonb_populate_record(
    null::semap.event,
    '{"key": {}, "measures": {}, "by_batch": false}' || n.event
      || jsonb_build_object('seq', p_after + n.nth, 'created_at', clock_timestamp())) e;
  get diagnostics v_made = row_count;

  insert into semap.event_evidence (event_id, place, uid, variable, source, stamp)
  select e.event_id, row.place, r.uid, r.variable, r.source, r.stamp
  from jsonb_to_recordset(p_events) as e (event_id uuid, evidence jsonb)
  cross join lateral jsonb_array_elements(e.evidence) with ordinality as row (evidence, place)
  cross join lateral jsonb_to_record(row.evidence) as r (uid uuid, variable text, source text, stamp timestamptz)
  on conflict do nothing;

  perform pg_notify('semap_event', (p_after + v_made)::text);
  return p_after + v_made;
end $$;

-- Delete what was made of maps that are gone.
create or replace function semap.forget_maps(p_worker text, p_maps integer[]) returns void
language sql as $$
  delete from semap.event_evidence v using semap.event e where v.event_id = e.event_id and e.map_id = any (p_maps);
  delete from semap.event where map_id = any (p_maps);
  delete from semap.event_count where map_id = any (p_maps);
  delete from semap.recompute_run where map_id = any (p_maps);
  delete from semap.pending_row where worker = p_worker and map_id = any (p_maps);
  delete from semap.late_row where map_id = any (p_maps)
$$;

-- Write what changed in the state of rules, and forget that of rules that are in force no more.
create or replace function semap.write_rule_states(
  p_worker text, p_rules_before jsonb, p_rules jsonb, p_states jsonb
) returns void
language plpgsql as $$
begin
  if p_rules <> p_rules_before then
    delete from semap.rule_state
    where worker = p_worker
      and rule_id in (select id::integer from jsonb_object_keys(p_rules_before) id where not p_rules ? id);
  end if;
  if jsonb_array_length(p_states) > 0 then
    delete from semap.rule_state s
    using jsonb_to_recordset(p_states) as c (rule_id integer, key text, state jsonb)
    where c.state is null and s.worker = p_worker and s.rule_id = c.rule_id and s.key = c.key;

    insert into semap.rule_state (worker, rule_id, key, state)
    select p_worker, c.rule_id, c.key, c.state
    from jsonb_to_recordset(p_states) as c (rule_id integer, key text, state jsonb)
    where c.state is not null
    on conflict (worker, rule_id, key) do update set state = excluded.state;
  end if;
end $$;

-- Write which rows wait for the watermark, which wait no more, and which came too late for it.
create or replace function semap.write_rows(p_worker text, p_pending jsonb, p_late jsonb) returns void
language plpgsql as $$
declare
  v_late  bigint;
begin
  if jsonb_array_length(p_pending -> 'removed') > 0 then
    delete from semap.pending_row w
    using jsonb_to_recordset(p_pending -> 'removed') as r (map_id integer, uid text)
    where w.worker = p_worker and w.map_id = r.map_id and w.uid = r.uid;
  end if;
  if jsonb_array_length(p_pending -> 'added') > 0 then
    insert into semap.pending_row (worker, map_id, uid, row)
    select p_worker, r.map_id, r.uid, r.row
    from jsonb_to_recordset(p_pending -> 'added') as r (map_id integer, uid text, row jsonb)
    on conflict (worker, map_id, uid) do update set row = excluded.row;
  end if;
  if jsonb_array_length(p_late) > 0 then
    insert into semap.late_row (map_id, uid, input, stamp, watermark, row)
    select r.map_id, r.uid, r.input, r.stamp, r.watermark, r.row
    from jsonb_to_recordset(p_late) as r (
      map_id integer, uid text, input text, stamp timestamptz, watermark timestamptz, row jsonb)
    on conflict (map_id, uid) do nothing;
    get diagnostics v_late = row_count;
    update semap.progress set late_rows = late_rows + v_late where worker = p_worker;
  end if;
end $$;

-- Commit what a worker made: events, its state and its place in the log, all or nothing. The place must be where the
-- worker believes it to be, so that of two workers only one goes on. Rules and watermarks that are null stay as they
-- are. The events of maps that were deleted go first. Gives the number of the last event.
create or replace function semap.commit_progress(
  p_worker text, p_before pg_lsn, p_lsn pg_lsn, p_rule_state jsonb, p_watermarks jsonb, p_gone_maps integer[],
  p_events jsonb, p_states jsonb default '[]', p_pending jsonb default '{}', p_late jsonb default '[]'
) returns bigint
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_known  semap.progress;
  v_seq    bigint;
begin
  select * into v_known from semap.progress where worker = p_worker and lsn = p_before for update;
  if not found then
    raise exception 'Another process has moved the progress of worker % on.', p_worker
      using errcode = 'serialization_failure';
  end if;

  -- what is acknowledged to the log must be on the disk, whatever the default of the server
  perform set_config('synchronous_commit', 'on', true);

  if cardinality(p_gone_maps) > 0 then
    perform semap.forget_maps(p_worker, p_gone_maps);
  end if;
  v_seq := semap.write_events(v_known.event_seq, p_events);
  perform semap.write_rule_states(p_worker, v_known.rule_state, coalesce(p_rule_state, v_known.rule_state), p_states);
  perform semap.write_rows(p_worker, p_pending, p_late);

  update semap.progress
  set lsn = p_lsn, event_seq = v_seq, rule_state = coalesce(p_rule_state, rule_state),
      watermarks = coalesce(p_watermarks, watermarks), updated_at = clock_timestamp()
  where worker = p_worker;
  return v_seq;
end $$;

-- Add events beside the log, such as those of late rows or of a run over the past; the worker goes on meanwhile. Those
-- of a map that is gone are left out, since the worker may have deleted its events before. Gives how many there were
-- not before.
create or replace function semap.add_events(p_worker text, p_events jsonb) returns bigint
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_before  bigint;
  v_after   bigint;
begin
  select event_seq into v_before from semap.progress where worker = p_worker for update;
  if not found then
    raise exception 'There is no worker %.', p_worker
      using errcode = 'no_data_found', hint = 'Run: semap db migrate';
  end if;
  -- a map that is there stays until these events are committed, so that the worker finds them when it goes
  perform from semap.place
  where map_id in (select (event ->> 'map_id')::integer from jsonb_array_elements(p_events) event)
  for key share;
  v_after := semap.write_events(v_before, (
    select coalesce(jsonb_agg(event order by place), '[]')
    from jsonb_array_elements(p_events) with ordinality as listed (event, place)
    where exists (select from semap.place where map_id = (event ->> 'map_id')::integer)));
  update semap.progress set event_seq = v_after where worker = p_worker;
  return v_after - v_before;
end $$;

-- Write what a partition of a topic brought: events of rules that run elsewhere, which are numbered here and of which
-- known ones are passed over, and rows that came too late; with the offset up to where it was read, all or nothing. It
-- must be read from where it was, so that of two collectors only one goes on. Gives how many events are new.
create or replace function semap.collect_events(
  p_worker text, p_topic text, p_partition integer, p_from bigint, p_next bigint, p_events jsonb, p_late jsonb
) returns bigint
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_new  bigint;
begin
  insert into semap.collected (topic, partition, next_offset) values (p_topic, p_partition, p_from)
  on conflict do nothing;
  update semap.collected set next_offset = p_next
  where topic = p_topic and partition = p_partition and next_offset = p_from;
  if not found then
    raise exception 'Another process has collected what is in partition % of %.', p_partition, p_topic
      using errcode = 'serialization_failure';
  end if;
  perform semap.write_rows(p_worker, '{}', p_late);
  v_new := semap.add_events(p_worker, p_events);
  insert into semap.event_place (event_id, place)
  select event_id, place::geometry
  from jsonb_to_recordset(p_events) as e (event_id uuid, place text) join semap.event using (event_id)
  where place is not null
  on conflict do nothing;
  return v_new;
end $$;
