-- What is in what, on what, and what meets what. A thing is compared in one of two ways:
-- '2d' as a prism: its footprint (a thing without one: its position) over its heights. Exact for prisms.
-- '3d' as its body, exact for concave bodies too, up to the tolerance of semap.contains_3d (1e-6 m); as its prism
--      where it has no body. A container without a body is a prism, and what is wholly in a prism is decided
--      exactly by outline and heights alone.
-- Functions that are called for each pair are in PL/pgSQL, whose plans a session keeps: the body of one in SQL that
-- cannot be inlined is planned again in every query.
-- Strictly in: completely within; touching the boundary from inside counts. In, relaxed: some of it lies inside;
-- what only touches from outside is not in, so that a room does not hold what stands beyond its wall or on its
-- ceiling. Heights are compared with a tolerance of 1e-6 m; without heights a prism reaches everywhere.

-- The triangles of shapes as one TIN. A triangle is written just as a polygon is, but for its type, which is 17.
create or replace function semap.one_tin(p_shapes public.geometry) returns public.geometry
language sql immutable parallel safe as $$
  select st_geomfromewkb('\x0110000080'::bytea || substring(st_asewkb(st_collect(t.geom), 'NDR') from 6 for 4)
                         || string_agg(set_byte(st_asewkb(t.geom, 'NDR'), 1, 17), ''::bytea order by t.path))
  from st_dump(p_shapes) t
$$;

-- The body of an instance in the map frame, all its meshes as one TIN; null without one or where it is not placed.
create or replace function semap.body_of(p_instance_id bigint) returns public.geometry
language plpgsql stable parallel safe as $$
begin
  return (
    select case when count(*) = 1 and bool_and(geometrytype(body) = 'TIN') then (array_agg(body))[1]
                else semap.one_tin(st_collect(body order by geometry_id)) end
    from (
      select g.geometry_id,
             semap.placed(case g.type when 'TRIANGLEMESH3D' then g.body else semap.triangulated(g.body) end,
                          semap.compose(f.pose, row(g.x_m, g.y_m, g.z_m, g.qx, g.qy, g.qz, g.qw)::semap.pose)) as body
      from semap.instance i
      join semap.geometry g on g.description_id = i.relative_description_id
      cross join lateral semap.frames_in_root(array[i.frame_id]) f
      join semap.frame root on root.frame_id = f.root_id and root.name = 'map'
      where i.instance_id = p_instance_id and g.type in ('TRIANGLEMESH3D', 'POLYGONMESH3D') and f.pose is not null
    ) part);
end $$;

-- The lowest height [m] of an instance: of its footprint if that has heights, else of its body or position.
create or replace function semap.bottom_m(p_instance_id bigint, p_z_min_m double precision) returns double precision
language plpgsql stable parallel safe as $$
begin
  if p_z_min_m is not null then
    return p_z_min_m;
  end if;
  return coalesce(
    (select st_zmin(geometry) from semap.abstraction where instance_id = p_instance_id and type = 'AxisAligned3D'),
    (select st_z(geometry) from semap.abstraction where instance_id = p_instance_id and type = 'Position3D'),
    '-infinity');
end $$;

-- The greatest height [m] of an instance: of its footprint if that has heights, else of its body or position.
create or replace function semap.top_m(p_instance_id bigint, p_z_max_m double precision) returns double precision
language plpgsql stable parallel safe as $$
begin
  if p_z_max_m is not null then
    return p_z_max_m;
  end if;
  return coalesce(
    (select st_zmax(geometry) from semap.abstraction where instance_id = p_instance_id and type = 'AxisAligned3D'),
    (select st_z(geometry) from semap.abstraction where instance_id = p_instance_id and type = 'Position3D'),
    'infinity');
end $$;

