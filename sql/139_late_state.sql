-- Late states, which come when their track has gone on already, correct what is known of it: which relations held when is
-- what it would be had all states come in the order of their stamps. What was written and does not stand is taken back by a
-- change that says so, and what was not written is added, both in the transaction that brings the states.
--
-- Only what a late state can have changed is found anew: from the last moment before it at which the memory of the track
-- beside a region was a matter of nothing before (semap.follow_steps), up to the first such moment after it. For a plain
-- region that is the state before it and the one after it. States that are looked through on either side are 10,000 at most:
-- further away, what is in the log counts.
-- A region counts from when it got its present form on, and tracks that were not there then from their beginning on.
-- Where a track is now, and what of it was set aside as an outlier since, no late state changes.

-- So many states of a track before a moment, and so many from it on, at most up to another one.
create or replace function semap.states_around(
  p_track_id bigint, p_stamp timestamptz, p_before integer, p_from integer, p_until timestamptz
) returns setof semap.track_state
language plpgsql stable set plan_cache_mode = force_custom_plan as $$
declare
  c_most_packed  constant integer := 490;
  v_since        timestamptz;
  v_to           timestamptz;
begin
  -- no more packed rows are opened than it takes
  select greatest(n.first_stamp, (
    select max(from_stamp) from (
      select from_stamp, sum(states) over (order by from_stamp desc) as total from semap.track_state_packed
      where track_id = p_track_id and from_stamp < p_stamp order by from_stamp desc limit p_before + 2) p
    where total >= p_before + c_most_packed)) into v_since
  from semap.track_now n where n.track_id = p_track_id;
  select least(p_until, min(to_stamp)) into v_to from (
    select to_stamp, sum(states) over (order by from_stamp) as total from semap.track_state_packed
    where track_id = p_track_id and from_stamp > p_stamp - interval '30 min' order by from_stamp limit p_from + 2) p
  where total >= p_from + c_most_packed;
  -- what is packed makes a plan dear
  if not exists (select from semap.track_state_packed
                 where track_id = p_track_id and from_stamp > v_since - interval '30 min' and from_stamp <= v_to) then
    return query
      (select * from semap.track_state s where s.track_id = p_track_id and s.stamp < p_stamp and s.stamp >= v_since
       order by s.stamp desc limit p_before)
      union all
      (select * from semap.track_state s where s.track_id = p_track_id and s.stamp >= p_stamp and s.stamp <= v_to
       order by s.stamp limit p_from);
    return;
  end if;
  return query
    (select track_id, stamp, x_m, y_m, z_m, std_m, is_last, heading_rad, speed_mps, length_m, width_m
     from semap.stored_state s
     where s.track_id = p_track_id and s.stamp < p_stamp and s.stamp >= v_since
       and s.from_stamp > v_since - interval '30 min' and s.from_stamp < p_stamp and s.to_stamp >= v_since
     order by s.stamp desc limit p_before)
    union all
    (select track_id, stamp, x_m, y_m, z_m, std_m, is_last, heading_rad, speed_mps, length_m, width_m
     from semap.stored_state s
     where s.track_id = p_track_id and s.stamp >= p_stamp and s.stamp <= v_to
       and s.from_stamp > p_stamp - interval '30 min' and s.from_stamp <= v_to and s.to_stamp >= p_stamp
     order by s.stamp limit p_from);
end $$;
comment on function semap.states_around is
  'So many states of a track before a moment, and so many from it on, at most up to another one.';

-- The changes of a track between two moments, the first not included, that were not taken back.
create or replace function semap.standing_changes_of_track(p_map_id integer, p_track_id bigint, p_after timestamptz, p_to timestamptz)
returns setof semap.relation_change
language sql stable as $$
  select * from semap.relation_change c
  where c.map_id = p_map_id and c.stamp > p_after and c.stamp <= p_to and c.track_id = p_track_id
    and c.amendment is distinct from 'retracted'
    and not exists (select from semap.relation_change d where d.retracts = c.uid)
$$;
comment on function semap.standing_changes_of_track is
  'The changes of a track between two moments, the first not included, that were not taken back.';

