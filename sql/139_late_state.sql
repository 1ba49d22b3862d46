-- Late states, which come when their track has gone on already, correct what is known of it: which relations held when
-- is what it would be had all states come in the order of their stamps. What was written and does not stand is taken
-- back by a change that says so, and what was not written is added, both in one transaction (sql/148).
--
-- Only what a late state can have changed is found anew: from the last moment before it at which the memory of the
-- track beside a region was a matter of nothing before (semap.late_spans), up to the first such moment after it. For
-- a stateless region that is the state before it and the one after it. States that are looked through on either side
-- are 10,000 at most: further away, what is in the log counts.
-- A region counts from when it got its present form on, and tracks that were not there then from their beginning on.
-- Where a track is now, and what of it was set aside as an outlier since, no late state changes.

-- Take changes back: they get a change each that says so, and the spans that they ended are gone.
create or replace function semap.retract_changes(p_uids uuid[]) returns void
language sql as $$
  delete from semap.relation_past where relation_past_id in (
    select n.relation_past_id from semap.relation_change c cross join lateral (
      select p.relation_past_id from semap.relation_past p
      where (p.track_id = c.track_id or p.subject_instance_id = c.subject_instance_id
             and p.object_track_id = c.object_track_id)
        and p.query_id = c.query_id and p.instance_id is not distinct from c.instance_id
        and p.object_track_id is not distinct from c.object_track_id
          and tstzrange(p.since, p.until, '[]') @> c.transition_at
          and p.since = c.since and p.until = c.transition_at limit 1) n
    where c.uid = any (p_uids) and c.kind = 'ended');
  insert into semap.relation_change (
    uid, map_id, query_id, query_name, track_id, track_name, subject_instance_id, subject_instance_name,
    instance_id, instance_name, object_track_id, object_track_name, kind, cause, stamp, transition_at, since, x_m, y_m,
    direction, edge, door_id, door_name, amendment, retracts)
  select md5(uid || '|retracted')::uuid, map_id, query_id, query_name, track_id, track_name, subject_instance_id,
         subject_instance_name, instance_id, instance_name, object_track_id, object_track_name, kind, cause, stamp,
         transition_at,
         since, x_m, y_m, direction, edge, door_id, door_name, 'retracted', uid
  from semap.relation_change where uid = any (p_uids) order by stamp, transition_at, change_id
$$;

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
  select array_agg(semap.change_uid(r.query_name, t.uid, r.instance_uid, c.kind::text, c.cause::text, c.transition_at)
                   order by c.place)
  into v_uids
  from unnest(p_changes) with ordinality as c (region_id, kind, cause, stamp, transition_at, since, x_m, y_m, place)
  join semap.region r using (region_id)
  join semap.track t on t.track_id = (p_now).track_id;
  perform semap.free_uids(v_uids);

  with told as (
    select c.*, u.uid, r.query_id, r.query_name, r.instance_id, r.instance_uid, r.instance_name, t.name as track_name,
           w.edge, w.door_id, w.door_name
    from unnest(p_changes) with ordinality as c (region_id, kind, cause, stamp, transition_at, since, x_m, y_m, place)
    join unnest(v_uids) with ordinality as u (uid, place) using (place)
    join semap.region r using (region_id)
    join semap.track t on t.track_id = (p_now).track_id
    left join lateral semap.crossed_at(c.region_id, case when c.cause = 'moved' then c.x_m end, c.y_m) w on true
  ), past as (
    insert into semap.relation_past (map_id, query_id, query_name, track_id, track_name, instance_id, instance_name,
                                     since, until)
    select (p_now).map_id, query_id, query_name, (p_now).track_id, track_name, instance_id, instance_name, since,
           transition_at
    from told where kind = 'ended' order by transition_at, place
  )
  insert into semap.relation_change (
    uid, map_id, query_id, query_name, track_id, track_name, instance_id, instance_name, kind, cause, stamp,
    transition_at,
    since,
    x_m, y_m, edge, door_id, door_name, amendment)
  select uid, (p_now).map_id, query_id, query_name, (p_now).track_id, track_name, instance_id, instance_name, kind,
         cause,
         stamp, transition_at, since, x_m, y_m, edge, door_id, door_name, 'added'
  from told order by stamp, transition_at, cause = 'disappeared', kind desc, instance_uid, place;
end $$;

