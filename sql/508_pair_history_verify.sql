-- What the log says of pairs (sql/505) against the states of tracks: nothing is taken from pair or followed_state but
-- how instances look. What takes time to confirm, has margins, or depends on more than one moment is left out here.

-- The queries about tracks whose pairs can be told from one moment.
create or replace function semap.momentary_queries(p_map_id integer) returns setof semap.continuous_query
language sql stable as $$
  select q.* from semap.continuous_query q join semap.predicate p on p.name = q.predicate
  where map_id = p_map_id and in_pairs and enabled and subject_kind = 'track' and object_kind = 'track'
    and follows_from = 'moment' and enter_margin_m = 0 and leave_margin_m = 0
    and enter_confirm = '0' and leave_confirm = '0'
$$;

-- The pairs of tracks for which these queries hold at a moment, by the states of the tracks.
create or replace function semap.pairs_at(p_map_id integer, p_at timestamptz)
returns table (query_id integer, subject_key bigint, object_key bigint)
language sql stable as $$
  with side as materialized (
    select w.query_id, w.is_object, p.track_id, semap.compared_track(p, w.compared, w.distance_m) as thing
    from semap.tracks_at(p_map_id, p_at) p join semap.pair_track_wanted w using (track_id) where w.map_id = p_map_id
  )
  select q.query_id, s.track_id, o.track_id
  from semap.momentary_queries(p_map_id) q
  join semap.query_predicate r using (query_id)
  join side s on s.query_id = q.query_id and not s.is_object
  join side o on o.query_id = q.query_id and o.is_object and o.track_id <> s.track_id
    and (r.reach_m = 'infinity' or st_dwithin((s.thing).shape, (o.thing).shape, r.reach_m))
  where (semap.pair_stands(q, s.thing, o.thing)).raw
$$;

-- The log of pairs against where both were, at the newest moments at which something began or ended, and at others
-- between.
create or replace function semap.pair_history_differences(p_map_id integer, p_moments integer default 40)
returns table (stamp timestamptz, thing text, stored text, wanted text)
language sql stable as $$
  with asked as materialized (
    select query_id from semap.momentary_queries(p_map_id)
  ), folded as materialized (
    select (f.change).*, f.is_newest from semap.folded_changes(p_map_id) f
    where (f.change).query_id in (table asked)
  ), span as materialized (
    select query_id, track_id, object_track_id, since as from_at, transition_at as to_at from folded
      where kind = 'ended'
    union all
    select query_id, track_id, object_track_id, transition_at, 'infinity' from folded where kind = 'began' and is_newest
  ), newest as (
    select f.stamp, row_number() over (order by change_id desc) as place, count(*) over () as places
    from (select * from folded where cause <> 'map' order by change_id desc limit 1000) f
  ), moment as materialized (
    select distinct n.stamp as at from newest n
    where place <= p_moments / 2 or place * p_moments / 2 % places < p_moments / 2 order by n.stamp desc limit p_moments
  ), logged as (
    select m.at, s.query_id, s.track_id, s.object_track_id
    from moment m join span s on s.from_at <= m.at and s.to_at > m.at
  ), stood as (
    select m.at, p.query_id, p.subject_key, p.object_key from moment m
      cross join lateral semap.pairs_at(p_map_id, m.at) p
  )
  select d.at, format('%s at %s', semap.relation_in_words(d.query_id, d.track_id, null, null, d.object_track_id), d.at),
         case when d.is_logged then 'a relation' else 'no relation' end,
         case when d.is_logged then 'no relation' else 'a relation' end
  from (select *, true as is_logged from (table logged except table stood) l
        union all
        select *, false from (table stood except table logged) s) d
  where (semap.pair_valid_from(d.query_id, d.track_id, d.object_track_id) >= d.at) is not true
$$;

-- Where a track crossed a line, by its states of the last hour up to a moment: stamps of the states that showed it.
create or replace function semap.crossings_again(
  p_now semap.track_now, p_line public.geometry, p_fastest_mps double precision, p_longest_gap interval,
  p_to timestamptz
) returns table (stamp timestamptz, transition_at timestamptz, direction text, z_m double precision)
language plpgsql stable as $$
declare
  v_before  semap.track_state;
  v_now     semap.track_state;
  v_source  semap.source;
  v_from    timestamptz := greatest(p_now.first_stamp, least(p_now.stamp, p_to) - interval '1 h');
  v_side    boolean;
  v_across  record;
