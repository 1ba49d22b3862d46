-- Late states and pairs: what any two things were to each other is what it would be had the states of both come in the
-- order of their stamps. What a pair is depends on others (nearest), on what was before (times to confirm, approaching, the
-- side of a line) and on when it was compared. So the past is *played* again, by the code that follows pairs as states come
-- in (sql/123, 124), in a part of the transaction that is rolled back: once with the late states and once without them.
-- Only what the two plays differ in is written, in the transaction that brings the states.

-- What these tracks were at a moment, and what they did from there on up to another one: in the order of their stamps,
-- without outliers, without what is named, and no further than each is known to be now. The first state of each track says
-- where it was at that moment, if it was there.
create or replace function semap.states_to_play(
  p_map_id integer, p_track_ids bigint[], p_from timestamptz, p_to timestamptz,
  p_without_ids bigint[], p_without_stamps timestamptz[]
) returns semap.arrival[]
language plpgsql stable set plan_cache_mode = force_custom_plan as $$
begin
  return (
    with taking_part as (
      select n as present, s as source from semap.track_now n join semap.source s using (source_id)
      where n.track_id = any (p_track_ids) and n.first_stamp <= p_to
    ), stated as materialized (
      select s.track_id, row(s.track_id, s.stamp, s.x_m, s.y_m, s.z_m, s.std_m, s.is_last, s.heading_rad, s.speed_mps,
                             s.length_m, s.width_m, s.std_across_m, s.std_yaw_rad)::semap.track_state as state
      from semap.stored_state s
      where s.track_id = any (p_track_ids) and s.stamp > p_from and s.stamp <= p_to
        and s.from_stamp > p_from - interval '30 min' and s.from_stamp <= p_to and s.to_stamp >= p_from
      union all
      -- most were seen not long before
      select (t.present).track_id, coalesce(b.state, (select l from semap.state_before((t.present).track_id, p_from) l))
      from taking_part t
      left join lateral (
        select s as state
        from semap.track_state s
        where s.track_id = (t.present).track_id and s.stamp <= p_from and s.stamp > p_from - interval '1 min'
        order by s.stamp desc limit 1) b on true
      where (t.present).first_stamp <= p_from
    ), kept as (
      select track_id, array_agg(state order by (state).stamp) as states, min((state).stamp) as first_stamp
      from stated
      where (state).stamp is not null
        and not exists (select from unnest(p_without_ids, p_without_stamps) w (track_id, stamp)
                        where w.track_id = stated.track_id and w.stamp = (stated.state).stamp)
      group by track_id
    ), ended as (
      select k.track_id, array_agg(distinct e.stamp) as stamps
      from kept k
      join semap.relation_change e
        on e.map_id = p_map_id and e.track_id = k.track_id and e.cause = 'disappeared' and e.object_track_id is null
        and e.stamp >= k.first_stamp and e.stamp <= p_to and e.amendment is distinct from 'retracted'
        and not exists (select from semap.relation_change d where d.retracts = e.uid)
        and not exists (select from unnest(p_without_ids, p_without_stamps) w (track_id, stamp)
                        where w.track_id = k.track_id and w.stamp = e.stamp)
      group by k.track_id
    )
    select array_agg(a order by (a).stamp, (a).track_id)
    from taking_part t
    join kept k on k.track_id = (t.present).track_id
    left join ended e on e.track_id = k.track_id
    cross join lateral semap.arrivals_again(
      t.source,
      array(select s from unnest(k.states) s where s.stamp <= (t.present).stamp), t.present, k.first_stamp > p_from,
      e.stamps || array(select (t.present).stamp where not (t.present).live and (t.present).stamp <= p_to), p_to) g
    cross join lateral unnest(g.arrivals) a
    where (a).stamp > p_from or (a).stamp = (select max(stamp) from unnest(g.arrivals) where stamp <= p_from));
end $$;
comment on function semap.states_to_play is
  'What these tracks were at a moment, and what they did from there on up to another one.';

