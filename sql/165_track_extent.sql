-- How much room a track takes, and what its tracker had mistaken.

-- The ground that a body covers: an ellipse, its length along the heading; where the heading is not known, the circle
-- that it does not leave however it turns; null without a measure.
create or replace function semap.track_footprint(
  p_x_m double precision, p_y_m double precision, p_heading_rad double precision,
  p_length_m double precision, p_width_m double precision
) returns public.geometry
language sql immutable parallel safe as $$
  select public.st_affine(
    'POLYGON ((1 0,0.9238795325112867 0.3826834323650898,0.7071067811865476 0.7071067811865475,
      0.3826834323650898 0.9238795325112867,0 1,-0.3826834323650897 0.9238795325112867,
      -0.7071067811865475 0.7071067811865476,-0.9238795325112867 0.3826834323650898,-1 0,
      -0.9238795325112867 -0.3826834323650897,-0.7071067811865477 -0.7071067811865475,
      -0.3826834323650904 -0.9238795325112865,0 -1,0.38268343236509 -0.9238795325112866,
      0.7071067811865474 -0.7071067811865477,0.9238795325112865 -0.3826834323650904,1 0))'::public.geometry,
    length_m / 2 * cos(heading_rad), -width_m / 2 * sin(heading_rad),
    length_m / 2 * sin(heading_rad), width_m / 2 * cos(heading_rad), p_x_m, p_y_m)
  from (select coalesce(p_heading_rad, 0) as heading_rad,
               case when p_heading_rad is null then greatest(p_length_m, p_width_m)
                    else coalesce(p_length_m, p_width_m) end as length_m,
               case when p_heading_rad is null then greatest(p_length_m, p_width_m)
                    else coalesce(p_width_m, p_length_m) end as width_m) e
$$;

-- Where each track that lives is, and the ground that it covers.
create or replace view semap.track_present with (security_invoker = true) as
  select t.map_id, t.track_id, k.name as track, t.source_id, n.name as source, t.stamp, t.x_m, t.y_m, t.z_m, t.std_m,
         t.heading_rad, t.speed_mps, t.length_m, t.width_m,
         semap.track_footprint(t.x_m, t.y_m, t.heading_rad, t.length_m, t.width_m) as footprint,
         t.std_across_m, t.std_yaw_rad
  from semap.track_place t
  join semap.track k using (track_id)
  join semap.source n on n.source_id = t.source_id
  where t.live;

-- End tracks of a source, each at a stamp, within a transaction that wrote states: where regions are held already, the
-- lock that an update of track takes by itself would be raised from shared to exclusive, and two that do wait in a
-- circle.
create or replace function semap.end_tracks(p_source_id integer, p_track_ids bigint[], p_stamps timestamptz[])
returns void
language plpgsql as $$
begin
  perform semap.lock_regions_shared();
  perform semap.lock_source(p_source_id);
  perform set_config('semap.source_is_locked', 'on', true);
  update semap.track k set ended_at = e.stamp
  from unnest(p_track_ids, p_stamps) e (track_id, stamp)
  where k.track_id = e.track_id and k.source_id = p_source_id;
  perform set_config('semap.source_is_locked', 'off', true);
end $$;

-- One writer of amendments at a time, until its transaction ends: whoever has seen one has seen those before it.
create or replace function semap.track_amendments_arrive() returns trigger
language plpgsql as $$
begin
  perform semap.lock_regions_shared();
  perform pg_advisory_xact_lock(7368, 0);
  return null;
end $$;

create or replace trigger track_amendments_arrive before insert on semap.track_amendment
  for each statement execute function semap.track_amendments_arrive();

-- An amendment is of the map of its tracks, which one source saw.
create or replace function semap.track_amendment_arrives() returns trigger
language plpgsql as $$
begin
  select k.map_id, k.source_id into new.map_id, new.source_id
  from semap.track k join semap.track o on o.track_id = new.other_track_id and o.source_id = k.source_id
  where k.track_id = new.track_id and k.source_id = coalesce(new.source_id, k.source_id);
  if not found then
    raise exception 'The tracks % and % are not of one source.', new.track_id, new.other_track_id
      using errcode = 'foreign_key_violation', hint = 'Name two tracks of the source.';
  end if;
  return new;
end $$;

create or replace trigger track_amendment_arrives before insert on semap.track_amendment
  for each row execute function semap.track_amendment_arrives();

-- Whose states are whose follows amendments, and for queries that follow them so do relations (sql/149). Listeners on
-- semap_amendment are woken.
create or replace function semap.track_amendments_arrived() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  perform semap.read_again(semap.write_readings(array[track_id, other_track_id], since), since)
  from (select * from new_amendment order by since desc, track_amendment_id) a;
  perform pg_notify('semap_amendment', max(track_amendment_id)::text) from new_amendment having count(*) > 0;
  return null;
end $$;

create or replace trigger track_amendments_arrived after insert on semap.track_amendment
  referencing new table as new_amendment for each statement execute function semap.track_amendments_arrived();

-- What trackers found that they had mistaken, by name. Relations take the tracks as they were told, but for queries
-- that follow amendments.
create or replace view semap.track_amended with (security_invoker = true) as
  select a.track_amendment_id, a.map_id, m.name as map, n.name as source, a.kind, a.track_id, k.name as track,
         a.other_track_id, o.name as other_track, a.since, a.found, a.received_at
  from semap.track_amendment a
  join semap.map m using (map_id)
  join semap.source n on n.source_id = a.source_id
  join semap.track k on k.track_id = a.track_id
  join semap.track o on o.track_id = a.other_track_id;
