-- New states move their tracks. They come as a track batch, by semap.add_states: what one source says of many tracks at
-- one stamp; or as rows of semap.track_state. Both are made chunks (sql/127), which semap.take_states takes. A state
-- within the safe region of its track needs one comparison; only tracks that left theirs are looked up. States at or
-- before the present of their track are late: they are queued, and correct its history (sql/139, 148). A state that is
-- its track's last ends the track after it.
--
-- Where a track is within its safe region is not written for each batch, but flushed once for many (sql/134): before
-- states that are not newer than all others of their source, so that track_now alone tells what is late.

-- Refuse states of a track at one stamp that are more than one, among these and, of tracks of which some are late, the
-- stored.
create or replace function semap.refuse_repeated(p_chunks semap.state_chunk[], p_late_ids bigint[]) returns void
language plpgsql as $$
declare
  v_again  record;
begin
  select s.track_id, s.stamp into v_again from (
    select s.track_id, s.stamp from semap.states_in(p_chunks) s
    union all
    select s.track_id, s.stamp
    from (select min(from_stamp) as first, max(to_stamp) as last from unnest(p_chunks)) w
    cross join lateral semap.states(p_late_ids, w.first, w.last) s) s
  group by s.track_id, s.stamp having count(*) > 1 limit 1;
  if found then
    raise exception 'There is a state of this track at this stamp already.'
      using errcode = 'unique_violation', hint = 'Send each state once.',
            detail = format('Key (stamp, track_id)=(%s, %s) already exists.', v_again.stamp, v_again.track_id);
  end if;
end $$;

-- Compare states with the safe regions of their tracks: how many they are, of how many tracks, and those that may
-- change something. Presents are in memory, and of many tracks only a few come in a batch: pages are read as they are
-- asked for, since else each batch would read all of track_now.
create or replace function semap.compare_states(
  p_source_id integer, p_chunks semap.state_chunk[], out states bigint, out tracks bigint,
  out updates semap.state_update[]
) language plpgsql stable
set plan_cache_mode = force_generic_plan set enable_mergejoin = off set random_page_cost = 0.5 as $$
begin
  -- state updates as semap.update_of makes them, which would make rows of all that is compared
  select count(*), count(distinct n.track_id),
         array_agg(semap.new_state_update(
           n, source_id => t.source_id, map_id => t.map_id, cell_m => t.cell_m, live => t.live, seen_stamp => t.stamp,
           from_x_m => t.x_m, from_y_m => t.y_m, from_z_m => t.z_m, region_ids => t.region_ids,
           outlier_stamp => t.outlier_stamp)) filter (where not (
           n.x_m > t.safe_x_min_m and n.x_m < t.safe_x_max_m and n.y_m > t.safe_y_min_m and n.y_m < t.safe_y_max_m
           and case when n.z_m is null then t.safe_z_min_m is null
                    else n.z_m >= t.safe_z_min_m and n.z_m < t.safe_z_max_m end
           and (n.std_m <= t.safe_std_m or n.std_m is null)
           and n.stamp > t.stamp and n.stamp < t.safe_until
           and t.source_id = p_source_id and not n.is_last) is true)
  into states, tracks, updates
  from semap.states_in(p_chunks) n left join semap.track_now t using (track_id);
end $$;

-- The states of these tracks after their present.
create or replace function semap.updates_of(p_chunks semap.state_chunk[], p_track_ids bigint[])
returns semap.state_update[]
language sql stable as $$
  select array_agg(semap.update_of(n, t)) from semap.states_in(p_chunks) n join semap.track_now t using (track_id)
  where t.track_id = any (p_track_ids) and n.stamp > t.stamp
$$;

-- Move tracks to these states, which passed the gate: relations begin and end, tracks appear and end.
create or replace function semap.follow_states(p_map_id integer, p_passed semap.state_update[]) returns void
language plpgsql as $$
declare
  v_crossings  semap.crossing[] := semap.move_tracks(p_passed);
begin
  if exists (select from semap.region where map_id = p_map_id and stateful) then
    v_crossings := v_crossings || semap.follow_stateful(p_passed);
  end if;
  perform semap.record_crossings(semap.crossings_as_told(v_crossings));
  perform set_config('semap.source_is_locked', 'on', true);
  if exists (select from unnest(p_passed) where not live) then
    update semap.track k set ended_at = null
    where k.ended_at is not null
      and k.track_id in (select (a.state).track_id from unnest(p_passed) a where not a.live);
  end if;
  if exists (select from semap.states_of(p_passed) where is_last) then
    update semap.track k set ended_at = s.stamp
    from semap.states_of(p_passed) s join semap.track_now t using (track_id)
    where s.is_last and s.stamp = t.stamp and k.track_id = s.track_id;
  end if;
  perform set_config('semap.source_is_locked', 'off', true);
end $$;

-- Store states of a source, and follow those of tracks that left their safe regions. p_is_stale: positions were flushed
-- since they were compared.
create or replace function semap.store_states(
  p_source semap.source, p_chunks semap.state_chunk[], p_found record, p_is_stale boolean
) returns void
language plpgsql as $$
declare
  v_late      semap.state_update[] := array(select a from unnest(p_found.updates) a
                                            where (a.state).stamp <= a.seen_stamp);
  v_updates  semap.state_update[] := p_found.updates;
  v_is_many   boolean := p_found.tracks < p_found.states;
