-- Maintenance of instances and blueprints. What is derived follows by triggers.

-- Whether other instances look like this one too, or may: its description has a name or is used by another.
create or replace function semap.description_is_shared(p_description_id bigint, p_instance_id bigint) returns boolean
language sql stable as $$
  select exists (select from semap.description where description_id = p_description_id and name is not null)
      or exists (select from semap.instance
                 where relative_description_id = p_description_id and instance_id <> p_instance_id)
$$;

-- Delete an instance with its frame. What stands on it goes with it, or stays where it is, on what carried it.
create or replace function semap.delete_instance(p_instance_id bigint, p_with_carried boolean default false)
returns void
language plpgsql as $$
declare
  v_frame_id  bigint;
  v_parent_id  bigint;
  v_child     bigint;
  v_is_own    boolean;
begin
  perform semap.lock_regions_exclusive();
  select f.frame_id, f.parent_id,
         f.parent_id is not null and (select count(*) = 1 from semap.instance o where o.frame_id = f.frame_id)
  into v_frame_id, v_parent_id, v_is_own
  from semap.instance i join semap.frame f using (frame_id) where i.instance_id = p_instance_id;
  if not found then
    raise exception 'There is no instance %.', p_instance_id
      using errcode = 'no_data_found', hint = 'List the instances to see their ids.';
  end if;
  if not v_is_own then -- what stands on a frame that others share, or on a root, does not stand on this instance
    delete from semap.instance where instance_id = p_instance_id;
    return;
  end if;
  if p_with_carried then
    delete from semap.instance where frame_id in (select semap.frames_below(array[v_frame_id]));
    -- frames that carried others outlive their instances by the triggers, from the leaves up
    with recursive below (frame_id) as (
      select frame_id from semap.frame where parent_id = v_frame_id
      union all
      select f.frame_id from semap.frame f join below b on f.parent_id = b.frame_id
    )
    delete from semap.frame where frame_id in (select frame_id from below);
    delete from semap.frame where frame_id = v_frame_id and parent_id is not null;
    return;
  end if;
  for v_child in select frame_id from semap.frame where parent_id = v_frame_id order by frame_id loop
    perform semap.change_frame(v_child, v_parent_id);
  end loop;
  delete from semap.instance where instance_id = p_instance_id;
end $$;

-- A copy of an instance under another name, on the same frame at the same place; both look alike until one is reshaped.
create or replace function semap.copy_instance(p_instance_id bigint, p_name text) returns bigint
language plpgsql as $$
declare
  v_frame_id     bigint;
  v_instance_id  bigint;
begin
  perform semap.lock_regions_exclusive();
  insert into semap.frame (map_id, name, parent_id)
  select f.map_id, p_name, coalesce(f.parent_id, f.frame_id)
  from semap.instance i join semap.frame f using (frame_id) where i.instance_id = p_instance_id
  returning frame_id into v_frame_id;
  if v_frame_id is null then
    raise exception 'There is no instance %.', p_instance_id
      using errcode = 'no_data_found', hint = 'List the instances to see their ids.';
  end if;
  insert into semap.frame_pose (frame_id, stamp, x_m, y_m, z_m, qx, qy, qz, qw)
  select v_frame_id, '-infinity', (p).x_m, (p).y_m, (p).z_m, (p).qx, (p).qy, (p).qz, (p).qw
  from (select case when f.parent_id is null then row(0, 0, 0, 0, 0, 0, 1)::semap.pose
                    else semap.pose_at(i.frame_id) end as p
        from semap.instance i join semap.frame f using (frame_id) where i.instance_id = p_instance_id) now;
  insert into semap.instance (map_id, name, alias, concept_id, frame_id, relative_description_id, storey_id, attributes)
  select map_id, p_name, alias, concept_id, v_frame_id, relative_description_id, storey_id, attributes
  from semap.instance where instance_id = p_instance_id
  returning instance_id into v_instance_id;
  insert into semap.door_room (door_id, room_id)
  select v_instance_id, room_id from semap.door_room where door_id = p_instance_id
  union all
  select door_id, v_instance_id from semap.door_room where room_id = p_instance_id;
  return v_instance_id;
end $$;

-- Delete a blueprint. Its instances look like another one from then on, or (null) like nothing.
create or replace function semap.delete_description(p_description_id bigint, p_replacement_id bigint default null)
returns void
language plpgsql as $$
begin
  perform semap.lock_regions_exclusive();
  if p_replacement_id is not null then
    update semap.instance set relative_description_id = p_replacement_id, updated_at = clock_timestamp()
    where relative_description_id = p_description_id;
  end if;
  delete from semap.description where description_id = p_description_id and not is_absolute;
  if not found then
    raise exception 'There is no description %.', p_description_id
      using errcode = 'no_data_found', hint = 'List the descriptions of the map to see their ids.';
  end if;
end $$;
