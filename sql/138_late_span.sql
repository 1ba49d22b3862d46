-- What of a track is looked at again after states of it that came late (sql/139).

-- The changes of a track between two moments, the first not included, that were not taken back.
create or replace function semap.standing_changes_of_track(p_map_id integer, p_track_id bigint, p_after timestamptz,
                                                           p_to timestamptz)
returns setof semap.relation_change
language sql stable as $$
  select * from semap.relation_change c
  where c.map_id = p_map_id and c.stamp > p_after and c.stamp <= p_to and c.track_id = p_track_id
    and c.amendment is distinct from 'retracted'
    and not exists (select from semap.relation_change d where d.retracts = c.uid)
$$;

-- The regions in which a track was known to be at the stamp of a state of it, since when, and until when (null: until
-- now). A boundary that was crossed at that very moment may have been known then, or only at a later state.
create or replace function semap.held_at(p_track_id bigint, p_at timestamptz)
returns table (query_id integer, instance_id bigint, since timestamptz, until timestamptz)
language sql stable as $$
  select h.query_id, h.instance_id, h.since, h.until from (
    select query_id, instance_id, since, until, map_id from semap.relation_past
    where track_id = p_track_id and tstzrange(since, until, '[]') @> p_at
    union all
    select query_id, instance_id, since, null, map_id from semap.relation
    where track_id = p_track_id and not in_pairs and since <= p_at
  ) h
  cross join lateral (
    select case when p_at in (h.since, h.until) then array(
      select c.kind from semap.standing_changes_of_track(h.map_id, p_track_id, p_at - interval '1 us', p_at) c
      where c.query_id = h.query_id and c.instance_id = h.instance_id and c.transition_at = p_at) end as kinds) k
  where (h.since < p_at or 'began' = any (k.kinds)) and (h.until > p_at or h.until is null or 'ended' <> all (k.kinds))
$$;

-- The regions that these states of a track may concern, and what is known of it beside each before them: that it was in
-- those that the log says, and nothing of how it stands to their boundaries. What a region counts from lies in raw_at.
-- p_is_amended: those of queries that take the track as amended, whose states these are; else those of the others.
create or replace function semap.relations_before(
  p_track_id bigint, p_map_id integer, p_cell_m double precision, p_updates semap.state_update[],
  p_late_to timestamptz, p_is_amended boolean default false
) returns semap.relation_state[]
language plpgsql stable as $$  -- which keeps its plan
begin
  return (
  with place as (
    select x_m, y_m from semap.states_of(p_updates) where x_m is not null
  ), way as (
    select public.st_makeline(array_agg(public.st_point(x_m, y_m))) as line,
           (select coalesce(max(leave_margin_m), 0) + 0.001 from semap.continuous_query where map_id = p_map_id)
             as wide_m
    from (select x_m, y_m from semap.states_of(p_updates) where x_m is not null order by stamp) p
  ), span as (
    select min(stamp) as first_stamp, case when p_is_amended then p_late_to else max(stamp) end as last_stamp
    from semap.states_of(p_updates)
  ), concerned as (
    select c.region_id
    from (select distinct floor(x_m / p_cell_m)::integer as cell_x, floor(y_m / p_cell_m)::integer as cell_y
          from place) p
    join semap.region_cell c on c.map_id = p_map_id and c.cell_x = p.cell_x and c.cell_y = p.cell_y and not c.stateful
    union
    select r.region_id from way join semap.region r
      on r.stateful and r.map_id = p_map_id and r.footprint && public.st_expand(line, wide_m)
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
           case when p_track_id <= r.valid_from_track_id then r.valid_from else '-infinity' end as valid_from
    from concerned join semap.region r using (region_id)
    where semap.reads_amended(r.query_id, p_track_id) = p_is_amended
  )
  select array_agg(semap.new_relation_state(
           query_id => f.query_id, subject_key => p_track_id, object_key => -f.instance_id, confirmed => h.held,
           since => null, pending => h.held, pending_at => null, raw => h.held,
           raw_at => case when f.valid_from >= s.first_stamp then f.valid_from end))
  from formed f
  cross join span s
  cross join lateral (
    select exists (select from semap.held_at(p_track_id, greatest(s.first_stamp, f.valid_from)) n
                   where n.query_id = f.query_id and n.instance_id = f.instance_id) as held) h
  where f.valid_from < p_late_to
    -- what was crossed before the region got its form, and known after it, is nothing that can be found again
    and not exists (
      select from semap.standing_changes_of_track(p_map_id, p_track_id, f.valid_from, s.last_stamp) c
      where f.valid_from >= s.first_stamp and c.query_id = f.query_id and c.instance_id = f.instance_id
        and c.transition_at <= f.valid_from));
