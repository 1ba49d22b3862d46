-- Pairs: relations that regions cannot answer, between any two things of a map (docs/decisions/0014). Who takes part in
-- such a query, on which side, and where it is, is kept in pair_member: instances as long as they are on the map, tracks
-- as long as they live. A thing has one number (`key`): a track its id, an instance its id below zero.
--
-- Several sources move tracks of one map at once, and a pair may be of two of them: writers of maps that have such
-- queries follow one another. The lock is taken after those of the regions and of the source (sql/020), before rows.
-- Edits of the map need none, since they keep all writers out. Two transactions that each write states of several
-- sources of such a map may wait for one another, as they may by the locks of their sources; PostgreSQL ends one.

-- Let one writer at a time move tracks of a map that has queries about pairs, until the transaction ends.
create or replace function semap.hold_pairs(p_map_id integer) returns void
language sql as $$ select pg_advisory_xact_lock(7373, p_map_id) $$;

-- A box with a third axis along which the sides of queries lie far apart, so that one index serves all of them. It is
-- thick, since the index keeps boxes together by their volumes.
create or replace function semap.pair_box(
  p_x_min_m double precision, p_y_min_m double precision, p_x_max_m double precision, p_y_max_m double precision,
  p_query_id integer, p_is_object boolean
) returns public.geometry
language sql immutable parallel safe as $$
  select public.st_makeline(
    public.st_makepoint(p_x_min_m, p_y_min_m, (2 * p_query_id::double precision + p_is_object::integer) * 1e8),
    public.st_makepoint(p_x_max_m, p_y_max_m, (2 * p_query_id::double precision + p_is_object::integer + 0.25) * 1e8))
$$;

-- What of a track a predicate compares: its place, the ground that it covers, or what lies beside that.
create or replace function semap.track_shape(
  p_predicate text, p_is_object boolean, p_distance_m double precision, p_x_m double precision, p_y_m double precision,
  p_heading_rad double precision, p_length_m double precision, p_width_m double precision
) returns public.geometry
language plpgsql immutable parallel safe as $$
begin
  if p_predicate = 'intersects' or p_is_object and p_predicate in ('contains', 'covers') then
    return coalesce(semap.track_footprint(p_x_m, p_y_m, p_heading_rad, p_length_m, p_width_m), public.st_point(p_x_m, p_y_m));
  elsif p_is_object and p_predicate in ('in_front_of', 'behind', 'left_of', 'right_of') then
    return semap.area_beside(semap.track_footprint(p_x_m, p_y_m, p_heading_rad, p_length_m, p_width_m),
                             p_heading_rad, p_predicate, p_distance_m);
  end if;
  return public.st_point(p_x_m, p_y_m);
end $$;

-- What of an instance a predicate compares: the abstraction, what lies beside it, or the lines that are crossed.
create or replace function semap.instance_shape(
  p_predicate text, p_is_object boolean, p_distance_m double precision, p_shape public.geometry, p_yaw_rad double precision
) returns public.geometry
language sql immutable parallel safe as $$
  select case
    when p_is_object and p_predicate in ('in_front_of', 'behind', 'left_of', 'right_of')
      then semap.area_beside(p_shape, p_yaw_rad, p_predicate, p_distance_m)
    when p_is_object and p_predicate = 'crosses' and public.st_dimension(p_shape) = 2
      then public.st_boundary(public.st_forcepolygonccw(p_shape))
    else p_shape end
$$;

-- Both sides of each query about pairs that is enabled.
create or replace view semap.pair_side as
  select * from semap.query_side where in_pairs and enabled;

-- Every instance that takes part in a query about pairs, as it is now. What rests on something may have no outline; an
-- opening that was drawn as a line, or has no line, is crossed where it is passed.
create or replace view semap.pair_instance_wanted as
  select s.query_id, s.is_object, s.map_id, s.query_name, s.predicate, i.instance_id, i.uid, i.name, p.geometry as place,
         semap.instance_shape(s.predicate, s.is_object, s.distance_m, c.geometry, y.yaw_rad) as shape,
         coalesce(a.z_min_m, d.z_min_m, '-infinity') as z_min_m, coalesce(a.z_max_m, d.z_max_m, 'infinity') as z_max_m,
         y.yaw_rad
  from semap.pair_side s
  join semap.instance i on i.map_id = s.map_id
    and (s.concept_id is null or i.concept_id in (select semap.concepts_below(s.concept_id)))
  left join semap.abstraction a on a.description_id = i.absolute_description_id and a.type = s.abstraction
  left join semap.abstraction p on p.description_id = i.absolute_description_id and p.type = 'Position2D'
  left join lateral (
    select * from semap.doorway(i)
    where s.predicate = 'crosses' and a.geometry is null
      and i.concept_id in (select semap.concepts_below(semap.concept_named('Opening'))) offset 0) d on true
  cross join lateral (select coalesce(a.geometry, d.line, case when s.predicate = 'on' then p.geometry end) as geometry) c
  cross join lateral (
    select case when s.is_object and s.predicate in ('in_front_of', 'behind', 'left_of', 'right_of')
                  or not s.is_object and s.predicate = 'facing'
             then (select semap.yaw(f.pose) from semap.frames_in_root(array[i.frame_id]) f) end as yaw_rad) y
  where s.kind = 'instance' and c.geometry is not null
    and (s.uids is null or i.uid = any (s.uids))
    and (s.condition_id is null or semap.condition_holds(s.condition_id, s.said, i.name, i.alias, i.attributes));

-- Every track that queries about pairs are about, whether it lives or not.
create or replace view semap.pair_track_wanted as
  select query_id, is_object, map_id, query_name, predicate, distance_m, track_id, uid, name
  from semap.side_track where in_pairs and enabled;

-- Put tracks where these states say, each one of another track, on both sides of all queries; those that appear come in.
create or replace function semap.place_tracks(p_states semap.arrival[], p_appeared bigint[]) returns void
language plpgsql
set enable_seqscan = off set enable_mergejoin = off set plan_cache_mode = force_generic_plan as $$
begin
  if p_appeared is not null then
    insert into semap.pair_member (query_id, is_object, map_id, query_name, track_id, uid, name)
    select query_id, is_object, map_id, query_name, track_id, uid, name
    from semap.pair_track_wanted where track_id = any (p_appeared)
    on conflict do nothing;
  end if;
  update semap.pair_member m
  set stamp = a.stamp, place = st_point(a.x_m, a.y_m), shape = s.shape, yaw_rad = a.heading_rad,
      z_min_m = a.z_m, z_max_m = a.z_m,
      box = semap.pair_box(floor(st_xmin(s.shape) / 2) * 2, floor(st_ymin(s.shape) / 2) * 2,
                           ceil(st_xmax(s.shape) / 2) * 2, ceil(st_ymax(s.shape) / 2) * 2, m.query_id, m.is_object)
  from unnest(p_states) a
  -- each is found once by its key and then by its place, whatever was known of the table when this was planned
  cross join lateral (select k.*, k.ctid as row_place from semap.pair_member k where k.key = a.track_id offset 0) n
  cross join lateral (select predicate, distance_m from semap.continuous_query c where c.query_id = n.query_id offset 0) q
  cross join lateral (select semap.track_shape(q.predicate, n.is_object, q.distance_m, a.x_m, a.y_m,
                                               a.heading_rad, a.length_m, a.width_m) as shape offset 0) s
  where m.ctid = n.row_place;
end $$;