begin
  select * into v_source from semap.source where source_id = p_now.source_id;
  for v_now in
    select s.* from semap.states_of((semap.updates_again(
      v_source, array(select s from semap.states(array[p_now.track_id], v_from, p_to) s),
      p_now, v_from = p_now.first_stamp,
      array(select e.stamp from semap.track_end e where e.track_id = p_now.track_id
            and e.stamp between v_from and p_to),
      p_to)).updates) s order by s.stamp
  loop
    if v_before.stamp is null or v_before.is_last or v_now.x_m is null then
      v_side := null;
    elsif v_now.stamp > v_before.stamp + coalesce(p_longest_gap, '30 s')
       or sqrt((v_now.x_m - v_before.x_m) ^ 2 + (v_now.y_m - v_before.y_m) ^ 2)
          > coalesce(p_fastest_mps, 30) * extract(epoch from v_now.stamp - v_before.stamp) then
      v_side := null;
    else
      v_across := semap.way_across(p_line, v_before.x_m, v_before.y_m, v_now.x_m, v_now.y_m, v_side);
      v_side := v_across.came_from_left;
      return query
        select v_now.stamp,
               v_before.stamp + make_interval(secs => part * extract(epoch from v_now.stamp - v_before.stamp)),
               case when is_left then 'left_to_right' else 'right_to_left' end,
               v_before.z_m + part * (v_now.z_m - v_before.z_m)
        from unnest(v_across.parts, v_across.from_left) u (part, is_left);
    end if;
    v_before := case when v_now.x_m is null then null else v_now end;
  end loop;
end $$;

-- The log of lines that were crossed in the last hour of each track against the ways of the tracks.
create or replace function semap.crossing_differences(p_map_id integer)
returns table (track_id bigint, thing text, stored text, wanted text)
language sql stable as $$
  with looked_at as materialized (
    select q.query_id, q.name, q.direction, q.dimensions, q.longest_gap, q.fastest_mps, n as present, i.instance_id,
           i.name as line, i.shape, i.z_min_m, i.z_max_m, w.name as track, p.through,
           greatest(n.first_stamp, least(n.stamp, p.through) - interval '1 h',
                    semap.pair_valid_from(q.query_id, n.track_id, -i.instance_id)) as since
    from semap.continuous_query q
    join semap.query_predicate d using (query_id, map_id)
    join semap.pair_progress p using (map_id)
    join semap.pair_track_wanted w on w.query_id = q.query_id and not w.is_object
    join semap.track_now n on n.track_id = w.track_id and n.first_stamp <= p.through
    join semap.pair_instance_wanted i on i.query_id = q.query_id and i.is_object
    where q.map_id = p_map_id and q.in_pairs and q.enabled and d.follows_from = 'way'
  ), wanted as (
    select l.query_id, (l.present).track_id, l.instance_id, c.stamp, c.direction
    from looked_at l
    cross join lateral semap.crossings_again(l.present, l.shape, l.fastest_mps, l.longest_gap, l.through) c
    where c.stamp > l.since and (l.direction is null or l.direction = c.direction)
      and (l.dimensions = 2 or (c.z_m >= l.z_min_m and c.z_m < l.z_max_m) is not false)
  ), logged as (
    select c.query_id, c.track_id, c.instance_id, c.stamp, c.direction
    from looked_at l
    cross join lateral semap.standing_changes_of_track(p_map_id, (l.present).track_id, l.since, l.through) c
    where c.query_id = l.query_id and c.instance_id = l.instance_id and c.kind::text = 'crossed'
  )
  select d.track_id, format('track %s, %s (%s) at %s', k.name, i.name, q.name, d.stamp),
         case when d.is_logged then d.direction else 'no crossing' end,
         case when d.is_logged then 'no crossing' else d.direction end
  from (select *, true as is_logged from (select * from logged except all select * from wanted) l
        union all
        select *, false from (select * from wanted except all select * from logged) w) d
  join semap.track k using (track_id) join semap.instance i using (instance_id) join semap.continuous_query q
    using (query_id)
$$;
