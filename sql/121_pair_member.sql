-- Pairs: relations that regions cannot answer, between any two things of a map (docs/decisions/0014). A thing has one
-- number (`key`): a track its id, an instance its id below zero. Instances that take part are kept in pair_instance,
-- with what the query compares of each; tracks that take part in `followed_state`, each where it was at the stamp up to
-- which the pairs of its map are followed (sql/147).
--
-- Several sources move tracks of one map at once, and a pair may be of two of them: writers of maps that have such
-- queries follow one another. The lock is taken after those of the regions and of the source (sql/020), before rows.
-- Edits of the map need none, since they keep all writers out. Two transactions that each write states of several
-- sources of such a map may wait for one another, as they may by the locks of their sources; PostgreSQL ends one.

-- Let one writer at a time move tracks of a map that has queries about pairs, until the transaction ends.
create or replace function semap.lock_pairs(p_map_id integer) returns void
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

-- Whether more of a track is compared than its place.
create or replace function semap.covers_ground(p_compared text) returns boolean
language sql immutable parallel safe return p_compared in ('ground', 'front', 'back', 'left', 'right');

-- What is compared of a track: its place, the ground that it covers, or what lies to a side of that.
create or replace function semap.track_shape(
  p_compared text, p_distance_m double precision, p_x_m double precision, p_y_m double precision,
  p_heading_rad double precision, p_length_m double precision, p_width_m double precision
) returns public.geometry
language plpgsql immutable parallel safe as $$
begin
  if p_compared = 'ground' then
    return coalesce(semap.track_footprint(p_x_m, p_y_m, p_heading_rad, p_length_m, p_width_m),
                    public.st_point(p_x_m, p_y_m));
  elsif semap.is_side(p_compared) then
    return semap.area_beside(semap.track_footprint(p_x_m, p_y_m, p_heading_rad, p_length_m, p_width_m),
                             p_heading_rad, p_compared, p_distance_m);
  end if;
  return public.st_point(p_x_m, p_y_m);
end $$;

-- What is compared of an instance: the abstraction, what lies to a side of it, or the lines that are crossed.
create or replace function semap.instance_shape(
  p_compared text, p_distance_m double precision, p_shape public.geometry, p_yaw_rad double precision
) returns public.geometry
language sql immutable parallel safe as $$
  select case
    when semap.is_side(p_compared) then semap.area_beside(p_shape, p_yaw_rad, p_compared, p_distance_m)
    when p_compared = 'line' and public.st_dimension(p_shape) = 2
      then public.st_boundary(public.st_forcepolygonccw(p_shape))
    else p_shape end
$$;

-- A track as it is compared.
create or replace function semap.compared_track(
  p_state semap.track_state, p_compared text, p_distance_m double precision
) returns semap.compared
language sql immutable parallel safe as $$
  select row(p_state.track_id, public.st_point(p_state.x_m, p_state.y_m),
             case when semap.covers_ground(p_compared)
                    then semap.track_shape(p_compared, p_distance_m, p_state.x_m, p_state.y_m, p_state.heading_rad,
                                           p_state.length_m, p_state.width_m)
                  else public.st_point(p_state.x_m, p_state.y_m) end,
             p_state.z_m, p_state.z_m, p_state.heading_rad)::semap.compared
$$;

-- An instance as it is compared.
create or replace function semap.compared_instance(p_instance semap.pair_instance) returns semap.compared
language sql immutable parallel safe as $$
  select row(-p_instance.instance_id, p_instance.place, p_instance.shape, p_instance.z_min_m, p_instance.z_max_m,
             p_instance.yaw_rad)::semap.compared
$$;

-- Both sides of each query about pairs that is enabled.
create or replace view semap.pair_side as
  select * from semap.query_side where in_pairs and enabled;

