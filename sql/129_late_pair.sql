-- Late states and pairs: what any two things were to each other is what it would be had the states of both come in the
-- order of their stamps. What a pair is depends on others (nearest), on what was before (times to confirm, approaching,
-- the side of a line) and on when it was compared. So the past is replayed again (sql/128), once with the late states
-- and once without them. Only what the two replays differ in is written (sql/146, 148).

-- Where tracks were at a moment, and their states from there up to another one, of all that may come into a pair with
-- these meanwhile: all of the map where a query asks for the nearest, or for whoever is faced however far away; else
-- those that come near enough. Null where that is too much to look through.
create or replace function semap.states_near(
  p_map_id integer, p_query_ids integer[], p_late_ids bigint[], p_from timestamptz, p_to timestamptz
) returns semap.track_state[]
language plpgsql stable set plan_cache_mode = force_custom_plan as $$
declare
  c_most_states  constant integer := 300000;
  v_ids          bigint[] := p_late_ids;
  v_reach_m      double precision;
  v_states       semap.track_state[];
begin
  select max(case when p.reach_m = 'infinity' then 'infinity' else coalesce(q.distance_m, 0) + q.leave_margin_m end)
  into v_reach_m
  from semap.continuous_query q join semap.query_predicate p using (query_id)
  where query_id = any (p_query_ids) and p.object_kind = 'track'
    and (p.subject_kind = 'track' or p.follows_from = 'rank');
  if v_reach_m is not null then
    select array_agg(distinct w.track_id) into v_ids
    from semap.pair_track_wanted w join semap.track_now n using (track_id)
    where w.query_id = any (p_query_ids) and n.first_stamp <= p_to and (n.live or n.stamp >= p_from);
  end if;
  v_states := array(
    (select s from semap.states(v_ids, p_from, p_to) s where s.stamp > p_from limit c_most_states + 1)
    union all
    select l from semap.states_at(
      array(select track_id from semap.track_now where track_id = any (v_ids) and first_stamp <= p_from), p_from) l);
  if cardinality(v_states) > c_most_states then
    return null;
  elsif v_reach_m is null or v_reach_m = 'infinity' then
    return v_states;
  end if;
  return (
    with seen as materialized (
      select s as state, s.track_id, s.x_m, s.y_m, greatest(s.length_m, s.width_m, 0) as size_m from unnest(v_states) s
    ), box as (
      select min(x_m) as x_min_m, max(x_m) as x_max_m, min(y_m) as y_min_m, max(y_m) as y_max_m,
             max(size_m) + v_reach_m as reach_m
      from seen where track_id = any (p_late_ids)
    ), near as (
      select distinct s.track_id
      from seen s, box b
      where s.x_m between b.x_min_m - b.reach_m - s.size_m and b.x_max_m + b.reach_m + s.size_m
        and s.y_m between b.y_min_m - b.reach_m - s.size_m and b.y_max_m + b.reach_m + s.size_m
    )
    select array_agg(s.state) from seen s join near using (track_id));
end $$;

-- What is replayed after states that came late, of these tracks at these stamps, for queries that take so long to
-- confirm. What a pair remembers of what was before is a matter of a few comparisons and of the times to confirm, so a
-- replay begins four states and two such times before the first late state. p_further: how many states it goes on after
-- the last one. The states are null where that is more than a replay may hold, or where states of that time are gone.
create or replace function semap.prepare_replay(
  p_map_id integer, p_query_ids integer[], p_confirm interval, p_ids bigint[], p_stamps timestamptz[],
  p_further integer, out from_stamp timestamptz, out to_stamp timestamptz, out is_present boolean,
  out track_ids bigint[], out states semap.track_state[], out states_without semap.track_state[]
)
language plpgsql stable as $$
declare
  c_most_states  constant integer := 20000;
  c_most_stamps  constant integer := 500;
  c_late_to      constant timestamptz := p_stamps[cardinality(p_stamps)];
  v_present      timestamptz := (select through from semap.pair_progress where map_id = p_map_id);
  v_ids          bigint[] := array(select distinct id from unnest(p_ids) id);
  v_stated       semap.track_state[];
