-- Regions that have to be followed carefully: what is not containment in an outline, boundaries with a margin or a time
-- to confirm, probabilities, ways between samples, or subjects that are chosen.
--
-- For each track near the boundary of such a region the state of the relation (sql/112) is remembered while its signals
-- differ. One whose signals agree is settled: of that nothing is remembered but whether it holds.

-- Where a point stands to a region: inside of its boundary, deep enough inside to enter, far enough outside to leave. A
-- place that is too uncertain (more than widest_std_m, along the longer axis of its error ellipse) is evidence of
-- nothing: neither. A stateless region has no shape but its footprint.
create or replace function semap.stands(
  p_region semap.region, p_x_m double precision, p_y_m double precision, p_z_m double precision, p_std_m real,
  p_std_across_m real default null, p_std_yaw_rad real default null
) returns table (raw boolean, enters boolean, leaves boolean)
language sql immutable parallel safe as $$
  select b.raw,
         b.raw and (p_region.enter_area is null or public.st_contains(p_region.enter_area, b.point))
           and (d.depth_m >= p_region.enter_stds * coalesce(p_std_m, 0)) is not false and not d.is_vague,
         (not b.at_height
          or not b.raw and (p_region.leave_area is null or not public.st_contains(p_region.leave_area, b.point))
             and (d.depth_m >= p_region.leave_stds * coalesce(p_std_m, 0)) is not false and not d.is_vague)
  from (select h.point, h.at_height, h.at_height and case p_region.test
                 when 'covers' then public.st_covers(p_region.shape, h.point)
                 when 'dwithin' then public.st_dwithin(p_region.shape, h.point, p_region.distance_m)
                 else public.st_contains(coalesce(p_region.shape, p_region.footprint), h.point) end as raw
        from (select public.st_point(p_x_m, p_y_m) as point,
                     p_z_m is null or (p_z_m >= p_region.z_min_m and p_z_m < p_region.z_max_m) as at_height offset 0) h
        offset 0) b
  cross join lateral (
    select case when p_region.enter_stds is null then null
                when p_std_across_m < p_std_m then semap.stretched_distance_m(
                  public.st_boundary(p_region.footprint), p_x_m, p_y_m, p_std_m, p_std_across_m, p_std_yaw_rad)
                else public.st_distance(public.st_boundary(p_region.footprint), b.point) end as depth_m,
           (p_region.enter_stds is not null and p_std_m > p_region.widest_std_m) is true as is_vague offset 0) d
$$;

-- Where a straight way from one place to another meets the boundaries of a region: parts of the way in [0, 1),
-- ascending, from each of which on to the next it stays on one side of all of them. Nothing where it meets none.
create or replace function semap.parts_of_way(
  p_region semap.region, p_x1_m double precision, p_y1_m double precision, p_z1_m double precision,
  p_x2_m double precision, p_y2_m double precision, p_z2_m double precision
) returns double precision[]
language plpgsql immutable parallel safe as $$ -- which keeps its plan
declare
  v_way    constant public.geometry := public.st_makeline(public.st_point(p_x1_m, p_y1_m),
                                                          public.st_point(p_x2_m, p_y2_m));
  v_shape  public.geometry;
  v_parts  double precision[];
begin
  if p_x1_m <> p_x2_m or p_y1_m <> p_y2_m then
    foreach v_shape in array array[p_region.footprint, p_region.enter_area, p_region.leave_area] loop
      if v_way operator(public.&&) v_shape and public.st_intersects(public.st_boundary(v_shape), v_way) then
        v_parts := v_parts || array(
          select public.st_linelocatepoint(v_way, d.geom)
          from public.st_dumppoints(public.st_intersection(public.st_boundary(v_shape), v_way)) d);
      end if;
    end loop;
  end if;
  if p_z1_m <> p_z2_m then
    v_parts := v_parts || array(
      select (z_m - p_z1_m) / (p_z2_m - p_z1_m) from unnest(array[p_region.z_min_m, p_region.z_max_m]) z_m
      where z_m between least(p_z1_m, p_z2_m) and greatest(p_z1_m, p_z2_m));
  end if;
  if v_parts is null or v_parts = '{}' then
    return null;
  end if;
  return array(select distinct part from unnest(0.0::double precision || v_parts) part where part < 1 order by part);
