-- Pairs of the past are *replayed*: from where tracks were at a moment, and what pairs were then, they are followed by
-- the code that follows them as states come in (sql/123, 124).

-- What tracks did from a moment up to another one, of these states of them and where they were at that moment: in the
-- order of their stamps, without outliers, and no further than each is known to be now. Of late states that are queued,
-- only those of these late tracks at these stamps. The first state of each track says where it was at that moment, if
-- it was there.
create or replace function semap.states_to_replay(
  p_map_id integer, p_stated semap.track_state[], p_from timestamptz, p_to timestamptz,
  p_late_ids bigint[], p_late_stamps timestamptz[]
) returns semap.track_state[]
language plpgsql stable set plan_cache_mode = force_custom_plan as $$
begin
  return (
    with left_out as materialized (
      select track_id, stamp from semap.late_state
      where of_pairs and track_id in (select track_id from unnest(p_stated)) and stamp <= p_to
      except select * from unnest(p_late_ids, p_late_stamps)
    ), kept as (
      select track_id, array_agg(s order by stamp) as states, min(stamp) as first_stamp
      from unnest(p_stated) s where (track_id, stamp) not in (table left_out) group by track_id
    ), ended as (
      select k.track_id, array_agg(distinct e.stamp) as stamps
      from kept k
      join semap.relation_change e
        on e.map_id = p_map_id and e.track_id = k.track_id and e.cause = 'disappeared' and e.object_track_id is null
        and e.stamp >= k.first_stamp and e.stamp <= p_to and e.amendment is distinct from 'retracted'
        and not exists (select from semap.relation_change d where d.retracts = e.uid)
        and (k.track_id, e.stamp) not in (table left_out)
      group by k.track_id
    )
    select array_agg(a order by a.stamp, a.track_id)
    from kept k
    join semap.track_now n using (track_id)
    join semap.source t using (source_id)
    left join ended e on e.track_id = k.track_id
    cross join lateral semap.updates_again(
      t, array(select s from unnest(k.states) s where s.stamp <= n.stamp), n, k.first_stamp > p_from,
      e.stamps || array(select n.stamp where not n.live and n.stamp <= p_to), p_to) g
    cross join lateral semap.states_of(g.updates) a
    where a.stamp > p_from or a.stamp = (select max(stamp) from semap.states_of(g.updates) where stamp <= p_from));
end $$;

-- What held at a moment between any two of these things, by the log.
create or replace function semap.pairs_held_at(p_query_ids integer[], p_track_ids bigint[], p_at timestamptz)
returns table (query_id integer, subject_key bigint, object_key bigint, since timestamptz)
language sql stable as $$
  select h.query_id, k.subject_key, k.object_key, max(h.since)
  from (select query_id, track_id, subject_instance_id, instance_id, object_track_id, since from semap.relation_past
        where query_id = any (p_query_ids) and tstzrange(since, until, '[]') @> p_at and until > p_at
        union all
        select query_id, track_id, subject_instance_id, instance_id, object_track_id, since from semap.relation
        where query_id = any (p_query_ids) and confirmed and since <= p_at) h
  cross join lateral (select coalesce(h.track_id, -h.subject_instance_id) as subject_key,
                             coalesce(h.object_track_id, -h.instance_id) as object_key) k
  where (k.subject_key < 0 or k.subject_key = any (p_track_ids))
    and (k.object_key < 0 or k.object_key = any (p_track_ids))
  group by h.query_id, k.subject_key, k.object_key
$$;

-- Play the pairs of a map from a moment on, at which what the log says held: what changed, and what pairs are at the
-- end.
create or replace function semap.replay_pairs(
  p_query_ids integer[], p_from timestamptz, p_states semap.track_state[],
  out changes semap.pair_change[], out pairs semap.relation_state[]
) language plpgsql stable as $$
declare
  v_step  record;
begin
  v_step := semap.follow_pairs(
    p_query_ids,
    array(select s from unnest(p_states) s where s.stamp > p_from),
    array(select s from unnest(p_states) s where s.stamp <= p_from and not s.is_last),
    array(select semap.relation_since(h.query_id, h.subject_key, h.object_key, true, h.since)
          from semap.pairs_held_at(p_query_ids, array(select track_id from unnest(p_states)), p_from) h
          where (h.subject_key > 0 or h.object_key > 0)
            and (h.subject_key < 0 or h.subject_key in (select track_id from unnest(p_states) s where s.stamp <= p_from
                                                        and not s.is_last))
            and (h.object_key < 0 or h.object_key in (select track_id from unnest(p_states) s where s.stamp <= p_from
                                                      and not s.is_last))));
  changes := v_step.changes;
  pairs := v_step.pairs;
end $$;

-- What a change says of a pair, whoever was called what.
create or replace function semap.change_said(p_change semap.relation_change) returns semap.pair_change
language sql immutable parallel safe as $$
  select row((p_change).query_id, coalesce((p_change).track_id, -(p_change).subject_instance_id),
             coalesce((p_change).object_track_id, -(p_change).instance_id), (p_change).kind::text, (p_change).cause,
             (p_change).stamp, (p_change).transition_at, (p_change).since, (p_change).x_m, (p_change).y_m,
             (p_change).direction)::semap.pair_change
$$;

-- In which order changes of two things stand that are of one moment: what ends that held before, then in turns what
-- begins and what ends again. p_turn: the how many-th of its kind it is.
create or replace function semap.place_in_moment(p_change semap.relation_change, p_turn bigint) returns bigint
language sql immutable parallel safe as $$
  select case when (p_change).kind = 'began' then 2 * p_turn - 1
              when (p_change).since < (p_change).transition_at then 0 else 2 * p_turn end
$$;

-- Which pairs are remembered in two ways, since when they hold aside.
create or replace function semap.differing_pairs(p_pairs semap.relation_state[], p_others semap.relation_state[])
returns table (query_id integer, subject_key bigint, object_key bigint)
language sql immutable parallel safe as $$
  select coalesce(p.query_id, o.query_id), coalesce(p.subject_key, o.subject_key), coalesce(p.object_key, o.object_key)
  from unnest(p_pairs) p
  full join unnest(p_others) o
    on o.query_id = p.query_id and o.subject_key = p.subject_key and o.object_key = p.object_key
  where (p.confirmed, p.pending, case when p.pending <> p.confirmed then p.pending_at end, p.distance_m, p.distance_at)
     is distinct from
        (o.confirmed, o.pending, case when o.pending <> o.confirmed then o.pending_at end, o.distance_m, o.distance_at)
$$;
