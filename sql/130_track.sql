-- A new track is known at once and has a present as soon as its first state arrives.
create or replace function semap.track_inserted() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  insert into semap.track_now (track_id, source_id, map_id, cell_m)
  select n.track_id, n.source_id, n.map_id, m.cell_m from new_track n join semap.map m using (map_id);
  if exists (select from semap.continuous_query q join new_track n using (map_id)
             where num_nonnulls(q.subject_concept_id, q.subject_uids, q.subject_where,
                                q.object_concept_id, q.object_uids, q.object_where) > 0) then
    perform semap.choose_tracks(null, array_agg(track_id)) from new_track;
  end if;
  if (select count(*) from new_track) >= 100 then
    analyze semap.track, semap.track_now;
  end if;
  return null;
end $$;

create or replace trigger track_inserted after insert on semap.track
  referencing new table as new_track for each statement execute function semap.track_inserted();

-- A track that ended leaves every region it was in, at its end. A state after that revives it.
create or replace function semap.track_updated() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_ended       bigint[];
  v_source_ids  integer[];
  v_crossings   semap.crossing[];
begin
  select array_agg(n.track_id) into v_ended
  from new_track n join old_track o using (track_id)
  where n.ended_at is not null and n.ended_at is distinct from o.ended_at;
  if v_ended is null then
    return null;
  end if;
  perform semap.lock_regions_shared();
  select array_agg(distinct source_id order by source_id) into v_source_ids
  from new_track where track_id = any (v_ended);
  perform semap.lock_source(source_id) from unnest(v_source_ids) source_id;
  perform semap.flush_positions(v_source_ids);

  select array_agg(row(n.track_id, r.region_id, 'ended', 'disappeared',
                       greatest(n.ended_at, t.stamp), greatest(n.ended_at, t.stamp), null,
                       null)::semap.crossing) into v_crossings
  from new_track n
  join semap.track_now t using (track_id)
  join semap.relation h on h.track_id = n.track_id and h.confirmed
  join semap.region r on r.query_id = h.query_id and r.instance_id = h.instance_id
  where n.track_id = any (v_ended);
  perform semap.record_crossings(semap.crossings_as_told(v_crossings));
  perform semap.settle_relations(array_agg(n)) from semap.relation n
  where track_id = any (v_ended) and not in_pairs and not semap.reads_amended(query_id, track_id);
  perform semap.read_again(array_agg(distinct g.track_id), min(n.ended_at))
  from new_track n join semap.track_reading g on g.state_track_id = n.track_id and g.to_stamp = 'infinity'
  where n.track_id = any (v_ended) having count(*) > 0;
  insert into semap.track_end (track_id, stamp)
  select k.track_id, greatest(k.ended_at, t.stamp)
  from new_track k join semap.track_now t using (track_id) where k.track_id = any (v_ended)
  on conflict do nothing;
  perform semap.end_pairs_of_ended(v_ended);

  update semap.track_now t
  set live = false, region_ids = '{}', stateful_ids = '{}', outlier_stamp = null, safe_x_min_m = 'infinity',
      safe_until = 'infinity', stamp = greatest(t.stamp, n.ended_at)
  from new_track n
  where t.track_id = n.track_id and n.track_id = any (v_ended);
  perform semap.note_newest(source_id, max(ended_at)) from new_track where track_id = any (v_ended)
  group by source_id order by source_id;
  return null;
end $$;

create or replace trigger track_updated after update on semap.track
  referencing old table as old_track new table as new_track
  for each statement execute function semap.track_updated();

-- A track that is deleted leaves every region it is in. Nobody keeps that it did, but the rule worker reads it in the
-- log, since what its rules know of the track would hold for ever.
create or replace function semap.track_leaves() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  if exists (select from semap.map where map_id = old.map_id) then
    perform semap.flush_positions(array[old.source_id]);
    insert into semap.relation_change (uid, map_id, query_id, query_name, track_id, track_name,
                                       instance_id, instance_name, kind, cause, stamp, transition_at, since)
    select gen_random_uuid(), r.map_id, r.query_id, r.query_name, old.track_id, old.name,
           r.instance_id, r.instance_name, 'ended', 'map', t.stamp, t.stamp, n.since
    from semap.relation n
    join semap.region r using (query_id, instance_id)
    join semap.track_now t using (track_id)
    where n.track_id = old.track_id and n.confirmed
    order by r.instance_uid, r.query_id;
    perform semap.end_pairs(old.map_id, array[old.track_id], null, 'map');
  end if;
  return old;
end $$;

create or replace trigger track_leaves before delete on semap.track
  for each row execute function semap.track_leaves();

-- With a track go its states and what they changed; a track of the same name starts anew.
create or replace function semap.track_deleted() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  delete from semap.relation where track_id in (select track_id from old_track);
  delete from semap.relation where object_track_id in (select track_id from old_track);
  delete from semap.relation_change
  where track_id in (select track_id from old_track) or object_track_id in (select track_id from old_track);
  delete from semap.relation_past where track_id in (select track_id from old_track);
  delete from semap.relation_past where object_track_id in (select track_id from old_track);
  delete from semap.followed_state where track_id in (select track_id from old_track);
  -- where they are among others, each gets chunks of its own first
  perform semap.compact_all(array(select distinct source_id from old_track order by 1));
  delete from semap.state_chunk where track_id in (select track_id from old_track);
  delete from semap.track_state_inbox where track_id in (select track_id from old_track);
  delete from semap.late_state where track_id in (select track_id from old_track);
  delete from semap.reading_due where track_id in (select track_id from old_track);
  delete from semap.track_reading
  where track_id in (select track_id from old_track) or state_track_id in (select track_id from old_track);
  delete from semap.track_now where track_id in (select track_id from old_track);
  return null;
end $$;

create or replace trigger track_deleted after delete on semap.track
  referencing old table as old_track for each statement execute function semap.track_deleted();
