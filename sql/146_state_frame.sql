-- States that come together, as one row of arrays. Of 1,000 states, most of what a COPY costs is to make rows and keys of
-- them, one by one; a *frame*, all tracks of a source at one moment, is stored as it came. It moves tracks as rows do
-- (sql/135), and is taken so where that is sure to be the same: where it follows a frame of the same tracks, all of which
-- live, and no place is asked for at once. Any other frame becomes rows here and now, and what holds for rows holds for it.
--
-- Frames become rows a second or two later (semap.unfold_frames, which the worker calls), so that few are looked through.
-- The newest one of a source stays as long as it is where everybody is, and the source is not silent.

-- Whether what a frame says of errors is so of each of its states (as the constraint ellipse_is_one of rows has it).
create or replace function semap.are_ellipses(p_frame semap.track_state_frame) returns boolean
language sql immutable parallel safe as $$
  select not exists (
    select from semap.states_of_frame(p_frame)
    where case when std_across_m is null then std_yaw_rad is null
               else std_across_m between 0 and std_m and std_m < 1e15 and abs(std_yaw_rad) <= 7
               end is not true)
$$;

-- Make rows of the oldest frames of a source, or of the one that has the oldest, of one day and of at most so many states,
-- but of one frame at least; says of how many. The rows go straight to where those of the day are, past the trigger of track_state, since
-- these states have moved their tracks.
create or replace function semap.unfold_frames(p_source_id integer default null, p_most_states integer default 20000)
returns bigint
language plpgsql security definer
set search_path = pg_catalog, pg_temp set plan_cache_mode = force_custom_plan as $$
declare
  c_is_to_go   constant text := $sql$
    not exists (select from semap.source_count c
                where c.source_id = f.source_id and c.frame_stamp = f.stamp and c.placed_stamp < f.stamp)
  $sql$;
  v_source_id  integer := p_source_id;
  v_from       timestamptz;
  v_frames     bigint;
begin
  if v_source_id is null then
    execute 'select f.source_id from semap.track_state_frame f where ' || c_is_to_go || ' order by f.stamp limit 1'
    into v_source_id;
  end if;
  perform pg_advisory_xact_lock(7374, v_source_id);
  execute 'select min(f.stamp) from semap.track_state_frame f where f.source_id = $1 and ' || c_is_to_go
  into v_from using v_source_id;
  if v_from is null then
    return 0;
  end if;
  v_from := date_trunc('day', v_from, 'UTC');
  execute format(
    'with old as ('
    ' select f.stamp, cardinality(f.track_ids) as states from semap.track_state_frame f'
    ' where f.source_id = $1 and f.stamp >= $2 and f.stamp < $3 and %s order by f.stamp limit 1000'
    '), chosen as ('
    ' select stamp from (select *, sum(states) over (order by stamp) - states as before from old) o'
    ' where before < $4'
    '), taken as ('
    ' delete from semap.track_state_frame f using chosen c where f.stamp = c.stamp and f.source_id = $1 returning f as frame'
    '), kept as ('
    ' insert into %s (track_id, stamp, x_m, y_m, z_m, std_m, is_last, heading_rad, speed_mps, length_m, width_m,'
    '                 std_across_m, std_yaw_rad)'
    ' select s.track_id, s.stamp, s.x_m, s.y_m, s.z_m, s.std_m, s.is_last, s.heading_rad, s.speed_mps, s.length_m, s.width_m,'
    '        s.std_across_m, s.std_yaw_rad'
    ' from taken cross join lateral semap.states_of_frame(frame) s'
    ') select count(*) from taken',
    c_is_to_go, coalesce(to_regclass('semap.track_state_' || to_char(v_from at time zone 'UTC', 'YYYYMMDD')),
                         'semap.track_state_default'))
  into v_frames using v_source_id, v_from, v_from + interval '1 day', p_most_states;
  return v_frames;
end $$;

-- Make rows of all frames of these sources, for what asks for all their states as rows. Whoever calls it keeps their writers out.
create or replace function semap.unfold_sources(p_source_ids integer[]) returns void
language plpgsql as $$
declare
  v_source_id  integer;
begin
  perform semap.settle_places(p_source_ids);
  for v_source_id in select distinct source_id from semap.track_state_frame where source_id = any (p_source_ids) loop
    while semap.unfold_frames(v_source_id, 1000000) > 0 loop
    end loop;
  end loop;
end $$;

-- Make rows of the frames of a source that are older than this: nobody else does, it seems. It is no reason to refuse what
-- comes.
create or replace function semap.unfold_old_frames(p_source_id integer, p_before timestamptz) returns void
language plpgsql as $$
begin
  while exists (select from semap.track_state_frame where source_id = p_source_id and stamp < p_before) loop
    exit when semap.unfold_frames(p_source_id, 100000) = 0;
  end loop;
exception when others then
  raise warning 'Frames of the source % do not become rows: %', p_source_id, sqlerrm;
