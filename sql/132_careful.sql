-- Regions that have to be followed carefully: other predicates than `contains`, boundaries with a margin or a time to
-- confirm, probabilities, ways between samples, or subjects that are chosen.
--
-- For each track near the boundary of such a region a *verge* is kept, with three sides that may differ for a while:
-- `side` is that of the boundary itself; `inside` changes only once the track is deep enough inside or far enough
-- outside, and in between stays what it was; `held` is the relation, which follows `inside` once that has lasted. A
-- track that is no longer between has no verge. A track that appears is where the boundary says at once.

-- Where a point stands to a region: inside of its boundary, deep enough inside to enter, far enough outside to leave. A
-- place that is too uncertain (more than widest_std_m) is evidence of nothing: neither.
create or replace function semap.stands(
  p_region semap.region, p_x_m double precision, p_y_m double precision, p_z_m double precision, p_std_m real,
  out side boolean, out enters boolean, out leaves boolean
) language plpgsql immutable parallel safe as $$
declare
  v_point      public.geometry := public.st_point(p_x_m, p_y_m);
  v_at_height  boolean := p_z_m is null or (p_z_m >= p_region.z_min_m and p_z_m < p_region.z_max_m);
  v_depth_m    double precision;
begin
  side := v_at_height and case p_region.predicate
    when 'covers' then public.st_covers(p_region.shape, v_point)
    when 'within_distance' then public.st_dwithin(p_region.shape, v_point, p_region.distance_m)
    else public.st_contains(p_region.shape, v_point) end;
  enters := side and (p_region.core is null or public.st_contains(p_region.core, v_point));
  leaves := not v_at_height
            or (not side and (p_region.reach is null or not public.st_contains(p_region.reach, v_point)));
  if p_region.enter_stds is not null and v_at_height then
    if p_std_m > p_region.widest_std_m then
      enters := false;
      leaves := false;
    elsif enters or leaves then
      v_depth_m := public.st_distance(public.st_boundary(p_region.footprint), v_point);
      enters := enters and v_depth_m >= p_region.enter_stds * coalesce(p_std_m, 0);
      leaves := leaves and v_depth_m >= p_region.leave_stds * coalesce(p_std_m, 0);
    end if;
  end if;
end $$;
comment on function semap.stands is
  'Where a point stands to a region: inside of its boundary, deep enough to enter, far enough outside to leave.';

-- Where a straight way from one place to another meets the boundaries of a region: parts of the way in [0, 1), ascending,
-- from each of which on to the next it stays on one side of all of them. Nothing where it meets none.
create or replace function semap.parts_of_way(
  p_region semap.region, p_x1_m double precision, p_y1_m double precision, p_z1_m double precision,
  p_x2_m double precision, p_y2_m double precision, p_z2_m double precision
) returns double precision[]
language sql immutable parallel safe as $$
  with way as (
    select public.st_makeline(public.st_point(p_x1_m, p_y1_m), public.st_point(p_x2_m, p_y2_m)) as line
  ), met as (
    select public.st_linelocatepoint(line, (public.st_dumppoints(
             public.st_intersection(public.st_boundary(shape), line))).geom) as part
    from way, unnest(array[p_region.footprint, p_region.core, p_region.reach]) shape
    where public.st_length(line) > 0 and public.st_intersects(public.st_boundary(shape), line)
    union
    select (z_m - p_z1_m) / (p_z2_m - p_z1_m)
    from unnest(array[p_region.z_min_m, p_region.z_max_m]) z_m
    where p_z1_m <> p_z2_m and z_m between least(p_z1_m, p_z2_m) and greatest(p_z1_m, p_z2_m)
  )
  select case when count(*) > 0 then array_agg(part order by part) end
  from (select 0.0::double precision as part where exists (select from met)
        union select part from met where part < 1) p
$$;
comment on function semap.parts_of_way is
  'Where a straight way from one place to another meets the boundaries of a region, as parts of the way in [0, 1).';

-- Let one track go on to one place at a moment, and tell whether its relation to the
-- region changed by that.
create or replace function semap.tread(
  inout p_verge semap.verge, p_region semap.region, p_at timestamptz, p_x_m double precision, p_y_m double precision,
  p_side boolean, p_enters boolean, p_leaves boolean, out changed boolean
) language plpgsql immutable as $$
begin
  if p_side <> p_verge.side then
    p_verge.side := p_side;
    p_verge.side_at := p_at;
    p_verge.x_m := p_x_m;
    p_verge.y_m := p_y_m;
  end if;
  if (p_enters and not p_verge.inside) or (p_leaves and p_verge.inside) then
    p_verge.inside := p_enters;
    p_verge.inside_at := p_at;
  end if;
  changed := p_verge.inside <> p_verge.held
    and p_at >= p_verge.inside_at + case when p_verge.inside then p_region.enter_confirm else p_region.leave_confirm end;
  if changed then
    p_verge.held := p_verge.inside;
  end if;
