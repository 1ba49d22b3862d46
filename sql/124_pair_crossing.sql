-- Lines that are crossed. A line has two sides along its direction; whoever comes to it from one of them and goes on to
-- the other has crossed it, there and then. Whoever only touches it, walks along it and comes back, or passes through
-- its very end has not. A state exactly on the line belongs to the side that it came from, which the pair remembers:
-- `pending` is the left one.

-- To which side of a path a direction points at a corner of it: true is left; null along the path and where it turns
-- back on itself. `back` leads to the corner before, `on` to the next one.
create or replace function semap.points_left(
  p_back_x double precision, p_back_y double precision, p_on_x double precision, p_on_y double precision,
  p_x double precision, p_y double precision
) returns boolean
language plpgsql immutable parallel safe as $$
declare
  v_on    double precision := p_on_x * p_y - p_on_y * p_x;
  v_back  double precision := p_x * p_back_y - p_y * p_back_x;
  v_turn  double precision := p_on_x * p_back_y - p_on_y * p_back_x;
begin
  if v_on = 0 and p_on_x * p_x + p_on_y * p_y > 0 or v_back = 0 and p_back_x * p_x + p_back_y * p_y > 0 then
    return null;
  elsif v_turn > 0 then
    return v_on > 0 and v_back > 0;
  elsif v_turn < 0 then
    return not (v_on < 0 and v_back < 0);
  end if;
  return case when p_on_x * p_back_x + p_on_y * p_back_y < 0 then v_on > 0 end;
end $$;

-- How a way meets a corner of a line that lies on it: the side of the line from which it comes to it and the one on
-- which it leaves it (null: along the line, or no side). `back` leads to the corner before, `on` to the next one.
create or replace function semap.way_at_corner(
  p_back_x double precision, p_back_y double precision, p_on_x double precision, p_on_y double precision,
  p_way_x double precision, p_way_y double precision,
  out comes_along boolean, out comes_from_left boolean, out goes_along boolean, out goes_to_left boolean
)
language plpgsql immutable parallel safe as $$
declare
  v_back_along  double precision := case when p_way_x * p_back_y - p_way_y * p_back_x = 0
                                         then p_way_x * p_back_x + p_way_y * p_back_y end;
  v_on_along    double precision := case when p_way_x * p_on_y - p_way_y * p_on_x = 0
                                         then p_way_x * p_on_x + p_way_y * p_on_y end;
begin
  comes_along := v_back_along <= 0 is true or v_on_along <= 0 is true;
  goes_along := v_back_along > 0 is true or v_on_along > 0 is true;
  comes_from_left := semap.points_left(p_back_x, p_back_y, p_on_x, p_on_y, -p_way_x, -p_way_y);
  goes_to_left := semap.points_left(p_back_x, p_back_y, p_on_x, p_on_y, p_way_x, p_way_y);
end $$;

-- Which ends of a way, as parts of it, lie within an edge that it runs along.
create or replace function semap.ends_within_edge(
  p_x1_m double precision, p_y1_m double precision, p_x2_m double precision, p_y2_m double precision,
  p_edge_x1_m double precision, p_edge_y1_m double precision,
  p_edge_x2_m double precision, p_edge_y2_m double precision
) returns setof double precision
language sql immutable parallel safe as $$
  select e.part
  from (values (0.0::double precision, p_x1_m, p_y1_m), (1.0, p_x2_m, p_y2_m)) e (part, x_m, y_m)
  cross join lateral (select (e.x_m - p_edge_x1_m) * (p_edge_x2_m - p_edge_x1_m)
                             + (e.y_m - p_edge_y1_m) * (p_edge_y2_m - p_edge_y1_m) as along) a
  where a.along > 0 and a.along < (p_edge_x2_m - p_edge_x1_m) ^ 2 + (p_edge_y2_m - p_edge_y1_m) ^ 2
$$;

-- Where a straight way meets lines, with the side of the line from which it comes to it and the one on which it leaves
-- it (null: along the line, or no side). Parts of the way in [0, 1].
create or replace function semap.way_meets(
  p_lines public.geometry, p_x1_m double precision, p_y1_m double precision, p_x2_m double precision,
  p_y2_m double precision
) returns table (part double precision, comes_along boolean, comes_from_left boolean, goes_along boolean,
                 goes_to_left boolean)