begin
  -- what a track was compared with when it appeared is replayed as well
  select least(min(b.stamp), p_stamps[1] - greatest(2 * p_confirm, '1 us')) into from_stamp
  from unnest(v_ids) id
  cross join lateral (select case when count(*) < 4 then min(stamp) - interval '1 us' else min(stamp) end as stamp
                      from semap.states_around(id, p_stamps[1], 4, 0, p_stamps[1])) b;
  if from_stamp < (select max(gone_before) from semap.retention where kind in ('states', 'changes')) then
    return;
  end if;
  -- A track is where its last state says until the present. Beyond that nothing of it changes but what lasts, and what
  -- others do. What is queued is stored already, and is no state that both replays go through.
  select case when bool_or(a.states = 0) then v_present
              else least(v_present, greatest(max(a.stamp), c_late_to + p_further * p_confirm / 2)
                                    + case when bool_or(a.states < p_further) then p_further * interval '1 s'
                                           else '0' end) end
  into to_stamp
  from unnest(v_ids) id
  cross join lateral (
    select array_agg(l.stamp) as stamps from semap.late_state l
    where l.of_pairs and l.track_id = id and l.stamp > c_late_to) n
  cross join lateral (
    select count(*) as states, max(stamp) as stamp from (
      select s.stamp
      from semap.states_around(id, c_late_to + interval '1 us', 0, p_further + coalesce(cardinality(n.stamps), 0),
                               v_present) s
      where (s.stamp = any (n.stamps)) is not true
      order by s.stamp limit p_further) s) a;
  is_present := to_stamp >= v_present;
  v_stated := semap.states_near(p_map_id, p_query_ids, v_ids, from_stamp, to_stamp);
  track_ids := array(select distinct track_id from unnest(v_stated));
  if (select count(*) <= c_most_states and count(distinct stamp) <= c_most_stamps
      from unnest(v_stated) s where s.stamp > prepare_replay.from_stamp) and v_stated is not null then
    states := semap.states_to_replay(p_map_id, v_stated, from_stamp, to_stamp, p_ids, p_stamps);
    states_without := semap.states_to_replay(p_map_id, v_stated, from_stamp, to_stamp, '{}', '{}');
  end if;
end $$;

-- How what is known of the pairs of a map is to be corrected after the oldest of its late states that are queued
-- (taken_*: which), of the same snapshot: many at once if that is not too much to replay, else fewer; and where one
-- state alone is too much, without the queries that take longest to confirm. A replay goes on until it makes no
-- difference to what is remembered, at most up to the present. query_ids: of which queries; '{}': nothing is to be
-- corrected. revision: what has to be that of the map still when it is written.
create or replace function semap.plan_correction(
  p_map_id integer, out taken_ids bigint[], out taken_stamps timestamptz[], out query_ids integer[],
  out revision bigint, out through timestamptz,
  out from_stamp timestamptz, out to_stamp timestamptz, out is_present boolean, out track_ids bigint[],
  out changes semap.pair_change[], out changes_without semap.pair_change[],
  out pairs semap.relation_state[], out pairs_without semap.relation_state[]
) language plpgsql stable as $$
declare
  c_query_ids  constant integer[] := array(select query_id from semap.continuous_query where map_id = p_map_id
                                           and in_pairs and enabled);
  v_confirm    interval;
  v_count      integer := 200;
  v_further    integer := 4;
  v_ids        bigint[];
  v_stamps     timestamptz[];
  v_next       record;
begin
  query_ids := c_query_ids;
  select p.revision, p.through into revision, through from semap.pair_progress p where p.map_id = p_map_id;
  select array_agg(track_id order by stamp, track_id), array_agg(stamp order by stamp, track_id)
  into taken_ids, taken_stamps
  from (select l.track_id, l.stamp from semap.late_state l
        where l.of_pairs and l.source_id in (select source_id from semap.source where map_id = p_map_id)
        order by l.stamp, l.track_id limit v_count) l;
  loop
    select array_agg(l.track_id order by place), array_agg(l.stamp order by place) into v_ids, v_stamps
    from unnest(taken_ids, taken_stamps) with ordinality l (track_id, stamp, place)
    where exists (select from semap.pair_track_wanted w where w.track_id = l.track_id
                  and w.query_id = any (c_query_ids));
    if v_ids is null then
      query_ids := '{}';
      exit;
    end if;
    select max(greatest(enter_confirm, leave_confirm, '0')) into v_confirm
    from semap.continuous_query q where q.query_id = any (query_ids);
    v_next := semap.prepare_replay(p_map_id, c_query_ids, v_confirm, v_ids, v_stamps, v_further);
    if v_next.states is null then
      exit when v_further > 4;
      if cardinality(taken_ids) > 1 then
        taken_ids := taken_ids[:cardinality(taken_ids) / 2];
        taken_stamps := taken_stamps[:cardinality(taken_ids)];
      else
        query_ids := array(select q.query_id from semap.continuous_query q
                           where q.query_id = any (query_ids)
                             and greatest(enter_confirm, leave_confirm, '0') < v_confirm);
      end if;
      exit when query_ids = '{}';
      continue;
    end if;
    from_stamp := v_next.from_stamp;
    to_stamp := v_next.to_stamp;
    is_present := v_next.is_present;
    track_ids := v_next.track_ids;
    select * into changes, pairs from semap.replay_pairs(c_query_ids, from_stamp, v_next.states);
    select * into changes_without, pairs_without
    from semap.replay_pairs(c_query_ids, from_stamp, v_next.states_without);
    exit when is_present or not exists (select from semap.differing_pairs(pairs, pairs_without));
    v_further := 4 * v_further;
  end loop;
end $$;