end $$;
comment on function semap.tread is
  'Let one track go on to one place at a moment, and tell whether its relation to the region changed by that.';

-- What a relation that changed says: the moment and the place at which the boundary was crossed last, where that was in
-- the same direction; else those at which the debounced state changed.
create or replace function semap.verge_crossing(p_verge semap.verge, p_state semap.arrival) returns semap.crossing
language sql immutable parallel safe as $$
  select row(p_state.track_id, (p_verge).region_id, case when (p_verge).held then 'began' else 'ended' end, 'moved',
             p_state.stamp, case when (p_verge).side = (p_verge).held then coalesce((p_verge).side_at, (p_verge).inside_at)
                                 else (p_verge).inside_at end,
             (p_verge).x_m, (p_verge).y_m)::semap.crossing
$$;
comment on function semap.verge_crossing is
  'What a relation that changed says: the moment and the place at which the boundary was crossed.';

-- A track that is inside in all ways, or in none.
create or replace function semap.verge_at_rest(p_track_id bigint, p_region semap.region, p_side boolean) returns semap.verge
language sql immutable parallel safe as $$
  select row(p_track_id, (p_region).region_id, (p_region).map_id, p_side, p_side, null, p_side, null, null, null)::semap.verge
$$;
comment on function semap.verge_at_rest is
  'A track that is inside in all ways, or in none.';

-- Follow one track through states, in the order of their stamps, in its relation to one region. Where the region asks for
-- the way between samples, each of the way's parts is trodden, too, unless it is too long or too fast to be one.
create or replace function semap.follow_region(
  p_region semap.region, inout p_verge semap.verge, p_arrivals semap.arrival[], out p_crossings semap.crossing[]
) language plpgsql immutable as $$
declare
  v_state    semap.arrival;
  v_from     semap.arrival := p_arrivals[1];
  v_live     boolean := v_from.live;
  v_gap_s    double precision;
  v_parts    double precision[];
  v_step     record;
  v_trod     record;
begin
  v_from.stamp := v_from.seen_stamp;
  v_from.x_m := v_from.from_x_m;
  v_from.y_m := v_from.from_y_m;
  v_from.z_m := v_from.from_z_m;
  foreach v_state in array p_arrivals loop
    v_gap_s := case when v_live then extract(epoch from v_state.stamp - v_from.stamp) end;
    v_parts := case
      when v_live and v_state.stamp <= v_from.stamp + p_region.longest_gap
           and sqrt((v_state.x_m - v_from.x_m) ^ 2 + (v_state.y_m - v_from.y_m) ^ 2) <= p_region.fastest_mps * v_gap_s
      then semap.parts_of_way(p_region, v_from.x_m, v_from.y_m, v_from.z_m, v_state.x_m, v_state.y_m, v_state.z_m) end;
    for v_step in
      select w.at, w.x_m, w.y_m, s.side, s.enters, s.leaves
      from (
        select v_from.stamp + make_interval(secs => part * v_gap_s) as at, ordinality,
               v_from.x_m + part * (v_state.x_m - v_from.x_m) as x_m, v_from.y_m + part * (v_state.y_m - v_from.y_m) as y_m,
               v_from.x_m + middle * (v_state.x_m - v_from.x_m) as on_x_m,
               v_from.y_m + middle * (v_state.y_m - v_from.y_m) as on_y_m,
               v_from.z_m + middle * (v_state.z_m - v_from.z_m) as on_z_m
        from (select part, ordinality, (part + coalesce(lead(part) over (order by ordinality), 1)) / 2 as middle
              from unnest(v_parts) with ordinality u (part, ordinality)) p
        union all
        select v_state.stamp, null, v_state.x_m, v_state.y_m, v_state.x_m, v_state.y_m, v_state.z_m
      ) w
      cross join lateral semap.stands(p_region, w.on_x_m, w.on_y_m, w.on_z_m, v_state.std_m) s
      order by w.ordinality nulls last
    loop
      if not v_live then
        v_live := true;
        p_verge := semap.verge_at_rest(v_state.track_id, p_region, v_step.side);
        if v_step.side then
          p_crossings := p_crossings || row(v_state.track_id, p_region.region_id, 'began', 'appeared', v_state.stamp,
                                            v_state.stamp, v_state.x_m, v_state.y_m)::semap.crossing;
        end if;
        continue;
      end if;
      if v_parts is not null then -- what is known all the way may have lasted long enough before this step
        v_trod := semap.tread(p_verge, p_region, v_step.at, null, null, p_verge.side, false, false);
        p_verge := v_trod.p_verge;
        if v_trod.changed then
          p_crossings := p_crossings || semap.verge_crossing(p_verge, v_state);
        end if;
      end if;
      v_trod := semap.tread(p_verge, p_region, v_step.at, v_step.x_m, v_step.y_m, v_step.side, v_step.enters, v_step.leaves);
      p_verge := v_trod.p_verge;
      if v_trod.changed then
        p_crossings := p_crossings || semap.verge_crossing(p_verge, v_state);
      end if;
    end loop;
    if v_state.is_last then
      if p_verge.held then
        p_crossings := p_crossings || row(v_state.track_id, p_region.region_id, 'ended', 'disappeared', v_state.stamp,
                                          v_state.stamp, v_state.x_m, v_state.y_m)::semap.crossing;
      end if;
      p_verge := semap.verge_at_rest(v_state.track_id, p_region, false);
      v_live := false;
    end if;
    v_from := v_state;
  end loop;
