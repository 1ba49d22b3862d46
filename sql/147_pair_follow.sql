-- What two things were to each other at a stamp is decided once that stamp is complete: when all states at or before it have
-- come, of all sources that are waited for. So it does not depend on how states are cut into batches, nor on which source
-- speaks first: at each stamp all tracks are where their latest state at or before it says. `pair_progress` tells up to
-- which stamp that is done. Tracks in pair_member are where they were then. The transaction that completes a stamp, by moving
-- a source (sql/125), follows the pairs up to it. States at or before it that come later are late (sql/129).
--
-- The row of the source is locked before the pairs of its map, by who writes states as by who says a watermark.

-- Up to where all states of a map have come, by its sources that follow tracks. One that has ended or is idle is not waited
-- for; where none is, the furthest counts, as for rules.
create or replace function semap.map_complete_through(p_map_id integer) returns timestamptz
language sql stable as $$
  select coalesce(
    (select min(semap.complete_through(s)) from semap.source s
     where s.map_id = p_map_id and not s.ended and not s.idle
       and exists (select from semap.track t where t.source_id = s.source_id)),
    (select max(semap.complete_through(s)) from semap.source s where s.map_id = p_map_id), '-infinity')
$$;

-- The last state of a track at or before a moment that passes the gate for outliers.
create or replace function semap.passed_state(p_now semap.track_now, p_at timestamptz) returns semap.track_state
language plpgsql stable as $$
declare
  v_source  semap.source;
  v_states  semap.track_state[];
  v_last    semap.arrival;
begin
  select * into v_source from semap.source where source_id = p_now.source_id;
  v_states := array(select s from semap.states_around(p_now.track_id, p_at + interval '1 us',
                                                      case when v_source.jump_m is null then 1 else 16 end, 0, p_at) s);
  select * into v_last from unnest((
    semap.arrivals_again(v_source, v_states, p_now, cardinality(v_states) < 16, '{}', p_at)).arrivals)
  order by stamp desc limit 1;
  return row(v_last.track_id, v_last.stamp, v_last.x_m, v_last.y_m, v_last.z_m, v_last.std_m, v_last.is_last, v_last.heading_rad,
             v_last.speed_mps, v_last.length_m, v_last.width_m, v_last.std_across_m, v_last.std_yaw_rad)::semap.track_state;
end $$;

-- The tracks of a map, of these or (null) of all, that lived at a moment, each where it was.
create or replace function semap.tracks_at(p_map_id integer, p_at timestamptz, p_track_ids bigint[] default null)
returns setof semap.track_state
language sql stable as $$
  select n.track_id, n.stamp, n.x_m, n.y_m, n.z_m, n.std_m, false, n.heading_rad, n.speed_mps, n.length_m, n.width_m,
         n.std_across_m, n.std_yaw_rad
  from semap.track_now n
  where n.map_id = p_map_id and n.live and n.stamp <= p_at and (p_track_ids is null or n.track_id = any (p_track_ids))
  union all
  select s.* from semap.track_now n cross join lateral semap.passed_state(n, p_at) s
  where n.map_id = p_map_id and n.stamp > p_at and n.first_stamp <= p_at and not s.is_last
    and not exists (select from semap.track_end e where e.track_id = s.track_id and e.stamp >= s.stamp and e.stamp <= p_at)
    and (p_track_ids is null or n.track_id = any (p_track_ids))
$$;

-- Those at the moment up to which the pairs of the map are followed.
create or replace function semap.tracks_followed(p_map_id integer, p_track_ids bigint[] default null)
returns setof semap.track_state
language sql stable as $$
  select t.* from semap.pair_progress p cross join lateral semap.tracks_at(p_map_id, p.through, p_track_ids) t
  where p.map_id = p_map_id
$$;

-- What the tracks of a map did after a moment, up to another one: states that pass the gate for outliers, and ends.
create or replace function semap.states_to_follow(p_map_id integer, p_after timestamptz, p_to timestamptz)
returns semap.arrival[]
language plpgsql stable set plan_cache_mode = force_generic_plan as $$
declare
  v_source  semap.source;
  v_ids     bigint[];
  v_states  semap.arrival[];
  v_some    semap.arrival[];
