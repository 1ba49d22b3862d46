-- What must hold of relations, computed anew from what they follow from, and how what is stored differs from it. Each
-- function with a name that ends in _differences gives a row for each thing that differs: what it is, what is stored,
-- what should be. They change nothing and see one snapshot: in a transaction at REPEATABLE READ they are right while
-- others write. Stateful regions, whose relations depend on the way, are followed by `semap doctor --verify` itself.

-- Where each track of a map is by what is stored, whether or not its place is written already (sql/134).
create or replace function semap.present_places(p_map_id integer) returns table (
  track_id bigint, source_id integer, live boolean, stamp timestamptz,
  x_m double precision, y_m double precision, z_m double precision, std_m real, std_across_m real, std_yaw_rad real
)
language sql stable as $$
  select track_id, source_id, live, stamp, x_m, y_m, z_m, std_m, std_across_m, std_yaw_rad
  from semap.track_place where map_id = p_map_id
$$;

-- Regions against what the queries and the map ask for.
create or replace function semap.region_differences(p_map_id integer)
returns table (query_id integer, instance_id bigint, thing text, stored text, wanted text)
language sql stable as $$
  with stored as materialized (
    select * from semap.region where map_id = p_map_id
  ), wanted as materialized (
    select * from semap.region_wanted where map_id = p_map_id
  )
  select coalesce(r.query_id, w.query_id), coalesce(r.instance_id, w.instance_id),
         format('region of %s (%s)', coalesce(w.instance_name, r.instance_name), coalesce(w.query_name, r.query_name)),
         case when r.query_id is null then 'none' when w.query_id is null then 'one' else 'another one' end,
         case when w.query_id is null then 'none' else 'what the map and the query say' end
  from stored r full join wanted w on w.query_id = r.query_id and w.instance_id = r.instance_id
  where r.query_id is null or w.query_id is null
     or not to_jsonb(r) @> to_jsonb(w) - '{footprint,shape,enter_area,leave_area}'::text[]
     or (st_asbinary(r.footprint), st_asbinary(r.shape), st_asbinary(r.enter_area),
         st_asbinary(r.leave_area)) is distinct from
        (st_asbinary(w.footprint), st_asbinary(w.shape), st_asbinary(w.enter_area), st_asbinary(w.leave_area))
$$;

-- Cells and edges of regions against those made anew.
create or replace function semap.grid_differences(p_map_id integer)
returns table (region_id integer, thing text, stored text, wanted text)
language sql stable as $$
  with own as materialized (
    select array_agg(region_id) as ids from semap.region where map_id = p_map_id
  ), wanted as materialized (
    select 'cells' as kind, region_id, c::text as piece from own, semap.cells_of_regions(ids) c
    union all
    select 'edges', region_id, e::text from own, semap.edges_of_regions(ids) e
  ), stored as materialized (
    select 'cells' as kind, region_id,
           row(map_id, cell_x, cell_y, region_id, whole, stateful, z_min_m, z_max_m)::text as piece
    from semap.region_cell where map_id = p_map_id
    union all
    select 'edges', region_id,
           row(map_id, cell_x, cell_y, region_id, stds, x_min_m, x_max_m, y_min_m, y_max_m)::text
    from semap.region_edge where map_id = p_map_id
  ), differing as (
    select kind, region_id, 1 as missing, 0 as strange from (select * from wanted except all select * from stored) m
    union all
    select kind, region_id, 0, 1 from (select * from stored except all select * from wanted) s
  )
  select d.region_id, format('%s of region %s (%s)', d.kind, r.instance_name, r.query_name),
         sum(d.strange) || ' that should not be there', sum(d.missing) || ' more'
  from differing d left join semap.region r using (region_id)
  group by d.kind, d.region_id, r.instance_name, r.query_name
$$;

-- Which tracks queries are about, against what their conditions say.
create or replace function semap.choice_differences(p_map_id integer)
returns table (query_id integer, is_object boolean, track_id bigint, thing text, stored text, wanted text)
language sql stable as $$
  select coalesce(s.query_id, w.query_id), coalesce(s.is_object, w.is_object), coalesce(s.track_id, w.track_id),
         format('track %s, query %s', t.name, q.name),
         case when s.query_id is null then 'not chosen' else 'chosen' end,
         case when w.query_id is null then 'not chosen' else 'chosen' end
  from (select * from semap.query_track where map_id = p_map_id) s
  full join (select * from semap.query_track_wanted where map_id = p_map_id) w using (query_id, is_object, track_id)
  join semap.track t on t.track_id = coalesce(s.track_id, w.track_id)
  join semap.continuous_query q on q.query_id = coalesce(s.query_id, w.query_id)
  where s.query_id is null or w.query_id is null
$$;

-- The newest state of each of these tracks that was not set aside.
create or replace function semap.newest_states(p_track_ids bigint[], p_since timestamptz)
returns setof semap.track_state
language sql stable as $$
  select distinct on (s.track_id) s.*
  from semap.states(p_track_ids, p_since, 'infinity') s join semap.track_now t using (track_id)
  where s.stamp is distinct from t.outlier_stamp
  order by s.track_id, s.stamp desc
$$;

