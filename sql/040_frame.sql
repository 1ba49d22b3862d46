-- The tree of frames. The pose of a frame with '-infinity' as its stamp holds from the beginning of time; later
-- ones are where it was when, with slerp between them. After the newest it stays where it is, and before the
-- oldest it is nowhere: nothing is extrapolated.

-- parent_T_frame at a time ('infinity': now); null before the first pose.
create or replace function semap.pose_at(p_frame_id bigint, p_at timestamptz default 'infinity') returns semap.pose
language sql stable parallel safe as $$
  select case
    when b.stamp is null or a.stamp = '-infinity' or a.stamp = p_at then
      row(a.x_m, a.y_m, a.z_m, a.qx, a.qy, a.qz, a.qw)::semap.pose
    else
      semap.interpolate(row(a.x_m, a.y_m, a.z_m, a.qx, a.qy, a.qz, a.qw)::semap.pose,
                        row(b.x_m, b.y_m, b.z_m, b.qx, b.qy, b.qz, b.qw)::semap.pose,
                        extract(epoch from p_at - a.stamp)::double precision
                        / extract(epoch from b.stamp - a.stamp)::double precision)
  end
  from (select * from semap.frame_pose where frame_id = p_frame_id and stamp <= p_at
        order by stamp desc limit 1) a
  left join lateral (select * from semap.frame_pose where frame_id = p_frame_id and stamp > p_at
                     order by stamp limit 1) b on true
$$;

-- root_T_frame of each frame at a time, with the root of its tree; null where a frame on the way was nowhere.
create or replace function semap.frames_in_root(p_frame_ids bigint[], p_at timestamptz default 'infinity')
returns table (frame_id bigint, root_id bigint, pose semap.pose)
language sql stable parallel safe as $$
  with recursive chain (start_id, frame_id, parent_id, pose) as (
    select f.frame_id, f.frame_id, f.parent_id, semap.pose_at(f.frame_id, p_at)
    from semap.frame f where f.frame_id = any (p_frame_ids)
    union all
    select c.start_id, f.frame_id, f.parent_id, semap.compose(semap.pose_at(f.frame_id, p_at), c.pose)
    from chain c join semap.frame f on f.frame_id = c.parent_id
  )
  select c.start_id, c.frame_id, c.pose from chain c where c.parent_id is null
$$;

-- Where the origin of a frame is in the root of its tree, now.
create or replace function semap.origin_in_root(p_frame_id bigint) returns public.geometry
language sql stable parallel safe as $$
  select public.st_makepoint((r.pose).x_m, (r.pose).y_m, (r.pose).z_m)
  from semap.frames_in_root(array[p_frame_id]) r
$$;

-- The frames themselves and every frame below them.
create or replace function semap.frames_below(p_frame_ids bigint[]) returns setof bigint
language sql stable parallel safe as $$
  with recursive below (frame_id) as (
    select unnest(p_frame_ids)
    union
    select f.frame_id from semap.frame f join below b on f.parent_id = b.frame_id
  )
  select frame_id from below
$$;

-- a_T_b between any two frames of one tree at a time ('infinity': now): maps points of b to a.
create or replace function semap.transform(p_a_id bigint, p_b_id bigint, p_at timestamptz default 'infinity')
returns semap.pose
language plpgsql stable parallel safe as $$
declare
  v_a  record;
  v_b  record;
begin
  select * into v_a from semap.frames_in_root(array[p_a_id], p_at);
  select * into v_b from semap.frames_in_root(array[p_b_id], p_at);
  if v_a.frame_id is null or v_b.frame_id is null then
    raise exception 'There is no frame %.', case when v_a.frame_id is null then p_a_id else p_b_id end
      using errcode = 'no_data_found', hint = 'List the frames of the map to see their ids.';
  end if;
  if v_a.root_id <> v_b.root_id then
    raise exception 'The frames % and % are in different trees.', p_a_id, p_b_id
      using errcode = 'invalid_parameter_value', hint = 'Put one root below a frame of the other tree.';
  end if;
  if v_a.pose is null or v_b.pose is null then
    raise exception 'At % one of the frames had no pose yet.', p_at
      using errcode = 'invalid_parameter_value', hint = 'Ask for a time after the first pose of each frame.';
  end if;
  return semap.compose(semap.inverse(v_a.pose), v_b.pose);
end $$;

-- Refuse the root of a map's things, which all of them stand on.
create or replace function semap.require_movable(p_frame_id bigint) returns void
language plpgsql stable as $$
begin
  if exists (select from semap.frame where frame_id = p_frame_id and parent_id is null and name = 'map') then
    raise exception 'The root frame of a map stays as it is.'
      using errcode = 'unique_violation', hint = 'Work with a frame below it.';
  end if;