-- The regions in which a track was known to be at the stamp of a state of it, since when, and until when (null: until now).
-- A boundary that was crossed at that very moment may have been known then, or only at a later state.
create or replace function semap.held_at(p_track_id bigint, p_at timestamptz)
returns table (query_id integer, instance_id bigint, since timestamptz, until timestamptz)
language sql stable as $$
  select h.query_id, h.instance_id, h.since, h.until from (
    select query_id, instance_id, since, until, map_id from semap.relation_past
    where track_id = p_track_id and tstzrange(since, until, '[]') @> p_at
    union all
    select query_id, instance_id, since, null, map_id from semap.relation where track_id = p_track_id and since <= p_at
  ) h
  cross join lateral (
    select case when p_at in (h.since, h.until) then array(
      select c.kind from semap.standing_changes_of_track(h.map_id, p_track_id, p_at - interval '1 us', p_at) c
      where c.query_id = h.query_id and c.instance_id = h.instance_id and c.edge_at = p_at) end as kinds) k
  where (h.since < p_at or 'began' = any (k.kinds)) and (h.until > p_at or h.until is null or 'ended' <> all (k.kinds))
$$;
comment on function semap.held_at is
  'The regions in which a track was known to be at the stamp of a state of it, since when, and until when (null: until now).';

-- The regions that these states of a track may concern, and what is known of it beside each before them: that it was in
-- those that the log says, and nothing of how it stands to their boundaries. What a region counts from lies in side_at.
create or replace function semap.verges_before(
  p_track_id bigint, p_map_id integer, p_cell_m double precision, p_arrivals semap.arrival[], p_late_to timestamptz
) returns semap.verge[]
language plpgsql stable as $$  -- which keeps its plan
begin
  return (
  with place as (
    select x_m, y_m from unnest(p_arrivals) where x_m is not null
  ), way as (
    select public.st_makeline(array_agg(public.st_point(x_m, y_m))) as line,
           (select coalesce(max(leave_margin_m), 0) + 0.001 from semap.continuous_query where map_id = p_map_id) as wide_m
    from (select x_m, y_m from unnest(p_arrivals) where x_m is not null order by stamp) p
  ), span as (
    select min(stamp) as first_stamp, max(stamp) as last_stamp from unnest(p_arrivals)
  ), concerned as (
    select c.region_id
    from (select distinct floor(x_m / p_cell_m)::integer as cell_x, floor(y_m / p_cell_m)::integer as cell_y from place) p
    join semap.region_cell c on c.map_id = p_map_id and c.cell_x = p.cell_x and c.cell_y = p.cell_y and not c.careful
    union
    select r.region_id from way join semap.region r
      on r.careful and r.map_id = p_map_id and r.footprint && public.st_expand(line, wide_m)
      and public.st_dwithin(r.footprint, line, wide_m)
    union
    select r.region_id from span cross join lateral semap.held_at(p_track_id, first_stamp) h
    join semap.region r using (query_id, instance_id)
    union
    select r.region_id from span
    cross join lateral semap.standing_changes_of_track(p_map_id, p_track_id, first_stamp, last_stamp) c
    join semap.region r using (query_id, instance_id)
  ), formed as (
    select r.region_id, r.query_id, r.instance_id,
           case when p_track_id <= r.formed_track_id then r.formed_stamp else '-infinity' end as formed_stamp
    from concerned join semap.region r using (region_id)
  )
  select array_agg(row(p_track_id, f.region_id, p_map_id, h.held, h.held, null, h.held,
                       case when f.formed_stamp >= s.first_stamp then f.formed_stamp end, null, null)::semap.verge)
  from formed f
  cross join span s
  cross join lateral (
    select exists (select from semap.held_at(p_track_id, greatest(s.first_stamp, f.formed_stamp)) n
                   where n.query_id = f.query_id and n.instance_id = f.instance_id) as held) h
  where f.formed_stamp < p_late_to);
end $$;
comment on function semap.verges_before is
  'The regions that these states of a track may concern, and what is known of it beside each before them.';

