-- New states move their tracks. A state within the calm of its track needs one comparison; only tracks that left theirs
-- are looked up. States at or before the present of their track are late: they are counted, and correct its history
-- (sql/139). A state that is its track's last ends the track after it.
--
-- Where tracks are is written late, where that saves most of the work: a *frame* is a batch that holds each live track
-- of its source once, all at one stamp. While one large frame follows another, `track_now` is written once a second of
-- event time for tracks that are calm. Meanwhile a live track was seen last at the later one of `track_now.stamp` and
-- `source_count.frame_stamp`. A map with queries about the way between samples, or about pairs, wants all places at once.

-- New states move their tracks: relations begin and end at the stamp of the first state that shows it. Presents are in
-- memory, and of many tracks only a few come in a batch: pages are read as they are asked for, since else each batch
-- would read all of track_now.
create or replace function semap.track_state_inserted() returns trigger
language plpgsql security definer
set search_path = public, pg_temp set plan_cache_mode = force_generic_plan set enable_mergejoin = off
set random_page_cost = 0.5 as $$
declare
  c_large       constant integer := 200;
  v_source      semap.source;
  v_count       semap.source_count;
  v_source_id   integer;
  v_map_id      integer;
  v_cell_m      double precision;
  v_states      bigint;
  v_tracks      bigint;
  v_first       timestamptz;
  v_last        timestamptz;
  v_strange     bigint;
  v_late        bigint := 0;
  v_appeared    bigint := 0;
  v_ended       bigint := 0;
  v_is_whole    boolean;
  v_is_stale    boolean;
  v_is_far      boolean;
  v_is_frame    boolean := false;
  v_is_careful  boolean;
  v_arrivals    semap.arrival[];
  v_passed      semap.arrival[];
  v_crossings   semap.crossing[];
  v_in_pairs    boolean;
  v_late_pairs  semap.arrival[];
