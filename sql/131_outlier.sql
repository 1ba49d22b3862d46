-- The gate for outliers. A place that asks for a longer way than `jump_m` and `jump_mps` of its source allow since the
-- last one is set aside: it moves nothing. If the next state fits to it rather than to what was before, the track did
-- jump, and is there from that state on; if not, it was an outlier, and is counted.

-- Whether one place can follow on another, some time later.
create or replace function semap.can_follow(
  p_source semap.source, p_gap interval, p_dx_m double precision, p_dy_m double precision
) returns boolean
language sql immutable parallel safe as $$
  select sqrt(p_dx_m ^ 2 + p_dy_m ^ 2) <= (p_source).jump_m + (p_source).jump_mps * extract(epoch from p_gap)
$$;

-- Whether the gate has to look at these states, since a step of a track is more than half as long as a jump: where it
-- was may be known only to within its calm.
create or replace function semap.any_far_step(p_source semap.source, p_arrivals semap.arrival[]) returns boolean
language plpgsql immutable parallel safe as $$ -- which keeps its plan
begin
  return exists (
    select from (
      select x_m - lag(x_m, 1, case when live then from_x_m end) over one_track as dx_m,
             y_m - lag(y_m, 1, case when live then from_y_m end) over one_track as dy_m
      from unnest(p_arrivals) window one_track as (partition by track_id order by stamp)) step
    where dx_m ^ 2 + dy_m ^ 2 > ((p_source).jump_m / 2) ^ 2);
end $$;

-- Keep with a track what was set aside of it, or that nothing is. It is looked up at its next state.
create or replace function semap.set_aside(p_track_id bigint, p_state semap.arrival) returns void
language sql as $$
  update semap.track_now
  set outlier_stamp = (p_state).stamp, outlier_x_m = (p_state).x_m, outlier_y_m = (p_state).y_m,
      calm_until = case when (p_state).stamp is null then 'infinity' else '-infinity' end::timestamptz
  where track_id = p_track_id and (outlier_stamp is not null or (p_state).stamp is not null)
$$;

-- Lead states through the gate for outliers, and write nothing: those that pass, what is set aside at the end of each
-- track (a stamp that is null: nothing), and how many were outliers. A track whose last state does not pass ends where
-- it was. p_asides: what was set aside of tracks before.
create or replace function semap.gate(
  p_source semap.source, p_arrivals semap.arrival[], p_asides semap.arrival[],
  out passed semap.arrival[], out asides semap.arrival[], out outliers bigint
)
language plpgsql immutable as $$
declare
  v_state   semap.arrival;
  v_before  semap.arrival;
  v_aside   semap.arrival;
  v_passes  boolean;
begin
  outliers := 0;
  for v_state in select * from unnest(p_arrivals) order by track_id, stamp loop
    if v_before.track_id is distinct from v_state.track_id then
      if v_before.track_id is not null then
        v_aside.track_id := v_before.track_id;
        asides := asides || v_aside;
      end if;
      v_before := v_state;
      v_before.stamp := v_state.seen_stamp;
      v_before.x_m := v_state.from_x_m;
      v_before.y_m := v_state.from_y_m;
      v_before.z_m := v_state.from_z_m;
      v_aside := null;
      select * into v_aside from unnest(p_asides) where track_id = v_state.track_id;
    end if;
    -- where nobody knows where it was, it may come from anywhere
    v_passes := case when v_before.live and v_before.x_m is not null then semap.can_follow(
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
      passed := passed || v_state;
      v_before := v_state;
      v_before.live := not v_state.is_last;
    else
      v_aside := v_state;
    end if;
  end loop;
  v_aside.track_id := v_before.track_id;
  asides := asides || v_aside;
end $$;

-- The states of these that pass the gate for outliers. What is set aside is kept with its track, which is looked up at
-- its next state.
create or replace function semap.gated(p_source semap.source, p_arrivals semap.arrival[]) returns semap.arrival[]
language plpgsql as $$
declare
  v_gate  record;
begin
  select * into v_gate from semap.gate(p_source, p_arrivals, array(
    select row(track_id, outlier_stamp, outlier_x_m, outlier_y_m, null, null, null, null, null, null, null, null, null,
               null,
               null, null, null, null, null, null, null, null, null)::semap.arrival
    from semap.track_now
    where outlier_stamp is not null and track_id in (select track_id from unnest(p_arrivals))));
  perform semap.set_aside(track_id, a) from unnest(v_gate.asides) a;
  if v_gate.outliers > 0 then
    update semap.source set outliers = outliers + v_gate.outliers where source_id = (p_source).source_id;
  end if;
  return v_gate.passed;
end $$;
