-- Leaves of doors. A door that has a `leaf` in its attributes gets one row in door_leaf: where its hinge is in the map,
-- which way it opens, and its range of motion. In the door's own frame x runs along the doorway, with the origin in its
-- middle, and the leaf opens towards +y; the hinge is on the left (-x) or on the right (+x), as in IFC's
-- IfcDoorTypeOperationEnum. A door without a leaf is an opening and has no state.

-- What a leaf may say beside `hinge` and `at`, its limits, and what holds where it does not.
create or replace function semap.leaf_numbers()
returns table (key text, low double precision, high double precision, otherwise double precision)
language sql immutable parallel safe rows 9 as $$
  values ('width_m', 0.2, 10, null::double precision),
         ('max_deg', 10, 180, 100),
         ('opening_above_deg', 1, 60, 10),
         ('open_from_deg', 5, 180, 70),
         ('turns_by_deg', 1, 60, 8),
         ('closed_below_deg', 0.5, 45, 6),
         ('rests_within_deg', 0.1, 20, 3),
         ('rests_for_s', 0.05, 60, 0.4)
$$;

-- The leaf of a door as a mapping, also where only its side is told; null where there is none.
create or replace function semap.leaf_declared(p_attributes jsonb) returns jsonb
language sql immutable parallel safe as $$
  select case jsonb_typeof(p_attributes -> 'leaf')
           when 'null' then null
           when 'string' then jsonb_build_object('hinge', p_attributes -> 'leaf')
           else p_attributes -> 'leaf' end
$$;

-- A number that a leaf says, or what holds where it says none.
create or replace function semap.leaf_number(p_leaf jsonb, p_key text) returns double precision
language sql immutable parallel safe as $$
  select coalesce((p_leaf ->> p_key)::double precision, n.otherwise) from semap.leaf_numbers() n where n.key = p_key
$$;

-- What is wrong with a leaf; null where it is right.
create or replace function semap.leaf_fault(p_leaf jsonb) returns text
language plpgsql immutable strict parallel safe as $$
declare
  v_fault  text;
begin
  if jsonb_typeof(p_leaf) <> 'object' then
    return 'it is neither a side nor a mapping';
  elsif coalesce(p_leaf ->> 'hinge', '') not in ('left', 'right') then
    return 'its hinge is neither left nor right';
  end if;
  select format('there is no %s in a leaf', k) into v_fault
  from jsonb_object_keys(p_leaf) k
  where k not in ('hinge', 'at') and k not in (select key from semap.leaf_numbers()) limit 1;
  if v_fault is not null then
    return v_fault;
  end if;
  select format('its %s is no number from %s to %s', n.key, n.low, n.high) into v_fault
  from semap.leaf_numbers() n
  where p_leaf ? n.key
    and case when jsonb_typeof(p_leaf -> n.key) = 'number' then (p_leaf -> n.key)::numeric not between n.low and n.high
             else true end
  limit 1;
  if v_fault is not null then
    return v_fault;
  elsif p_leaf ? 'at' and not (
          jsonb_path_match(p_leaf, '$.at.type() == "array" && $.at.size() == 2') and jsonb_path_match(
          p_leaf, '!exists ($.at[*] ? (@.type() != "number" || @ > 100 || @ < -100))')) then
    return 'its at is no point [x, y] within 100 m';
  elsif semap.leaf_number(p_leaf, 'closed_below_deg') >= semap.leaf_number(p_leaf, 'opening_above_deg')
     or semap.leaf_number(p_leaf, 'opening_above_deg') >= semap.leaf_number(p_leaf, 'max_deg') then
    return 'closed_below_deg, opening_above_deg and max_deg do not rise';
  end if;
  return null;
end $$;

-- The range of motion of a leaf: the sector that it sweeps around its hinge, from a little before closed to a little
-- beyond its largest angle, with a margin around for the thickness of the leaf and for what a map and a laser err.
create or replace function semap.range_of_motion(
  p_hinge_x_m double precision, p_hinge_y_m double precision, p_closed_rad double precision, p_sense integer,
  p_width_m double precision, p_max_rad double precision, p_margin_m double precision default 0.12
) returns public.geometry
language sql immutable parallel safe as $$
  select public.st_buffer(
    public.st_makepolygon(public.st_makeline(
      array[public.st_point(p_hinge_x_m, p_hinge_y_m)]
      || array(select public.st_point(p_hinge_x_m + p_width_m * cos(p_closed_rad + p_sense * angle_rad),
                                      p_hinge_y_m + p_width_m * sin(p_closed_rad + p_sense * angle_rad))
               from generate_series(0, steps) step,
                    lateral (select radians(-5) + (p_max_rad + radians(15)) * step / steps as angle_rad) a
               order by step)
      || public.st_point(p_hinge_x_m, p_hinge_y_m))),
    p_margin_m, 'quad_segs=4')
  from (select ceil(degrees(p_max_rad) / 5)::integer as steps) s
$$;