-- What held at a moment between any two of these things, by the log.
create or replace function semap.pairs_held_at(p_query_ids integer[], p_track_ids bigint[], p_at timestamptz)
returns table (query_id integer, subject_key bigint, object_key bigint, since timestamptz)
language sql stable as $$
  select h.query_id, k.subject_key, k.object_key, max(h.since)
  from (select query_id, track_id, subject_instance_id, instance_id, object_track_id, since from semap.relation_past
        where query_id = any (p_query_ids) and tstzrange(since, until, '[]') @> p_at and until > p_at
        union all
        select query_id, track_id, subject_instance_id, instance_id, object_track_id, since from semap.pair
        where query_id = any (p_query_ids) and held and since <= p_at) h
  cross join lateral (select coalesce(h.track_id, -h.subject_instance_id) as subject_key,
                             coalesce(h.object_track_id, -h.instance_id) as object_key) k
  where (k.subject_key < 0 or k.subject_key = any (p_track_ids)) and (k.object_key < 0 or k.object_key = any (p_track_ids))
  group by h.query_id, k.subject_key, k.object_key
$$;
comment on function semap.pairs_held_at is
  'What held at a moment between any two of these things, by the log.';

-- Play the pairs of a map from a moment on, at which what is given held, and tell what changed and which pairs there are at
-- the end. Nothing of it stays.
create or replace function semap.play_pairs(
  p_map_id integer, p_query_ids integer[], p_from timestamptz, p_states semap.arrival[],
  out changes semap.relation_change[], out pairs semap.pair[]
) language plpgsql as $$
declare
  v_is_over  constant text := 'SM129';
  v_held     semap.pair[];
  v_ids      bigint[] := array(select distinct track_id from unnest(p_states));
begin
  select array_agg(row(null, p_map_id, h.query_id, case when h.subject_key > 0 then h.subject_key end,
                       case when h.subject_key < 0 then -h.subject_key end, case when h.object_key < 0 then -h.object_key end,
                       case when h.object_key > 0 then h.object_key end, true, h.since, true, h.since, null, null,
                       h.subject_key, h.object_key)::semap.pair)
  into v_held from semap.pairs_held_at(p_query_ids, v_ids, p_from) h;
  begin
    delete from semap.relation_change where map_id = p_map_id and stamp > p_from and query_id = any (p_query_ids);
    delete from semap.pair where query_id = any (p_query_ids) and (track_id is not null or object_track_id is not null);
    delete from semap.pair_member where query_id = any (p_query_ids) and track_id is not null;
    perform semap.place_tracks(
      array_agg(a), array_agg(a.track_id)) from unnest(p_states) a where a.stamp <= p_from and not a.is_last;
    insert into semap.pair (map_id, query_id, track_id, subject_instance_id, instance_id, object_track_id,
                            held, since, inside, inside_at)
    select h.map_id, h.query_id, h.track_id, h.subject_instance_id, h.instance_id, h.object_track_id, true, h.since, true, h.since
    from unnest(v_held) h
    where (h.track_id is not null or h.object_track_id is not null)
      and exists (select from semap.pair_member m where m.key = h.subject_key and m.query_id = h.query_id and not m.is_object)
      and exists (select from semap.pair_member m where m.key = h.object_key and m.query_id = h.query_id and m.is_object);
    perform semap.compare_pairs(p_map_id, array(
      select row(a.track_id, a.stamp, a.x_m, a.y_m, a.z_m, a.std_m, a.heading_rad, a.speed_mps, a.length_m, a.width_m,
                 a.is_last, a.source_id, a.map_id, a.cell_m,
                 exists (select from unnest(p_states) b where b.track_id = a.track_id and b.stamp <= p_from and not b.is_last),
                 a.seen_stamp, null, null, null, '{}', null,
                 a.std_across_m, a.std_yaw_rad)::semap.arrival
      from unnest(p_states) a where a.stamp > p_from));
    changes := array(select c from semap.relation_change c
                     where c.map_id = p_map_id and c.stamp > p_from and c.query_id = any (p_query_ids) order by c.change_id);
    pairs := array(select p from semap.pair p where p.query_id = any (p_query_ids));
    raise exception using errcode = v_is_over;
  exception when sqlstate 'SM129' then
    null;
  end;
