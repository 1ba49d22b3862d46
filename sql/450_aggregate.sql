-- What is in what, over all levels. A target is directly in a container of the same map
--   footprint: where its position (Position2D) lies in the container's footprint or on its border, its own footprint
--              is the smaller one, and its height (of Position3D, or the middle of its band) is in the
--              container's band;
--   storey:    where the container is its storey;
--   frame:     where its frame stands below the container's own, other than a root.

-- What is directly in these containers, and by which of footprint, storey and frame; a null height or band is every
-- height.
create or replace function semap.direct_contents(
  p_container_ids bigint[], p_target_ids bigint[] default null,
  p_links text[] default array['footprint', 'storey', 'frame']
) returns table (container_id bigint, target_id bigint, link text)
language sql stable parallel safe set search_path = public, pg_temp as $$
  with recursive below (container_id, frame_id) as (
    select c.instance_id, f.frame_id
    from semap.instance c
    join semap.frame own on own.frame_id = c.frame_id and own.parent_id is not null
    join semap.frame f on f.parent_id = own.frame_id
    where c.instance_id = any (p_container_ids) and 'frame' = any (p_links)
    union
    select b.container_id, f.frame_id from below b join semap.frame f on f.parent_id = b.frame_id
  )
  select c.instance_id, p.instance_id, 'footprint'
  from semap.abstraction c
  join semap.instance ci on ci.instance_id = c.instance_id
  join semap.abstraction p
    on p.type = 'Position2D' and p.instance_id is not null and p.instance_id <> c.instance_id
       and st_covers(c.geometry, p.geometry)
  join semap.instance ti on ti.instance_id = p.instance_id and ti.map_id = ci.map_id
  left join semap.abstraction f on f.instance_id = p.instance_id and f.type = 'Footprint'
  left join semap.abstraction p3 on p3.instance_id = p.instance_id and p3.type = 'Position3D'
  cross join lateral (select coalesce(st_z(p3.geometry), (p.z_min_m + p.z_max_m) / 2) as z_m) h
  where c.type = 'Footprint' and c.instance_id = any (p_container_ids) and 'footprint' = any (p_links)
    and (p_target_ids is null or p.instance_id = any (p_target_ids))
    and coalesce(st_area(f.geometry), 0) < st_area(c.geometry)
    and (h.z_m is null or (c.z_min_m is null or h.z_m >= c.z_min_m) and (c.z_max_m is null or h.z_m < c.z_max_m))
  union all
  select storey_id, instance_id, 'storey'
  from semap.instance
  where storey_id = any (p_container_ids) and storey_id <> instance_id and 'storey' = any (p_links)
    and (p_target_ids is null or instance_id = any (p_target_ids))
  union all
  select b.container_id, t.instance_id, 'frame'
  from below b join semap.instance t on t.frame_id = b.frame_id
  where p_target_ids is null or t.instance_id = any (p_target_ids)
$$;

-- What is in these containers over all levels, each once: at its lowest level, with the container right around it
-- there. From the second level on only spaces contain by their footprints: what lies under a desk of a room need not
-- be in that room. p_links says which of 'footprint', 'storey' and 'frame' count.
create or replace function semap.contained_in(
  p_container_ids bigint[], p_target_ids bigint[] default null,
  p_links text[] default array['footprint', 'storey', 'frame']
) returns table (container_id bigint, target_id bigint, level integer, via_id bigint, link text)
language plpgsql stable parallel safe set search_path = public, pg_temp as $$
declare
  v_containers  bigint[] := array(select distinct id from unnest(p_container_ids) id where id is not null);
  v_inner       bigint[] := v_containers;
  v_seen        bigint[] := v_containers;  -- pairs of v_seen_in and v_seen
  v_seen_in     bigint[] := v_containers;
  v_spaces      integer[] := array(select semap.concepts_below(semap.concept_named('Space')));
  v_found       record;
begin
  level := 0;
  while cardinality(v_containers) > 0 loop
    level := level + 1;
    select array_agg(f.outer_id order by f.outer_id, f.target_id) as containers,
           array_agg(f.target_id order by f.outer_id, f.target_id) as targets,
           array_agg(f.via_id order by f.outer_id, f.target_id) as vias,
           array_agg(f.link order by f.outer_id, f.target_id) as links
    into v_found
    from (
      select distinct on (n.outer_id, d.target_id) n.outer_id, d.target_id, n.inner_id as via_id, d.link
      from unnest(v_containers, v_inner) n (outer_id, inner_id)
      join (
        select * from semap.direct_contents(
          array(select i.instance_id from semap.instance i
                where i.instance_id = any (v_inner) and (level = 1 or i.concept_id = any (v_spaces))), null, p_links)
        union all
        select * from semap.direct_contents(
          array(select i.instance_id from semap.instance i
                where i.instance_id = any (v_inner) and level > 1 and i.concept_id <> all (v_spaces)), null,
          array_remove(p_links, 'footprint'))
      ) d on d.container_id = n.inner_id
      -- by its hash, whatever is expected of the arrays
      where (n.outer_id, d.target_id) not in (select * from unnest(v_seen_in, v_seen))
      order by n.outer_id, d.target_id, d.link, n.inner_id) f;
    v_containers := v_found.containers;
    v_inner := v_found.targets;
    v_seen_in := v_seen_in || v_found.containers;
    v_seen := v_seen || v_found.targets;
    return query
      select f.container_id, f.target_id, level, f.via_id, f.link
      from unnest(v_found.containers, v_found.targets, v_found.vias,
                  v_found.links) f (container_id, target_id, via_id, link)
      where p_target_ids is null or f.target_id = any (p_target_ids);
  end loop;
end $$;

-- How many of the targets are in each container over all levels, where they are at least and at most so many.
create or replace function semap.counted_in(
  p_container_ids bigint[], p_target_ids bigint[] default null, p_at_least integer default 1,
  p_at_most integer default null
) returns table (container_id bigint, targets integer)
language sql stable parallel safe set search_path = public, pg_temp as $$
  select c.instance_id, count(t.target_id)::integer
  from semap.instance c
  left join semap.contained_in(p_container_ids, p_target_ids) t on t.container_id = c.instance_id
  where c.instance_id = any (p_container_ids)
  group by c.instance_id
  having count(t.target_id) >= p_at_least and (p_at_most is null or count(t.target_id) <= p_at_most)
$$;