-- Things without a footprint whose position lies in the box of a reference's footprint, on the same map.
create or replace function semap.position_pairs(p_reference_ids bigint[], p_target_ids bigint[] default null)
returns table (
  reference_id bigint, reference_area public.geometry, reference_z_min_m double precision,
  reference_z_max_m double precision,
  target_id bigint, target_area public.geometry, target_z_min_m double precision, target_z_max_m double precision
)
language sql stable parallel safe as $$
  select r.instance_id, r.geometry, r.z_min_m, r.z_max_m, t.instance_id, t.geometry, t.z_min_m, t.z_max_m
  from semap.abstraction r
  join semap.instance ri on ri.instance_id = r.instance_id
  cross join lateral (select * from semap.abstraction a
                      where a.type = 'Position2D' and a.instance_id is not null and a.geometry && r.geometry offset 0) t
  join semap.instance ti on ti.instance_id = t.instance_id and ti.map_id = ri.map_id
  where (p_reference_ids is not null or p_target_ids is null)
    and r.instance_id = any (coalesce(p_reference_ids, array(select instance_id from semap.instance)))
    and r.type = 'Footprint' and t.instance_id <> r.instance_id
    and (p_target_ids is null or t.instance_id in (select unnest(p_target_ids)))
    and not exists (select from semap.abstraction f where f.instance_id = t.instance_id and f.type = 'Footprint')
  union all
  select r.instance_id, r.geometry, r.z_min_m, r.z_max_m, t.instance_id, t.geometry, t.z_min_m, t.z_max_m
  from semap.abstraction t
  join semap.instance ti on ti.instance_id = t.instance_id
  cross join lateral (select * from semap.abstraction a
                      where a.type = 'Footprint' and a.instance_id is not null and a.geometry && t.geometry offset 0) r
  join semap.instance ri on ri.instance_id = r.instance_id and ri.map_id = ti.map_id
  where p_reference_ids is null and p_target_ids is not null
    and t.instance_id = any (p_target_ids) and t.type = 'Position2D' and t.instance_id <> r.instance_id
    and not exists (select from semap.abstraction f where f.instance_id = t.instance_id and f.type = 'Footprint')
$$;

-- Whether one prism holds another, or some of it ('within', 'partly'), or they share a point ('meets').
create or replace function semap.prisms_relate(
  p_relation text,
  p_area public.geometry, p_bottom_m double precision, p_top_m double precision,
  p_other public.geometry, p_other_bottom_m double precision, p_other_top_m double precision
) returns boolean
language plpgsql immutable parallel safe as $$
declare
  v_is_within  boolean := p_other_bottom_m >= p_bottom_m - 1e-6 and p_other_top_m <= p_top_m + 1e-6;
begin
  if p_relation = 'meets' then
    return p_other_bottom_m <= p_top_m + 1e-6 and p_bottom_m <= p_other_top_m + 1e-6 and st_intersects(p_area, p_other);
  elsif p_relation = 'within' then
    return v_is_within and st_contains(p_area, p_other);
  end if;
  return (v_is_within or p_other_bottom_m < p_top_m - 1e-6 and p_bottom_m < p_other_top_m - 1e-6)
         -- the first two are quick for one area and many others, which are mostly decided by them
         and st_intersects(p_area, p_other)
         and (st_contains(p_area, p_other) or st_relate(p_area, p_other, 'T********'));
end $$;

-- The prism over an area; what is flat is a micrometre thick, within the tolerance of the predicates.
create or replace function semap.prism_between(
  p_area public.geometry, p_bottom_m double precision, p_top_m double precision
) returns public.geometry
language plpgsql immutable parallel safe as $$
begin
  return semap.extruded(p_area, case when p_top_m - p_bottom_m < 1e-6 then p_bottom_m - 5e-7 else p_bottom_m end,
                        case when p_top_m - p_bottom_m < 1e-6 then p_bottom_m + 5e-7 else p_top_m end);
end $$;


-- Whether one body holds another, or some of it, or they share a point; prisms stand for bodies that are not there,
-- points for what is no more.
create or replace function semap.bodies_relate(
  p_relation text,
  p_area public.geometry, p_bottom_m double precision, p_top_m double precision, p_body public.geometry,
  p_other public.geometry, p_other_bottom_m double precision, p_other_top_m double precision,
  p_other_body public.geometry
) returns boolean
language plpgsql stable parallel safe as $$
declare
  v_body   public.geometry := p_body;
  v_other  public.geometry := p_other_body;