-- What these states of a track are, in the order of their stamps: with where it was said to have ended, and without what does
-- not pass the gate for outliers; its present passes. p_is_first: there is no state before them. Further, from which stamp
-- on what passes is a matter of these states alone, and from which on of those after p_late_to (null: nowhere): a state
-- that can follow on the one before it passes, whatever was before.
create or replace function semap.arrivals_again(
  p_source semap.source, p_states semap.track_state[], p_now semap.track_now, p_is_first boolean,
  p_ends timestamptz[], p_late_to timestamptz,
  out arrivals semap.arrival[], out known_from timestamptz, out free_from timestamptz
)
language plpgsql stable as $$
begin
  with stated as (
    select distinct on (s.stamp) s.* from unnest(p_states) s order by s.stamp
  )
  select array_agg(row((p_now).track_id, e.stamp, s.x_m, s.y_m, s.z_m, s.std_m, s.heading_rad, s.speed_mps, s.length_m,
                       s.width_m, coalesce(s.is_last, false) or e.stamp = any (p_ends), (p_now).source_id, (p_now).map_id,
                       (p_now).cell_m, not p_is_first, '-infinity', null, null, null, '{}', null)::semap.arrival
                   order by e.stamp)
  into arrivals
  from (select stamp from stated union select unnest(p_ends)) e left join stated s using (stamp);

  if (p_source).jump_m is null then
    known_from := '-infinity';
    select min(stamp) into free_from from unnest(arrivals) where stamp > p_late_to;
    return;
  end if;
  select case when p_is_first then '-infinity' else min(stamp) end, min(stamp) filter (where before_stamp > p_late_to)
  into known_from, free_from
  from (select stamp, lag(stamp) over in_order as before_stamp,
               semap.can_follow(p_source, stamp - lag(stamp) over in_order, x_m - lag(x_m) over in_order,
                                y_m - lag(y_m) over in_order) as follows
        from unnest(arrivals) window in_order as (order by stamp)) s
  where follows;
  if semap.any_far_step(p_source, arrivals) then
    select array_agg(a order by (a).stamp) into arrivals from (
      select distinct on ((a).stamp) a from (
        select a, 1 as place from unnest((semap.gate(
          p_source, array(select a from unnest(arrivals) a where a.x_m is not null), '{}')).passed) a
        union all
        select a, 2 from unnest(arrivals) a where a.x_m is null or a.stamp = (p_now).stamp) both_kinds
      order by (a).stamp, place) passed;
  end if;
end $$;
comment on function semap.arrivals_again is
  'What these states of a track are, in the order of their stamps: with its ends and without outliers.';

-- Take changes back: they get a change each that says so, and the spans that they ended are gone.
create or replace function semap.take_back(p_uids uuid[]) returns void
language sql as $$
  delete from semap.relation_past where relation_past_id in (
    select n.relation_past_id from semap.relation_change c cross join lateral (
      select p.relation_past_id from semap.relation_past p
      where p.track_id = c.track_id and p.query_id = c.query_id and p.instance_id = c.instance_id
        and tstzrange(p.since, p.until, '[]') @> c.edge_at and p.since = c.since and p.until = c.edge_at limit 1) n
    where c.uid = any (p_uids) and c.kind = 'ended');
  insert into semap.relation_change (
    uid, map_id, query_id, query_name, track_id, track_name, instance_id, instance_name, kind, cause, stamp, edge_at, since,
    x_m, y_m, amendment, retracts)
  select md5(uid || '|retracted')::uuid, map_id, query_id, query_name, track_id, track_name, instance_id, instance_name, kind,
         cause, stamp, edge_at, since, x_m, y_m, 'retracted', uid
  from semap.relation_change where uid = any (p_uids) order by stamp, edge_at, change_id
$$;
comment on function semap.take_back is
  'Take changes back: they get a change each that says so, and the spans that they ended are gone.';

-- Add changes of relations of a track, in their order, and the spans that they end. One that was taken back, and stands
-- again, has the identity that it had: what was taken back, and its retraction, get others.
create or replace function semap.add_changes(p_now semap.track_now, p_changes semap.amended[]) returns void
language plpgsql as $$
declare
  v_uids  uuid[];
