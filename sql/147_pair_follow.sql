-- What two things were to each other at a stamp is decided once that stamp is complete: when all states at or before it
-- have come, of all sources that are waited for. So it does not depend on how states are cut into batches, nor on which
-- source speaks first: at each stamp all tracks are where their latest state at or before it says. `pair_progress`
-- tells up to which stamp that is done. followed_state has where the tracks were then. The transaction that completes a
-- stamp, by moving a source (sql/125), follows the pairs up to it. States at or before it that come later are late
-- (sql/129, 148).
--
-- The row of the source is locked before the pairs of its map, by who writes states as by who says a watermark.

-- Up to where all states of a map have come, by its sources that follow tracks. One that has ended or is idle is not
-- waited for; where none is, the furthest counts, as for rules.
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
  v_last    semap.track_state;
begin
  select * into v_source from semap.source where source_id = p_now.source_id;
  v_states := array(select s from semap.states_around(p_now.track_id, p_at + interval '1 us',
                                                      case when v_source.jump_m is null then 1 else 16 end, 0, p_at) s);
  select * into v_last from semap.states_of((
    semap.updates_again(v_source, v_states, p_now, cardinality(v_states) < 16, '{}', p_at)).updates)
  order by stamp desc limit 1;
  return v_last;
end $$;

-- The tracks of a map, of these or (null) of all, that lived at a moment, each where it was.
create or replace function semap.tracks_at(p_map_id integer, p_at timestamptz, p_track_ids bigint[] default null)
returns setof semap.track_state
language sql stable as $$
  select p.* from semap.track_now n cross join lateral semap.present_state(n) p
  where n.map_id = p_map_id and n.live and n.stamp <= p_at and (p_track_ids is null or n.track_id = any (p_track_ids))
  union all
  select s.* from semap.track_now n cross join lateral semap.passed_state(n, p_at) s
  where n.map_id = p_map_id and n.stamp > p_at and n.first_stamp <= p_at and not s.is_last
    and not exists (select from semap.track_end e where e.track_id = s.track_id and e.stamp >= s.stamp
                    and e.stamp <= p_at)
    and (p_track_ids is null or n.track_id = any (p_track_ids))
$$;

-- Those at the moment up to which the pairs of the map are followed.
create or replace function semap.tracks_followed(p_map_id integer, p_track_ids bigint[] default null)
returns setof semap.track_state
language sql stable as $$
  select t.* from semap.pair_progress p cross join lateral semap.tracks_at(p_map_id, p.through, p_track_ids) t
  where p.map_id = p_map_id
$$;

-- What the tracks of a map did after a moment up to which its pairs are followed, up to another one: states that pass
-- the gate for outliers, and ends.
create or replace function semap.states_to_follow(p_map_id integer, p_after timestamptz, p_to timestamptz)
returns semap.track_state[]
language plpgsql stable set plan_cache_mode = force_generic_plan as $$
declare
  v_source  semap.source;
  v_ids     bigint[];
  v_states  semap.track_state[];
  v_some    semap.state_update[];
begin
  select array_agg(track_id) into v_ids from semap.track_now where map_id = p_map_id and stamp > p_after;
  with stated as materialized (
    select s.track_id, s.stamp, s as state from semap.states(v_ids, p_after, p_to) s where s.stamp > p_after
  ), ended as materialized (
    select * from semap.track_end e where e.track_id = any (v_ids) and e.stamp > p_after and e.stamp <= p_to
  )
  select array_agg(state) into v_states
  from (
    select case when e.stamp is null then s.state else semap.as_last(s.state) end as state
    from stated s left join ended e using (track_id, stamp)
    union all
    select semap.new_state(e.track_id, e.stamp, is_last => true)
    from ended e where not exists (select from stated s where s.track_id = e.track_id and s.stamp = e.stamp)) m;

  for v_source in select * from semap.source where map_id = p_map_id and jump_m is not null loop
    v_some := array(
      select semap.new_state_update(s, source_id => n.source_id, map_id => p_map_id, cell_m => n.cell_m,
                               live => f.track_id is not null, seen_stamp => (f.state).stamp,
                               from_x_m => (f.state).x_m, from_y_m => (f.state).y_m, from_z_m => (f.state).z_m)
      from unnest(v_states) s
      join semap.track_now n on n.track_id = s.track_id and n.source_id = v_source.source_id
      left join semap.followed_state f on f.track_id = s.track_id
      where s.x_m is not null);
    if semap.any_far_step(v_source, v_some) then
      v_states := array(select s from unnest(v_states) s
                        where s.x_m is null or s.track_id not in (select track_id from semap.states_of(v_some)))
        || array(
          select a.state
          from unnest((semap.gate(v_source, v_some, array(
            -- set aside before: what came after the last state that passed
            select s
            from (select distinct (a.state).track_id, a.seen_stamp from unnest(v_some) a where a.live) t
            cross join lateral semap.states_around(t.track_id, p_after + interval '1 us', 1, 0, p_after) s
            where s.stamp > t.seen_stamp))).passed) a);
    end if;
  end loop;
  return v_states;