begin
  if p_other_bottom_m > p_top_m + 1e-6 or p_bottom_m > p_other_top_m + 1e-6 then
    return false;
  end if;
  if p_body is null and (p_other_body is null or p_relation = 'within') then
    return semap.prisms_relate(p_relation, p_area, p_bottom_m, p_top_m, p_other, p_other_bottom_m, p_other_top_m);
  end if;
  if p_relation = 'within' and (p_other_bottom_m < p_bottom_m - 1e-6 or p_other_top_m > p_top_m + 1e-6) then
    return false;
  end if;
  -- a prism without an end is cut off well beyond the other
  if v_body is null then
    v_body := semap.prism_between(p_area, greatest(p_bottom_m, p_other_bottom_m - 1),
                                  least(p_top_m, p_other_top_m + 1));
  end if;
  if v_other is null and st_dimension(p_other) = 2 then
    v_other := semap.prism_between(p_other, greatest(p_other_bottom_m, p_bottom_m - 1),
                                   least(p_other_top_m, p_top_m + 1));
  elsif v_other is null then
    v_other := st_makepoint(st_x(p_other), st_y(p_other),
                            least(greatest(p_other_bottom_m, p_bottom_m), p_other_top_m));
  end if;
  if p_relation = 'within' then
    return semap.contains_3d(v_body, v_other);
  elsif p_relation = 'meets' then
    return semap.intersects_3d(v_body, v_other);
  elsif st_dimension(v_other) = 0 then
    return semap.contains_3d(v_body, v_other);
  end if;
  return semap.overlaps_3d(v_body, v_other) or semap.contains_3d(v_body, v_other);
end $$;

-- Refuse a mode other than '2d' and '3d'.
create or replace function semap.require_mode(p_mode text) returns void
language plpgsql immutable parallel safe as $$
begin
  if p_mode is null or p_mode not in ('2d', '3d') then
    raise exception 'There is no mode %.', coalesce(p_mode, 'null')
      using errcode = 'invalid_parameter_value', hint = 'Use 2d (footprints and heights) or 3d (bodies).';
  end if;
end $$;

-- Pairs of things of one map of which a relation holds: the target is within the reference, partly in it, or
-- meets it. Prisms are compared first; bodies are looked at only where footprints and heights meet.
create or replace function semap.related_pairs(
  p_relation text, p_reference_ids bigint[], p_target_ids bigint[], p_mode text
) returns table (reference_id bigint, target_id bigint)
language plpgsql stable parallel safe as $$
begin
  perform semap.require_mode(p_mode);
  if p_mode = '2d' then
    return query
      select p.reference_id, p.target_id
      from (select * from semap.footprint_pairs(p_reference_ids, p_target_ids)
            union all select * from semap.position_pairs(p_reference_ids, p_target_ids)) p
      where semap.prisms_relate(
        p_relation,
        p.reference_area, semap.bottom_m(p.reference_id, p.reference_z_min_m),
        semap.top_m(p.reference_id, p.reference_z_max_m),
        p.target_area, semap.bottom_m(p.target_id, p.target_z_min_m), semap.top_m(p.target_id, p.target_z_max_m));
  else
    return query
      with pair as materialized (
        select p.reference_id, p.reference_area, p.target_id, p.target_area,
               semap.bottom_m(p.reference_id, p.reference_z_min_m) as r_low,
               semap.top_m(p.reference_id, p.reference_z_max_m) as r_high,
               semap.bottom_m(p.target_id, p.target_z_min_m) as t_low,
               semap.top_m(p.target_id, p.target_z_max_m) as t_high
        from (select * from semap.footprint_pairs(p_reference_ids, p_target_ids)
              union all select * from semap.position_pairs(p_reference_ids, p_target_ids)) p
        where st_dwithin(p.reference_area, p.target_area, 1e-6)
      ), near as materialized (
        -- what is within something has its box in the other's box
        select * from pair
        where case when p_relation = 'within' then t_low >= r_low - 1e-6 and t_high <= r_high + 1e-6
                                                   and st_expand(reference_area, 1e-6) ~ target_area
                   else t_low <= r_high + 1e-6 and r_low <= t_high + 1e-6 end
      ), body as materialized (
        select id, semap.body_of(id) as body
        from (select n.reference_id as id from near n union select n.target_id from near n) thing
      )
      select n.reference_id, n.target_id
      from near n join body r on r.id = n.reference_id join body t on t.id = n.target_id
      where semap.bodies_relate(p_relation, n.reference_area, n.r_low, n.r_high, r.body,
                                n.target_area, n.t_low, n.t_high, t.body);
  end if;
