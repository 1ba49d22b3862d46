-- Commit what a run of the batch layer found, all or nothing: events that the log lacks, and its verdict on every event
-- of these rules with a stamp from p_from on and before p_to, in place of earlier ones. Gives the number of the run.
create or replace function semap.commit_recompute(
  p_worker text, p_map_id integer, p_rules text[], p_from timestamptz, p_to timestamptz, p_started_at timestamptz,
  p_settings jsonb, p_counts jsonb, p_events jsonb, p_verdicts jsonb
) returns integer
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_run_id  integer;
begin
  perform from semap.map where map_id = p_map_id for key share;
  if not found then
    raise exception 'The map was deleted meanwhile.' using errcode = 'no_data_found', hint = 'Nothing was written.';
  end if;
  -- the lock on the worker's progress, which this takes, also keeps two runs from judging at once
  perform semap.add_events(p_worker, p_events);

  insert into semap.recompute_run (map_id, from_stamp, to_stamp, settings, started_at, finished_at, counts)
  values (p_map_id, p_from, p_to, p_settings, p_started_at, clock_timestamp(), p_counts)
  returning run_id into v_run_id;

  delete from semap.event_amendment a using semap.event e
  where e.event_id = a.event_id and e.map_id = p_map_id and e.rule_name = any (p_rules)
    and e.stamp >= p_from and e.stamp < p_to;

  insert into semap.event_amendment (event_id, verdict, by_event_id, run_id)
  select v.event_id, v.verdict, v.by_event_id, v_run_id
  from jsonb_to_recordset(p_verdicts) as v (event_id uuid, verdict text, by_event_id uuid)
  join semap.event e using (event_id);
  return v_run_id;
end $$;

-- Retract the events of a map that rest on what these late rows say was taken back, and what rests on those. The
-- verdicts are those of a run of their own. Gives how many events there are.
create or replace function semap.retract_events(p_map_id integer, p_late_row_ids bigint[]) returns integer
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_event_ids  uuid[];
  v_run_id     integer;
begin
  with recursive void as (
    select v.event_id
    from semap.late_row l
    join semap.relation_change c on c.uid::text = l.uid::text and c.retracts is not null
    join semap.event_evidence v on v.uid = c.retracts and v.source = 'relation'
    where l.map_id = p_map_id and l.late_row_id = any (p_late_row_ids)
    union
    select v.event_id from void join semap.event_evidence v on v.uid = void.event_id and v.source = 'event'
  )
  select array_agg(event_id) into v_event_ids from void;
  if v_event_ids is null then
    return 0;
  end if;
  insert into semap.recompute_run (map_id, from_stamp, to_stamp, settings, started_at, finished_at, counts)
  select p_map_id, min(stamp), max(stamp), '{"late_rows": true}', clock_timestamp(), clock_timestamp(),
         jsonb_build_object('retracted', count(*))
  from semap.event where event_id = any (v_event_ids)
  returning run_id into v_run_id;
  insert into semap.event_amendment as a (event_id, verdict, run_id)
  select event_id, 'retracted', v_run_id from unnest(v_event_ids) event_id join semap.event using (event_id)
  on conflict (event_id) do update
  set verdict = 'retracted', by_event_id = null, run_id = v_run_id, amended_at = clock_timestamp();
  return cardinality(v_event_ids);
end $$;
