-- How things lie to one another seen from above, by their footprints. Boxes are compared by the index first; the
-- predicates themselves are those of PostGIS (GEOS), exact for the coordinates as they are stored.
-- Every operator takes references and targets as ids of instances; null means all instances on the maps of the
-- other side (here and in 415 to 430; elsewhere only where a comment says so). A thing is never paired with itself, and
-- things of different maps are not paired.

-- The instances of these ids with their maps; for null all on the maps of the others, or all there are.
create or replace function semap.operands(p_ids bigint[], p_other_ids bigint[])
returns table (instance_id bigint, map_id integer)
language sql stable parallel safe rows 100 as $$
  select i.instance_id, i.map_id from semap.instance i
  where p_ids is not null and i.instance_id = any (p_ids)
  union all
  select i.instance_id, i.map_id from semap.instance i
  where p_ids is null
    and i.map_id = any (array(select o.map_id from semap.instance o where o.instance_id = any (p_other_ids)
                              union select m.map_id from semap.map m where p_other_ids is null))
$$;

-- Whether an abstraction is flat (2) or of space (3); refuses a name that is none.
create or replace function semap.dimensions_of(p_abstraction text) returns integer
language plpgsql immutable parallel safe as $$
begin
  if p_abstraction in ('Footprint', 'FootprintHull', 'FootprintBox', 'AxisAligned2D', 'Position2D') then
    return 2;
  elsif p_abstraction in ('Position3D', 'AxisAligned3D', 'BoundingBox', 'BoundingHull') then
    return 3;
  end if;
  raise exception 'There is no abstraction %.', p_abstraction
    using errcode = 'invalid_parameter_value',
          hint = 'Use Footprint, FootprintHull, FootprintBox, AxisAligned2D, Position2D, Position3D, AxisAligned3D,'
                 ' BoundingBox or BoundingHull.';
end $$;

-- Pairs of things of one map whose footprints' boxes meet, with their footprints and the heights of these.
create or replace function semap.footprint_pairs(p_reference_ids bigint[], p_target_ids bigint[] default null)
returns table (
  reference_id bigint, reference_area public.geometry, reference_z_min_m double precision,
  reference_z_max_m double precision,
  target_id bigint, target_area public.geometry, target_z_min_m double precision, target_z_max_m double precision
)
language sql stable parallel safe as $$
  -- `offset 0` keeps the join by the index, whatever the statistics say; each branch starts where ids are given
  select r.instance_id, r.geometry, r.z_min_m, r.z_max_m, t.instance_id, t.geometry, t.z_min_m, t.z_max_m
  from semap.abstraction r
  join semap.instance ri on ri.instance_id = r.instance_id
  cross join lateral (select * from semap.abstraction a
                      where a.type = 'Footprint' and a.instance_id is not null and a.geometry && r.geometry offset 0) t
  join semap.instance ti on ti.instance_id = t.instance_id and ti.map_id = ri.map_id
  where (p_reference_ids is not null or p_target_ids is null)
    and r.instance_id = any (coalesce(p_reference_ids, array(select instance_id from semap.instance)))
    and r.type = 'Footprint' and t.instance_id <> r.instance_id
    and (p_target_ids is null or t.instance_id in (select unnest(p_target_ids)))
  union all
  select r.instance_id, r.geometry, r.z_min_m, r.z_max_m, t.instance_id, t.geometry, t.z_min_m, t.z_max_m
  from semap.abstraction t
  join semap.instance ti on ti.instance_id = t.instance_id
  cross join lateral (select * from semap.abstraction a
                      where a.type = 'Footprint' and a.instance_id is not null and a.geometry && t.geometry offset 0) r
  join semap.instance ri on ri.instance_id = r.instance_id and ri.map_id = ti.map_id
  where p_reference_ids is null and p_target_ids is not null
    and t.instance_id = any (p_target_ids) and t.type = 'Footprint' and t.instance_id <> r.instance_id
$$;

-- All pairs of things of one map that have footprints, near or far.
create or replace function semap.footprint_product(p_reference_ids bigint[], p_target_ids bigint[] default null)
returns table (reference_id bigint, reference_area public.geometry, target_id bigint, target_area public.geometry)
language sql stable parallel safe as $$
  select r.instance_id, r.geometry, t.instance_id, t.geometry
  from semap.operands(p_reference_ids, p_target_ids) ri
  join semap.operands(p_target_ids, p_reference_ids) ti on ti.map_id = ri.map_id and ti.instance_id <> ri.instance_id
  cross join lateral (select * from semap.abstraction a
                      where a.instance_id = ri.instance_id and a.type = 'Footprint' offset 0) r
  cross join lateral (select * from semap.abstraction a
                      where a.instance_id = ti.instance_id and a.type = 'Footprint' offset 0) t
$$;