-- Keep how a track stands to these regions at its present, after its history was corrected.
create or replace function semap.keep_present(p_now semap.track_now, p_kept semap.relation_state[]) returns void
language plpgsql as $$
begin
  perform semap.keep_relations((p_now).map_id, array(
    select k from unnest(p_kept) k join semap.region r on r.query_id = k.query_id and r.instance_id = -k.object_key
    where r.stateful));
  update semap.track_now t
  set stateful_ids = array(
        select r.region_id from semap.relation n join semap.region r using (query_id, instance_id)
        where n.track_id = t.track_id and n.confirmed and r.stateful order by r.region_id),
      safe_until = case when t.outlier_stamp is null then coalesce((
        select min(n.pending_at + case when n.pending then r.enter_confirm else r.leave_confirm end)
        from semap.relation n join semap.region r using (query_id, instance_id)
        where n.track_id = t.track_id and n.confirmed <> n.pending), 'infinity') else '-infinity' end
  where t.track_id = (p_now).track_id;
end $$;

-- Bring what a track is to regions now in line with what was found of it: what holds, since when, and what is over.
create or replace function semap.hold_relations(p_now semap.track_now, p_held semap.amended[]) returns void
language sql as $$
  with over as (
    delete from semap.relation n using unnest(p_held) h, semap.region r
    where r.region_id = h.region_id and h.kind = 'ended' and n.query_id = r.query_id
      and n.subject_key = (p_now).track_id and n.object_key = -r.instance_id and n.confirmed
  )
  insert into semap.relation as n (query_id, map_id, track_id, instance_id, confirmed, since, pending, raw)
  select r.query_id, r.map_id, (p_now).track_id, r.instance_id, true, h.since, true, true
  from unnest(p_held) h join semap.region r using (region_id) where h.kind = 'began'
  on conflict (query_id, subject_key, object_key) do update set confirmed = true, since = excluded.since
  where n.since is distinct from excluded.since
$$;

-- The spans of a track beside regions in which what its log says can be corrected, each with what these crossings say
-- there. What a region was said to be in a span, and what it is said to be now, have to agree on where the track was
-- before, and, but for spans that last up to its present, on where it is after.
create or replace function semap.sound_spans(
  p_now semap.track_now, p_crossings semap.crossing[], p_spans semap.replayed[], p_present_ids integer[]
) returns setof semap.sound_span
language sql stable as $$
  with span as (
    select s.*, r.query_id, r.instance_id, r.stateful, h.since as held_since,
           n.since as after_since, n.until as after_until, s.region_id = any (p_present_ids) as is_present
    from unnest(p_spans) s
    join semap.region r using (region_id)
    left join lateral (select since from semap.held_at((p_now).track_id, s.from_stamp) h
                       where h.query_id = r.query_id and h.instance_id = r.instance_id) h on true
    left join lateral (select since, until from semap.held_at((p_now).track_id, s.to_stamp) n
                       where n.query_id = r.query_id and n.instance_id = r.instance_id) n on true
  ), found as (
    select s.region_id, c.kind, c.cause, c.stamp, c.transition_at, c.place,
           case when s.stateful then c.x_m end as x_m, case when s.stateful then c.y_m end as y_m,
           case when c.kind = 'began' then c.transition_at
                else least(coalesce(lag(c.transition_at) over one_region, s.held_since), c.transition_at) end as since,
           coalesce(lag(c.kind = 'began') over one_region, s.held_since is not null) as was_held
    from unnest(p_crossings) with ordinality
      as c (track_id, region_id, kind, cause, stamp, transition_at, x_m, y_m, place)
    join span s using (region_id)
    where c.stamp > s.from_stamp and c.stamp <= s.to_stamp
    window one_region as (partition by s.region_id order by c.place)
  ), told as (
    select region_id, bool_and(was_held <> (kind = 'began')) as alternates,
           array_agg(row(region_id, kind, cause, stamp, transition_at, since, x_m, y_m)::semap.amended order by place)
             as changes
    from found group by region_id
  ), after as (
    select s.*, t.changes,
           case when t.region_id is null then s.held_since
                when t.changes[cardinality(t.changes)].kind = 'began'
                  then t.changes[cardinality(t.changes)].transition_at end as now_since
    from span s left join told t using (region_id)
    where t.alternates is not false
  )
  select region_id, query_id, instance_id, from_stamp, to_stamp, is_present, now_since, after_since, after_until,
         changes
  from after where is_present or (now_since is null) = (after_since is null)
$$;

