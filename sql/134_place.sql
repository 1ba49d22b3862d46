-- Where tracks are, while track_now is written late (sql/135).

-- Write the place of each live track of these sources that has a newer one.
create or replace function semap.settle_places(p_source_ids integer[]) returns void
language plpgsql as $$
declare
  v_count  semap.source_count;
begin
  for v_count in
    select * from semap.source_count
    where source_id = any (p_source_ids) and frame_stamp > placed_stamp order by source_id
  loop
    update semap.track_now t
    set stamp = s.stamp, x_m = s.x_m, y_m = s.y_m, z_m = s.z_m,
        std_m = s.std_m, std_across_m = s.std_across_m, std_yaw_rad = s.std_yaw_rad,
        heading_rad = s.heading_rad, speed_mps = s.speed_mps, length_m = s.length_m, width_m = s.width_m
    from semap.framed_state s
    where t.live and t.stamp < v_count.frame_stamp
      and s.source_id = v_count.source_id and s.stamp = v_count.frame_stamp and s.track_id = t.track_id;
    update semap.track_now t
    set stamp = s.stamp, x_m = s.x_m, y_m = s.y_m, z_m = s.z_m,
        std_m = s.std_m, std_across_m = s.std_across_m, std_yaw_rad = s.std_yaw_rad,
        heading_rad = s.heading_rad, speed_mps = s.speed_mps, length_m = s.length_m, width_m = s.width_m
    from semap.track_state s
    where t.source_id = v_count.source_id and t.live and t.stamp < v_count.frame_stamp
      and s.stamp = v_count.frame_stamp and s.track_id = t.track_id;
    -- a state that was packed meanwhile
    update semap.track_now t
    set stamp = s.stamp, x_m = s.x_m, y_m = s.y_m, z_m = s.z_m,
        std_m = s.std_m, std_across_m = s.std_across_m, std_yaw_rad = s.std_yaw_rad,
        heading_rad = s.heading_rad, speed_mps = s.speed_mps, length_m = s.length_m, width_m = s.width_m
    from semap.track_now n
    cross join lateral semap.state_before(n.track_id, v_count.frame_stamp, v_count.frame_stamp) s
    where n.source_id = v_count.source_id and n.live and n.stamp < v_count.frame_stamp and t.track_id = n.track_id;
    update semap.source_count set placed_stamp = frame_stamp where source_id = v_count.source_id;
  end loop;
end $$;

-- Write where all tracks of these maps are.
create or replace function semap.settle_maps(p_map_ids integer[]) returns void
language sql as $$ select semap.settle_places(array_agg(source_id)) from semap.source where map_id = any (p_map_ids) $$;

-- Whether places of the tracks of a source may be written late: no query asks for the way between two samples, and no
-- calm is so wide that the gate for outliers could not do without the exact place.
create or replace function semap.may_place_late(p_source_id integer, p_map_id integer, p_cell_m double precision)
returns boolean
language plpgsql stable as $$  -- which keeps its plan
begin
  return coalesce((select jump_m >= 3 * p_cell_m or jump_m is null from semap.source where source_id = p_source_id), false)
    and not exists (select from semap.region where map_id = p_map_id and careful and longest_gap is not null);
end $$;

-- Count states that came late, and note which tracks began earlier than was known.
create or replace function semap.note_late(p_source_id integer, p_late semap.arrival[]) returns void
language plpgsql as $$
begin
  update semap.source set late_states = late_states + cardinality(p_late) where source_id = p_source_id;
  update semap.track_now t set first_stamp = n.stamp
  from (select track_id, min(stamp) as stamp from unnest(p_late) group by track_id) n
  where t.track_id = n.track_id and n.stamp < t.first_stamp;
end $$;

-- A gate for outliers that is another one asks how far tracks went, so places are written by then; and whether
-- frames may follow one another is found anew.
create or replace function semap.gate_changed() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  perform semap.settle_places(array[new.source_id]);
  update semap.source_count set frame_tracks = null, frame_track_ids = null where source_id = new.source_id;
  return null;
end $$;

create or replace trigger gate_changed after update of jump_m, jump_mps on semap.source
  for each row execute function semap.gate_changed();

-- Where tracks are, each at the newest place that is known of it: for those who read, where the triggers read track_now.
-- Restricted roles see their own maps.
create or replace view semap.track_place with (security_barrier) as
  select t.track_id, t.source_id, t.map_id, t.live, t.first_stamp, coalesce(s.stamp, t.stamp) as stamp,
         case when s.stamp is null then t.x_m else s.x_m end as x_m,
         case when s.stamp is null then t.y_m else s.y_m end as y_m,
         case when s.stamp is null then t.z_m else s.z_m end as z_m,
         case when s.stamp is null then t.std_m else s.std_m end as std_m,
         case when s.stamp is null then t.std_across_m else s.std_across_m end as std_across_m,
         case when s.stamp is null then t.std_yaw_rad else s.std_yaw_rad end as std_yaw_rad,
         case when s.stamp is null then t.heading_rad else s.heading_rad end as heading_rad,
         case when s.stamp is null then t.speed_mps else s.speed_mps end as speed_mps,
         case when s.stamp is null then t.length_m else s.length_m end as length_m,
         case when s.stamp is null then t.width_m else s.width_m end as width_m,
         t.region_ids, t.careful_ids
  from semap.track_now t
  left join (
    select s.* from semap.source_count c
    join semap.framed_state s on s.source_id = c.source_id and s.stamp = c.frame_stamp
    where c.placed_stamp < c.frame_stamp
  ) s on s.track_id = t.track_id and s.source_id = t.source_id and s.stamp > t.stamp and t.live
  where (select semap.visible_maps() is null) or t.map_id = any ((select semap.visible_maps())::integer[]);
