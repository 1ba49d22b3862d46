-- How a door stands follows from the angles at which its leaf is seen, in the order of their stamps, by a state
-- machine:
--
--   closed   -> opening   above opening_above
--   opening  -> open      from open_from on, or where the leaf rests
--   opening  -> closing   fell by turns_by below the largest angle, or below closed_below
--   open     -> closing   likewise
--   closing  -> closed    below closed_below, also where the leaf rests there
--   closing  -> opening   rose by turns_by above the smallest angle
--   closing  -> open      where the leaf rests above opening_above
--
-- A change wants two observations in a row that are beyond its threshold by a standard deviation, or one that is by
-- three and could have been reached at 200 degrees a second from the one before, at most 0.15 s ago: so neither noise
-- nor what looks like a leaf once makes one. It has the stamp of the observation that shows it. The leaf rests where it
-- has not gone from an angle by rests_within, or by three standard deviations, for rests_for. The first observation
-- gives the first state. A door that is not seen keeps its state. There is no clock: the same observations give the
-- same states, cut into any batches between scans.

-- The state that an angle asks for beside the present one, with how far beyond its threshold it is; null where none.
create or replace function semap.door_next(
  p_now semap.door_now, p_leaf semap.door_leaf, p_angle_rad double precision,
  out state text, out beyond_rad double precision
) language plpgsql immutable parallel safe as $$
begin
  beyond_rad := case p_now.state
                  when 'closed' then p_angle_rad - p_leaf.opening_above_rad
                  when 'closing' then p_leaf.closed_below_rad - p_angle_rad
                  else greatest(p_now.extreme_rad - p_leaf.turns_by_rad, p_leaf.closed_below_rad) - p_angle_rad end;
  if beyond_rad > 0 then
    state := case p_now.state when 'closed' then 'opening' when 'closing' then 'closed' else 'closing' end;
  elsif p_now.state = 'opening' and p_angle_rad > p_leaf.open_from_rad then
    state := 'open';
    beyond_rad := p_angle_rad - p_leaf.open_from_rad;
  elsif p_now.state = 'closing' and p_angle_rad > p_now.extreme_rad + p_leaf.turns_by_rad then
    state := 'opening';
    beyond_rad := p_angle_rad - p_now.extreme_rad - p_leaf.turns_by_rad;
  end if;
end $$;

-- One observation of a leaf: the door as it stands after it.
create or replace function semap.door_step(
  p_now semap.door_now, p_before semap.door_now, p_leaf semap.door_leaf,
  p_stamp timestamptz, p_angle_rad double precision, p_std_rad double precision
) returns semap.door_now
language plpgsql immutable parallel safe as $$
declare
  v_now      semap.door_now := case when p_now.instance_id is null then p_before else p_now end;
  v_asked    record;
  v_next     text;
  v_since_s  double precision;
  v_is_sure  boolean;
begin
  if v_now.state is null then
    v_now.state := case when p_angle_rad > p_leaf.opening_above_rad then 'open' else 'closed' end;
    v_now.since := p_stamp;
    v_now.extreme_rad := p_angle_rad;
    v_now.rest_rad := p_angle_rad;
    v_now.rest_since := p_stamp;
  else
    -- of two observations the less extreme: one alone is no extreme
    if v_now.state = 'closing' then
      v_now.extreme_rad := least(v_now.extreme_rad, greatest(p_angle_rad, v_now.angle_rad));
    elsif v_now.state <> 'closed' then
      v_now.extreme_rad := greatest(v_now.extreme_rad, least(p_angle_rad, v_now.angle_rad));
    end if;
    if abs(p_angle_rad - v_now.rest_rad) > greatest(p_leaf.rests_within_rad, 3 * p_std_rad) then
      v_now.rest_rad := p_angle_rad;
      v_now.rest_since := p_stamp;
    end if;
    v_asked := semap.door_next(v_now, p_leaf, p_angle_rad);
    v_next := case when v_asked.beyond_rad > p_std_rad then v_asked.state end;
    v_since_s := extract(epoch from p_stamp - v_now.stamp);
    v_is_sure := v_asked.beyond_rad > 3 * p_std_rad and v_since_s <= 0.15
                 and abs(p_angle_rad - v_now.angle_rad) <= radians(200) * v_since_s + p_std_rad;
    if v_next is not null and not v_is_sure and v_next is distinct from v_now.doubt then
      v_now.doubt := v_next;
      v_next := null;
    elsif v_next is null then
      v_now.doubt := null;
    end if;
    if v_next is null and v_now.state in ('opening', 'closing') and p_stamp - v_now.rest_since >= p_leaf.rests_for then
      v_next := case when p_angle_rad > p_leaf.opening_above_rad then 'open'
                     when p_angle_rad < p_leaf.closed_below_rad and v_now.state = 'closing' then 'closed' end;
    end if;
    if v_next is not null then
      if not (v_now.state = 'opening' and v_next = 'open') then
        v_now.extreme_rad := p_angle_rad;
      end if;
      v_now.state := v_next;
      v_now.since := p_stamp;
      v_now.doubt := null;
    end if;
  end if;
  v_now.stamp := p_stamp;
  v_now.angle_rad := p_angle_rad;
  v_now.angle_std_rad := p_std_rad;
  return v_now;
end $$;

-- The door as it stands after each of its observations, from how it stood before them.
create or replace aggregate semap.door_course(
  p_before semap.door_now, p_leaf semap.door_leaf, p_stamp timestamptz, p_angle_rad double precision,
  p_std_rad double precision
) (sfunc = semap.door_step, stype = semap.door_now, parallel = safe);