end $$;

-- Where the tracks are that these states may be about: those that move, and others that may be near to them, where
-- queries are about two tracks.
create or replace function semap.places_to_follow(p_map_id integer, p_query_ids integer[], p_states semap.track_state[])
returns semap.track_state[]
language plpgsql stable set plan_cache_mode = force_generic_plan as $$
declare
  c_cell_m   constant double precision := 8; -- as in semap.keep_followed
  c_most_m   constant double precision := 40;
  v_reach_m  double precision;
  v_around   integer[];
begin
  select max(case when semap.covers_ground(q.object_compared) then 'infinity' else q.reach_m end) into v_reach_m
  from semap.query_predicate q
  where q.query_id = any (p_query_ids) and q.object_kind = 'track'
    and (q.subject_kind = 'track' or q.follows_from = 'rank');
  if v_reach_m is null then
    return semap.followed_places(p_map_id, array(select track_id from unnest(p_states)));
  elsif v_reach_m > c_most_m then
    return semap.followed_places(p_map_id);
  end if;
  v_around := array(select generate_series(-ceil(v_reach_m / c_cell_m)::integer, ceil(v_reach_m / c_cell_m)::integer));
  return array(
    select f.state
    from (
      select track_id from unnest(p_states)
      union
      select f.track_id
      from (select distinct c.cell_x + dx as cell_x, c.cell_y + dy as cell_y
            from (select distinct floor(x_m / c_cell_m)::integer as cell_x, floor(y_m / c_cell_m)::integer as cell_y
                  from unnest(p_states) where x_m is not null) c, unnest(v_around) dx, unnest(v_around) dy) c
      join semap.followed_state f on f.map_id = p_map_id and f.cell_x = c.cell_x and f.cell_y = c.cell_y) k
    join semap.followed_state f using (track_id));
end $$;

-- Follow the pairs of a map up to where all its states have come.
create or replace function semap.advance_pairs(p_map_id integer) returns void
language plpgsql as $$
declare
  c_queries   constant integer[] := array(select query_id from semap.continuous_query
                                          where map_id = p_map_id and in_pairs and enabled);
  v_through   timestamptz;
  v_complete  timestamptz;
  v_states    semap.track_state[];
  v_ids       bigint[];
  v_before    semap.relation_state[];
  v_step      record;
begin
  if c_queries = '{}' then
    return;
  end if;
  perform semap.lock_regions_shared();
  perform semap.lock_pairs(p_map_id);
  v_complete := semap.map_complete_through(p_map_id);
  select through into v_through from semap.pair_progress where map_id = p_map_id;
  if v_complete > v_through then
    v_states := semap.states_to_follow(p_map_id, v_through, v_complete);
    if v_states is not null then
      v_ids := array(select distinct track_id from unnest(v_states));
      v_before := semap.known_pairs(c_queries, v_ids);
      v_step := semap.follow_pairs(c_queries, v_states, semap.places_to_follow(p_map_id, c_queries, v_states),
                                   v_before);
      perform semap.keep_followed(p_map_id, v_ids, v_step.places);
      perform semap.keep_pairs(p_map_id, v_before, v_step.pairs);
      perform semap.record_pair_changes(v_step.changes);
    end if;
    update semap.pair_progress set through = v_complete where map_id = p_map_id;
  end if;
end $$;

-- Pairs of a map are followed from here on, where they were not followed up to here.
create or replace function semap.begin_following(p_map_id integer) returns void
language plpgsql as $$
declare
  c_complete  constant timestamptz := semap.map_complete_through(p_map_id);
begin
  if c_complete <= (select through from semap.pair_progress where map_id = p_map_id) then
    return;
  end if;
  insert into semap.pair_progress as p (map_id, through) values (p_map_id, c_complete)
  on conflict (map_id) do update set through = excluded.through;
  perform semap.flush_positions(array_agg(source_id order by source_id)) from semap.source where map_id = p_map_id;
  delete from semap.followed_state where map_id = p_map_id;
  perform semap.keep_followed(p_map_id, array_agg(s.track_id), array_agg(s))
    from semap.tracks_at(p_map_id, c_complete) s;
end $$;

-- A source that has come further, or is not waited for any more, may complete stamps of its map.
create or replace function semap.source_completes() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  perform semap.advance_pairs(map_id) from semap.map where map_id = coalesce(new.map_id, old.map_id);
  return null;
end $$;

create or replace trigger source_completes after update on semap.source
  for each row when (
    (new.watermark, new.newest_stamp, new.newest_is_whole, new.lateness, new.ended, new.idle, new.late_from)
    is distinct from
    (old.watermark, old.newest_stamp, old.newest_is_whole, old.lateness, old.ended, old.idle, old.late_from))
  execute function semap.source_completes();

create or replace trigger source_gone after delete on semap.source
  for each row execute function semap.source_completes();
