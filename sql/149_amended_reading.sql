-- Readings of amended tracks (sql/116) are followed by the same code as tracks whose states came late: from the stamp
-- on from which a reading is another one, and as far back before it as relations depend on it, up to its present. What
-- of that differs from the log is written as one difference. States that were dropped are not asked for: what the log
-- says of their time stays.

-- A state as one of another track, which is or is not over with it.
create or replace function semap.as_read(p_state semap.track_state, p_track_id bigint, p_is_last boolean)
returns semap.track_state
language plpgsql immutable parallel safe as $$
begin
  p_state.track_id := p_track_id;
  p_state.is_last := p_is_last;
  return p_state;
end $$;

-- The stretches of a reading, each with up to where its states count: what was set aside as an outlier does not.
create or replace function semap.stretches(p_track_id bigint)
returns table (track_id bigint, from_stamp timestamptz, to_stamp timestamptz, is_open boolean, live boolean,
               first_stamp timestamptz, stamp timestamptz)
language sql stable as $$
  select g.state_track_id, g.from_stamp, least(g.to_stamp - interval '1 us', t.stamp), g.to_stamp = 'infinity', t.live,
         t.first_stamp, t.stamp
  from semap.track_reading g join semap.track_now t on t.track_id = g.state_track_id
  where g.track_id = p_track_id
$$;

-- The states of a reading: so many before a stamp, and all from it on. At a stamp at which two tracks have one, that of
-- the track itself counts. Who went on as another track was not over; the end of a reading is said by its present.
create or replace function semap.read_states(p_track_id bigint, p_from timestamptz, p_before integer)
returns setof semap.track_state
language sql stable as $$
  with state as (
    select distinct on ((s.state).stamp) (s.state).stamp, s.state, g.track_id as of_track, (s.state).is_last
    from semap.stretches(p_track_id) g
    cross join lateral (
      select b as state
      from semap.states_around(g.track_id, least(p_from, g.to_stamp + interval '1 us'), p_before, 0, g.to_stamp,
                               g.from_stamp) b
      union all
      select s from semap.states(array[g.track_id], greatest(p_from, g.from_stamp), g.to_stamp) s) s
    order by (s.state).stamp, g.track_id <> p_track_id, g.track_id
  ), counted as (
    select *, row_number() over (order by stamp desc) as back, count(*) filter (where stamp >= p_from) over () as since,
           lead(of_track) over (order by stamp) as next_track
    from state
  )
  select s.*
  from counted c cross join lateral semap.as_read(c.state, p_track_id, c.is_last and c.next_track = c.of_track) s
  where c.back <= c.since + p_before
$$;

-- The present of a reading, with these states: as that of a track.
create or replace function semap.read_present(p_track_id bigint, p_states semap.track_state[]) returns semap.track_now
language plpgsql stable as $$
declare
  v_now  semap.track_now := (select n from semap.track_now n where track_id = p_track_id);
begin
  select coalesce(bool_or(live) filter (where is_open), false),
         greatest((select max(stamp) from unnest(p_states)),
                  max(stamp) filter (where is_open and not live and stamp >= from_stamp)),
         min(greatest(first_stamp, from_stamp))
  into v_now.live, v_now.stamp, v_now.first_stamp from semap.stretches(p_track_id);
  return v_now;
end $$;

-- When a reading was said to have ended and went on later: where the next state after it is of the same track.
create or replace function semap.read_ends(p_track_id bigint, p_states semap.track_state[]) returns timestamptz[]
language sql stable as $$
  select array_agg(e.stamp)
  from semap.stretches(p_track_id) g
  join semap.track_end e on e.track_id = g.track_id and e.stamp between g.from_stamp and g.to_stamp
  cross join lateral (select min(s.stamp) as stamp from unnest(p_states) s where s.stamp > e.stamp) n
  where e.stamp >= (select min(stamp) from unnest(p_states)) and n.stamp between g.from_stamp and g.to_stamp
    and exists (select from semap.states(array[g.track_id], n.stamp, n.stamp))
    and (g.track_id = p_track_id
         or not exists (select from semap.stretches(p_track_id) o
                        cross join lateral semap.states(array[o.track_id], n.stamp, n.stamp)
                        where o.track_id = p_track_id and n.stamp between o.from_stamp and o.to_stamp))
$$;