end $$;

-- What these states of a track are, in the order of their stamps: with where it was said to have ended, and without
-- what does not pass the gate for outliers; its present passes. p_is_first: there is no state before them. Further,
-- from which stamp on what passes is a matter of these states alone, and from which on of those after p_late_to (null:
-- nowhere): a state that can follow on the one before it passes, whatever was before.
create or replace function semap.updates_again(
  p_source semap.source, p_states semap.track_state[], p_now semap.track_now, p_is_first boolean,
  p_ends timestamptz[], p_late_to timestamptz,
  out updates semap.state_update[], out known_from timestamptz, out free_from timestamptz
)
language plpgsql stable as $$
begin
  with stated as (
    select distinct on (s.stamp) s.stamp, s as state from unnest(p_states) s order by s.stamp
  )
  select array_agg(semap.new_state_update(
                     case when s.stamp is null then semap.new_state((p_now).track_id, e.stamp, is_last => true)
                          when e.stamp = any (p_ends) then semap.as_last(s.state) else s.state end,
                     source_id => (p_now).source_id, map_id => (p_now).map_id, cell_m => (p_now).cell_m,
                     live => not p_is_first, seen_stamp => '-infinity')
                   order by e.stamp)
  into updates
  from (select stamp from stated union select unnest(p_ends)) e left join stated s on s.stamp = e.stamp;

  if (p_source).jump_m is null then
    known_from := '-infinity';
    select min(stamp) into free_from from semap.states_of(updates) where stamp > p_late_to;
    return;
  end if;
  select case when p_is_first then '-infinity' else min(stamp) end, min(stamp) filter (where before_stamp > p_late_to)
  into known_from, free_from
  from (select stamp, lag(stamp) over in_order as before_stamp,
               semap.can_follow(p_source, stamp - lag(stamp) over in_order, x_m - lag(x_m) over in_order,
                                y_m - lag(y_m) over in_order) as follows
        from semap.states_of(updates) window in_order as (order by stamp)) s
  where follows;
  if semap.any_far_step(p_source, updates) then
    select array_agg(a order by stamp) into updates from (
      select distinct on (stamp) a, stamp from (
        select a, (a.state).stamp, 1 as place from unnest((semap.gate(
          p_source, array(select a from unnest(updates) a where (a.state).x_m is not null), '{}')).passed) a
        union all
        select a, (a.state).stamp, 2 from unnest(updates) a
        where (a.state).x_m is null or (a.state).stamp = (p_now).stamp) both_kinds
      order by stamp, place) passed;
  end if;
end $$;

-- Between which stamps what is found of a track beside each region may differ from what was found without states of it
-- that came late, from p_late_from on: after the last state before them at which a relation is a matter of the states
-- from p_known_from on alone, and up to the first one at which it is a matter of those from p_free_from on alone. That
-- is so where the track appears or ends, and where it was evidently inside, or evidently outside, for as long as it
-- takes to confirm that. Null: no such state is among these.
create or replace function semap.late_spans(
  p_updates semap.state_update[], p_kept semap.relation_state[], p_late_from timestamptz, p_known_from timestamptz,
  p_free_from timestamptz
) returns semap.replayed[]
language plpgsql stable as $$ -- which keeps its plan
begin
  return (
    with step as (
      select region_id, (before).raw_at as counts_from, known_at, part, at, is_last, appears, enter_confirm,
             leave_confirm,
             case when appears then raw when enters then true when leaves then false end as decided,
             known_at > p_free_from or known_at = p_free_from and part is null as is_free
      from (
        select region_id, before, known_at, at, part, is_last, enter_confirm, leave_confirm, raw, enters, leaves,
               -- whether the track appears with the first free state is a matter of what came before it
               appears and known_at <> p_free_from as appears
        from semap.steps(p_updates, p_kept)) s
    ), turn as (
      select *, decided is distinct from lag(decided) over one_region
                or is_free and lag(is_free) over one_region is not true as begins
      from step window one_region as (partition by region_id order by known_at, part)
    ), run as (
      select *, max(at) filter (where begins) over (partition by region_id order by known_at, part) as run_at from turn
    ), sure as (
      select *, part is null and (appears or is_last
                                  or at >= run_at + case when decided then enter_confirm
                                                         when not decided then leave_confirm end) as is_sure
      from run
    )
    select array_agg(span order by (span).region_id) from (
      select row(region_id,
                 coalesce(max(known_at) filter (where is_sure and known_at < p_late_from and known_at >= p_known_from),
                          counts_from),
                 min(known_at) filter (where is_sure and known_at >= p_late_from and is_free))::semap.replayed as span
      from sure group by region_id, counts_from) s);
end $$;