-- In what the log of a track differs from what was found in these spans: which of its changes do not stand, which are
-- missing, and how the track stands to regions at present where it does otherwise than was known.
create or replace function semap.amendments(
  p_now semap.track_now, p_spans semap.sound_span[],
  out gone uuid[], out missing semap.amended[], out held semap.amended[]
)
language plpgsql stable as $$ -- which keeps its plan
begin
  with sound as materialized (
    select * from unnest(p_spans)
  ), found as (
    select c.*, row_number() over () as place from sound s cross join lateral unnest(s.changes) c
  ), stood as (
    select s.region_id, c.uid, c.kind, c.cause, c.stamp, c.transition_at, c.since
    from (select min(from_stamp) as from_stamp, max(to_stamp) as to_stamp from sound) w
    cross join lateral semap.standing_changes_of_track((p_now).map_id, (p_now).track_id, w.from_stamp, w.to_stamp) c
    join sound s using (query_id, instance_id)
    where c.stamp > s.from_stamp and c.stamp <= s.to_stamp
  ), over as (
    select uid from stood t
    where not exists (select from found f where (f.region_id, f.kind, f.cause, f.stamp, f.transition_at, f.since)
                                              = (t.region_id, t.kind, t.cause, t.stamp, t.transition_at, t.since))
  ), new as (
    select row(f.region_id, f.kind, f.cause, f.stamp, f.transition_at, f.since, f.x_m, f.y_m)::semap.amended as change
    from found f
    where not exists (select from stood t where (f.region_id, f.kind, f.cause, f.stamp, f.transition_at, f.since)
                                              = (t.region_id, t.kind, t.cause, t.stamp, t.transition_at, t.since))
    order by f.place
  ), tail as (
    -- it holds since another moment: so says its end, too, which came later
    select t.uid, row(s.region_id, t.kind, t.cause, t.stamp, t.transition_at, s.now_since, t.x_m, t.y_m)::semap.amended
      as change
    from sound s
    cross join lateral (
      select * from semap.standing_changes_of_track((p_now).map_id, (p_now).track_id, s.to_stamp, 'infinity') c
      where c.query_id = s.query_id and c.instance_id = s.instance_id and c.kind = 'ended'
        and c.transition_at = s.after_until
        and c.stamp >= s.after_until
      order by c.stamp limit 1) t
    where not s.is_present and s.now_since <> s.after_since and s.after_until is not null
  )
  select array(select uid from over union all select uid from tail),
         array(select change from new) || array(select change from tail),
         array(select row(region_id, case when now_since is null then 'ended' else 'began' end, 'moved', to_stamp,
                          to_stamp, now_since, null, null)::semap.amended
               from sound where is_present or after_until is null and now_since <> after_since)
  into gone, missing, held;
end $$;

-- Write in what the log of a track differs from these crossings, in those of these spans of its relations that are
-- sound: changes that are taken back, and changes that are added. A change that stands again after it was taken back
-- gets its identity back.
create or replace function semap.write_amendments(
  p_now semap.track_now, p_crossings semap.crossing[], p_spans semap.replayed[], p_present_ids integer[]
) returns void
language plpgsql as $$
declare
  v_amended  record;
begin
  v_amended := semap.amendments(
    p_now, array(select s from semap.sound_spans(p_now, p_crossings, p_spans, p_present_ids) s order by s.region_id));
  perform semap.retract_changes(v_amended.gone);
  perform semap.add_changes(p_now, v_amended.missing);
  perform semap.hold_relations(p_now, v_amended.held);
end $$;

-- Queue states that came late, and count them. Rules wait until those are corrected that came within the lateness of
-- their source, so that they never see what is taken back by them.
create or replace function semap.queue_late(p_source semap.source, p_late semap.state_update[]) returns void
language plpgsql as $$
begin
  insert into semap.late_state (track_id, stamp, source_id, of_pairs)
  select track_id, stamp, p_source.source_id, false from semap.states_of(p_late);
  update semap.source s
  set late_states = s.late_states + cardinality(p_late),
      late_from = least(s.late_from, (select min(stamp) from semap.states_of(p_late)
                                      where stamp > semap.complete_through(s)))
  where s.source_id = p_source.source_id;
  -- which tracks began earlier than was known
  update semap.track_now t set first_stamp = n.stamp
  from (select track_id, min(stamp) as stamp from semap.states_of(p_late) group by track_id) n
  where t.track_id = n.track_id and n.stamp < t.first_stamp;
  notify semap_late;
end $$;