-- Follow a reading anew from a stamp on, and from the state before it, which may be its last no more, or may be now. It
-- writes nothing.
create or replace function semap.replay_reading(
  p_track_id bigint, p_from timestamptz, out now semap.track_now, out kept semap.relation_state[],
  out crossings semap.crossing[], out spans semap.replayed[]
) language plpgsql stable as $$
declare
  c_most_states  constant integer := 10000;
  c_kept_since   constant timestamptz := coalesce(
    (select gone_before from semap.retention where kind = 'states'), '-infinity');
  v_from         timestamptz;
  v_before       integer := 16;
  v_states       semap.track_state[];
  v_is_first     boolean;
  v_again        record;
  v_known        semap.relation_state[];
begin
  loop
    v_states := array(select s from semap.read_states(p_track_id, p_from, v_before + 1) s);
    v_from := coalesce((select max(stamp) from unnest(v_states) where stamp < p_from), p_from);
    now := semap.read_present(p_track_id, v_states);
    v_is_first := (select count(*) < v_before from unnest(v_states) where stamp < v_from)
                  and now.first_stamp >= c_kept_since;
    v_again := semap.updates_again(
      (select s from semap.source s where source_id = now.source_id), v_states, now, v_is_first,
      semap.read_ends(p_track_id, v_states) || case when not now.live and v_states <> '{}' then array[now.stamp] end,
      'infinity');
    v_known := semap.relations_before(p_track_id, now.map_id, now.cell_m, v_again.updates, 'infinity', true);
    spans := semap.late_spans(v_again.updates, v_known, v_from, coalesce(v_again.known_from, 'infinity'), 'infinity');
    exit when v_is_first or v_before >= c_most_states
           or not exists (select from unnest(spans) where from_stamp is null);
    v_before := v_before * 4;
  end loop;
  select f.kept, f.crossings into kept, crossings from semap.follow_steps(v_again.updates, v_known) f;
  -- of whom nothing is left but what the log says
  spans := array(
    select row(region_id, coalesce(from_stamp, case when v_is_first then '-infinity' else v_from - interval '1 us' end),
               'infinity')::semap.replayed from unnest(spans)
    union all
    select distinct row(r.region_id, v_from - interval '1 us', 'infinity')::semap.replayed
    from semap.standing_changes_of_track(now.map_id, p_track_id, v_from - interval '1 us', 'infinity') c
    join semap.region r using (query_id, instance_id)
    where v_states = '{}' and semap.reads_amended(r.query_id, p_track_id));
end $$;

-- Correct what queries that follow amendments know of a track, from a stamp on.
create or replace function semap.correct_reading(p_track_id bigint, p_from timestamptz) returns void
language plpgsql as $$
declare
  v_found  record;
begin
  v_found := semap.replay_reading(p_track_id, p_from);
  perform semap.write_amendments(v_found.now, v_found.crossings, v_found.spans,
                                 array(select region_id from unnest(v_found.spans)));
  delete from semap.relation n
  where n.track_id = p_track_id and not n.confirmed and not n.in_pairs
    and semap.reads_amended(n.query_id, p_track_id);
  perform semap.keep_present(v_found.now, v_found.kept);
end $$;

-- The sources whose states are in readings of a source that are due, and the source.
create or replace function semap.sources_read(p_source_id integer) returns integer[]
language sql stable as $$
  select array(
    select p_source_id
    union
    select t.source_id
    from semap.reading_due d join semap.track_reading g using (track_id)
    join semap.track_now t on t.track_id = g.state_track_id
    where d.source_id = p_source_id
    order by 1)
$$;

-- Correct some readings of a source that are due: how many. Whoever calls it keeps the writers out.
create or replace function semap.correct_readings(p_source_id integer, p_most integer) returns bigint
language plpgsql as $$
declare
  c_kept_since  constant timestamptz := (select gone_before from semap.retention where kind = 'states');
  v_due         record;
  v_corrected   bigint := 0;
begin
  for v_due in
    with taken as (
      delete from semap.reading_due where source_id = p_source_id and track_id in (
        select track_id from semap.reading_due where source_id = p_source_id
        group by track_id order by min(from_stamp) limit p_most)
      returning track_id, from_stamp
    )
    select track_id, greatest(min(from_stamp), c_kept_since) as from_stamp from taken group by track_id order by 1
  loop
    perform semap.correct_reading(v_due.track_id, v_due.from_stamp);
    v_corrected := v_corrected + 1;
  end loop;
  return v_corrected;
end $$;