end $$;
comment on function semap.play_pairs is
  'Play the pairs of a map from a moment on, and tell what changed and which pairs there are at the end. Nothing of it stays.';

-- Who has these identities gives them away: what was taken back, and what says so, get others.
create or replace function semap.free_uids(p_uids uuid[]) returns void
language plpgsql as $$
begin
  if exists (select from semap.relation_change where uid = any (p_uids)) then
    update semap.relation_change d
    set uid = md5(d.uid || '|' || d.change_id)::uuid, retracts = md5(c.uid || '|' || c.change_id)::uuid
    from semap.relation_change c where c.uid = any (p_uids) and d.retracts = c.uid;
    update semap.relation_change c set uid = md5(c.uid || '|' || c.change_id)::uuid where c.uid = any (p_uids);
  end if;
end $$;
comment on function semap.free_uids is
  'Who has these identities gives them away: what was taken back, and what says so, get others.';

-- Add changes of pairs, in their order, and the spans that they end.
create or replace function semap.add_pair_changes(p_changes semap.relation_change[]) returns void
language plpgsql as $$
begin
  if p_changes = '{}' then
    return;
  end if;
  perform semap.free_uids(array(select uid from unnest(p_changes)));
  insert into semap.relation_change (
    uid, map_id, query_id, query_name, track_id, track_name, subject_instance_id, subject_instance_name,
    instance_id, instance_name, object_track_id, object_track_name, kind, cause, stamp, edge_at, since, x_m, y_m, direction,
    amendment)
  select uid, map_id, query_id, query_name, track_id, track_name, subject_instance_id, subject_instance_name,
         instance_id, instance_name, object_track_id, object_track_name, kind, cause, stamp, edge_at, since, x_m, y_m, direction,
         'added'
  from unnest(p_changes) order by stamp, edge_at, change_id;
  insert into semap.relation_past (map_id, query_id, query_name, track_id, track_name, subject_instance_id,
                                   subject_instance_name, instance_id, instance_name, object_track_id, object_track_name,
                                   since, until)
  select map_id, query_id, query_name, track_id, track_name, subject_instance_id, subject_instance_name,
         instance_id, instance_name, object_track_id, object_track_name, since, edge_at
  from unnest(p_changes) where kind = 'ended' order by edge_at, change_id;
end $$;
comment on function semap.add_pair_changes is
  'Add changes of pairs, in their order, and the spans that they end.';

-- Since when a pair can be corrected: the newest stamp of its map when the query, or an instance that counts for it, got the
-- form that it has; tracks that came to be known later are corrected from their beginning on.
create or replace function semap.pair_formed(p_query_id integer, p_subject_key bigint, p_object_key bigint)
returns timestamptz
language sql stable as $$
  select max(f.formed_stamp)
  from (select formed_stamp, formed_track_id from semap.pair_form where query_id = p_query_id
        union all
        select formed_stamp, formed_track_id from semap.pair_member m
        where m.query_id = p_query_id and m.instance_id is not null
          and (m.key in (p_subject_key, p_object_key)
               or exists (select from semap.continuous_query q where q.query_id = p_query_id and q.predicate = 'nearest'))) f
  where f.formed_track_id >= least(case when p_subject_key > 0 then p_subject_key end, case when p_object_key > 0 then p_object_key end)
$$;
comment on function semap.pair_formed is
  'Since when a pair can be corrected.';

-- What a change says of a pair, whoever was called what.
create or replace function semap.change_said(p_change semap.relation_change) returns semap.pair_change
language sql immutable parallel safe as $$
  select row((p_change).query_id, coalesce((p_change).track_id, -(p_change).subject_instance_id),
             coalesce((p_change).object_track_id, -(p_change).instance_id), (p_change).kind::text, (p_change).cause,
             (p_change).stamp, (p_change).edge_at, (p_change).since, (p_change).x_m, (p_change).y_m,
             (p_change).direction)::semap.pair_change