end $$;

-- What is in the references: strictly (completely within; touching from inside counts), or relaxed (some of it
-- lies inside; what only touches from outside is not in). Exact for prisms ('2d') or for bodies ('3d').
create or replace function semap.in_objects(
  p_reference_ids bigint[], p_target_ids bigint[] default null, p_mode text default '2d', p_strict boolean default false
) returns table (reference_id bigint, target_id bigint)
language sql stable parallel safe as $$
  select * from semap.related_pairs(case when p_strict then 'within' else 'partly' end, p_reference_ids, p_target_ids,
                                    p_mode)
$$;

-- What shares a point with the references; touching counts. Exact for prisms ('2d') or for bodies ('3d').
create or replace function semap.intersecting_objects(
  p_reference_ids bigint[], p_target_ids bigint[] default null, p_mode text default '2d'
) returns table (reference_id bigint, target_id bigint)
language sql stable parallel safe as $$
  select * from semap.related_pairs('meets', p_reference_ids, p_target_ids, p_mode)
$$;

-- The height [m] of the upward face of a body beneath an area that is nearest to a height; null where none is
-- beneath it. Of a slope counts its highest place beneath the area.
create or replace function semap.surface_beneath(p_body public.geometry, p_area public.geometry,
                                                 p_height_m double precision)
returns double precision
language sql immutable parallel safe as $$
  select s.height_m
  from st_dump(p_body) t
  cross join lateral (
    select st_x(a) as ax, st_y(a) as ay, st_z(a) as az, st_x(b) as bx, st_y(b) as by, st_z(b) as bz,
           st_x(c) as cx, st_y(c) as cy, st_z(c) as cz
    from (select st_pointn(ring, 1) as a, st_pointn(ring, 2) as b, st_pointn(ring, 3) as c
          from (select st_exteriorring(t.geom) as ring) r) corner) p
  cross join lateral (
    select (bx - ax) * (cy - ay) - (cx - ax) * (by - ay) as nz,
           (by - ay) * (cz - az) - (cy - ay) * (bz - az) as nx,
           (bz - az) * (cx - ax) - (cz - az) * (bx - ax) as ny) n
  cross join lateral (
    select st_intersection(st_makepolygon(st_makeline(array[
             st_makepoint(ax, ay), st_makepoint(bx, by), st_makepoint(cx, cy), st_makepoint(ax, ay)])),
             p_area) as overlap) o
  cross join lateral (
    select max(az - (nx * (st_x(d.geom) - ax) + ny * (st_y(d.geom) - ay)) / nz) as height_m
    from st_dumppoints(o.overlap) d) s
  where t.geom && p_area and nz > 1e-12 and (st_area(o.overlap) > 1e-12 or st_dimension(p_area) < 2)
    and s.height_m is not null
  order by abs(s.height_m - p_height_m)
  limit 1
$$;

-- What rests on the references: their footprints overlap, and the target's lowest height is within the tolerance
-- of a surface of the reference beneath it (a body: any upward face under the target's footprint, so that a shelf
-- has boards; else the top of the prism). gap_m: how far above (below: negative) that surface it begins.
create or replace function semap.on_objects(
  p_reference_ids bigint[], p_target_ids bigint[] default null, p_tolerance_m double precision default 0.05
) returns table (reference_id bigint, target_id bigint, gap_m double precision)
language sql stable parallel safe as $$
  with pair as materialized (
    select p.reference_id, p.target_id, p.reference_area, p.target_area,
           semap.bottom_m(p.target_id, p.target_z_min_m) as bottom_m,
           semap.bottom_m(p.reference_id, p.reference_z_min_m) as reference_bottom_m,
           semap.top_m(p.reference_id, p.reference_z_max_m) as top_m
    from (select * from semap.footprint_pairs(p_reference_ids, p_target_ids)
          union all select * from semap.position_pairs(p_reference_ids, p_target_ids)) p
  ), over as materialized (
    select * from pair
    where bottom_m between reference_bottom_m - p_tolerance_m and top_m + p_tolerance_m
      and bottom_m > '-infinity' and st_relate(reference_area, target_area, 'T********')
  ), body as materialized (
    select r.id, semap.body_of(r.id) as body from (select distinct o.reference_id as id from over o) r
  )
  select o.reference_id, o.target_id, g.gap_m
  from over o join body b on b.id = o.reference_id
  cross join lateral (
    select o.bottom_m - case when b.body is null then o.top_m
                             else semap.surface_beneath(b.body, o.target_area, o.bottom_m) end as gap_m offset 0) g
  where abs(g.gap_m) <= p_tolerance_m