end $$;

-- Write the places of sources that have been silent for so long: their newest frame may become rows as well.
create or replace function semap.settle_silent_sources(p_silent interval default '10 s') returns void
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_source_ids  integer[] := array(
    select source_id from semap.source_count c
    where frame_stamp > placed_stamp and received_at < clock_timestamp() - p_silent
      and exists (select from semap.track_state_frame f where f.source_id = c.source_id)
    order by source_id);
begin
  if v_source_ids <> '{}' then
    perform semap.hold_regions();
    perform semap.hold_source(source_id) from unnest(v_source_ids) source_id;
    perform semap.settle_places(v_source_ids);
  end if;
end $$;

-- Make rows of a frame, and know whether the next one may follow it: whether it holds each live track of its source once,
-- says where that is, and no query of the map asks for more than where somebody is.
create or replace function semap.take_frame_as_rows(p_frame semap.track_state_frame) returns void
language plpgsql set random_page_cost = 0.5 as $$
declare
  v_tracks      constant integer := cardinality(p_frame.track_ids);
  v_map_id      integer;
  v_may_follow  boolean;
  v_count       semap.source_count;
begin
  select s.map_id, semap.may_place_late(s.source_id, s.map_id, m.cell_m) into v_map_id, v_may_follow
  from semap.source s join semap.map m using (map_id) where s.source_id = p_frame.source_id;
  if v_map_id is null then
    raise exception 'There is no source %.', p_frame.source_id
      using errcode = 'foreign_key_violation', hint = 'Insert the source into semap.source first.';
  end if;
  insert into semap.track_state select * from semap.states_of_frame(p_frame);
  select * into v_count from semap.source_count where source_id = p_frame.source_id;
  if v_count.frame_stamp > p_frame.stamp or not v_may_follow
     or exists (select from semap.continuous_query
                where map_id = v_map_id and enabled and (in_pairs or longest_gap is not null)) then
    return;
  end if;
  if v_count.frame_stamp < p_frame.stamp then
    if (select count(*) <> v_tracks or bool_or(stamp <> p_frame.stamp)
        from (select stamp from semap.track_now
              where map_id = v_map_id and source_id = p_frame.source_id and live limit v_tracks + 1) l) then
      return;
    end if;
    v_count.placed_stamp := p_frame.stamp;
  elsif v_count.frame_tracks is distinct from v_tracks then
    return;
  end if;
  update semap.track_now t set slot = n.slot
  from unnest(p_frame.track_ids) with ordinality n (track_id, slot)
  where t.track_id = n.track_id and t.slot is distinct from n.slot;
  update semap.source_count
  set frame_stamp = p_frame.stamp, placed_stamp = v_count.placed_stamp, frame_tracks = v_tracks, frame_track_ids = p_frame.track_ids
  where source_id = p_frame.source_id;
end $$;

-- A frame moves its tracks, and is kept, or becomes rows.
create or replace function semap.state_frame_arrives() returns trigger
language plpgsql security definer
set search_path = public, pg_temp set plan_cache_mode = force_generic_plan set enable_mergejoin = off
set random_page_cost = 0.5 as $$
declare
  c_places_each     constant interval := '10 s';
  v_states          constant integer := cardinality(new.track_ids);
  -- which are taken by their place at once, unlike those of a record
  v_x_m             constant double precision[] := new.x_m;
  v_y_m             constant double precision[] := new.y_m;
  v_z_m             constant double precision[] := new.z_m;
  v_std_m           constant real[] := new.std_m;
  v_before          record;
  v_arrivals        semap.arrival[];
  v_crossings       semap.crossing[];
  v_as_rows         boolean;