begin
  if v_is_many or v_late <> '{}' then
    perform semap.refuse_repeated(p_chunks, array(select track_id from semap.states_of(v_late)));
  end if;
  insert into semap.state_chunk select * from unnest(p_chunks);
  perform semap.read_states_again(p_source, p_chunks);
  if v_late <> '{}' then
    perform semap.queue_late(p_source, v_late);
  end if;
  if v_is_many or p_is_stale or v_late <> '{}' then
    v_updates := semap.updates_of(p_chunks, array(select track_id from semap.states_of(v_updates)));
  end if;
  if v_updates is null then
    return;
  end if;
  if exists (select from unnest(v_updates) where outlier_stamp is not null)
     or semap.any_far_step(p_source, v_updates) then
    v_updates := semap.gated(p_source, v_updates);
  end if;
  perform semap.follow_states(p_source.map_id, v_updates);
end $$;

-- Count states of a source that are stored, and write where its tracks are: at once, or once for many batches.
create or replace function semap.count_states(
  p_source_id integer, p_chunks semap.state_chunk[], p_states bigint, p_last timestamptz, p_is_at_once boolean
) returns void
language plpgsql as $$
declare
  c_chunks_each  constant integer := 32;
  v_unflushed    integer;
begin
  insert into semap.source_count as c (source_id, track_states, newest_stamp, flushed_stamp, unflushed)
  values (p_source_id, p_states, p_last, case when p_is_at_once then p_last else '-infinity' end,
          case when p_is_at_once then 0 else 1 end)
  on conflict (source_id) do update
  set track_states = c.track_states + p_states, received_at = clock_timestamp(),
      newest_stamp = greatest(c.newest_stamp, p_last),
      flushed_stamp = case when p_is_at_once then greatest(c.newest_stamp, p_last) else c.flushed_stamp end,
      unflushed = case when p_is_at_once then 0 else c.unflushed + 1 end
  returning unflushed into v_unflushed;
  if p_is_at_once then
    perform semap.place_tracks_at(array(select s from semap.states_in(p_chunks) s));
  elsif v_unflushed > c_chunks_each then
    perform semap.flush_positions(array[p_source_id]);
  end if;
end $$;

-- Take states of one source. p_is_whole: they are all that it has to say of the newest of their stamps.
create or replace function semap.take_states(p_source_id integer, p_chunks semap.state_chunk[], p_is_whole boolean)
returns void
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_source      semap.source;
  v_cell_m      double precision;
  v_count       semap.source_count;
  v_first       timestamptz;
  v_last        timestamptz;
  v_found       record;
  v_is_at_once  boolean;
  v_is_stale    boolean := false;
  v_in_pairs    boolean;
begin
  if current_setting('transaction_isolation') <> 'read committed' then
    perform semap.require_read_committed();
  end if;
  perform pg_advisory_xact_lock_shared(7363, 0), pg_advisory_xact_lock(7364, p_source_id); -- as in sql/020, at once
  select * into v_count from semap.source_count where source_id = p_source_id;
  select * into v_source from semap.source where source_id = p_source_id;
  select cell_m, exists (select from semap.continuous_query q where q.map_id = m.map_id and q.in_pairs and q.enabled)
  into v_cell_m, v_in_pairs from semap.map m where map_id = v_source.map_id;
  select min(from_stamp), max(to_stamp) into v_first, v_last from unnest(p_chunks);
  if v_in_pairs then
    perform from semap.source where source_id = p_source_id for no key update;
    perform semap.lock_pairs(v_source.map_id);
  end if;
  -- what is not newer than all before, or of many stamps, does not wait: what is not flushed is of the newest stamps
  v_is_at_once := v_in_pairs or p_chunks[1].track_id is not null or coalesce(v_first <= v_count.newest_stamp, false);
  if v_is_at_once and v_count.unflushed > 0 then
    perform semap.flush_positions(array[p_source_id]);
    v_count.unflushed := 0;
  end if;

  select * into v_found from semap.compare_states(p_source_id, p_chunks);
  if v_found.updates is not null then
    if exists (select from unnest(v_found.updates) where source_id is distinct from p_source_id) then
      perform semap.refuse_strange(p_source_id, v_found.updates);
    end if;
    v_is_stale := v_count.unflushed > 0 and (
      semap.needs_positions(v_source, v_cell_m) or semap.any_far_step(v_source, v_found.updates));
    if v_is_stale then
      perform semap.flush_positions(array[p_source_id]);
    end if;
  end if;
  perform semap.store_states(v_source, p_chunks, v_found, v_is_stale);
  perform semap.count_states(p_source_id, p_chunks, v_found.states, v_last, v_is_at_once);
  if v_in_pairs then
    insert into semap.late_state (track_id, stamp, source_id, of_pairs)
    select n.track_id, n.stamp, p_source_id, true
    from semap.pair_progress p join semap.states_in(p_chunks) n on n.stamp <= p.through
    where p.map_id = v_source.map_id;
    if found then
      notify semap_late;
    end if;
  end if;
  perform semap.note_newest(p_source_id, v_last, p_is_whole);
end $$;

-- Throw away what rows that became chunks have left, before new ones come, where there is much of it and nobody writes.
create or replace function semap.empty_inbox() returns trigger
language plpgsql security definer set search_path = pg_catalog, pg_temp as $$
begin
  if pg_relation_size('semap.track_state_inbox') > 64 << 20 then
    begin
      lock table semap.track_state_inbox in access exclusive mode nowait;
      truncate semap.track_state_inbox;
    exception when lock_not_available then
      null;
    end;
  end if;
  return null;
end $$;

create or replace trigger empty_inbox before insert on semap.track_state
  for each statement execute function semap.empty_inbox();