end $$;

-- What these tracks are to each stateful region that their states may concern: one that a track comes into the box of,
-- is in, or remembers.
create or replace function semap.known_relations(p_updates semap.state_update[]) returns semap.relation_state[]
language plpgsql stable as $$ -- which keeps its plan
begin
  return (
    with state_update as (
      select s.*, a.map_id, lag(s.x_m, 1, a.from_x_m) over one_track as before_x_m,
             lag(s.y_m, 1, a.from_y_m) over one_track as before_y_m
      from unnest(p_updates) a cross join lateral (select (a.state).*) s
      window one_track as (partition by s.track_id order by s.stamp)
    ), track as (
      select a.track_id, a.map_id, n.stateful_ids,
             public.st_expand(public.st_makeenvelope(
               least(min(a.x_m), min(a.before_x_m)), least(min(a.y_m), min(a.before_y_m)),
               greatest(max(a.x_m), max(a.before_x_m)), greatest(max(a.y_m), max(a.before_y_m))), 0.001) as extent
      from state_update a join semap.track_now n using (track_id)
      group by a.track_id, a.map_id, n.stateful_ids
    ), concerned as (
      select t.track_id, r.query_id, r.instance_id from track t join semap.region r
        on r.stateful and r.map_id = t.map_id and r.footprint && t.extent
      union
      select t.track_id, r.query_id, r.instance_id
      from track t cross join unnest(t.stateful_ids) region_id join semap.region r using (region_id)
      union
      select n.track_id, n.query_id, n.instance_id from track t join semap.relation n using (track_id)
      where not n.in_pairs and (n.raw <> n.pending or n.pending <> n.confirmed)
    )
    select array_agg(case when n.query_id is not null then semap.state_of_relation(n)
                          else semap.relation_since(c.query_id, c.track_id, -c.instance_id, false, null) end)
    from concerned c
    left join semap.relation n
      on n.query_id = c.query_id and n.subject_key = c.track_id and n.object_key = -c.instance_id
    where not semap.reads_amended(c.query_id, c.track_id));
end $$;

-- Each step of these tracks beside each of these regions: the parts of the way to each state, where the region asks for
-- them and they are neither too long nor too fast, and (part null) the state itself. What is kept of a track beside a
-- region was so when its side changed last, and steps before that are none.
create or replace function semap.steps(p_updates semap.state_update[], p_kept semap.relation_state[])
returns table (
  track_id bigint, region_id integer, before semap.relation_state, enter_confirm interval, leave_confirm interval,
  known_at timestamptz, at timestamptz, x_m double precision, y_m double precision,
  raw boolean, enters boolean, leaves boolean, part double precision, has_parts boolean, appears boolean,
  is_last boolean,
  seen semap.observation
)
language sql stable as $$
  with state_update as (
    select s.*, lag(s.stamp, 1, a.seen_stamp) over one_track as before_stamp,
           lag(s.x_m, 1, a.from_x_m) over one_track as before_x_m,
           lag(s.y_m, 1, a.from_y_m) over one_track as before_y_m,
           lag(s.z_m, 1, a.from_z_m) over one_track as before_z_m,
           lag(s.is_last, 1, not a.live) over one_track as appears
    from unnest(p_updates) a cross join lateral (select (a.state).*) s
    window one_track as (partition by s.track_id order by s.stamp)
  )
  select a.track_id, r.region_id, c, r.enter_confirm, r.leave_confirm, a.stamp, w.at, w.x_m, w.y_m,
         s.raw, s.enters, s.leaves, w.part, p.parts is not null, a.appears, a.is_last,
         row(w.at, w.x_m, w.y_m, s.raw, s.enters, s.leaves, a.appears, null)::semap.observation
  from unnest(p_kept) c
  join semap.region r on r.query_id = c.query_id and r.instance_id = -c.object_key
  join state_update a on a.track_id = c.subject_key and (c.raw_at is null or a.stamp > c.raw_at)
  cross join lateral (
    select case
      when r.longest_gap is null or a.appears or a.stamp > a.before_stamp + r.longest_gap
        or sqrt((a.x_m - a.before_x_m) ^ 2 + (a.y_m - a.before_y_m) ^ 2)
           > r.fastest_mps * extract(epoch from a.stamp - a.before_stamp) then null
      else semap.parts_of_way(r, a.before_x_m, a.before_y_m, a.before_z_m, a.x_m, a.y_m, a.z_m) end as parts offset 0) p
  cross join lateral (
    select a.before_stamp + make_interval(secs => part * extract(epoch from a.stamp - a.before_stamp)) as at, part,
           a.before_x_m + part * (a.x_m - a.before_x_m) as x_m, a.before_y_m + part * (a.y_m - a.before_y_m) as y_m,
           a.before_x_m + middle * (a.x_m - a.before_x_m) as on_x_m,
           a.before_y_m + middle * (a.y_m - a.before_y_m) as on_y_m,
           a.before_z_m + middle * (a.z_m - a.before_z_m) as on_z_m
    from (select part, (part + coalesce(lead(part) over (order by part), 1)) / 2 as middle from unnest(p.parts) part) u
    union all
    select a.stamp, null, a.x_m, a.y_m, a.x_m, a.y_m, a.z_m) w
  cross join lateral semap.stands(r, w.on_x_m, w.on_y_m, w.on_z_m, a.std_m, a.std_across_m, a.std_yaw_rad) s
  where r.subject is null
     or exists (select from semap.query_track q where q.query_id = r.query_id and q.track_id = a.track_id
                and not q.is_object)