language plpgsql immutable parallel safe as $$
declare
  v_line     public.geometry;
  v_x        double precision[];
  v_y        double precision[];
  v_way_x    double precision := p_x2_m - p_x1_m;
  v_way_y    double precision := p_y2_m - p_y1_m;
  v_corners  integer;
  v_is_ring  boolean;
  v_before   integer;
  v_from     double precision;
  v_to       double precision;
begin
  for v_line in select (public.st_dump(public.st_removerepeatedpoints(p_lines))).geom loop
    select array_agg(public.st_x(geom) order by path), array_agg(public.st_y(geom) order by path) into v_x, v_y
    from public.st_dumppoints(v_line);
    v_corners := cardinality(v_x);
    v_is_ring := v_corners > 2 and v_x[1] = v_x[v_corners] and v_y[1] = v_y[v_corners];
    for i in 1 .. v_corners loop
      v_from := v_way_x * (v_y[i] - p_y1_m) - v_way_y * (v_x[i] - p_x1_m);
      if v_from = 0 and not (v_is_ring and i = v_corners) then
        part := (v_way_x * (v_x[i] - p_x1_m) + v_way_y * (v_y[i] - p_y1_m)) / (v_way_x * v_way_x + v_way_y * v_way_y);
        if part between 0 and 1 then
          v_before := case when i > 1 then i - 1 when v_is_ring then v_corners - 1 end;
          select c.* into comes_along, comes_from_left, goes_along, goes_to_left
          from semap.way_at_corner(v_x[v_before] - v_x[i], v_y[v_before] - v_y[i], v_x[i + 1] - v_x[i],
                                   v_y[i + 1] - v_y[i], v_way_x, v_way_y) c;
          return next;
        end if;
      end if;
      exit when i = v_corners;
      v_to := v_way_x * (v_y[i + 1] - p_y1_m) - v_way_y * (v_x[i + 1] - p_x1_m);
      if v_from < 0 and v_to > 0 or v_from > 0 and v_to < 0 then
        comes_along := false;
        goes_along := false;
        comes_from_left := v_from < 0;
        goes_to_left := v_from > 0;
        v_from := (v_x[i + 1] - v_x[i]) * (p_y1_m - v_y[i]) - (v_y[i + 1] - v_y[i]) * (p_x1_m - v_x[i]);
        v_to := (v_x[i + 1] - v_x[i]) * (p_y2_m - v_y[i]) - (v_y[i + 1] - v_y[i]) * (p_x2_m - v_x[i]);
        -- two zeros: a line so long that its coordinates cannot tell both ends of the way apart
        if (v_from >= 0 and v_to <= 0 or v_from <= 0 and v_to >= 0) and v_from <> v_to then
          part := v_from / (v_from - v_to);
          return next;
        end if;
      elsif v_from = 0 and v_to = 0 then
        return query
          select w.part, true, null::boolean, true, null::boolean
          from semap.ends_within_edge(p_x1_m, p_y1_m, p_x2_m, p_y2_m, v_x[i], v_y[i], v_x[i + 1], v_y[i + 1]) w (part);
      end if;
    end loop;
  end loop;
end $$;

-- Where a way crosses lines, as parts of it with the side that it leaves; and from which side its end, if on a line,
-- came. p_came_from_left: of its start, if that is on a line.
create or replace function semap.way_across(
  p_lines public.geometry, p_x1_m double precision, p_y1_m double precision, p_x2_m double precision,
  p_y2_m double precision,
  p_came_from_left boolean, out parts double precision[], out from_left boolean[], out came_from_left boolean
) language plpgsql immutable parallel safe as $$
declare
  v_meets  record;
begin
  came_from_left := p_came_from_left;
  if p_x1_m = p_x2_m and p_y1_m = p_y2_m then
    return;
  end if;
  for v_meets in
    select * from semap.way_meets(p_lines, p_x1_m, p_y1_m, p_x2_m, p_y2_m) order by part
  loop
    if v_meets.part > 0 and not v_meets.comes_along then
      came_from_left := v_meets.comes_from_left;
    end if;
    if v_meets.part < 1 and not v_meets.goes_along then
      if came_from_left <> v_meets.goes_to_left then
        parts := parts || v_meets.part;
        from_left := from_left || came_from_left;
      end if;
      came_from_left := null;
    end if;
  end loop;
  if v_meets.part is null or v_meets.part < 1 then
    came_from_left := null;
  end if;