-- The leaves of these doors as they should be. A door has a width of its own, or that of its shape, whose middle is
-- then the middle of the doorway. Its heights are those of its shape, or begin where it stands. A door that is tilted,
-- is nowhere, or has no width has no leaf; nor has what became a door while something else was said of its leaf.
create or replace function semap.leaves_wanted(p_instance_ids bigint[])
returns table (
  instance_id bigint, map_id integer, hinge_x_m double precision, hinge_y_m double precision,
  closed_rad double precision, sense smallint, width_m double precision, max_rad double precision,
  z_min_m double precision, z_max_m double precision,
  opening_above_rad double precision, open_from_rad double precision, turns_by_rad double precision,
  closed_below_rad double precision, rests_within_rad double precision, rests_for interval,
  range_of_motion public.geometry
)
language sql stable set search_path = public, pg_temp as $$
  with door as (
    select i.instance_id, i.map_id, i.relative_description_id, i.absolute_description_id, i.frame_id, d.leaf,
           semap.length_said(i.attributes, 'width_m') as width_m,
           semap.length_said(i.attributes, 'height_m') as height_m
    from semap.instance i,
         lateral (select case when semap.leaf_fault(l) is null then l end as leaf
                  from semap.leaf_declared(i.attributes) l offset 0) d
    where i.instance_id = any (p_instance_ids) and d.leaf is not null
      and i.concept_id in (select semap.concepts_below(semap.concept_named('Door')))
  ), placed as materialized (
    select p.frame_id, p.pose
    from semap.frames_in_root(array(select frame_id from door)) p
    join semap.frame root on root.frame_id = p.root_id and root.name = 'map'
    where p.pose is not null and semap.is_upright(p.pose)
  ), measured as (
    select d.instance_id, d.map_id, d.leaf, p.pose, m.width_m,
           case when d.leaf ->> 'hinge' = 'left' then 1 else -1 end as sense,
           case when d.leaf ? 'at' then (d.leaf #>> '{at,0}')::double precision
                when d.width_m is null then coalesce(s.x_m, 0) else 0 end as x_m,
           case when d.leaf ? 'at' then (d.leaf #>> '{at,1}')::double precision
                when d.width_m is null then coalesce(s.y_m, 0) else 0 end as y_m,
           coalesce(b.z_min_m, (p.pose).z_m) as z_min_m,
           coalesce(b.z_max_m, (p.pose).z_m + coalesce(d.height_m, 2)) as z_max_m
    from door d
    join placed p using (frame_id)
    left join semap.abstraction b on b.description_id = d.absolute_description_id and b.type = 'Footprint'
    left join lateral (
      select st_xmax(a.geometry) - st_xmin(a.geometry) as width_m,
             (st_xmax(a.geometry) + st_xmin(a.geometry)) / 2 as x_m,
             (st_ymax(a.geometry) + st_ymin(a.geometry)) / 2 as y_m
      from semap.abstraction a
      where a.description_id = d.relative_description_id and a.type = 'Footprint') s on true
    cross join lateral (
      select coalesce(semap.leaf_number(d.leaf, 'width_m'), d.width_m, nullif(s.width_m, 0)) as width_m) m
    where m.width_m between 0.2 and 10
  )
  select m.instance_id, m.map_id, h.x_m, h.y_m, c.closed_rad, m.sense::smallint, m.width_m, a.max_rad, m.z_min_m,
         m.z_max_m,
         radians(semap.leaf_number(m.leaf, 'opening_above_deg')),
         least(radians(semap.leaf_number(m.leaf, 'open_from_deg')), 0.75 * a.max_rad),
         radians(semap.leaf_number(m.leaf, 'turns_by_deg')), radians(semap.leaf_number(m.leaf, 'closed_below_deg')),
         radians(semap.leaf_number(m.leaf, 'rests_within_deg')),
         make_interval(secs => semap.leaf_number(m.leaf, 'rests_for_s')),
         semap.range_of_motion(h.x_m, h.y_m, c.closed_rad, m.sense, m.width_m, a.max_rad)
  from measured m
  cross join lateral (select radians(semap.leaf_number(m.leaf, 'max_deg')) as max_rad) a
  cross join lateral (select semap.yaw(m.pose) + case when m.sense = 1 then 0 else pi() end as closed_rad) c
  cross join lateral semap.carry(m.pose, m.x_m - m.sense * m.width_m / 2, m.y_m, 0) h
$$;

-- Bring the leaves of these doors in line with the map. One that is another now has its state to be seen anew.
create or replace function semap.refresh_leaves(p_instance_ids bigint[]) returns void
language plpgsql set search_path = public, pg_temp as $$
begin
  if p_instance_ids is null then
    return;
  end if;
  perform semap.lock_regions_exclusive();
  with wanted as materialized (
    select * from semap.leaves_wanted(p_instance_ids)
  ), gone as (
    delete from semap.door_leaf l
    where l.instance_id = any (p_instance_ids) and not exists (select from wanted w where w.instance_id = l.instance_id)
  ), changed as (
    insert into semap.door_leaf as l select * from wanted
    on conflict (instance_id) do update
    set map_id = excluded.map_id, hinge_x_m = excluded.hinge_x_m, hinge_y_m = excluded.hinge_y_m,
        closed_rad = excluded.closed_rad, sense = excluded.sense, width_m = excluded.width_m,
        max_rad = excluded.max_rad,
        z_min_m = excluded.z_min_m, z_max_m = excluded.z_max_m,
        opening_above_rad = excluded.opening_above_rad, open_from_rad = excluded.open_from_rad,
        turns_by_rad = excluded.turns_by_rad, closed_below_rad = excluded.closed_below_rad,
        rests_within_rad = excluded.rests_within_rad, rests_for = excluded.rests_for,
        range_of_motion = excluded.range_of_motion
    where to_jsonb(l) is distinct from to_jsonb(excluded)
    returning instance_id
  )
  insert into semap.door_now as n (instance_id) select instance_id from changed
  on conflict (instance_id) do update
  set state = null, since = null, angle_rad = null, angle_std_rad = null,
      extreme_rad = null, rest_rad = null, rest_since = null, doubt = null;
end $$;

-- Doors with a leaf were added or changed. What a leaf says must be right.
create or replace function semap.door_changed() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_door  record;
begin
  select n.name, f.fault into v_door
  from new_row n, lateral (select semap.leaf_fault(semap.leaf_declared(n.attributes)) as fault) f
  where n.attributes ? 'leaf' and f.fault is not null
    and n.concept_id in (select semap.concepts_below(semap.concept_named('Door')))
  order by n.name limit 1;
  if found then
    raise exception 'The leaf of % is wrong: %.', v_door.name, v_door.fault
      using errcode = 'check_violation', hint = 'Write leaf: left, or leaf: {hinge: right, max_deg: 95}.';
  end if;
  perform semap.refresh_leaves(array_agg(n.instance_id)) from new_row n
  where n.attributes ? 'leaf' or exists (select from semap.door_leaf l where l.instance_id = n.instance_id);
  return null;
end $$;

create or replace trigger door_inserted after insert on semap.instance
  referencing new table as new_row for each statement execute function semap.door_changed();
create or replace trigger door_updated after update on semap.instance
  referencing new table as new_row for each statement execute function semap.door_changed();

-- A frame moved: so did the doors on it.
create or replace function semap.door_moved() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  if tg_op = 'DELETE' then
    perform semap.refresh_leaves(array_agg(i.instance_id))
    from semap.frames_below(array(select frame_id from old_row)) below (frame_id) join semap.instance i using (frame_id)
    where i.attributes ? 'leaf';
  else
    perform semap.refresh_leaves(array_agg(i.instance_id))
    from semap.frames_below(array(select frame_id from new_row)) below (frame_id) join semap.instance i using (frame_id)
    where i.attributes ? 'leaf';
  end if;
  return null;
end $$;

create or replace trigger door_moved_updated after update on semap.frame
  referencing new table as new_row for each statement execute function semap.door_moved();
create or replace trigger door_moved_inserted after insert on semap.frame_pose
  referencing new table as new_row for each statement execute function semap.door_moved();
create or replace trigger door_moved_updated after update on semap.frame_pose
  referencing new table as new_row for each statement execute function semap.door_moved();
create or replace trigger door_moved_deleted after delete on semap.frame_pose
  referencing old table as old_row for each statement execute function semap.door_moved();

-- A door looks different now: its leaf may have another width, or other heights.
create or replace function semap.door_reshaped() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  if tg_op = 'DELETE' then
    perform semap.refresh_leaves(array_agg(i.instance_id)) from semap.instance i
    where i.attributes ? 'leaf' and i.absolute_description_id in (select description_id from old_row
                                                                  where type = 'Footprint');
  else
    perform semap.refresh_leaves(array_agg(i.instance_id)) from semap.instance i
    where i.attributes ? 'leaf' and i.absolute_description_id in (select description_id from new_row
                                                                  where type = 'Footprint');
  end if;
  return null;
end $$;

create or replace trigger door_reshaped_inserted after insert on semap.abstraction
  referencing new table as new_row for each statement execute function semap.door_reshaped();
create or replace trigger door_reshaped_updated after update on semap.abstraction
  referencing new table as new_row for each statement execute function semap.door_reshaped();
create or replace trigger door_reshaped_deleted after delete on semap.abstraction
  referencing old table as old_row for each statement execute function semap.door_reshaped();

-- What is a door may be others now.
create or replace function semap.doors_reconsidered() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  perform semap.refresh_leaves(array_agg(instance_id)) from semap.instance where attributes ? 'leaf';
  return null;
end $$;

create or replace trigger doors_reconsidered after update of name on semap.concept
  for each statement execute function semap.doors_reconsidered();
create or replace trigger doors_reconsidered after insert or update or delete on semap.concept_parent
  for each statement execute function semap.doors_reconsidered();

-- What maps said of leaves before this version knew them, or made something else of them.
do $$
begin
  perform semap.refresh_leaves(array_agg(instance_id)) from semap.instance where attributes ? 'leaf';
end $$;
