-- The gate for outliers. A place that asks for a longer way than `jump_m` and `jump_mps` of its source allow since the
-- last one is set aside: it moves nothing. If the next state fits to it rather than to what was before, the track did
-- jump, and is there from that state on; if not, it was an outlier, and is counted.

-- A state, and what was known of its track before it.
create or replace function semap.new_state_update(
  state semap.track_state, source_id integer, map_id integer, cell_m double precision, live boolean,
  seen_stamp timestamptz default null, from_x_m double precision default null, from_y_m double precision default null,
  from_z_m double precision default null, region_ids integer[] default '{}', outlier_stamp timestamptz default null
) returns semap.state_update
language sql immutable parallel safe as $$
  select row(state, source_id, map_id, cell_m, live, seen_stamp, from_x_m, from_y_m, from_z_m, region_ids,
             outlier_stamp)::semap.state_update
$$;

-- The states of these state updates.
create or replace function semap.states_of(p_updates semap.state_update[]) returns setof semap.track_state
language sql immutable parallel safe rows 100 as $$ select (a.state).* from unnest(p_updates) a $$;

-- Whether one place can follow on another, some time later.
create or replace function semap.can_follow(
  p_source semap.source, p_gap interval, p_dx_m double precision, p_dy_m double precision
) returns boolean
language sql immutable parallel safe as $$
  select sqrt(p_dx_m ^ 2 + p_dy_m ^ 2) <= (p_source).jump_m + (p_source).jump_mps * extract(epoch from p_gap)
$$;

-- Whether the gate has to look at these states, since a step of a track is more than half as long as a jump: where it
-- was may be known only to within its safe region.
create or replace function semap.any_far_step(p_source semap.source, p_updates semap.state_update[]) returns boolean
language plpgsql immutable parallel safe as $$ -- which keeps its plan
begin
  return exists (
    select from (
      select s.x_m - lag(s.x_m, 1, case when a.live then a.from_x_m end) over one_track as dx_m,
             s.y_m - lag(s.y_m, 1, case when a.live then a.from_y_m end) over one_track as dy_m
      from unnest(p_updates) a cross join lateral (select (a.state).*) s
      window one_track as (partition by s.track_id order by s.stamp)) step
    where dx_m ^ 2 + dy_m ^ 2 > ((p_source).jump_m / 2) ^ 2);
end $$;

-- Keep with a track what was set aside of it, or that nothing is. It is looked up at its next state.
create or replace function semap.set_aside(p_track_id bigint, p_state semap.track_state) returns void
language sql as $$
  update semap.track_now
  set outlier_stamp = (p_state).stamp, outlier_x_m = (p_state).x_m, outlier_y_m = (p_state).y_m,
      safe_until = case when (p_state).stamp is null then 'infinity' else '-infinity' end::timestamptz
  where track_id = p_track_id and (outlier_stamp is not null or (p_state).stamp is not null)
$$;

-- Lead states through the gate for outliers, and write nothing: those that pass, what is set aside at the end of each
-- track (a stamp that is null: nothing), and how many were outliers. A track whose last state does not pass ends where
-- it was. p_asides: what was set aside of tracks before.
create or replace function semap.gate(
  p_source semap.source, p_updates semap.state_update[], p_asides semap.track_state[],
  out passed semap.state_update[], out asides semap.track_state[], out outliers bigint
)
language plpgsql immutable as $$
declare
  v_update  semap.state_update;
  v_state    semap.track_state;
  v_before   semap.track_state;
  v_aside    semap.track_state;
  v_lives    boolean;
  v_passes   boolean;
begin
  outliers := 0;
  for v_update in select * from unnest(p_updates) a order by (a.state).track_id, (a.state).stamp loop
    v_state := v_update.state;
    if v_before.track_id is distinct from v_state.track_id then
      if v_before.track_id is not null then
        v_aside.track_id := v_before.track_id;
        asides := asides || v_aside;
      end if;
      v_lives := v_update.live;
      v_before := semap.new_state(v_state.track_id, v_update.seen_stamp, v_update.from_x_m, v_update.from_y_m);
      v_before.z_m := v_update.from_z_m;
      v_aside := null;
      select * into v_aside from unnest(p_asides) where track_id = v_state.track_id;
    end if;
    -- where nobody knows where it was, it may come from anywhere
    v_passes := case when v_lives and v_before.x_m is not null then semap.can_follow(
      p_source, v_state.stamp - v_before.stamp, v_state.x_m - v_before.x_m, v_state.y_m - v_before.y_m) else true end;
    if v_aside.stamp < v_state.stamp then
      if not v_passes and semap.can_follow(p_source, v_state.stamp - v_aside.stamp,
                                           v_state.x_m - v_aside.x_m, v_state.y_m - v_aside.y_m) then
        v_passes := true;
      else
        outliers := outliers + 1;
      end if;
      v_aside := null;
    end if;
    if not v_passes and v_state.is_last then
      outliers := outliers + 1;
      v_state.x_m := v_before.x_m;
      v_state.y_m := v_before.y_m;
      v_state.z_m := v_before.z_m;
      v_passes := true;
    end if;
    if v_passes then
      v_update.state := v_state;
      passed := passed || v_update;
      v_before := v_state;
      v_lives := not v_state.is_last;
    else
      v_aside := v_state;
    end if;
  end loop;
  v_aside.track_id := v_before.track_id;
  asides := asides || v_aside;
end $$;

-- The states of these that pass the gate for outliers. What is set aside is kept with its track, which is looked up at
-- its next state.
create or replace function semap.gated(p_source semap.source, p_updates semap.state_update[])
returns semap.state_update[]
language plpgsql as $$
declare
  v_gate  record;
begin
  select * into v_gate from semap.gate(p_source, p_updates, array(
    select semap.new_state(track_id, outlier_stamp, outlier_x_m, outlier_y_m) from semap.track_now
    where outlier_stamp is not null and track_id in (select track_id from semap.states_of(p_updates))));
  perform semap.set_aside(track_id, a) from unnest(v_gate.asides) a;
  if v_gate.outliers > 0 then
    update semap.source set outliers = outliers + v_gate.outliers where source_id = (p_source).source_id;
  end if;
  return v_gate.passed;
end $$;