end $$;
comment on function semap.follow_region is
  'Follow one track through states, in the order of their stamps, in its relation to one region.';

-- Keep where a track stands to a region while it is between; what was kept before is p_before.
create or replace function semap.keep_verge(p_before semap.verge, p_verge semap.verge) returns void
language plpgsql as $$
begin
  if p_verge.held = p_verge.inside and p_verge.inside = p_verge.side then
    if p_before.held <> p_before.inside or p_before.inside <> p_before.side then
      delete from semap.verge where track_id = p_verge.track_id and region_id = p_verge.region_id;
    end if;
  elsif p_verge is distinct from p_before then
    insert into semap.verge select (p_verge).*
    on conflict (track_id, region_id) do update
    set held = excluded.held, inside = excluded.inside, inside_at = excluded.inside_at,
        side = excluded.side, side_at = excluded.side_at, x_m = excluded.x_m, y_m = excluded.y_m;
  end if;
end $$;
comment on function semap.keep_verge is
  'Keep where a track stands to a region while it is between.';

-- Follow tracks through these states in their relations to all careful regions, and give what began and ended by it. What
-- is kept of each track between batches is brought up to date: the regions it is in, its verges, and when one of these is
-- due, if nothing else happens.
create or replace function semap.follow_carefully(p_arrivals semap.arrival[]) returns semap.crossing[]
language plpgsql as $$
declare
  v_states     semap.arrival[];
  v_now        semap.track_now;
  v_extent     public.geometry;
  v_region     semap.region;
  v_verge      semap.verge;
  v_followed   record;
  v_held       integer[];
  v_due        timestamptz;
  v_crossings  semap.crossing[];
begin
  for v_states in
    select array_agg(a order by a.stamp) from unnest(p_arrivals) a group by a.track_id order by a.track_id
  loop
    select * into v_now from semap.track_now where track_id = v_states[1].track_id;
    v_extent := public.st_expand(public.st_extent(public.st_makepoint(x_m, y_m))::public.geometry, 0.001)
      from (select x_m, y_m from unnest(v_states)
            union all select v_states[1].from_x_m, v_states[1].from_y_m where v_states[1].live) places;
    v_held := '{}';
    v_due := 'infinity';
    for v_region in
      select r.*
      from semap.region r
      where r.careful and r.map_id = v_now.map_id
        and (r.footprint && v_extent
             or r.region_id = any (v_now.careful_ids)
             or r.region_id in (select region_id from semap.verge where track_id = v_now.track_id))
        and (r.subject is null or exists (select from semap.query_track s
                                          where s.query_id = r.query_id and s.track_id = v_now.track_id))
      order by r.instance_uid, r.query_id
    loop
      select * into v_verge from semap.verge v where v.track_id = v_now.track_id and v.region_id = v_region.region_id;
      if not found then
        v_verge := semap.verge_at_rest(v_now.track_id, v_region, v_region.region_id = any (v_now.careful_ids));
      end if;
      v_followed := semap.follow_region(v_region, v_verge, v_states);
      perform semap.keep_verge(v_verge, v_followed.p_verge);
      v_verge := v_followed.p_verge;
      v_crossings := v_crossings || v_followed.p_crossings;
      if v_verge.held then
        v_held := v_held || v_region.region_id;
      end if;
      if v_verge.held <> v_verge.inside then
        v_due := least(v_due, v_verge.inside_at
                              + case when v_verge.inside then v_region.enter_confirm else v_region.leave_confirm end);
      end if;
    end loop;
    update semap.track_now
    set careful_ids = v_held,
        calm_until = case when outlier_stamp is null then v_due else '-infinity' end
    where track_id = v_now.track_id;
  end loop;
  return v_crossings;
end $$;
comment on function semap.follow_carefully is
  'Follow tracks through these states in their relations to all careful regions, and give what began and ended by it.';