-- The present of tracks against their newest states, and whether they live against when they ended.
create or replace function semap.present_differences(p_map_id integer)
returns table (track_id bigint, thing text, stored text, wanted text)
language sql stable as $$
  with place as materialized (
    select * from semap.present_places(p_map_id)
  ), present as materialized (
    select k.track_id, k.name, k.source_id as of_source, k.ended_at, t.source_id, t.map_id, t.cell_m,
           m.cell_m as map_cell_m,
           t.track_id is not null as is_there, t.outlier_stamp, p.live, p.stamp, p.x_m, p.y_m, p.z_m
    from semap.track k
    join semap.map m on m.map_id = k.map_id
    left join semap.track_now t on t.track_id = k.track_id
    left join place p on p.track_id = k.track_id
    where k.map_id = p_map_id
  ), newest as materialized (
    select s.* from (select array_agg(track_id) as ids, min(stamp) as since from present where live) b
    cross join lateral semap.newest_states(b.ids, b.since) s
  )
  select p.track_id, format('track %s', p.name), d.stored, d.wanted
  from present p
  left join newest s using (track_id)
  cross join lateral (
    select 'no present', 'one' where not p.is_there
    union all
    select 'of another source, map or cell', 'as its track and its map'
    where p.is_there and (p.source_id, p.map_id, p.cell_m) is distinct from (p.of_source, p_map_id, p.map_cell_m)
    union all
    select case when p.live then 'lives' else 'does not live' end,
           case when p.ended_at is null then 'lives' else 'ended at ' || p.ended_at end
    where p.is_there and p.live = (p.ended_at is not null) and p.stamp > '-infinity'
    union all
    select format('at (%s, %s) at %s', p.x_m, p.y_m, p.stamp), format('at (%s, %s) at %s', s.x_m, s.y_m, s.stamp)
    where p.live and (s.stamp, s.x_m, s.y_m, s.z_m) is distinct from (p.stamp, p.x_m, p.y_m, p.z_m)
      and (s.stamp is not null or p.stamp >= coalesce((select gone_before from semap.retention where kind = 'states'),
                                                      '-infinity'))
  ) d (stored, wanted)
$$;

-- The regions of these by which the relations of a track are its own: not those of its reading (sql/116).
create or replace function semap.own_regions(p_track_id bigint, p_region_ids integer[]) returns integer[]
language sql stable as $$
  select coalesce(array_agg(region_id order by place) filter (where not exists (
           select from semap.region r where r.region_id = i.region_id and semap.reads_amended(r.query_id, p_track_id))),
         '{}')
  from unnest(p_region_ids) with ordinality i (region_id, place)
$$;

-- The regions that the present of each track says it is in, against its relations.
create or replace function semap.held_differences(p_map_id integer)
returns table (track_id bigint, thing text, stored text, wanted text)
language sql stable as $$
  select t.track_id, format('track %s, regions of its present', k.name),
         array_to_string(t.region_ids || t.stateful_ids, ' '), array_to_string(h.plain_ids || h.stateful_ids, ' ')
  from semap.track_now t
  join semap.track k using (track_id)
  join semap.regions_held(array(select track_id from semap.track_now where map_id = p_map_id)) h using (track_id)
  where t.map_id = p_map_id and (t.region_ids, t.stateful_ids) is distinct from (h.plain_ids, h.stateful_ids)
    and (semap.own_regions(t.track_id, t.region_ids), semap.own_regions(t.track_id, t.stateful_ids))
        is distinct from
        (semap.own_regions(t.track_id, h.plain_ids), semap.own_regions(t.track_id, h.stateful_ids))
$$;

-- Which stateless regions hold each live track of a map, by its place and their footprints alone.
create or replace function semap.plain_relations(p_map_id integer)
returns table (track_id bigint, region_id integer)
language plpgsql as $$
begin
  drop table if exists pg_temp.semap_footprint;
  create temporary table semap_footprint on commit drop as
    select r.region_id, r.query_id, r.footprint, r.z_min_m, r.z_max_m from semap.region r
    where r.map_id = p_map_id and not r.stateful;
  create index on pg_temp.semap_footprint using gist (footprint);
  analyze pg_temp.semap_footprint;
  return query
    select s.track_id, r.region_id
    from semap.present_places(p_map_id) p
    join pg_temp.semap_footprint r on st_contains(r.footprint, st_point(p.x_m, p.y_m))
    cross join lateral semap.subject_now(r.query_id, p.track_id) s (track_id)
    where p.live and (p.z_m is null or p.z_m >= r.z_min_m and p.z_m < r.z_max_m) and s.track_id is not null;
end $$;

-- Relations with stateless regions against where the tracks are; and relations with nothing.
create or replace function semap.plain_differences(p_map_id integer)
returns table (track_id bigint, region_id integer, thing text, stored text, wanted text)
language sql as $$
  with wanted as materialized (
    select * from semap.plain_relations(p_map_id)
  ), stored as materialized (
    select n.track_id, r.region_id, n.confirmed, n.since
    from semap.relation n left join semap.region r using (query_id, instance_id)
    where n.map_id = p_map_id and not n.in_pairs and r.stateful is not true
  )
  select coalesce(s.track_id, w.track_id), coalesce(s.region_id, w.region_id),
         format('track %s, %s (%s)', k.name, coalesce(r.instance_name, 'a region that is gone'), r.query_name),
         case when s.track_id is null then 'no relation' when s.confirmed then 'a relation since ' || s.since
              else 'a relation that waits' end,
         case when w.track_id is null then 'no relation' else 'a relation' end
  from stored s
  full join wanted w on w.track_id = s.track_id and w.region_id = s.region_id
  left join semap.region r on r.region_id = coalesce(s.region_id, w.region_id)
  left join semap.track k on k.track_id = coalesce(s.track_id, w.track_id)
  where s.track_id is null or w.track_id is null or not s.confirmed
$$;