-- Every instance that takes part in a query about pairs, as it is now. What rests on something may have no outline; an
-- opening that was drawn as a line, or has no line, is crossed where it is passed.
create or replace view semap.pair_instance_wanted as
  select s.query_id, s.is_object, s.map_id, s.query_name, s.compared, i.instance_id, i.uid, i.name,
         p.geometry as place,
         semap.instance_shape(s.compared, s.distance_m, c.geometry, y.yaw_rad) as shape,
         coalesce(a.z_min_m, d.z_min_m, '-infinity') as z_min_m, coalesce(a.z_max_m, d.z_max_m, 'infinity') as z_max_m,
         y.yaw_rad
  from semap.pair_side s
  join semap.instance i on i.map_id = s.map_id
    and (s.concept_id is null or i.concept_id in (select semap.concepts_below(s.concept_id)))
  left join semap.abstraction a on a.description_id = i.absolute_description_id and a.type = s.abstraction
  left join semap.abstraction p on p.description_id = i.absolute_description_id and p.type = 'Position2D'
  left join lateral (
    select * from semap.doorway(i)
    where s.compared = 'line' and a.geometry is null
      and i.concept_id in (select semap.concepts_below(semap.concept_named('Opening'))) offset 0) d on true
  cross join lateral (select coalesce(a.geometry, d.line, case when s.compared in ('body', 'top') then p.geometry end)
                      as geometry) c
  cross join lateral (
    select case when semap.is_side(s.compared) or s.compared = 'pose'
             then (select semap.yaw(f.pose) from semap.frames_in_root(array[i.frame_id]) f) end as yaw_rad) y
  where s.kind = 'instance' and c.geometry is not null
    and (s.uids is null or i.uid = any (s.uids))
    and (s.condition_id is null or semap.condition_holds(s.condition_id, s.said, i.name, i.alias, i.attributes));

-- Every track that queries about pairs are about, whether it lives or not.
create or replace view semap.pair_track_wanted as
  select query_id, is_object, map_id, query_name, compared, distance_m, track_id, uid, name
  from semap.side_track where in_pairs and enabled;

-- The sides of queries about pairs that tracks are on; `is_chosen`: only those in query_track are.
create or replace view semap.track_side as
  select query_id, is_object, map_id, compared, distance_m,
         concept_id is not null or uids is not null or condition_id is not null as is_chosen
  from semap.pair_side where kind = 'track';

-- The tracks that take part in these queries, of those that are at these places: what the query compares of each, and
-- how far that reaches from its place.
create or replace function semap.track_members(p_query_ids integer[], p_places semap.track_state[])
returns table (query_id integer, is_object boolean, key bigint, stamp timestamptz, x_m double precision,
               y_m double precision, z_m double precision, yaw_rad double precision, shape public.geometry,
               half_m double precision)
language plpgsql stable rows 1000 as $$
#variable_conflict use_column
declare
  v_side  record;
begin
  for v_side in select * from semap.track_side s where s.query_id = any (p_query_ids) loop
    if semap.covers_ground(v_side.compared) then
      return query
        select v_side.query_id, v_side.is_object, p.track_id, p.stamp, p.x_m, p.y_m, p.z_m,
               p.heading_rad::double precision, g.shape,
               greatest(st_xmax(g.shape) - p.x_m, p.x_m - st_xmin(g.shape), st_ymax(g.shape) - p.y_m,
                        p.y_m - st_ymin(g.shape))
        from unnest(p_places) p
        cross join lateral semap.track_shape(v_side.compared, v_side.distance_m, p.x_m, p.y_m, p.heading_rad,
                                             p.length_m, p.width_m) g (shape)
        where not v_side.is_chosen or exists (
          select from semap.query_track t
          where t.query_id = v_side.query_id and t.is_object = v_side.is_object and t.track_id = p.track_id);
    else
      return query
        select v_side.query_id, v_side.is_object, p.track_id, p.stamp, p.x_m, p.y_m, p.z_m,
               p.heading_rad::double precision,
               st_point(p.x_m, p.y_m), 0.0::double precision
        from unnest(p_places) p
        where not v_side.is_chosen or exists (
          select from semap.query_track t
          where t.query_id = v_side.query_id and t.is_object = v_side.is_object and t.track_id = p.track_id);
    end if;
  end loop;
end $$;

-- Keep where these tracks of a map are (p_places, of more tracks): those that are nowhere have ended.
create or replace function semap.keep_followed(p_map_id integer, p_track_ids bigint[], p_places semap.track_state[])
returns void
language sql as $$
  with gone as (
    delete from semap.followed_state f using unnest(p_track_ids) id left join unnest(p_places) p on p.track_id = id
    where p.track_id is null and f.track_id = id
  )
  insert into semap.followed_state (track_id, map_id, cell_x, cell_y, state)
  select p.track_id, p_map_id, floor(p.x_m / 8)::integer, floor(p.y_m / 8)::integer, p
  from unnest(p_track_ids) id join unnest(p_places) p on p.track_id = id
  on conflict (track_id) do update set cell_x = excluded.cell_x, cell_y = excluded.cell_y, state = excluded.state
$$;

-- Where the tracks of a map are as its pairs see them, of these or (null) of all.
create or replace function semap.followed_places(p_map_id integer, p_track_ids bigint[] default null)
returns semap.track_state[]
language sql stable as $$
  select coalesce(array_agg(f.state), '{}') from semap.followed_state f
  where f.map_id = p_map_id and (p_track_ids is null or f.track_id = any (p_track_ids))
$$;
