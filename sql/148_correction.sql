-- The past was otherwise: late states are queued with their batch (semap.late_state), and what is known of the past is
-- corrected in transactions of their own, of so many states each, by the worker. What is written in one of them is one
-- difference: what is taken back, what is added, and where things stand at present. Of regions a track is followed
-- anew, by itself (sql/139); writers of its source wait for that. Pairs of a map are replayed anew (sql/129) while all
-- go on, and only what is written keeps others out; what a replay that went up to the present has not seen is replayed
-- again then.
--
-- An edit of the map corrects first what is queued, since what came before a region or a query got its form is not
-- looked at after it.

-- Correct the history of some tracks of a source in regions after late states that are queued: of how many states;
-- where none is, that of some readings that are due: how many.
create or replace function semap.correct_tracks(p_source_id integer, p_most_tracks integer default 16) returns bigint
language plpgsql as $$
declare
  v_track_id   bigint;
  v_corrected  bigint := 0;
begin
  perform semap.lock_source(source_id) from unnest(semap.sources_read(p_source_id)) source_id;
  perform semap.flush_positions(semap.sources_read(p_source_id));
  for v_track_id in
    select track_id from semap.late_state where source_id = p_source_id and not of_pairs
    group by track_id order by min(stamp) limit p_most_tracks
  loop
    v_corrected := v_corrected + semap.correct_track(v_track_id);
  end loop;
  if v_corrected = 0 then
    v_corrected := semap.correct_readings(p_source_id, p_most_tracks);
  end if;
  update semap.source
  set late_from = (select min(l.stamp) from (
                     select stamp from semap.late_state where source_id = p_source_id and not of_pairs
                     union all
                     select from_stamp from semap.reading_due where source_id = p_source_id) l
                   where l.stamp >= late_from)
  where source_id = p_source_id and late_from is not null;
  return v_corrected;
end $$;

-- Correct the history of pairs of a map after late states that are queued: of how many states. Tracks that are known by
-- a newer one than before are there from then on.
create or replace function semap.correct_pairs(p_map_id integer) returns bigint
language plpgsql as $$
declare
  v_plan    record;
  v_ids     bigint[];
  v_places  semap.track_state[];
begin
  select * into v_plan from semap.plan_correction(p_map_id);
  perform semap.lock_pairs(p_map_id);
  if exists (select from semap.pair_progress
             where map_id = p_map_id and (revision <> v_plan.revision
                                          or v_plan.is_present and through <> v_plan.through)) then
    select * into v_plan from semap.plan_correction(p_map_id);
  end if;
  if v_plan.query_ids <> '{}' then
    perform semap.write_pair_amendments(
      p_map_id, v_plan.query_ids, v_plan.track_ids, v_plan.from_stamp, v_plan.taken_stamps[1], v_plan.to_stamp,
      v_plan.is_present, v_plan.changes, v_plan.changes_without, v_plan.pairs, v_plan.pairs_without);
  end if;
  v_ids := array(select distinct id from unnest(v_plan.taken_ids) id);
  v_places := array(select s from semap.tracks_followed(p_map_id, v_ids) s);
  perform semap.end_pairs(p_map_id, array(select id from unnest(v_ids) id
                                          where not exists (select from unnest(v_places) p where p.track_id = id)),
                          null, 'disappeared');
  perform semap.keep_followed(p_map_id, v_ids, v_places);
  update semap.pair_progress set revision = revision + 1 where map_id = p_map_id;
  delete from semap.late_state l using unnest(v_plan.taken_ids, v_plan.taken_stamps) t (track_id, stamp)
  where l.of_pairs and l.track_id = t.track_id and l.stamp = t.stamp;
  return coalesce(cardinality(v_plan.taken_ids), 0);
end $$;

-- Correct something of what is known of the past of a map, or (null) of any, in a transaction of its own: of how many
-- late states; 0: none is queued. Regions come first, since the log says of them which tracks ended.
create or replace function semap.correct_some(p_map_id integer default null) returns bigint
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_late  record;
begin
  if not exists (select from semap.late_state union all select from semap.reading_due) then
    return 0;
  end if;
  perform semap.lock_regions_shared();
  select s.source_id, s.map_id, l.of_pairs into v_late
  from semap.source s cross join lateral (
    select of_pairs from (
      (select of_pairs from semap.late_state l where l.source_id = s.source_id order by of_pairs limit 1)
      union all
      (select false from semap.reading_due d where d.source_id = s.source_id limit 1)) w
    order by of_pairs limit 1) l
  where p_map_id is null or s.map_id = p_map_id
  order by l.of_pairs, s.late_from, s.source_id limit 1;
  if not found then
    return 0;
  end if;
  return case when v_late.of_pairs then semap.correct_pairs(v_late.map_id)
              else semap.correct_tracks(v_late.source_id) end;
end $$;

-- Correct all that is known of the past of a map, or (null) of any, in this transaction.
create or replace function semap.correct_all(p_map_id integer default null) returns void
language plpgsql as $$
begin
  while semap.correct_some(p_map_id) > 0 loop
  end loop;
end $$;