begin
  if p_changes = '{}' then
    return;
  end if;
  select array_agg(semap.change_uid(r.query_name, t.uid, r.instance_uid, c.kind::text, c.cause::text, c.edge_at) order by c.place)
  into v_uids
  from unnest(p_changes) with ordinality as c (region_id, kind, cause, stamp, edge_at, since, x_m, y_m, place)
  join semap.region r using (region_id)
  join semap.track t on t.track_id = (p_now).track_id;
  if exists (select from semap.relation_change where uid = any (v_uids)) then
    update semap.relation_change d
    set uid = md5(d.uid || '|' || d.change_id)::uuid, retracts = md5(c.uid || '|' || c.change_id)::uuid
    from semap.relation_change c where c.uid = any (v_uids) and d.retracts = c.uid;
    update semap.relation_change c set uid = md5(c.uid || '|' || c.change_id)::uuid where c.uid = any (v_uids);
  end if;

  with told as (
    select c.*, u.uid, r.query_id, r.query_name, r.instance_id, r.instance_uid, r.instance_name, t.name as track_name
    from unnest(p_changes) with ordinality as c (region_id, kind, cause, stamp, edge_at, since, x_m, y_m, place)
    join unnest(v_uids) with ordinality as u (uid, place) using (place)
    join semap.region r using (region_id)
    join semap.track t on t.track_id = (p_now).track_id
  ), past as (
    insert into semap.relation_past (map_id, query_id, query_name, track_id, track_name, instance_id, instance_name,
                                     since, until)
    select (p_now).map_id, query_id, query_name, (p_now).track_id, track_name, instance_id, instance_name, since, edge_at
    from told where kind = 'ended' order by edge_at, place
  )
  insert into semap.relation_change (
    uid, map_id, query_id, query_name, track_id, track_name, instance_id, instance_name, kind, cause, stamp, edge_at, since,
    x_m, y_m, amendment)
  select uid, (p_now).map_id, query_id, query_name, (p_now).track_id, track_name, instance_id, instance_name, kind, cause,
         stamp, edge_at, since, x_m, y_m, 'added'
  from told order by stamp, edge_at, cause = 'disappeared', kind desc, instance_uid, place;
end $$;
comment on function semap.add_changes is
  'Add changes of relations of a track, in their order, and the spans that they end.';

-- Keep how a track stands to these regions at its present, after its history was corrected.
create or replace function semap.keep_present(p_now semap.track_now, p_verges semap.verge[]) returns void
language plpgsql as $$
begin
  delete from semap.verge v using unnest(p_verges) n where v.track_id = n.track_id and v.region_id = n.region_id;
  insert into semap.verge
  select n.* from unnest(p_verges) n join semap.region r using (region_id)
  where r.careful and (n.held <> n.inside or n.inside <> n.side);
  update semap.track_now t
  set careful_ids = array(select n.region_id from semap.relation n join semap.region r using (region_id)
                          where n.track_id = t.track_id and r.careful order by n.region_id),
      calm_until = case when t.outlier_stamp is null then coalesce((
        select min(v.inside_at + case when v.inside then r.enter_confirm else r.leave_confirm end)
        from semap.verge v join semap.region r using (region_id)
        where v.track_id = t.track_id and v.held <> v.inside), 'infinity') else '-infinity' end
  where t.track_id = (p_now).track_id;
end $$;
comment on function semap.keep_present is
  'Keep how a track stands to these regions at its present, after its history was corrected.';

-- Write in what the log of a track differs from these crossings, in these spans of its relations: changes that are taken
-- back, and changes that are added. What a region was said to be in a span, and what it is said to be now, have to agree on
-- where the track was before, and, but for spans that last up to its present, on where it is after; else nothing of that
-- region is written. A change that stands again after it was taken back gets its identity back.
create or replace function semap.write_amendments(
  p_now semap.track_now, p_crossings semap.crossing[], p_spans semap.replayed[], p_present_ids integer[]
) returns void
language plpgsql as $$
declare
  v_gone  uuid[];
  v_new   semap.amended[];
  v_held  semap.amended[];