$$;

-- What lies in an area of the map, seen from above: completely within (strict; on the boundary counts), or sharing a
-- point with it (relaxed). Compared is one of the flat abstractions, at whatever height.
create or replace function semap.in_area(
  p_area public.geometry, p_map_id integer, p_target_ids bigint[] default null, p_strict boolean default false,
  p_abstraction text default 'Footprint'
) returns table (target_id bigint)
language plpgsql stable parallel safe as $$
begin
  if semap.dimensions_of(p_abstraction) <> 2 then
    raise exception '% is not flat.', p_abstraction
      using errcode = 'invalid_parameter_value', hint = 'Use in_volume, or Footprint, Position2D, FootprintHull ...';
  end if;
  return query execute format(
    'select a.instance_id from (select * from semap.abstraction'
    '  where type = %L and instance_id is not null and geometry && $1 offset 0) a'
    ' join semap.instance i on i.instance_id = a.instance_id and i.map_id = $2'
    ' where ($3 is null or a.instance_id in (select unnest($3))) and %s',
    p_abstraction, case when p_strict then 'st_coveredby(a.geometry, $1)' else 'st_intersects(a.geometry, $1)' end)
    using p_area, p_map_id, p_target_ids;
end $$;

-- What lies in a volume: a closed TIN, or an area between two heights. Completely within (strict; touching from
-- inside counts), or sharing a point with it (relaxed). Things count as bodies, or as prisms where they have none.
create or replace function semap.in_volume(
  p_volume public.geometry, p_map_id integer, p_target_ids bigint[] default null, p_strict boolean default false,
  p_z_min_m double precision default '-infinity', p_z_max_m double precision default 'infinity'
) returns table (target_id bigint)
language plpgsql stable parallel safe as $$
declare
  v_is_body    boolean := st_zmflag(p_volume) = 2 and geometrytype(p_volume) in ('TIN', 'POLYHEDRALSURFACE');
  v_body       public.geometry := case when v_is_body then p_volume end;
  v_area       public.geometry := case when v_is_body then st_envelope(st_force2d(p_volume))
                                       else st_force2d(p_volume) end;
  v_bottom_m   double precision := case when v_is_body then st_zmin(p_volume) else p_z_min_m end;
  v_top_m      double precision := case when v_is_body then st_zmax(p_volume) else p_z_max_m end;
  v_relation   text := case when p_strict then 'within' else 'meets' end;
begin
  return query
    with thing as materialized (
      select a.instance_id, a.geometry, semap.bottom_m(a.instance_id, a.z_min_m) as bottom_m,
             semap.top_m(a.instance_id, a.z_max_m) as top_m
      from (select * from semap.abstraction
            where type = 'Footprint' and instance_id is not null and geometry && v_area offset 0) a
      union all
      select a.instance_id, a.geometry, semap.bottom_m(a.instance_id, a.z_min_m), semap.top_m(a.instance_id, a.z_max_m)
      from (select * from semap.abstraction
            where type = 'Position2D' and instance_id is not null and geometry && v_area offset 0) a
      where not exists (select from semap.abstraction f where f.instance_id = a.instance_id and f.type = 'Footprint')
    )
    select t.instance_id
    from thing t join semap.instance i on i.instance_id = t.instance_id and i.map_id = p_map_id
    where (p_target_ids is null or t.instance_id in (select unnest(p_target_ids)))
      and t.bottom_m <= v_top_m + 1e-6 and v_bottom_m <= t.top_m + 1e-6
      and semap.bodies_relate(v_relation, v_area, v_bottom_m, v_top_m, v_body,
                              t.geometry, t.bottom_m, t.top_m, semap.body_of(t.instance_id));
end $$;