$$;
comment on function semap.change_said is
  'What a change says of a pair, whoever was called what.';

-- Which pairs are remembered in two ways, since when they hold aside.
create or replace function semap.differing_pairs(p_pairs semap.pair[], p_others semap.pair[])
returns table (query_id integer, subject_key bigint, object_key bigint)
language sql immutable parallel safe as $$
  select coalesce(p.query_id, o.query_id), coalesce(p.subject_key, o.subject_key), coalesce(p.object_key, o.object_key)
  from unnest(p_pairs) p
  full join unnest(p_others) o
    on o.query_id = p.query_id and o.subject_key = p.subject_key and o.object_key = p.object_key
  where (p.held, p.inside, case when p.inside <> p.held then p.inside_at end, p.distance_m, p.distance_at)
     is distinct from (o.held, o.inside, case when o.inside <> o.held then o.inside_at end, o.distance_m, o.distance_at)
$$;
comment on function semap.differing_pairs is
  'Which pairs are remembered in two ways, since when they hold aside.';

-- Write in what the log differs from a play (p_with) of it from p_from on up to p_to, of the pairs in which that play differs
-- from one without the late states (p_without), the first of which is of p_late_from. What the log says of a pair, and what the
-- play says, have to agree on what held before the first late state and, but for a play up to the present, on what holds
-- after it; else nothing of that pair is written.
create or replace function semap.write_pair_amendments(
  p_map_id integer, p_query_ids integer[], p_track_ids bigint[], p_from timestamptz, p_late_from timestamptz, p_to timestamptz,
  p_is_present boolean, p_with semap.relation_change[], p_without semap.relation_change[],
  p_pairs semap.pair[], p_pairs_without semap.pair[]
) returns void
language plpgsql as $$
declare
  v_gone   uuid[];
  v_new    semap.relation_change[];
  v_since  semap.pair[];
  v_now    semap.pair[];