$$;

-- What a relation that changed says: the moment and the place at which the boundary was crossed last, where that was in
-- the same direction; else those at which the debounced state changed.
create or replace function semap.transition(
  p_state semap.relation_state, p_region_id integer, p_known_at timestamptz
) returns semap.crossing
language sql immutable parallel safe as $$
  select row(p_state.subject_key, p_region_id, case when p_state.confirmed then 'began' else 'ended' end,
             'moved',
             p_known_at, semap.transition_time(p_state), p_state.x_m, p_state.y_m)::semap.crossing
$$;

-- Keep how tracks stand to stateful regions after these steps; what began and ended by them is written after it.
create or replace function semap.keep_relations(p_map_id integer, p_kept semap.relation_state[]) returns void
language plpgsql as $$ -- which keeps its plan
begin
  with gone as (
    delete from semap.relation n using unnest(p_kept) k
    where n.query_id = k.query_id and n.subject_key = k.subject_key and n.object_key = k.object_key
      and not n.confirmed and not k.confirmed and not k.pending and not k.raw
  )
  insert into semap.relation as n (query_id, map_id, track_id, instance_id, confirmed, since, pending, pending_at, raw,
                                   raw_at, x_m, y_m)
  select k.query_id, p_map_id, k.subject_key, -k.object_key, coalesce(o.confirmed, false), o.since,
         k.pending, case when d.differ then k.pending_at end, k.raw, case when d.differ then k.raw_at end,
         case when d.differ then k.x_m end, case when d.differ then k.y_m end
  from unnest(p_kept) k
  cross join lateral (select k.confirmed <> k.pending or k.pending <> k.raw as differ) d
  left join semap.relation o
    on o.query_id = k.query_id and o.subject_key = k.subject_key and o.object_key = k.object_key
  where d.differ or o.confirmed or k.confirmed and o.query_id is not null
  on conflict (query_id, subject_key, object_key) do update
  set pending = excluded.pending, pending_at = excluded.pending_at, raw = excluded.raw, raw_at = excluded.raw_at,
      x_m = excluded.x_m, y_m = excluded.y_m
  where (n.pending, n.pending_at, n.raw, n.raw_at, n.x_m, n.y_m) is distinct from
        (excluded.pending, excluded.pending_at, excluded.raw, excluded.raw_at, excluded.x_m, excluded.y_m);
end $$;

