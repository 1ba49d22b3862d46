-- Spatial relations as frame structure, and back: what lies on or in a thing gets its frame below that thing's, and
-- moves with it from then on. Nothing moves in the map by that. Only a frame that is an instance's own is put
-- elsewhere or carries: not a root, and none on which several instances stand.

-- Whether a frame is that of one instance alone.
create or replace function semap.is_own_frame(p_frame_id bigint) returns boolean
language sql stable parallel safe as $$
  select exists (select from semap.frame where frame_id = p_frame_id and parent_id is not null)
     and (select count(*) = 1 from semap.instance where frame_id = p_frame_id)
$$;

-- Put the frame of each target below the frame of its reference, both keeping their places; says what was done.
-- Of several references of a target the first that may carry it counts.
create or replace function semap.carry_by(p_reference_ids bigint[], p_target_ids bigint[])
returns table (target_id bigint, reference_id bigint, outcome text)
language plpgsql as $$
declare
  v_pair  record;
  v_done  bigint[] := array[]::bigint[];
begin
  for v_pair in
    select p.reference_id, p.target_id, r.frame_id as reference_frame_id, t.frame_id as target_frame_id,
           row_number() over (partition by p.target_id order by p.place desc) = 1 as is_last
    from unnest(p_reference_ids, p_target_ids) with ordinality p (reference_id, target_id, place)
    join semap.instance r on r.instance_id = p.reference_id
    join semap.instance t on t.instance_id = p.target_id
    order by p.target_id, p.place
  loop
    continue when v_pair.target_id = any (v_done);
    reference_id := v_pair.reference_id;
    target_id := v_pair.target_id;
    outcome := case
      when not semap.is_own_frame(v_pair.target_frame_id) then 'kept: its frame is not its own'
      when not semap.is_own_frame(v_pair.reference_frame_id) then 'kept: the frame below is not that of one thing'
      when v_pair.reference_frame_id in (select semap.frames_below(array[v_pair.target_frame_id]))
        then 'kept: it carries what would carry it'
      when exists (select from semap.frame where frame_id = v_pair.target_frame_id
                                             and parent_id = v_pair.reference_frame_id) then 'carried already'
      else 'carried' end;
    if outcome = 'carried' then
      perform semap.change_frame(v_pair.target_frame_id, v_pair.reference_frame_id);
    end if;
    if outcome not like 'kept%' or v_pair.is_last then
      v_done := v_done || v_pair.target_id;
      return next;
    end if;
  end loop;
end $$;

-- Let what lies on a thing (semap.on_objects) be carried by it, without moving anything; says what was put where. Of
-- several supports the one counts that shares most of the target's footprint, then the smallest.
create or replace function semap.structure_by_support(
  p_map_id integer, p_ids bigint[] default null, p_reference_ids bigint[] default null
) returns table (target_id bigint, reference_id bigint, outcome text)
language plpgsql set search_path = public, pg_temp as $$
declare
  v_all    bigint[] := array(select instance_id from semap.instance where map_id = p_map_id);
  v_pairs  record;
begin
  perform semap.lock_regions_exclusive();
  select array_agg(s.reference_id order by s.target_id, common_m2 desc nulls last, st_area(r.geometry), s.reference_id)
           as refs,
         array_agg(s.target_id order by s.target_id, common_m2 desc nulls last, st_area(r.geometry), s.reference_id)
           as targets
  into v_pairs
  from (select distinct o.reference_id, o.target_id
        from semap.on_objects(coalesce(p_reference_ids, v_all), coalesce(p_ids, v_all)) o) s
  left join semap.abstraction r on r.instance_id = s.reference_id and r.type = 'Footprint'
  left join semap.abstraction t on t.instance_id = s.target_id and t.type = 'Footprint'
  cross join lateral (select round(st_area(st_intersection(r.geometry, t.geometry))::numeric, 6) as common_m2) c;
  return query select c.target_id, c.reference_id, c.outcome from semap.carry_by(v_pairs.refs, v_pairs.targets) c;
end $$;

-- Let what is in a thing, by its footprint and heights (semap.direct_contents), be carried by it, without moving
-- anything: by the smallest thing that it is in.
create or replace function semap.structure_by_containment(
  p_map_id integer, p_ids bigint[] default null, p_reference_ids bigint[] default null
) returns table (target_id bigint, reference_id bigint, outcome text)
language plpgsql set search_path = public, pg_temp as $$
declare
  v_all    bigint[] := array(select instance_id from semap.instance where map_id = p_map_id);
  v_pairs  record;
begin
  perform semap.lock_regions_exclusive();
  select array_agg(d.container_id order by d.target_id, st_area(c.geometry), d.container_id) as refs,
         array_agg(d.target_id order by d.target_id, st_area(c.geometry), d.container_id) as targets
  into v_pairs
  from semap.direct_contents(coalesce(p_reference_ids, v_all), coalesce(p_ids, v_all)) d
  join semap.abstraction c on c.instance_id = d.container_id and c.type = 'Footprint'
  where d.link = 'footprint';
  return query select c.target_id, c.reference_id, c.outcome from semap.carry_by(v_pairs.refs, v_pairs.targets) c;
end $$;

-- Put the frames of these instances right below the root of their tree, where they stand; says what was done.
create or replace function semap.unstructure(p_ids bigint[])
returns table (target_id bigint, outcome text)
language plpgsql as $$
declare
  v_each  record;
begin
  perform semap.lock_regions_exclusive();
  for v_each in
    select i.instance_id, i.frame_id, f.parent_id, r.root_id
    from semap.instance i join semap.frame f using (frame_id)
    join semap.frames_in_root(array(select frame_id from semap.instance where instance_id = any (p_ids))) r
      using (frame_id)
    where i.instance_id = any (p_ids)
    order by i.instance_id
  loop
    target_id := v_each.instance_id;
    outcome := case when not semap.is_own_frame(v_each.frame_id) then 'kept: its frame is not its own'
                    when v_each.parent_id = v_each.root_id then 'free already' else 'freed' end;
    if outcome = 'freed' then
      perform semap.change_frame(v_each.frame_id, v_each.root_id);
    end if;
    return next;
  end loop;
end $$;