begin
  with played as (
    select true as late, c, semap.change_said(c) as said from unnest(p_with) c
    union all
    select false, c, semap.change_said(c) from unnest(p_without) c
  ), differing as (
    select distinct (said).query_id, (said).subject_key, (said).object_key from (
      select said from played where late except select said from played where not late
      union all
      (select said from played where not late except select said from played where late)) d
    union
    select d.query_id, d.subject_key, d.object_key from semap.differing_pairs(p_pairs, p_pairs_without) d
  ), logged as (
    select c, semap.change_said(c) as said from semap.relation_change c
    where c.map_id = p_map_id and c.stamp > p_from and c.query_id = any (p_query_ids)
      and c.amendment is distinct from 'retracted'
      and not exists (select from semap.relation_change d where d.retracts = c.uid)
  ), pair as (
    select d.*, w.*, l.*,
           coalesce(w.with_before = 'began', h.since is not null) as with_held_before,
           coalesce(l.log_before = 'began', h.since is not null) as log_held_before,
           coalesce(w.with_last = 'began', h.since is not null) as with_held,
           coalesce(l.log_last = 'began', h.since is not null) as log_held,
           case when w.with_before is null then h.since when w.with_before = 'began' then w.with_since_before end as found_before,
           case when l.log_before is null then h.since when l.log_before = 'began' then l.log_since_before end as told_before,
           case when w.with_last is null then h.since when w.with_last = 'began' then w.with_since end as found_since,
           case when l.log_last is null then h.since when l.log_last = 'began' then l.log_since end as told_since
    from differing d
    left join semap.pairs_held_at(p_query_ids, p_track_ids, p_from) h using (query_id, subject_key, object_key)
    cross join lateral (
      select (array_agg((c).kind order by (c).change_id desc) filter (where (c).stamp < p_late_from))[1] as with_before,
             (array_agg((c).since order by (c).change_id desc) filter (where (c).stamp < p_late_from))[1] as with_since_before,
             (array_agg((c).kind order by (c).change_id desc))[1] as with_last,
             (array_agg((c).since order by (c).change_id desc))[1] as with_since
      from played p
      where late and (c).kind <> 'crossed' and (c).stamp <= p_to
        and ((said).query_id, (said).subject_key, (said).object_key) = (d.query_id, d.subject_key, d.object_key)) w
    cross join lateral (
      select (array_agg(kind order by place desc) filter (where stamp < p_late_from))[1] as log_before,
             (array_agg(since order by place desc) filter (where stamp < p_late_from))[1] as log_since_before,
             (array_agg(kind order by place desc))[1] as log_last,
             (array_agg(since order by place desc))[1] as log_since,
             coalesce(bool_or(cause = 'map' or kind = before_kind), false) as is_odd
      from (select *, lag(kind) over (order by place) as before_kind from (
            select (c).*, row_number() over (order by (c).stamp, (c).edge_at, semap.place_in_moment(c, turn), (c).change_id) as place
            from (select c, row_number() over (partition by (c).edge_at, (c).kind, (c).since < (c).edge_at
                                               order by (c).change_id) as turn
                  from logged
                  where (c).kind <> 'crossed' and (c).stamp <= p_to
                    and ((said).query_id, (said).subject_key, (said).object_key) = (d.query_id, d.subject_key, d.object_key)) t) p) o) l
  ), sound as (
    -- what held before the first late state holds since when the log says
    select *, case when found_since = found_before then told_before else found_since end as now_since
    from pair p
    where with_held_before = log_held_before and (p_is_present or with_held = log_held) and not is_odd
      and (semap.pair_formed(p.query_id, p.subject_key, p.object_key) > p_from) is not true
  ), told as (
    select l.* from logged l
    join sound s on ((said).query_id, (said).subject_key, (said).object_key) = (s.query_id, s.subject_key, s.object_key)
    where (c).stamp >= p_late_from and (c).stamp <= p_to
  ), found as (
    select f.c, semap.change_said(f.c) as said
    from played p
    join sound s on ((said).query_id, (said).subject_key, (said).object_key) = (s.query_id, s.subject_key, s.object_key)
    cross join lateral (
      select case when (p.c).kind = 'ended' and (p.c).since = s.found_before and s.found_before <> s.told_before
                  then jsonb_populate_record(p.c, jsonb_build_object('since', least(s.told_before, (p.c).edge_at)))
                  else p.c end as c) f
    where late and (p.c).stamp >= p_late_from and (p.c).stamp <= p_to
  ), moment as (
    -- what happens at one moment is written together, so that it stands in the order in which it happened
    select distinct (said).query_id, (said).subject_key, (said).object_key, (said).edge_at from (
      (select said from told except select said from found) union all (select said from found except select said from told)) d
  ), gone as (
    select (c).uid from told
    where ((said).query_id, (said).subject_key, (said).object_key, (said).edge_at) in (table moment)
  ), new as (
    select c from found
    where ((said).query_id, (said).subject_key, (said).object_key, (said).edge_at) in (table moment)
  ), tail as (
    -- it holds since another moment: so says its end, too, which came later
    select (t.c).uid, jsonb_populate_record(t.c, jsonb_build_object('since', s.now_since)) as c
    from sound s
    cross join lateral (
      select c from logged
      where (c).kind = 'ended' and (c).stamp > p_to
        and ((said).query_id, (said).subject_key, (said).object_key) = (s.query_id, s.subject_key, s.object_key)
      order by (c).stamp limit 1) t
    where not p_is_present and s.with_held and s.now_since <> s.told_since
  )
  select array(select uid from gone union all select uid from tail),
         array(select c from new order by (c).change_id) || array(select c from tail),
         array(select row(null, p_map_id, query_id, null, null, null, null, true, now_since, true, now_since, null, null,
                          subject_key, object_key)::semap.pair
               from sound where not p_is_present and with_held and now_since <> told_since),
         array(select row(null, p_map_id, query_id, null, null, null, null, with_held, now_since, with_held, null, null, null,
                          subject_key, object_key)::semap.pair from sound where p_is_present)
  into v_gone, v_new, v_since, v_now;
  perform semap.take_back(v_gone);
  perform semap.add_pair_changes(v_new);

  update semap.pair p set since = s.since
  from unnest(v_since) s
  where (p.query_id, p.subject_key, p.object_key) = (s.query_id, s.subject_key, s.object_key) and p.held and p.since < p_to;
  delete from semap.pair p using unnest(v_now) n
  where (p.query_id, p.subject_key, p.object_key) = (n.query_id, n.subject_key, n.object_key);
  insert into semap.pair (map_id, query_id, track_id, subject_instance_id, instance_id, object_track_id,
                          held, since, inside, inside_at, distance_m, distance_at)
  select p.map_id, p.query_id, p.track_id, p.subject_instance_id, p.instance_id, p.object_track_id,
         p.held, n.since, p.inside, p.inside_at, p.distance_m, p.distance_at
  from unnest(p_pairs) p
  join unnest(v_now) n on (p.query_id, p.subject_key, p.object_key) = (n.query_id, n.subject_key, n.object_key);