-- Whether a named predicate of OGC Simple Features holds of two geometries.
create or replace function semap.holds(p_predicate text, p_a public.geometry, p_b public.geometry) returns boolean
language plpgsql immutable parallel safe as $$
begin
  case lower(p_predicate)
    -- before GEOS 3.13 ST_Equals looks at the types first, and takes a line without length for no point
    when 'equals' then return st_equals(p_a, p_b)
                              or st_dimension(p_a) <> st_dimension(p_b) and st_relate(p_a, p_b, 'T*F**FFF*');
    when 'disjoint' then return st_disjoint(p_a, p_b);
    when 'touches' then return st_touches(p_a, p_b);
    when 'contains' then return st_contains(p_a, p_b);
    when 'covers' then return st_covers(p_a, p_b);
    when 'covered_by' then return st_coveredby(p_a, p_b);
    when 'within' then return st_within(p_a, p_b);
    when 'intersects' then return st_intersects(p_a, p_b);
    when 'overlaps' then return st_overlaps(p_a, p_b);
    when 'crosses' then return st_crosses(p_a, p_b);
    else
      raise exception 'There is no predicate %.', p_predicate using errcode = 'invalid_parameter_value',
        hint = 'Use equals, disjoint, touches, contains, covers, covered_by, within, intersects, overlaps or crosses.';
  end case;
end $$;

-- Pairs of things of whose footprints a named predicate holds: reference, predicate, target, read in this order.
create or replace function semap.topology(p_predicate text, p_reference_ids bigint[],
                                          p_target_ids bigint[] default null)
returns table (reference_id bigint, target_id bigint)
language plpgsql stable parallel safe as $$
begin
  -- an unknown name is refused even where there is nothing to compare
  perform semap.holds(p_predicate, 'point(0 0)', 'point(0 0)');
  if lower(p_predicate) <> 'disjoint' then
    return query
      select p.reference_id, p.target_id from semap.footprint_pairs(p_reference_ids, p_target_ids) p
      where semap.holds(p_predicate, p.reference_area, p.target_area);
  else
    return query
      select p.reference_id, p.target_id from semap.footprint_product(p_reference_ids, p_target_ids) p
      where st_disjoint(p.reference_area, p.target_area);
  end if;
end $$;

-- Refuse what is no pattern of DE-9IM.
create or replace function semap.require_pattern(p_pattern text) returns void
language plpgsql immutable parallel safe as $$
begin
  if p_pattern !~ '^[TFtf012*]{9}$' then
    raise exception '% is no pattern of DE-9IM.', p_pattern
      using errcode = 'invalid_parameter_value', hint = 'Give nine of T, F, 0, 1, 2 and *, such as T*F**F***.';
  end if;
end $$;

-- The DE-9IM matrices of pairs of footprints, those that match a pattern (such as T*F**F***), or all. Pairs whose
-- boxes are apart are looked at only where the pattern admits what is disjoint.
create or replace function semap.relate(
  p_reference_ids bigint[], p_target_ids bigint[] default null, p_pattern text default null
) returns table (reference_id bigint, target_id bigint, matrix text)
language sql stable parallel safe as $$
  select semap.require_pattern(p_pattern);
  select p.reference_id, p.target_id, m.matrix
  from semap.footprint_pairs(p_reference_ids, p_target_ids) p
  -- computed once (tests/operators/test_operator_plan)
  cross join lateral (select st_relate(p.reference_area, p.target_area) as matrix offset 0) m
  where p_pattern is null or st_relatematch(m.matrix, p_pattern)
  union all
  select p.reference_id, p.target_id, 'FF2FF1212'
  from semap.footprint_product(p_reference_ids, p_target_ids) p
  where (p_pattern is null or st_relatematch('FF2FF1212', p_pattern))
    and not p.reference_area && p.target_area
$$;

-- The relation of two areas in the region connection calculus (Randell, Cui and Cohn 1992): DC, EC, PO, TPP, NTPP,
-- TPPI, NTPPI or EQ, read from their DE-9IM matrix; null where one of them is no area.
create or replace function semap.rcc8(p_a public.geometry, p_b public.geometry) returns text
language sql immutable parallel safe as $$
  select case
    when st_dimension(p_a) is distinct from 2 or st_dimension(p_b) is distinct from 2
         or st_isempty(p_a) or st_isempty(p_b) then null
    when not p_a && p_b or st_relatematch(matrix, 'FF*FF****') then 'DC'
    when st_relatematch(matrix, 'F********') then 'EC'
    when st_relatematch(matrix, '**F***F**') then 'EQ'
    when st_relatematch(matrix, '**F*T****') then 'TPP'
    when st_relatematch(matrix, '**F*F****') then 'NTPP'
    when st_relatematch(matrix, '****T*F**') then 'TPPI'
    when st_relatematch(matrix, '****F*F**') then 'NTPPI'
    else 'PO'
  end
  from (select st_relate(p_a, p_b) as matrix offset 0) m -- computed once (tests/operators/test_operator_plan)
$$;

-- The RCC-8 relations of pairs of footprints, those asked for, or all; pairs whose boxes are apart are looked at
-- only where DC is asked for.
create or replace function semap.rcc8_relations(
  p_reference_ids bigint[], p_target_ids bigint[] default null, p_relations text[] default null
) returns table (reference_id bigint, target_id bigint, relation text)
language sql stable parallel safe as $$
  select p.reference_id, p.target_id, r.relation
  from semap.footprint_pairs(p_reference_ids, p_target_ids) p
  -- computed once (tests/operators/test_operator_plan)
  cross join lateral (select semap.rcc8(p.reference_area, p.target_area) as relation offset 0) r
  where p_relations is null or r.relation = any (p_relations)
  union all
  select p.reference_id, p.target_id, 'DC'
  from semap.footprint_product(p_reference_ids, p_target_ids) p
  where (p_relations is null or 'DC' = any (p_relations)) and not p.reference_area && p.target_area
$$;