-- Let one writer at a time touch the doors of a map, until the transaction ends: several sources may see one door.
create or replace function semap.hold_doors(p_map_id integer) returns void
language sql as $$ select pg_advisory_xact_lock(7367, p_map_id) $$;

-- Write what changed, as states of objects, in the order in which it was seen.
create or replace function semap.record_doors(p_source_id integer, p_doors semap.door_now[]) returns void
language sql as $$
  insert into semap.object_state (source_id, instance_id, property, value, stamp, attributes)
  select p_source_id, d.instance_id, 'door', d.state, d.stamp,
         jsonb_build_object('angle_deg', round(degrees(d.angle_rad)::numeric, 1),
                            'angle_std_deg', round(degrees(d.angle_std_rad)::numeric, 2))
  from unnest(p_doors) d
  order by d.stamp, d.instance_id
  on conflict (uid) do nothing
$$;

-- Count lines of a source that come, and hold its map's doors, until the transaction ends: which map that is.
create or replace function semap.begin_lines(p_source_id integer, p_newest timestamptz, p_lines bigint) returns integer
language plpgsql as $$
declare
  v_map_id  integer;
begin
  perform semap.lock_regions_shared();
  perform semap.lock_source(p_source_id);
  select map_id into v_map_id from semap.source where source_id = p_source_id;
  if not found then
    raise exception 'There is no source %.', p_source_id
      using errcode = 'foreign_key_violation', hint = 'Insert the source into semap.source first.';
  end if;
  perform semap.count_received(p_source_id, p_newest, p_lines => p_lines);
  perform semap.hold_doors(v_map_id);
  return v_map_id;
end $$;

-- New lines move the doors whose leaves they are. Of several that may be one leaf in one scan, the longest is. Lines at
-- or before the present of their door change nothing: they are kept and counted as late.
create or replace function semap.lines_arrived() returns trigger
language plpgsql security definer
set search_path = public, pg_temp set plan_cache_mode = force_generic_plan set enable_mergejoin = off as $$
declare
  v_source_id   integer;
  v_is_foreign  boolean;
  v_lines       bigint;
  v_newest      timestamptz;
  v_map_id      integer;
  v_late        bigint;
  v_changed     semap.door_now[];
begin
  select min(source_id), min(source_id) <> max(source_id), count(*), max(stamp)
  into v_source_id, v_is_foreign, v_lines, v_newest
  from new_line;
  if v_source_id is null then
    return null;
  end if;
  if v_is_foreign then
    raise exception 'The lines of one statement come from more than one source.'
      using errcode = 'cardinality_violation', hint = 'Insert or copy the lines of each source by themselves.';
  end if;
  v_map_id := semap.begin_lines(v_source_id, v_newest, v_lines);
  with seen as materialized (
    select distinct on (e.instance_id, n.stamp) e.instance_id, n.stamp, e.angle_rad, e.angle_std_rad
    from new_line n
    cross join lateral semap.leaves_seen(v_map_id, n.x1_m, n.y1_m, n.x2_m, n.y2_m, n.z_m, n.angle_std_rad,
                                         n.offset_std_m) e
    order by e.instance_id, n.stamp, e.length_m desc, e.miss_m, e.angle_rad
  ), stepped as materialized (
    select s.instance_id, s.stamp, d.state as present_state,
           semap.door_course(d, l, s.stamp, s.angle_rad, s.angle_std_rad) over one_door as now,
           lead(s.stamp) over one_door is null as is_present
    from seen s
    join semap.door_now d on d.instance_id = s.instance_id and s.stamp > d.stamp
    join semap.door_leaf l on l.instance_id = s.instance_id
    window one_door as (partition by s.instance_id order by s.stamp)
  ), compared as (
    select now, lag((now).state, 1, present_state) over (partition by instance_id order by stamp) as before_state
    from stepped
  ), moved as (
    update semap.door_now d
    set stamp = (n.now).stamp, state = (n.now).state, since = (n.now).since,
        angle_rad = (n.now).angle_rad, angle_std_rad = (n.now).angle_std_rad, extreme_rad = (n.now).extreme_rad,
        rest_rad = (n.now).rest_rad, rest_since = (n.now).rest_since, doubt = (n.now).doubt
    from stepped n
    where n.is_present and d.instance_id = n.instance_id
  )
  select (select count(*) from seen) - (select count(*) from stepped),
         (select array_agg(now) from compared where (now).state is distinct from before_state)
  into v_late, v_changed;
  if v_changed is not null then
    perform semap.record_doors(v_source_id, v_changed);
  end if;
  if v_late > 0 then
    update semap.source set late_states = late_states + v_late where source_id = v_source_id;
  end if;
  return null;
end $$;

create or replace trigger lines_arrived after insert on semap.line_observation
  referencing new table as new_line for each statement execute function semap.lines_arrived();

-- With a source go the lines that it saw: of a table of many days, only the pages that its index names are read.
create or replace function semap.lines_forgotten() returns trigger
language plpgsql security definer set search_path = public, pg_temp set enable_seqscan = off as $$
declare
  v_source_ids  integer[] := array(select source_id from old_source);
begin
  if v_source_ids <> '{}' then
    lock table semap.state_chunk, semap.line_observation in row exclusive mode; -- in the order of ensure_partitions
    delete from semap.line_observation where source_id = any (v_source_ids);
  end if;
  return null;
end $$;

create or replace trigger lines_forgotten after delete on semap.source
  referencing old table as old_source for each statement execute function semap.lines_forgotten();