begin
  with span as (
    select s.*, r.query_id, r.instance_id, r.careful, h.since as held_since,
           n.since as after_since, n.until as after_until, s.region_id = any (p_present_ids) as is_present
    from unnest(p_spans) s
    join semap.region r using (region_id)
    left join lateral (select since from semap.held_at((p_now).track_id, s.from_stamp) h
                       where h.query_id = r.query_id and h.instance_id = r.instance_id) h on true
    left join lateral (select since, until from semap.held_at((p_now).track_id, s.to_stamp) n
                       where n.query_id = r.query_id and n.instance_id = r.instance_id) n on true
  ), found as (
    select s.region_id, c.kind, c.cause, c.stamp, c.edge_at, c.place,
           case when s.careful then c.x_m end as x_m, case when s.careful then c.y_m end as y_m,
           case when c.kind = 'began' then c.edge_at
                else least(coalesce(lag(c.edge_at) over one_region, s.held_since), c.edge_at) end as since,
           coalesce(lag(c.kind = 'began') over one_region, s.held_since is not null) as was_held,
           lead(c.kind) over one_region is null as is_final
    from unnest(p_crossings) with ordinality
      as c (track_id, region_id, kind, cause, stamp, edge_at, x_m, y_m, place)
    join span s using (region_id)
    where c.stamp > s.from_stamp and c.stamp <= s.to_stamp
    window one_region as (partition by s.region_id order by c.place)
  ), after as (
    select s.*, coalesce(f.kind = 'began', s.held_since is not null) as is_held,
           case when f.region_id is null then s.held_since when f.kind = 'began' then f.edge_at end as now_since
    from span s left join found f on f.region_id = s.region_id and f.is_final
    where not exists (select from found f where f.region_id = s.region_id and f.was_held = (f.kind = 'began'))
  ), sound as (
    select * from after where is_present or is_held = (after_since is not null)
  ), stood as (
    select s.region_id, c.uid, c.kind, c.cause, c.stamp, c.edge_at, c.since
    from (select min(from_stamp) as from_stamp, max(to_stamp) as to_stamp from sound) w
    cross join lateral semap.standing_changes_of_track((p_now).map_id, (p_now).track_id, w.from_stamp, w.to_stamp) c
    join sound s using (query_id, instance_id)
    where c.stamp > s.from_stamp and c.stamp <= s.to_stamp
  ), gone as (
    select uid from stood t
    where not exists (select from found f where (f.region_id, f.kind, f.cause, f.stamp, f.edge_at, f.since)
                                              = (t.region_id, t.kind, t.cause, t.stamp, t.edge_at, t.since))
  ), new as (
    select row(f.region_id, f.kind, f.cause, f.stamp, f.edge_at, f.since, f.x_m, f.y_m)::semap.amended as change
    from found f join sound using (region_id)
    where not exists (select from stood t where (f.region_id, f.kind, f.cause, f.stamp, f.edge_at, f.since)
                                              = (t.region_id, t.kind, t.cause, t.stamp, t.edge_at, t.since))
    order by f.place
  ), tail as (
    -- it holds since another moment: so says its end, too, which came later
    select t.uid, row(s.region_id, t.kind, t.cause, t.stamp, t.edge_at, s.now_since, t.x_m, t.y_m)::semap.amended as change
    from sound s
    cross join lateral (
      select * from semap.standing_changes_of_track((p_now).map_id, (p_now).track_id, s.to_stamp, 'infinity') c
      where c.query_id = s.query_id and c.instance_id = s.instance_id and c.kind = 'ended' and c.edge_at = s.after_until
        and c.stamp >= s.after_until
      order by c.stamp limit 1) t
    where not s.is_present and s.now_since <> s.after_since and s.after_until is not null
  )
  select array(select uid from gone union all select uid from tail),
         array(select change from new) || array(select change from tail),
         array(select row(region_id, case when is_held then 'began' else 'ended' end, 'moved', to_stamp, to_stamp, now_since,
                          null, null)::semap.amended
               from sound where is_present or after_until is null and now_since <> after_since)
  into v_gone, v_new, v_held;
  perform semap.take_back(v_gone);
  perform semap.add_changes(p_now, v_new);

  delete from semap.relation n using unnest(v_held) h
  where n.track_id = (p_now).track_id and n.region_id = h.region_id and h.kind = 'ended';
  insert into semap.relation as n (track_id, region_id, query_id, instance_id, map_id, since)
  select (p_now).track_id, r.region_id, r.query_id, r.instance_id, r.map_id, h.since
  from unnest(v_held) h join semap.region r using (region_id) where h.kind = 'began'
  on conflict (track_id, region_id) do update set since = excluded.since where n.since <> excluded.since;
end $$;
comment on function semap.write_amendments is
  'Write in what the log of a track differs from these crossings, in these spans of its relations.';