end $$;
comment on function semap.write_pair_amendments is
  'Write in what the log differs from a play of it, of the pairs in which that play differs from one without the late states.';

-- Which tracks may come into a pair with these between two moments: all of the map where a query asks for the nearest, or for
-- whoever is faced however far away; else those that come near enough.
create or replace function semap.tracks_to_play(
  p_map_id integer, p_query_ids integer[], p_late_ids bigint[], p_from timestamptz, p_to timestamptz
) returns bigint[]
language plpgsql stable set plan_cache_mode = force_custom_plan as $$
declare
  v_others   bigint[];
  v_reach_m  double precision;
begin
  select array_agg(distinct w.track_id) into v_others
  from semap.pair_track_wanted w join semap.track_now n using (track_id)
  where w.query_id = any (p_query_ids) and n.first_stamp <= p_to and (n.live or n.stamp >= p_from);
  select max(case when predicate = 'nearest' or predicate = 'facing' and distance_m is null then 'infinity'
                  when predicate = 'crosses' then 0
                  else coalesce(distance_m, 0) + coalesce(leave_margin_m, 0) end)
  into v_reach_m
  from semap.continuous_query
  where query_id = any (p_query_ids) and object_kind = 'track' and (subject_kind = 'track' or predicate = 'nearest');
  if v_reach_m is null then
    return p_late_ids;
  elsif v_reach_m = 'infinity' then
    return v_others;
  end if;
  return (
    with seen as materialized (
      select s.track_id, s.x_m, s.y_m, greatest(s.length_m, s.width_m, 0) as size_m
      from semap.stored_state s
      where s.track_id = any (v_others) and s.stamp >= p_from - interval '1 min' and s.stamp <= p_to
        and s.from_stamp > p_from - interval '31 min' and s.from_stamp <= p_to and s.to_stamp >= p_from - interval '1 min'
      union all
      select n.track_id, n.x_m, n.y_m, greatest(n.length_m, n.width_m, 0)
      from semap.track_now n where n.track_id = any (v_others) and n.stamp <= p_to
    ), box as (
      select min(x_m) as x_min_m, max(x_m) as x_max_m, min(y_m) as y_min_m, max(y_m) as y_max_m,
             max(size_m) + v_reach_m as reach_m
      from seen where track_id = any (p_late_ids)
    )
    select array_agg(distinct s.track_id)
    from seen s, box b
    where s.x_m between b.x_min_m - b.reach_m - s.size_m and b.x_max_m + b.reach_m + s.size_m
      and s.y_m between b.y_min_m - b.reach_m - s.size_m and b.y_max_m + b.reach_m + s.size_m);
end $$;
comment on function semap.tracks_to_play is
  'Which tracks may come into a pair with these between two moments.';