-- Note in which stateful regions tracks are, and when a relation of theirs is due if nothing else happens.
create or replace function semap.note_held(p_kept semap.relation_state[], p_track_ids bigint[]) returns void
language plpgsql as $$ -- which keeps its plan
begin
  update semap.track_now t
  set stateful_ids = coalesce(n.region_ids, '{}'),
      safe_until = case when t.outlier_stamp is null then coalesce(n.due, 'infinity') else '-infinity' end
  from unnest(p_track_ids) k (track_id)
  left join (
    select v.subject_key as track_id, array_agg(r.region_id order by r.region_id) filter (where v.confirmed)
             as region_ids,
           min(v.pending_at + case when v.pending then r.enter_confirm else r.leave_confirm end)
             filter (where v.confirmed <> v.pending) as due
    from unnest(p_kept) v join semap.region r on r.query_id = v.query_id and r.instance_id = -v.object_key
    group by v.subject_key) n using (track_id)
  where t.track_id = k.track_id;
end $$;

-- Follow tracks through these states beside these regions: what of them is to be kept then, and what began and ended.
-- It writes nothing.
create or replace function semap.follow_steps(
  p_updates semap.state_update[], p_kept semap.relation_state[],
  out kept semap.relation_state[], out crossings semap.crossing[]
)
language plpgsql stable as $$
declare
  v_step       record;
  v_state      semap.relation_state;
  v_before     semap.relation_state;
  v_region_id  integer;
begin
  for v_step in
    select * from semap.steps(p_updates, p_kept) s order by s.track_id, s.region_id, s.known_at, s.part nulls last
  loop
    if (v_state.subject_key, v_region_id) is distinct from (v_step.track_id, v_step.region_id) then
      if v_state.subject_key is not null then
        kept := kept || v_state;
      end if;
      v_state := v_step.before;
      v_region_id := v_step.region_id;
    end if;

    if v_step.x_m is null then
      null; -- the track was said to have ended, and nobody saw it
    elsif v_step.appears then
      v_state := semap.debounce(v_state, v_step.seen, v_step.enter_confirm, v_step.leave_confirm);
      if v_state.confirmed then
        crossings := crossings || row(v_step.track_id, v_step.region_id, 'began', 'appeared', v_step.known_at,
                                          v_step.known_at, v_step.x_m, v_step.y_m)::semap.crossing;
      end if;
    else
      -- what is known all the way may have lasted long enough before this step
      if v_step.has_parts and v_state.pending <> v_state.confirmed then
        v_before := v_state;
        v_state := semap.debounce(v_state, semap.time_passed(v_step.at), v_step.enter_confirm, v_step.leave_confirm);
        if v_state.confirmed <> v_before.confirmed then
          crossings := crossings || semap.transition(v_state, v_region_id, v_step.known_at);
        end if;
      end if;
      v_before := v_state;
      v_state := semap.debounce(v_state, v_step.seen, v_step.enter_confirm, v_step.leave_confirm);
      if v_state.confirmed <> v_before.confirmed then
        crossings := crossings || semap.transition(v_state, v_region_id, v_step.known_at);
      end if;
    end if;

    if v_step.is_last and v_step.part is null then
      if v_state.confirmed then
        crossings := crossings || row(v_step.track_id, v_step.region_id, 'ended', 'disappeared', v_step.known_at,
                                          v_step.known_at, v_step.x_m, v_step.y_m)::semap.crossing;
      end if;
      v_state.confirmed := false;
      v_state.pending := false;
      v_state.raw := false;
    end if;
  end loop;
  if v_state.subject_key is not null then
    kept := kept || v_state;
  end if;
end $$;

-- Follow tracks through these states in their relations to all stateful regions, and give what began and ended by it.
create or replace function semap.follow_stateful(p_updates semap.state_update[]) returns semap.crossing[]
language plpgsql as $$
declare
  v_map_id     constant integer := p_updates[1].map_id;
  v_kept       semap.relation_state[];
  v_crossings  semap.crossing[];
begin
  if p_updates is null then
    return null;
  end if;
  select f.kept, f.crossings into v_kept, v_crossings
  from semap.follow_steps(p_updates, semap.known_relations(p_updates)) f;
  perform semap.keep_relations(v_map_id, v_kept);
  perform semap.note_held(v_kept, array(select distinct track_id from semap.states_of(p_updates)));
  return v_crossings;
end $$;
