-- Where tracks are. semap.track_now has what a state is compared with: the safe region of its track, and where it was
-- when it left the one before. Where a track is within its safe region, its newest chunk says; that is *flushed* to
-- track_now once for many chunks, and whenever somebody asks for the exact position of all tracks of a source. Readers
-- ask semap.track_place. No other file knows which columns of track_now are those of a state.

-- The newest state of each track whose position was not flushed. Most chunks are of the tracks of the next newer one,
-- so they are not opened; a source has one chunk of each stamp that is not flushed (sql/135).
create or replace view semap.unflushed_state as
  select distinct on (k.source_id, s.track_id) k.source_id, s.track_id, s as state
  from (
    select n.source_id, c.from_stamp,
           lag(c.track_ids) over (partition by n.source_id order by c.from_stamp desc) is distinct from c.track_ids
             as is_newest
    from semap.source_count n join semap.state_chunk c on c.source_id = n.source_id and c.from_stamp > n.flushed_stamp
    where n.unflushed > 0 and c.track_id is null) k
  join semap.state_chunk c on c.source_id = k.source_id and c.track_id is null and c.from_stamp = k.from_stamp
  cross join lateral semap.states_of(c) s
  where k.is_newest
  order by k.source_id, s.track_id, s.stamp desc;

-- The present of a track, as a state.
create or replace function semap.present_state(p_now semap.track_now) returns setof semap.track_state
language sql immutable parallel safe rows 1 as $$
  select p_now.track_id, p_now.stamp, p_now.x_m, p_now.y_m, p_now.z_m, p_now.std_m, false, p_now.heading_rad,
         p_now.speed_mps, p_now.length_m, p_now.width_m, p_now.std_across_m, p_now.std_yaw_rad
$$;

-- Bring tracks to where these states say, and give what began and ended by it with stateless regions, at the stamp of
-- the first state that shows it. The states of one track come in any order, none of them late.
create or replace function semap.move_tracks(p_updates semap.state_update[]) returns semap.crossing[]
language plpgsql as $$
declare
  v_crossings  semap.crossing[];
begin
  with located as (
    select s.*, a.map_id, a.cell_m, a.live, a.region_ids, g.region_ids as here_ids, g.z_min_m as safe_z_min_m,
           g.z_max_m as safe_z_max_m
    from unnest(p_updates) a cross join lateral (select (a.state).*) s
    cross join lateral semap.regions_at(a.map_id, a.cell_m, s.x_m, s.y_m, s.z_m) g
  ), stepped as (
    select *, lag(is_last, 1, not live) over one_track as appears,
           lead(stamp) over one_track is null as is_present, first_value(stamp) over one_track as first_stamp,
           lag(case when is_last then '{}' else here_ids end, 1, region_ids) over one_track as before_ids
    from located
    window one_track as (partition by track_id order by stamp)
  ), crossed as (
    select track_id, region_id, 'began'::semap.change_kind as kind,
           case when appears then 'appeared' else 'moved' end::semap.change_cause as cause, stamp
    from stepped, unnest(here_ids) region_id
    where here_ids <> before_ids and region_id <> all (before_ids)
    union all
    select track_id, region_id, 'ended', 'moved', stamp
    from stepped, unnest(before_ids) region_id
    where here_ids <> before_ids and region_id <> all (here_ids)
    union all
    select track_id, region_id, 'ended', 'disappeared', stamp
    from stepped, unnest(here_ids) region_id
    where is_last
  ), moved as (
    update semap.track_now t
    set live = true, first_stamp = least(t.first_stamp, n.first_stamp),
        stamp = n.stamp, x_m = n.x_m, y_m = n.y_m, z_m = n.z_m,
        std_m = n.std_m, std_across_m = n.std_across_m, std_yaw_rad = n.std_yaw_rad,
        heading_rad = n.heading_rad, speed_mps = n.speed_mps, length_m = n.length_m, width_m = n.width_m,
        region_ids = case when n.is_last then '{}' else n.here_ids end,
        safe_x_min_m = c.x_min_m, safe_x_max_m = c.x_max_m, safe_y_min_m = c.y_min_m, safe_y_max_m = c.y_max_m,
        safe_z_min_m = n.safe_z_min_m, safe_z_max_m = n.safe_z_max_m, safe_std_m = c.std_m
    from stepped n cross join lateral semap.safe_rectangle(n.map_id, n.cell_m, n.x_m, n.y_m, n.std_m) c
    where t.track_id = n.track_id and n.is_present
  )
  select array_agg(row(track_id, region_id, kind, cause, stamp, stamp, null, null)::semap.crossing
                   order by stamp, cause = 'disappeared')
  into v_crossings from crossed;
  return v_crossings;
end $$;