-- Follow a track anew around the oldest of its late states that are queued, at most so many: from late_from up to
-- late_to. It writes nothing.
create or replace function semap.replay_track(
  p_now semap.track_now, p_most integer, out late_from timestamptz, out late_to timestamptz, out last timestamptz,
  out is_first boolean, out is_present boolean, out kept semap.relation_state[], out crossings semap.crossing[],
  out spans semap.replayed[]
) language plpgsql stable as $$
declare
  c_most_states   constant integer := 10000;
  c_source        constant semap.source := (select s from semap.source s where source_id = p_now.source_id);
  c_queued        constant timestamptz[] := array(select stamp from semap.late_state
                                                  where track_id = p_now.track_id and not of_pairs order by stamp);
  c_not_yet       constant timestamptz[] := c_queued[p_most + 1:];
  v_before        integer := 16;
  v_from          integer := 16;
  v_states        semap.track_state[];
  v_first         timestamptz;
  v_again         record;
  v_known         semap.relation_state[];
  v_is_unknown    boolean;
  v_is_unsettled  boolean;
begin
  late_from := c_queued[1];
  loop
    v_states := array(select s from semap.states_around(p_now.track_id, late_from, v_before, v_from, p_now.stamp) s);
    select min(stamp), max(stamp), count(*) filter (where stamp >= late_from) < v_from
    into v_first, last, is_present from unnest(v_states);
    is_first := v_first <= p_now.first_stamp;
    if is_present then
      last := p_now.stamp;
    end if;
    if c_not_yet <> '{}' then
      v_states := array(select s from unnest(v_states) s where s.stamp <> all (c_not_yet));
    end if;
    select coalesce(max(late), late_from) into late_to from unnest(c_queued[:p_most]) late where late <= last;
    v_again := semap.updates_again(
      c_source, v_states, p_now, is_first,
      array(select distinct stamp
            from semap.standing_changes_of_track(p_now.map_id, p_now.track_id, v_first, last)
            where cause = 'disappeared' and object_track_id is null -- of two tracks the other one may have ended
              and not semap.reads_amended(query_id, p_now.track_id)
            union select p_now.stamp where is_present and not p_now.live),
      late_to);
    v_known := semap.relations_before(p_now.track_id, p_now.map_id, p_now.cell_m, v_again.updates, late_to);
    spans := semap.late_spans(v_again.updates, v_known, late_from, coalesce(v_again.known_from, 'infinity'),
                              coalesce(v_again.free_from, 'infinity'));
    select coalesce(bool_or(from_stamp is null), false) and not is_first,
           coalesce(bool_or(to_stamp is null), false) and not is_present
    into v_is_unknown, v_is_unsettled from unnest(spans);
    exit when not (v_is_unknown and v_before < c_most_states or v_is_unsettled and v_from < c_most_states);
    v_before := v_before * case when v_is_unknown then 4 else 1 end;
    v_from := v_from * case when not v_is_unsettled then 1
      when (select count(*) from unnest(c_queued[:p_most]) late where late <= last) * 4 >= v_from then 16 else 4 end;
  end loop;
  select f.kept, f.crossings into kept, crossings
  from semap.follow_steps(array(
    select a from unnest(v_again.updates) a
    where (a.state).stamp <= (select max(coalesce(to_stamp, 'infinity')) from unnest(spans))), v_known) f;
end $$;

-- Correct what is known of a track after the oldest of its late states that are queued, at most so many: of how many
-- states. Whoever calls it keeps the writers of its source out.
create or replace function semap.correct_track(p_track_id bigint, p_most integer default 500) returns bigint
language plpgsql as $$
declare
  c_now        constant semap.track_now := (select n from semap.track_now n where track_id = p_track_id);
  v_found      record;
  v_corrected  bigint;
begin
  v_found := semap.replay_track(c_now, p_most);
  perform semap.write_amendments(
    c_now, v_found.crossings,
    array(select row(region_id, coalesce(from_stamp, case when v_found.is_first then '-infinity'
                                                          else v_found.late_from - interval '1 us' end),
                     coalesce(to_stamp, v_found.last))::semap.replayed from unnest(v_found.spans)),
    array(select region_id from unnest(v_found.spans) where to_stamp is null and v_found.is_present));
  if v_found.is_present then
    perform semap.keep_present(c_now, array(
      select k
      from unnest(v_found.kept) k join semap.region r on r.query_id = k.query_id and r.instance_id = -k.object_key
      join unnest(v_found.spans) s using (region_id) where s.to_stamp is null));
  end if;
  delete from semap.late_state where track_id = p_track_id and not of_pairs and stamp <= v_found.late_to;
  get diagnostics v_corrected = row_count;
  return v_corrected;
end $$;