begin
  select array_agg(track_id) into v_ids from semap.track_now where map_id = p_map_id and stamp > p_after;
  with stated as materialized (
    select * from semap.states(v_ids, p_after, p_to) s where s.stamp > p_after
  ), ended as materialized (
    select * from semap.track_end e where e.track_id = any (v_ids) and e.stamp > p_after and e.stamp <= p_to
  ), moment as (
    select s.track_id, s.stamp, s.x_m, s.y_m, s.z_m, s.std_m, s.heading_rad, s.speed_mps, s.length_m, s.width_m,
           s.is_last or e.stamp is not null as is_last, s.std_across_m, s.std_yaw_rad
    from stated s left join ended e using (track_id, stamp)
    union all
    select e.track_id, e.stamp, null, null, null, null, null, null, null, null, true, null, null
    from ended e where not exists (select from stated s where s.track_id = e.track_id and s.stamp = e.stamp)
  )
  select array_agg(row(s.track_id, s.stamp, s.x_m, s.y_m, s.z_m, s.std_m, s.heading_rad, s.speed_mps, s.length_m, s.width_m,
                       s.is_last, n.source_id, p_map_id, n.cell_m, m.place is not null, m.stamp, st_x(m.place), st_y(m.place),
                       m.z_min_m, '{}', null, s.std_across_m, s.std_yaw_rad)::semap.arrival)
  into v_states
  from moment s
  join semap.track_now n using (track_id)
  left join lateral (
    select stamp, place, z_min_m from semap.pair_member where key = s.track_id limit 1) m on true;

  for v_source in select * from semap.source where map_id = p_map_id and jump_m is not null loop
    v_some := array(select a from unnest(v_states) a where a.source_id = v_source.source_id);
    if semap.any_far_step(v_source, v_some) then
      v_states := array(select a from unnest(v_states) a where a.source_id <> v_source.source_id or a.x_m is null)
        || (semap.gate(v_source, array(select a from unnest(v_some) a where a.x_m is not null), array(
              -- set aside before: what came after the last state that passed
              select row(t.track_id, s.stamp, s.x_m, s.y_m, null, null, null, null, null, null, null, null, null, null,
                         null, null, null, null, null, null, null, null, null)::semap.arrival
              from (select distinct track_id, seen_stamp from unnest(v_some) where live) t
              cross join lateral (select * from semap.states_around(t.track_id, p_after + interval '1 us', 1, 0, p_after)) s
              where s.stamp > t.seen_stamp))).passed;
    end if;
  end loop;
  return v_states;
end $$;

-- Follow the pairs of a map up to where all its states have come.
create or replace function semap.follow_pairs(p_map_id integer) returns void
language plpgsql as $$
declare
  v_through   timestamptz;
  v_complete  timestamptz;
begin
  if not exists (select from semap.continuous_query where map_id = p_map_id and in_pairs and enabled) then
    return;
  end if;
  perform semap.hold_regions();
  perform semap.hold_pairs(p_map_id);
  v_complete := semap.map_complete_through(p_map_id);
  select through into v_through from semap.pair_progress where map_id = p_map_id;
  if v_complete > v_through then
    perform semap.compare_pairs(p_map_id, semap.states_to_follow(p_map_id, v_through, v_complete));
    update semap.pair_progress set through = v_complete where map_id = p_map_id;
  end if;
end $$;

-- Pairs of these maps are followed from here on, where nobody followed them before.
create or replace function semap.begin_following(p_map_ids integer[]) returns void
language sql as $$
  insert into semap.pair_progress as p (map_id, through)
  select id, semap.map_complete_through(id) from unnest(p_map_ids) id
  on conflict (map_id) do update set through = excluded.through where p.through < excluded.through
$$;

-- A source that has come further, or is not waited for any more, may complete stamps of its map.
create or replace function semap.source_completes() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  perform semap.follow_pairs(map_id) from semap.map where map_id = coalesce(new.map_id, old.map_id);
  return null;
end $$;

create or replace trigger source_completes after update on semap.source
  for each row when (
    (new.watermark, new.newest_stamp, new.newest_is_whole, new.lateness, new.ended, new.idle)
    is distinct from (old.watermark, old.newest_stamp, old.newest_is_whole, old.lateness, old.ended, old.idle))
  execute function semap.source_completes();

create or replace trigger source_gone after delete on semap.source
  for each row execute function semap.source_completes();

-- Correct pairs after these states, each of a stamp up to which the pairs of their map were followed already; tracks that
-- are known by a newer one than before are there from now on.
create or replace function semap.take_late_pairs(p_map_id integer, p_late semap.arrival[]) returns void
language plpgsql as $$
declare
  v_ids       bigint[] := array(select distinct track_id from unnest(p_late));
  v_now       semap.arrival[];
  v_appeared  bigint[];
  v_gone      bigint[];
begin
  perform semap.amend_pairs(p_map_id, p_late);
  select array_agg(row(s.track_id, s.stamp, s.x_m, s.y_m, s.z_m, s.std_m, s.heading_rad, s.speed_mps, s.length_m, s.width_m,
                       false, null, p_map_id, null, true, null, null, null, null, '{}', null, null, null)::semap.arrival),
         array_agg(s.track_id) filter (where not exists (select from semap.pair_member m where m.key = s.track_id))
  into v_now, v_appeared
  from semap.tracks_followed(p_map_id, v_ids) s;
  perform semap.place_tracks(v_now, v_appeared);
  v_gone := array(select distinct key from semap.pair_member where key = any (v_ids)
                  except select track_id from unnest(v_now));
  if v_gone <> '{}' then
    perform semap.let_tracks_go(v_gone, null, 'disappeared');
  end if;
end $$;