-- Write the present of these tracks anew: where the newest states say that they are, until when the tracks say.
create or replace function semap.write_presents(p_track_ids bigint[], p_newest semap.track_state[]) returns void
language sql as $$
  update semap.track_now t
  set live = k.ended_at is null and s.stamp is not null, stamp = greatest(s.stamp, k.ended_at, '-infinity'),
      first_stamp = least(t.first_stamp, s.stamp),
      x_m = s.x_m, y_m = s.y_m, z_m = s.z_m,
      std_m = s.std_m, std_across_m = s.std_across_m, std_yaw_rad = s.std_yaw_rad,
      heading_rad = s.heading_rad, speed_mps = s.speed_mps, length_m = s.length_m, width_m = s.width_m
  from semap.track k left join unnest(p_newest) s using (track_id)
  where k.track_id = any (p_track_ids) and t.track_id = k.track_id
$$;

-- Tracks that stay within their safe regions are where the newest of these states says.
create or replace function semap.place_tracks_at(p_states semap.track_state[]) returns void
language sql as $$
  update semap.track_now t
  set stamp = s.stamp, x_m = s.x_m, y_m = s.y_m, z_m = s.z_m,
      std_m = s.std_m, std_across_m = s.std_across_m, std_yaw_rad = s.std_yaw_rad,
      heading_rad = s.heading_rad, speed_mps = s.speed_mps, length_m = s.length_m, width_m = s.width_m
  from (select distinct on (track_id) * from unnest(p_states) order by track_id, stamp desc) s
  -- what is set aside as an outlier is no position (sql/131)
  where t.track_id = s.track_id and s.stamp > t.stamp and s.stamp < t.safe_until
$$;

-- Write the position of each track of these sources that has a newer one. Whoever calls it keeps their writers out.
create or replace function semap.flush_positions(p_source_ids integer[]) returns void
language plpgsql as $$
declare
  v_source_id  integer;
begin
  for v_source_id in
    select source_id from semap.source_count where source_id = any (p_source_ids) and unflushed > 0 order by source_id
  loop
    perform semap.place_tracks_at(array(select state from semap.unflushed_state where source_id = v_source_id));
    update semap.source_count set flushed_stamp = newest_stamp, unflushed = 0 where source_id = v_source_id;
  end loop;
end $$;

-- Write where all tracks of these maps are.
create or replace function semap.flush_maps(p_map_ids integer[]) returns void
language sql as $$
  select semap.flush_positions(array_agg(source_id)) from semap.source where map_id = any (p_map_ids)
$$;

-- Write the positions of sources that have been silent for so long, so that all of their states can be compacted.
create or replace function semap.flush_silent_sources(p_silent interval default '10 s') returns void
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_source_ids  integer[] := array(
    select source_id from semap.source_count where unflushed > 0 and received_at < clock_timestamp() - p_silent
    order by source_id);
begin
  if v_source_ids <> '{}' then
    perform semap.lock_regions_shared();
    perform semap.lock_source(source_id) from unnest(v_source_ids) source_id;
    perform semap.flush_positions(v_source_ids);
  end if;
end $$;

-- Whether what follows from a state that left the safe region of its track needs the exact position before it: a query
-- asks for the way between two samples, or a safe region may be so wide that the gate for outliers could not do
-- without.
create or replace function semap.needs_positions(p_source semap.source, p_cell_m double precision) returns boolean
language sql stable as $$
  select coalesce((p_source).jump_m < 3 * p_cell_m, false)
      or exists (select from semap.region where map_id = (p_source).map_id and stateful and longest_gap is not null)
$$;

-- A gate for outliers that is another one asks how far tracks went, so positions are written by then.
create or replace function semap.gate_changed() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  perform semap.flush_positions(array[new.source_id]);
  return null;
end $$;

create or replace trigger gate_changed after update of jump_m, jump_mps on semap.source
  for each row execute function semap.gate_changed();

-- Where tracks are, each at its newest position; restricted roles see their own maps.
create or replace view semap.track_place with (security_barrier) as
  select t.track_id, t.source_id, t.map_id, t.live, t.first_stamp, p.stamp, p.x_m, p.y_m, p.z_m, p.std_m,
         p.std_across_m, p.std_yaw_rad, p.heading_rad, p.speed_mps, p.length_m, p.width_m, t.region_ids, t.stateful_ids
  from semap.track_now t
  left join semap.unflushed_state u
    on u.track_id = t.track_id and (u.state).stamp > t.stamp and (u.state).stamp < t.safe_until
  cross join lateral (
    select t.stamp, t.x_m, t.y_m, t.z_m, t.std_m, t.std_across_m, t.std_yaw_rad, t.heading_rad, t.speed_mps, t.length_m,
           t.width_m where u.track_id is null
    union all
    select (u.state).stamp, (u.state).x_m, (u.state).y_m, (u.state).z_m, (u.state).std_m, (u.state).std_across_m,
           (u.state).std_yaw_rad, (u.state).heading_rad, (u.state).speed_mps, (u.state).length_m, (u.state).width_m
    where u.track_id is not null) p
  where (select semap.visible_maps() is null) or t.map_id = any ((select semap.visible_maps())::integer[]);