-- Correct what is known of the pairs of a map after states that came late. What a pair remembers of what was before is a
-- matter of a few comparisons and of the times to confirm, so the play begins four states and four such times before the
-- first late state. It goes on until both plays remember the same, at most up to the present.
create or replace function semap.amend_pairs(p_map_id integer, p_late semap.arrival[]) returns void
language plpgsql as $$
declare
  c_most_late    constant integer := 200;
  c_most_states  constant integer := 20000;
  v_query_ids    integer[] := array(select query_id from semap.continuous_query where map_id = p_map_id and in_pairs and enabled);
  v_confirm      interval;
  v_late_ids     bigint[];
  v_stamps       timestamptz[];
  v_ids          bigint[];
  v_from         timestamptz;
  v_late_to      timestamptz;
  v_to           timestamptz;
  v_present      timestamptz;
  v_further      integer;
  v_track_ids    bigint[];
  v_is_present   boolean;
  v_states       semap.arrival[];
  v_with         record;
  v_without      record;
begin
  select array_agg(track_id order by stamp, track_id), array_agg(stamp order by stamp, track_id)
  into v_late_ids, v_stamps
  from (select distinct l.track_id, l.stamp from unnest(p_late) l
        where exists (select from semap.pair_track_wanted w where w.track_id = l.track_id and w.query_id = any (v_query_ids))) l;
  select 4 * max(greatest(enter_confirm, leave_confirm, '0')) into v_confirm
  from semap.continuous_query where query_id = any (v_query_ids);
  select max(stamp) into v_present from semap.track_now where map_id = p_map_id;

  while cardinality(v_late_ids) > 0 loop
    v_ids := array(select distinct id from unnest(v_late_ids[:c_most_late]) id);
    -- what a track was compared with when it appeared is played as well
    select least(min(b.stamp), v_stamps[1] - greatest(v_confirm, '1 us')) into v_from
    from unnest(v_ids) id
    cross join lateral (select case when count(*) < 4 then min(stamp) - interval '1 us' else min(stamp) end as stamp
                        from semap.states_around(id, v_stamps[1], 4, 0, v_stamps[1])) b;
    exit when v_from < (select gone_before from semap.retention where kind = 'states');
    v_late_to := v_stamps[least(c_most_late, cardinality(v_stamps))];
    v_further := 4;
    loop
      -- beyond its last state nothing of a track changes but what lasts, and what others do
      select greatest(max(a.stamp), v_late_to + v_further * v_confirm / 4)
             + case when bool_or(a.states < v_further) then v_further * interval '1 s' else '0' end
      into v_to
      from unnest(v_ids) id
      cross join lateral (select count(*) as states, max(stamp) as stamp
                          from semap.states_around(id, v_late_to + interval '1 us', 0, v_further, v_present)) a;
      v_is_present := v_to >= v_present;
      v_track_ids := semap.tracks_to_play(p_map_id, v_query_ids, v_ids, v_from, v_to);
      v_states := semap.states_to_play(p_map_id, v_track_ids, v_from, v_to, v_late_ids[c_most_late + 1:], v_stamps[c_most_late + 1:]);
      select * into v_with from semap.play_pairs(p_map_id, v_query_ids, v_from, v_states);
      select * into v_without from semap.play_pairs(
        p_map_id, v_query_ids, v_from,
        semap.states_to_play(p_map_id, v_track_ids, v_from, v_to, v_late_ids, v_stamps));
      exit when v_is_present or cardinality(v_states) > c_most_states
             or not exists (select from semap.differing_pairs(v_with.pairs, v_without.pairs));
      v_further := 4 * v_further;
    end loop;
    perform semap.write_pair_amendments(
      p_map_id, v_query_ids, v_track_ids, v_from, v_stamps[1], v_to, v_is_present,
      v_with.changes, v_without.changes, v_with.pairs, v_without.pairs);
    v_late_ids := v_late_ids[c_most_late + 1:];
    v_stamps := v_stamps[c_most_late + 1:];
  end loop;
end $$;
comment on function semap.amend_pairs is
  'Correct what is known of the pairs of a map after states that came late.';