begin
  if new.track_ids is null or new.x_m is null or new.y_m is null then
    return new; -- which is refused
  elsif (cardinality(new.x_m), cardinality(new.y_m)) <> (v_states, v_states)
     or v_states <> any (array[cardinality(new.z_m), cardinality(new.std_m), cardinality(new.heading_rad),
                               cardinality(new.speed_mps), cardinality(new.length_m), cardinality(new.width_m),
                               cardinality(new.std_across_m), cardinality(new.std_yaw_rad)]) then
    raise exception 'The arrays of a frame of states differ in length.'
      using errcode = 'array_subscript_error', hint = 'Give each a value for each of track_ids, or null in place of the array.';
  elsif v_states = 0 then
    return null;
  end if;
  if current_setting('transaction_isolation') <> 'read committed' then
    perform semap.require_read_committed();
  end if;
  perform pg_advisory_xact_lock_shared(7363, 0), pg_advisory_xact_lock(7364, new.source_id); -- as in sql/020, in one statement
  select s.map_id, s.jump_m, c.frame_stamp, c.placed_stamp, c.frame_track_ids into v_before
  from semap.source_count c join semap.source s using (source_id) where c.source_id = new.source_id;
  -- what no state may say is refused as a row; constraints of this table would be parsed anew for each frame
  v_as_rows := not (
    new.track_ids = v_before.frame_track_ids
    and new.stamp > v_before.frame_stamp and new.stamp between '1800-01-01Z' and '9999-01-01Z'
    and -1e7 <= all (new.x_m) and 1e7 >= all (new.x_m) and -1e7 <= all (new.y_m) and 1e7 >= all (new.y_m)
    and coalesce(-1e7 <= all (new.z_m) and 1e7 >= all (new.z_m), true)
    and coalesce(-7 <= all (new.heading_rad) and 7 >= all (new.heading_rad), true)
    and coalesce(0 <= all (new.speed_mps) and 1e4 >= all (new.speed_mps), true)
    and coalesce(0 < all (new.length_m) and 1e4 >= all (new.length_m), true)
    and coalesce(0 < all (new.width_m) and 1e4 >= all (new.width_m), true)
    and (new.std_across_m is null and new.std_yaw_rad is null or semap.are_ellipses(new))
    -- values are taken by their place
    and coalesce('[1:' || v_states || ']' = all (array[
      array_dims(new.x_m), array_dims(new.y_m), array_dims(new.z_m), array_dims(new.std_m), array_dims(new.heading_rad),
      array_dims(new.speed_mps), array_dims(new.length_m), array_dims(new.width_m), array_dims(new.std_across_m),
      array_dims(new.std_yaw_rad)]), true)) is true;

  if not v_as_rows then
    -- all of these tracks are known, live, and were seen before: what is left of the comparison in sql/135
    select array_agg(row(t.track_id, new.stamp, v_x_m[t.slot], v_y_m[t.slot], v_z_m[t.slot], v_std_m[t.slot],
                         new.heading_rad[t.slot], new.speed_mps[t.slot], new.length_m[t.slot], new.width_m[t.slot], false,
                         t.source_id, t.map_id, t.cell_m, t.live, v_before.frame_stamp, t.x_m, t.y_m, t.z_m, t.region_ids,
                         t.outlier_stamp, new.std_across_m[t.slot], new.std_yaw_rad[t.slot])::semap.arrival),
           -- what the gate has to look at, and no place
           bool_or(t.outlier_stamp is not null or v_x_m[t.slot] is null or v_y_m[t.slot] is null
                   or (v_x_m[t.slot] - t.x_m) ^ 2 + (v_y_m[t.slot] - t.y_m) ^ 2 > (v_before.jump_m / 2) ^ 2)
    into v_arrivals, v_as_rows
    from semap.track_now t
    where t.map_id = v_before.map_id and t.source_id = new.source_id and t.live
      and (v_x_m[t.slot] > t.calm_x_min_m and v_x_m[t.slot] < t.calm_x_max_m
           and v_y_m[t.slot] > t.calm_y_min_m and v_y_m[t.slot] < t.calm_y_max_m
           and case when v_z_m[t.slot] is null then t.calm_z_min_m is null
                    else v_z_m[t.slot] >= t.calm_z_min_m and v_z_m[t.slot] < t.calm_z_max_m end
           and (v_std_m[t.slot] <= t.calm_std_m or v_std_m[t.slot] is null)
           and new.stamp < t.calm_until) is not true;
  end if;
  if v_as_rows then
    perform semap.take_frame_as_rows(new);
    perform semap.note_newest(new.source_id, new.stamp, true);
    return null;
  end if;

  if v_arrivals is not null then
    v_crossings := semap.move_tracks(v_arrivals);
    if exists (select from semap.region where map_id = v_before.map_id and careful) then
      v_crossings := v_crossings || semap.follow_carefully(v_arrivals);
    end if;
    perform semap.record_crossings(v_crossings);
  end if;
  if new.stamp >= v_before.placed_stamp + c_places_each then
    update semap.track_now t
    set stamp = n.stamp, x_m = n.x_m, y_m = n.y_m, z_m = n.z_m,
        std_m = n.std_m, std_across_m = n.std_across_m, std_yaw_rad = n.std_yaw_rad,
        heading_rad = n.heading_rad, speed_mps = n.speed_mps, length_m = n.length_m, width_m = n.width_m
    from semap.states_of_frame(new) n
    where t.track_id = n.track_id and t.stamp < new.stamp;
    v_before.placed_stamp := new.stamp;
    perform semap.unfold_old_frames(new.source_id, new.stamp - interval '1 min');
  end if;
  update semap.source_count
  set track_states = track_states + v_states, received_at = clock_timestamp(),
      frame_stamp = new.stamp, placed_stamp = v_before.placed_stamp
  where source_id = new.source_id;
  perform semap.note_newest(new.source_id, new.stamp, true);
  return new;
end $$;

create or replace trigger state_frame_arrives before insert on semap.track_state_frame
  for each row execute function semap.state_frame_arrives();