end $$;

-- Set parent_T_frame from a time on ('-infinity': as its static pose).
create or replace function semap.set_transform(
  p_frame_id bigint, p_pose semap.pose, p_stamp timestamptz default '-infinity'
) returns void
language sql as $$
  select semap.require_movable(p_frame_id);
  insert into semap.frame_pose (frame_id, stamp, x_m, y_m, z_m, qx, qy, qz, qw)
  select p_frame_id, p_stamp, semap.snapped((p_pose).x_m), semap.snapped((p_pose).y_m), semap.snapped((p_pose).z_m),
         qx / length, qy / length, qz / length, qw / length
  from (select semap.snapped((p_pose).qx) as qx, semap.snapped((p_pose).qy) as qy,
               semap.snapped((p_pose).qz) as qz, semap.snapped((p_pose).qw) as qw) q,
       lateral (select sqrt(qx * qx + qy * qy + qz * qz + qw * qw) as length) l
  on conflict (frame_id, stamp) do update
  set x_m = excluded.x_m, y_m = excluded.y_m, z_m = excluded.z_m,
      qx = excluded.qx, qy = excluded.qy, qz = excluded.qz, qw = excluded.qw
$$;

-- Put a frame below another one: it stays where it is in the world, now and where it was at each of its stamps, or
-- keeps its local transform and moves with its new parent.
create or replace function semap.change_frame(p_frame_id bigint, p_parent_id bigint, p_keep_world boolean default true)
returns void
language plpgsql as $$
begin
  perform semap.lock_regions_exclusive();
  perform semap.require_movable(p_frame_id);
  if p_keep_world then
    -- where the new parent was nowhere, the frame is from then on nowhere too
    delete from semap.frame_pose p
    where p.frame_id = p_frame_id and p_parent_id is not null and p.stamp > '-infinity'
      and p.stamp < (select max(stamp) from semap.frame_pose where frame_id = p_frame_id)
      and not coalesce((select pose is not null from semap.frames_in_root(array[p_parent_id], p.stamp)), false);
    update semap.frame_pose p
    set x_m = (new.pose).x_m, y_m = (new.pose).y_m, z_m = (new.pose).z_m,
        qx = (new.pose).qx, qy = (new.pose).qy, qz = (new.pose).qz, qw = (new.pose).qw
    from (
      select old.stamp,
             semap.compose(
               case when p_parent_id is null then row(0, 0, 0, 0, 0, 0, 1)::semap.pose
                    else semap.inverse((select pose from semap.frames_in_root(array[p_parent_id], old.at))) end,
               (select pose from semap.frames_in_root(array[p_frame_id], old.at))) as pose
      from (select stamp,
                   case when stamp = '-infinity' or stamp = max(stamp) over () then 'infinity' else stamp end as at
            from semap.frame_pose where frame_id = p_frame_id) old
    ) new
    where p.frame_id = p_frame_id and p.stamp = new.stamp and new.pose is not null;
  end if;
  update semap.frame set parent_id = p_parent_id where frame_id = p_frame_id;
end $$;

-- Refuse a frame below itself, or below a frame of another map.
create or replace function semap.frame_checked() returns trigger
language plpgsql set search_path = public, pg_temp as $$
declare
  v_frame  record;
begin
  with recursive above (start_id, frame_id) as ( -- of all at once, and no frame twice
    select frame_id, parent_id from new_row where parent_id is not null
    union
    select a.start_id, f.parent_id from above a join semap.frame f using (frame_id) where f.parent_id is not null
  )
  select n.name, p.name as parent, p.map_id <> n.map_id as is_foreign into v_frame
  from new_row n join semap.frame p on p.frame_id = n.parent_id
  where p.map_id <> n.map_id or n.frame_id in (select start_id from above where frame_id = start_id)
  limit 1;
  if found then
    raise exception '% cannot be put below %, %.', v_frame.name, v_frame.parent,
      case when v_frame.is_foreign then 'which is on another map' else 'which stands on it' end
      using errcode = 'check_violation', hint = 'Choose a frame of the same map that does not stand on this one.';
  end if;
  return null;
end $$;

create or replace trigger frame_checked_insert after insert on semap.frame
  referencing new table as new_row for each statement execute function semap.frame_checked();
create or replace trigger frame_checked_update after update on semap.frame
  referencing new table as new_row for each statement execute function semap.frame_checked();