end $$;

-- The state of a pair whose subject is on the line that is its object: the side that it came from.
create or replace function semap.side_of_line(p_query_id integer, p_subject_key bigint, p_object_key bigint,
                                              p_from_left boolean)
returns semap.relation_state
language sql immutable parallel safe as $$
  select semap.new_relation_state(
    query_id => p_query_id, subject_key => p_subject_key, object_key => p_object_key, confirmed => false, since => null,
    pending => p_from_left, pending_at => null, raw => p_from_left, raw_at => null)
$$;

-- The crossings of lines by tracks that went from where they were (p_places) to where these states say; what pairs are
-- to each other then: those of lines on which a way ended.
create or replace function semap.cross_lines(
  p_query_ids integer[], p_places semap.track_state[], p_states semap.track_state[],
  inout pairs semap.relation_state[], out changes semap.pair_change[]
)
language plpgsql stable set plan_cache_mode = force_generic_plan as $$
begin
  with way as materialized (
    select m.key, m.query_id, b.stamp as from_stamp, b.x_m as x1_m, b.y_m as y1_m, b.z_m as z1_m,
           m.stamp, m.x_m as x2_m, m.y_m as y2_m, m.z_m as z2_m, q.dimensions, q.direction,
           semap.pair_box(least(b.x_m, m.x_m), least(b.y_m, m.y_m), greatest(b.x_m, m.x_m), greatest(b.y_m, m.y_m),
                          m.query_id, true) as box,
           m.stamp <= b.stamp + coalesce(q.longest_gap, '30 s')
           and sqrt((m.x_m - b.x_m) ^ 2 + (m.y_m - b.y_m) ^ 2)
               <= coalesce(q.fastest_mps, 30) * extract(epoch from m.stamp - b.stamp) as is_way
    from semap.track_members(p_query_ids, p_states) m
    join unnest(p_places) b on b.track_id = m.key
    join semap.continuous_query q on q.query_id = m.query_id
  ), met as materialized (
    select w.*, o.instance_id, o.z_min_m, o.z_max_m, c.*
    from way w
    cross join lateral (
      select * from semap.pair_instance o
      where o.box &&& w.box and o.query_id is not distinct from w.query_id and o.is_object is not false offset 0) o
    left join unnest(pairs) p on p.query_id = w.query_id and p.subject_key = w.key and p.object_key = -o.instance_id
    cross join lateral semap.way_across(o.shape, x1_m, y1_m, x2_m, y2_m, p.pending) c
    where w.is_way
  ), crossed as (
    select m.query_id, m.key, m.instance_id, m.stamp,
           from_stamp + make_interval(secs => part * extract(epoch from stamp - from_stamp)) as at,
           x1_m + part * (x2_m - x1_m) as x_m, y1_m + part * (y2_m - y1_m) as y_m,
           case when is_left then 'left_to_right' else 'right_to_left' end as way
    from met m
    cross join lateral unnest(m.parts, m.from_left) with ordinality c (part, is_left, place)
    where (m.direction is null or m.direction = case when is_left then 'left_to_right' else 'right_to_left' end)
      and (m.dimensions = 2 or (z1_m + part * (z2_m - z1_m) >= m.z_min_m
                                and z1_m + part * (z2_m - z1_m) < m.z_max_m) is not false)
    order by m.query_id, m.key, m.instance_id, part, place
  )
  select array(select p from unnest(pairs) p
               where not exists (select from way w where w.query_id = p.query_id and w.key = p.subject_key)
               union all
               select semap.side_of_line(query_id, key, -instance_id, came_from_left) from met
                 where came_from_left is not null),
         (select array_agg(row(query_id, key, -instance_id, 'crossed', 'moved', stamp, at, at, x_m, y_m,
                               way)::semap.pair_change)
          from crossed)
  into pairs, changes;
end $$;