begin
  select t.source_id, t.map_id, t.cell_m into v_source_id, v_map_id, v_cell_m
  from (select track_id from new_state limit 1) n join semap.track_now t using (track_id);
  if current_setting('transaction_isolation') <> 'read committed' then
    perform semap.require_read_committed();
  end if;
  perform pg_advisory_xact_lock_shared(7363, 0), pg_advisory_xact_lock(7364, v_source_id); -- as in sql/020, in one statement
  select * into v_count from semap.source_count where source_id = v_source_id;
  v_count.frame_stamp := coalesce(v_count.frame_stamp, '-infinity');
  v_in_pairs := exists (select from semap.continuous_query where map_id = v_map_id and in_pairs and enabled);
  if v_in_pairs then
    perform from semap.source where source_id = v_source_id for no key update;
    perform semap.hold_pairs(v_map_id);
    select array_agg(semap.arrival_of(n, t, v_count.frame_stamp)) into v_late_pairs
    from semap.pair_progress p join new_state n on n.stamp <= p.through join semap.track_now t using (track_id)
    where p.map_id = v_map_id and t.source_id = v_source_id;
  end if;

  select count(*), count(distinct n.track_id), min(n.stamp), max(n.stamp),
         array_agg(row(n.track_id, n.stamp, n.x_m, n.y_m, n.z_m, n.std_m, n.heading_rad, n.speed_mps, n.length_m,
                       n.width_m, n.is_last, t.source_id, t.map_id, t.cell_m, t.live,
                       greatest(t.stamp, case when t.live then v_count.frame_stamp end),
                       t.x_m, t.y_m, t.z_m, t.region_ids, t.outlier_stamp, n.std_across_m, n.std_yaw_rad)::semap.arrival) filter (where not (
           n.x_m > t.calm_x_min_m and n.x_m < t.calm_x_max_m and n.y_m > t.calm_y_min_m and n.y_m < t.calm_y_max_m
           and case when n.z_m is null then t.calm_z_min_m is null
                    else n.z_m >= t.calm_z_min_m and n.z_m < t.calm_z_max_m end
           and (n.std_m <= t.calm_std_m or n.std_m is null)
           and n.stamp > t.stamp and n.stamp > v_count.frame_stamp and n.stamp < t.calm_until
           and t.source_id = v_source_id and not n.is_last) is true)
    into v_states, v_tracks, v_first, v_last, v_arrivals
  from new_state n left join semap.track_now t using (track_id);
  if v_states = 0 then
    return null;
  end if;

  v_is_whole := v_first = v_last and v_tracks = v_states;
  if v_arrivals is not null then
    select * into v_source from semap.source where source_id = v_source_id;
    select count(*) filter (where source_id is null or source_id <> v_source_id),
           count(*) filter (where stamp <= seen_stamp),
           count(distinct track_id) filter (where not live and stamp > seen_stamp),
           count(*) filter (where is_last and stamp > seen_stamp),
           bool_or(outlier_stamp is not null or live and (x_m - from_x_m) ^ 2 + (y_m - from_y_m) ^ 2 > (v_source.jump_m / 2) ^ 2)
      into v_strange, v_late, v_appeared, v_ended, v_is_far
    from unnest(v_arrivals);
    if v_strange > 0 then
      perform semap.refuse_strange(v_source_id, v_arrivals);
    end if;
    if v_late > 0 then
      perform semap.unfold_sources(array[v_source_id]);
      perform semap.take_late(v_source, array(select a from unnest(v_arrivals) a where a.stamp <= a.seen_stamp));
    end if;
    -- what is needed of places that are not written yet, and of the other states of the same tracks
    v_is_stale := v_count.frame_stamp > v_count.placed_stamp
      and (v_appeared > 0 and v_first <= v_count.frame_stamp or v_is_far);
    if v_is_stale then
      perform semap.settle_places(array[v_source_id]);
      v_is_whole := false;
    end if;
    if v_appeared > 0 and v_first <= v_count.frame_stamp then
      update semap.source_count set frame_stamp = '-infinity', placed_stamp = '-infinity', frame_tracks = null, frame_track_ids = null
      where source_id = v_source_id returning * into v_count;
    end if;
    if v_tracks < v_states or v_is_stale or v_late > 0 then
      select array_agg(semap.arrival_of(n, t, v_count.frame_stamp)) into v_arrivals
      from new_state n join semap.track_now t using (track_id)
      where t.track_id in (select track_id from unnest(v_arrivals))
        and n.stamp > t.stamp and (n.stamp > v_count.frame_stamp or not t.live);
    end if;
    v_passed := v_arrivals;
    if v_is_far or v_tracks < v_states and semap.any_far_step(v_source, v_arrivals) then
      v_passed := semap.gated(v_source, v_arrivals);
      v_is_whole := false;
    end if;

    v_crossings := semap.move_tracks(v_passed);
    if exists (select from semap.region where map_id = v_map_id and careful) then
      v_crossings := v_crossings || semap.follow_carefully(v_passed);
    end if;
    perform semap.record_crossings(v_crossings);
  end if;

  if v_appeared > 0 then
    update semap.track k set ended_at = null
    where k.ended_at is not null and k.track_id in (select track_id from unnest(v_passed) where not live);
  end if;
  if v_ended > 0 then
    update semap.track k set ended_at = a.stamp
    from unnest(v_passed) a join semap.track_now t using (track_id)
    where a.is_last and a.stamp = t.stamp and k.track_id = a.track_id;
  end if;

  if v_is_whole and not v_in_pairs and v_late = 0 and v_states > c_large and v_states = v_count.frame_tracks + v_appeared
     and v_count.frame_track_ids is null
     and v_last < v_count.placed_stamp + interval '1 second' and semap.may_place_late(v_source_id, v_map_id, v_cell_m) then
    update semap.source_count
    set track_states = track_states + v_states, received_at = clock_timestamp(),
        frame_stamp = v_last, frame_tracks = v_states - v_ended, frame_track_ids = null
    where source_id = v_source_id;
    perform semap.note_newest(v_source_id, v_last);
    return null;
  end if;

  update semap.track_now t
  set stamp = n.stamp, x_m = n.x_m, y_m = n.y_m, z_m = n.z_m,
      std_m = n.std_m, std_across_m = n.std_across_m, std_yaw_rad = n.std_yaw_rad,
      heading_rad = n.heading_rad, speed_mps = n.speed_mps, length_m = n.length_m, width_m = n.width_m
  from new_state n
  where t.track_id = n.track_id and n.stamp > t.stamp and n.stamp > v_count.frame_stamp and n.stamp < t.calm_until
    and (v_tracks = v_states or (n.track_id, n.stamp) in (select track_id, max(stamp) from new_state group by track_id));
  if v_is_whole and v_late = 0 and v_states > c_large then
    -- counted no further than it takes to know, since many tracks may be live that are not in this batch
    v_is_frame := v_states - v_ended = (
      select count(*) from (select from semap.track_now where map_id = v_map_id and live and source_id = v_source_id
                            limit v_states - v_ended + 1) l);
  end if;
  insert into semap.source_count as c (source_id, track_states) values (v_source_id, v_states)
  on conflict (source_id) do update
  set track_states = c.track_states + v_states, received_at = clock_timestamp(),
      frame_stamp = case when v_is_frame then v_last else c.frame_stamp end,
      placed_stamp = case when v_is_frame then v_last else c.placed_stamp end,
      frame_tracks = case when v_is_frame then v_states - v_ended end, frame_track_ids = null;
  if v_late_pairs is not null then
    perform semap.take_late_pairs(v_map_id, v_late_pairs);
  end if;
  perform semap.note_newest(v_source_id, v_last);
  return null;
end $$;

create or replace trigger track_state_inserted after insert on semap.track_state
  referencing new table as new_state for each statement execute function semap.track_state_inserted();