-- Correct what is known of a track after states of it that came late, at these stamps, ascending.
create or replace function semap.amend_track(p_source semap.source, p_now semap.track_now, p_late timestamptz[]) returns void
language plpgsql as $$
declare
  c_most_states  constant integer := 10000;
  c_most_late    constant integer := 500;
  v_late         timestamptz[] := p_late;
  v_not_yet      timestamptz[];
  v_before       integer;
  v_from         integer;
  v_states       semap.track_state[];
  v_first        timestamptz;
  v_last         timestamptz;
  v_late_to      timestamptz;
  v_is_first     boolean;
  v_is_present   boolean;
  v_again        record;
  v_found        record;
  v_is_unknown   boolean;
  v_is_unsettled boolean;
begin
  while cardinality(v_late) > 0 loop
    v_before := 16;
    v_from := 16;
    v_not_yet := v_late[c_most_late + 1:];
    loop
      v_states := array(select s from semap.states_around((p_now).track_id, v_late[1], v_before, v_from, (p_now).stamp) s);
      select min(stamp), max(stamp), count(*) filter (where stamp >= v_late[1]) < v_from
      into v_first, v_last, v_is_present from unnest(v_states);
      v_is_first := v_first <= (p_now).first_stamp;
      if v_is_present then
        v_last := (p_now).stamp;
      end if;
      if v_not_yet <> '{}' then
        v_states := array(select s from unnest(v_states) s
                          where not exists (select from unnest(v_not_yet) late where late = s.stamp));
      end if;
      select max(late) into v_late_to from unnest(v_late[:c_most_late]) late where late <= v_last;
      select * into v_again from semap.arrivals_again(
        p_source, v_states, p_now, v_is_first,
        array(select distinct stamp from semap.standing_changes_of_track((p_now).map_id, (p_now).track_id, v_first, v_last)
              where cause = 'disappeared'
              union select (p_now).stamp where v_is_present and not (p_now).live),
        v_late_to);
      select * into v_found from semap.follow_steps(
        v_again.arrivals,
        semap.verges_before((p_now).track_id, (p_now).map_id, (p_now).cell_m, v_again.arrivals, v_late_to),
        v_late[1], coalesce(v_again.known_from, 'infinity'), coalesce(v_again.free_from, 'infinity'));
      select coalesce(bool_or(from_stamp is null), false) and not v_is_first,
             coalesce(bool_or(to_stamp is null), false) and not v_is_present
      into v_is_unknown, v_is_unsettled from unnest(v_found.spans);
      exit when not (v_is_unknown and v_before < c_most_states or v_is_unsettled and v_from < c_most_states);
      v_before := v_before * case when v_is_unknown then 4 else 1 end;
      v_from := v_from * case when not v_is_unsettled then 1
        when (select count(*) from unnest(v_late[:c_most_late]) late where late <= v_last) * 4 >= v_from then 16 else 4 end;
    end loop;

    perform semap.write_amendments(
      p_now, v_found.crossings,
      array(select row(region_id, coalesce(from_stamp, case when v_is_first then '-infinity'
                                                            else v_late[1] - interval '1 us' end),
                       coalesce(to_stamp, v_last))::semap.replayed from unnest(v_found.spans)),
      array(select region_id from unnest(v_found.spans) where to_stamp is null and v_is_present));
    if v_is_present then
      perform semap.keep_present(p_now, array(select v from unnest(v_found.verges) v join unnest(v_found.spans) s using (region_id)
                                              where s.to_stamp is null));
    end if;
    v_late := array(select late from unnest(v_late) late where late > v_late_to order by late);
  end loop;
end $$;
comment on function semap.amend_track is
  'Correct what is known of a track after states of it that came late.';

-- Count states that came late, and correct what is known of their tracks.
create or replace function semap.take_late(p_source semap.source, p_late semap.arrival[]) returns void
language plpgsql as $$
declare
  v_track  record;
begin
  perform semap.note_late((p_source).source_id, p_late);
  for v_track in
    select n as now, l.seen_stamp, l.stamps
    from (select track_id, max(seen_stamp) as seen_stamp, array_agg(distinct stamp order by stamp) as stamps
          from unnest(p_late) group by track_id) l
    join semap.track_now n using (track_id)
    order by track_id
  loop
    v_track.now.stamp := v_track.seen_stamp;
    perform semap.amend_track(p_source, v_track.now, v_track.stamps);
  end loop;
end $$;
comment on function semap.take_late is
  'Count states that came late, and correct what is known of their tracks.';
