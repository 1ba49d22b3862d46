-- Let every track in a cell of these regions, or of their edges, be looked up at its next state.
create or replace function semap.unsettle(p_region_ids integer[]) returns void
language sql as $$
  update semap.track_now t set safe_x_min_m = 'infinity'
  where (t.map_id, floor(t.x_m / t.cell_m)::integer, floor(t.y_m / t.cell_m)::integer) in
    (select map_id, cell_x, cell_y from semap.region_cell where region_id = any (p_region_ids)
     union select map_id, cell_x, cell_y from semap.region_edge where region_id = any (p_region_ids))
$$;

-- The cells that these regions reach into.
create or replace function semap.cells_of_regions(p_region_ids integer[]) returns table (
  map_id integer, cell_x integer, cell_y integer, region_id integer, whole boolean, stateful boolean,
  z_min_m double precision, z_max_m double precision
)
language sql stable as $$
  select r.map_id, cell_x, cell_y, r.region_id, st_containsproperly(r.footprint, cell.square), r.stateful,
         r.z_min_m, r.z_max_m
  from semap.region r
  join semap.map m using (map_id)
  cross join lateral generate_series(floor(st_xmin(r.footprint) / m.cell_m)::integer,
                                     floor(st_xmax(r.footprint) / m.cell_m)::integer) cell_x
  cross join lateral generate_series(floor(st_ymin(r.footprint) / m.cell_m)::integer,
                                     floor(st_ymax(r.footprint) / m.cell_m)::integer) cell_y
  cross join lateral (
    select st_makeenvelope(cell_x * m.cell_m, cell_y * m.cell_m,
                           (cell_x + 1) * m.cell_m, (cell_y + 1) * m.cell_m) as square
  ) cell
  where r.region_id = any (p_region_ids) and st_intersects(r.footprint, cell.square)
$$;

-- The edges of these regions, each in every cell that it passes through. One that is kept away from is, too, where it
-- may be too near for a position that is as inexact as the query allows; one of a rounded shape is widened by the half
-- millimetre that its corners lack.
create or replace function semap.edges_of_regions(p_region_ids integer[]) returns table (
  map_id integer, cell_x integer, cell_y integer, region_id integer, stds real,
  x_min_m double precision, x_max_m double precision, y_min_m double precision, y_max_m double precision
)
language sql stable as $$
  select r.map_id, cell_x, cell_y, r.region_id, w.stds, e.x_min_m - w.by_m, e.x_max_m + w.by_m,
         e.y_min_m - w.by_m, e.y_max_m + w.by_m
  from semap.region r
  join semap.map m using (map_id)
  cross join lateral (
    select greatest(r.enter_stds, r.leave_stds, 0)::real as stds, coalesce(r.widest_std_m, 0) as widest_std_m,
           case when r.distance_m is null then 0 else 0.001 end as by_m) w
  cross join lateral (select shape from unnest(array[r.footprint, r.enter_area, r.leave_area]) shape
                      where shape is not null and not st_isempty(shape)) s
  cross join lateral semap.footprint_edges(s.shape) e
  cross join lateral generate_series(floor((e.x_min_m - w.by_m - w.stds * w.widest_std_m) / m.cell_m)::integer,
                                     floor((e.x_max_m + w.by_m + w.stds * w.widest_std_m) / m.cell_m)::integer) cell_x
  cross join lateral generate_series(floor((e.y_min_m - w.by_m - w.stds * w.widest_std_m) / m.cell_m)::integer,
                                     floor((e.y_max_m + w.by_m + w.stds * w.widest_std_m) / m.cell_m)::integer) cell_y
  where r.region_id = any (p_region_ids)
$$;

-- Write the cells and edges of these regions anew. A region that would fill more than a million
-- cells is refused: its map wants larger ones.
create or replace function semap.index_regions(p_region_ids integer[]) returns void
language plpgsql as $$
declare
  v_name text;
begin
  select r.instance_name into v_name
  from semap.region r join semap.map m using (map_id)
  where r.region_id = any (p_region_ids)
    and ((st_xmax(r.footprint) - st_xmin(r.footprint)) / m.cell_m + 1)
      * ((st_ymax(r.footprint) - st_ymin(r.footprint)) / m.cell_m + 1) > 1e6
  limit 1;
  if v_name is not null then
    raise exception 'The footprint of % covers more than a million cells of its map.', v_name
      using errcode = 'program_limit_exceeded', hint = 'Create the map with larger cells (semap map create --cell).';
  end if;

  delete from semap.region_cell where region_id = any (p_region_ids);
  delete from semap.region_edge where region_id = any (p_region_ids);

  insert into semap.region_cell (map_id, cell_x, cell_y, region_id, whole, stateful, z_min_m, z_max_m)
  select * from semap.cells_of_regions(p_region_ids);
  insert into semap.region_edge (map_id, cell_x, cell_y, region_id, stds, x_min_m, x_max_m, y_min_m, y_max_m)
  select * from semap.edges_of_regions(p_region_ids);

  -- many new rows at once, as after an import: the plans of the triggers should know of them at once
  if cardinality(p_region_ids) >= 100 then
    analyze semap.region, semap.region_cell, semap.region_edge;
  end if;
end $$;

-- Note that these regions have a new form: what came before on their map is not a matter of it.
create or replace function semap.note_valid_from(p_region_ids integer[]) returns void
language sql as $$
  update semap.region r
  set valid_from = n.stamp, valid_from_track_id = n.track_id
  from (select map_id, max(stamp) as stamp, max(track_id) as track_id from semap.track_now
        where map_id in (select map_id from semap.region where region_id = any (p_region_ids)) group by map_id) n
  where r.region_id = any (p_region_ids) and r.map_id = n.map_id
$$;

-- Write the regions of these instances as the map and the queries ask for them: which are other ones than before.
create or replace function semap.write_regions(p_instance_ids bigint[]) returns integer[]
language plpgsql as $$ -- which plans for how many they are
declare
  v_changed  integer[];
begin
  with changed as (
    insert into semap.region as r (
      query_id, query_name, instance_id, instance_uid, instance_name, map_id, footprint, z_min_m, z_max_m,
      test, compared, shape, distance_m, enter_area, leave_area, enter_confirm, leave_confirm, enter_stds, leave_stds,
      widest_std_m, longest_gap, fastest_mps, subject, stateful)
    select
      query_id, query_name, instance_id, instance_uid, instance_name, map_id, footprint, z_min_m, z_max_m,
      test, compared, shape, distance_m, enter_area, leave_area, enter_confirm, leave_confirm, enter_stds, leave_stds,
      widest_std_m, longest_gap, fastest_mps, subject, stateful
    from semap.region_wanted
    where instance_id = any (p_instance_ids)
    order by query_id, instance_uid
    on conflict (query_id, instance_id) do update set
      query_name = excluded.query_name, instance_uid = excluded.instance_uid,
      instance_name = excluded.instance_name, footprint = excluded.footprint, z_min_m = excluded.z_min_m,
      z_max_m = excluded.z_max_m, test = excluded.test, compared = excluded.compared, shape = excluded.shape,
      distance_m = excluded.distance_m, enter_area = excluded.enter_area, leave_area = excluded.leave_area,
      enter_confirm = excluded.enter_confirm, leave_confirm = excluded.leave_confirm,
      enter_stds = excluded.enter_stds, leave_stds = excluded.leave_stds, widest_std_m = excluded.widest_std_m,
      longest_gap = excluded.longest_gap, fastest_mps = excluded.fastest_mps, subject = excluded.subject,
      stateful = excluded.stateful
    where (r.query_name, r.instance_uid, r.instance_name, st_asbinary(r.footprint), r.z_min_m, r.z_max_m,
           r.test, r.compared, st_asbinary(r.shape), r.distance_m, st_asbinary(r.enter_area), st_asbinary(r.leave_area),
           r.enter_confirm, r.leave_confirm, r.enter_stds, r.leave_stds, r.widest_std_m, r.longest_gap,
           r.fastest_mps, r.subject, r.stateful)
      is distinct from
          (excluded.query_name, excluded.instance_uid, excluded.instance_name, st_asbinary(excluded.footprint),
           excluded.z_min_m, excluded.z_max_m, excluded.test, excluded.compared, st_asbinary(excluded.shape),
           excluded.distance_m, st_asbinary(excluded.enter_area), st_asbinary(excluded.leave_area),
           excluded.enter_confirm, excluded.leave_confirm, excluded.enter_stds, excluded.leave_stds,
           excluded.widest_std_m, excluded.longest_gap, excluded.fastest_mps, excluded.subject,
           excluded.stateful)
    returning region_id
  )
  select array_agg(region_id) into v_changed from changed;
  return v_changed;
end $$;

-- Who enters and leaves regions by an edit: those that have changed, and those that are wanted no more.
create or replace function semap.crossings_by_edit(p_changed_ids integer[], p_gone_ids integer[])
returns semap.crossing[]
language plpgsql stable as $$
declare
  v_crossings  semap.crossing[];
begin
  with inside as (
    select distinct semap.subject_now(r.query_id, t.track_id) as track_id, r.region_id
    from semap.region_cell c
    join semap.region r using (region_id)
    join semap.track_now t
      on t.map_id = c.map_id and t.live
      and floor(t.x_m / t.cell_m)::integer = c.cell_x and floor(t.y_m / t.cell_m)::integer = c.cell_y
    where c.region_id = any (p_changed_ids)
      and case when r.stateful then (select raw from semap.stands(r, t.x_m, t.y_m, t.z_m, t.std_m))
                    and (r.subject is null or exists (select from semap.query_track s
                                                   where s.query_id = r.query_id and s.track_id = t.track_id
                                                     and not s.is_object))
               else (c.whole or st_contains(r.footprint, st_point(t.x_m, t.y_m)))
                    and (t.z_m is null or (t.z_m >= r.z_min_m and t.z_m < r.z_max_m)) end
  ), crossed as (
    select coalesce(i.track_id, n.track_id) as track_id, coalesce(i.region_id, n.region_id) as region_id,
           case when n.track_id is null then 'began' else 'ended' end::semap.change_kind as kind
    from inside i
    full join (select n.track_id, r.region_id from semap.region r join semap.relation n using (query_id, instance_id)
               where r.region_id = any (p_gone_ids || p_changed_ids) and n.confirmed) n using (track_id, region_id)
    where i.track_id is null or n.track_id is null
  )
  select array_agg(row(c.track_id, c.region_id, c.kind, 'map', t.stamp, t.stamp, null, null)::semap.crossing)
    into v_crossings
  from crossed c join semap.region r using (region_id)
  cross join lateral semap.present_stamp(r.query_id, c.track_id) t (stamp)
  where c.track_id is not null;
  return v_crossings;
end $$;

-- In which regions these tracks are: those that are found by where they are alone, and those that are followed.
create or replace function semap.regions_held(p_track_ids bigint[])
returns table (track_id bigint, plain_ids integer[], stateful_ids integer[])
language sql stable as $$
  select k.track_id,
         coalesce(array_agg(r.region_id order by r.region_id) filter (where not r.stateful), '{}'),
         coalesce(array_agg(r.region_id order by r.region_id) filter (where r.stateful), '{}')
  from (select distinct track_id from unnest(p_track_ids) u (track_id)) k
  left join semap.relation n on n.track_id = k.track_id and n.confirmed and not n.in_pairs
  left join semap.region r on r.query_id = n.query_id and r.instance_id = n.instance_id
  group by k.track_id
$$;

-- Bring the regions of these instances in line with the map and the queries. Who is in a region that
-- appeared, changed or went enters or leaves it now, at the last stamp of the track.
create or replace function semap.refresh_regions(p_instance_ids bigint[]) returns void
language plpgsql as $$
declare
  v_gone       integer[];
  v_changed    integer[];
  v_crossings  semap.crossing[];
begin
  if p_instance_ids is null then
    return;
  end if;
  perform semap.lock_regions_exclusive();
  select array_agg(r.region_id) into v_gone
  from semap.region r left join semap.region_wanted w using (query_id, instance_id)
  where r.instance_id = any (p_instance_ids) and w.instance_id is null;
  v_changed := semap.write_regions(p_instance_ids);
  if v_gone is null and v_changed is null then
    return;
  end if;

  perform semap.flush_maps(array(select distinct map_id from semap.region where region_id = any (v_gone || v_changed)));
  perform semap.unsettle(v_gone || v_changed);
  perform semap.index_regions(v_changed);
  perform semap.unsettle(v_changed);
  perform semap.note_valid_from(v_changed);
  v_crossings := semap.crossings_by_edit(v_changed, v_gone);
  perform semap.record_crossings(v_crossings);
  perform semap.settle_relations(array_agg(n))
  from semap.region r join semap.relation n using (query_id, instance_id) where r.region_id = any (v_gone || v_changed);
  delete from semap.region where region_id = any (v_gone);
  update semap.track_now t
  set region_ids = h.plain_ids, stateful_ids = h.stateful_ids
  from semap.regions_held(array(
    select track_id from unnest(v_crossings)
    union
    select n.track_id from semap.region r join semap.relation n using (query_id, instance_id)
    where r.region_id = any (v_changed))) h
  where t.track_id = h.track_id;
end $$;

-- A footprint was added, edited or removed: its regions follow.
create or replace function semap.abstraction_changed() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  if tg_op <> 'DELETE' then
    perform semap.refresh_pairs_of(array_agg(distinct instance_id)) from new_row where instance_id is not null;
  end if;
  if tg_op <> 'INSERT' then
    perform semap.refresh_pairs_of(array_agg(distinct instance_id)) from old_row where instance_id is not null;
  end if;
  if tg_op = 'INSERT' then
    perform semap.refresh_regions(array_agg(i.instance_id)) from semap.instance i
    where i.absolute_description_id in (select description_id from new_row where type = 'Footprint');
  elsif tg_op = 'DELETE' then
    perform semap.refresh_regions(array_agg(i.instance_id)) from semap.instance i
    where i.absolute_description_id in (select description_id from old_row where type = 'Footprint');
  else
    perform semap.refresh_regions(array_agg(i.instance_id)) from semap.instance i
    where i.absolute_description_id in (select description_id from old_row where type = 'Footprint'
                                        union select description_id from new_row where type = 'Footprint');
  end if;
  return null;
end $$;

create or replace trigger abstraction_inserted after insert on semap.abstraction
  referencing new table as new_row for each statement execute function semap.abstraction_changed();
create or replace trigger abstraction_updated after update on semap.abstraction
  referencing old table as old_row new table as new_row for each statement execute function semap.abstraction_changed();
create or replace trigger abstraction_deleted after delete on semap.abstraction
  referencing old table as old_row for each statement execute function semap.abstraction_changed();

-- An instance was added, changed its concept, name or description, or was removed: its regions follow.
create or replace function semap.instance_changed() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  if tg_op = 'DELETE' then
    perform semap.refresh_regions(array_agg(instance_id)) from old_row;
    perform semap.refresh_pairs_of(array_agg(instance_id)) from old_row;
  else
    perform semap.refresh_regions(array_agg(instance_id)) from new_row;
    perform semap.refresh_pairs_of(array_agg(instance_id)) from new_row;
  end if;
  return null;
end $$;

create or replace trigger instance_inserted after insert on semap.instance
  referencing new table as new_row for each statement execute function semap.instance_changed();
create or replace trigger instance_updated after update on semap.instance
  referencing new table as new_row for each statement execute function semap.instance_changed();
create or replace trigger instance_deleted after delete on semap.instance
  referencing old table as old_row for each statement execute function semap.instance_changed();

-- A concept moved in the taxonomy: the regions follow.
create or replace function semap.concepts_moved() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  perform semap.refresh_regions(array_agg(distinct instance_id))
  from (
    select r.instance_id
    from semap.region r left join semap.region_wanted w using (query_id, instance_id)
    where w.instance_id is null
    union all
    select w.instance_id
    from semap.region_wanted w left join semap.region r using (query_id, instance_id)
    where r.instance_id is null
  ) differing;
  perform semap.refresh_pairs(array_agg(q.query_id), null)
  from semap.continuous_query q join semap.query_predicate p using (query_id)
  where q.in_pairs and q.enabled
    -- what is an opening
    and (q.subject_concept_id is not null or q.object_concept_id is not null or p.object_compared = 'line');
  return null;
end $$;

create or replace trigger concept_moved after insert or update or delete on semap.concept_parent
  for each statement execute function semap.concepts_moved();

-- A continuous query was added, changed or removed: its regions follow.
create or replace function semap.queries_changed() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_query_ids  integer[];
begin
  if tg_op = 'DELETE' then
    select array_agg(query_id) into v_query_ids from old_query;
  else
    select array_agg(query_id) into v_query_ids from new_query;
    perform semap.choose_tracks(v_query_ids, null);
  end if;
  if tg_op = 'UPDATE' then
    -- what it was in pairs ends before it begins in regions
    perform semap.refresh_pairs(array_agg(query_id), null, null, true)
    from new_query n join old_query o using (query_id) where o.in_pairs and not n.in_pairs
    having count(*) > 0;
  end if;
  if tg_op = 'UPDATE' then
    perform semap.read_again(array_agg(distinct g.track_id), min(g.to_stamp))
    from new_query n join old_query o using (query_id) join semap.track_reading g on g.map_id = n.map_id
    where n.follows_amendments and not o.follows_amendments
    having count(*) > 0;
  end if;
  perform semap.refresh_regions(array_agg(distinct instance_id))
  from (select instance_id from semap.region where query_id = any (v_query_ids)
        union all select instance_id from semap.region_wanted where query_id = any (v_query_ids)) i;
  if tg_op = 'UPDATE' then
    -- one that has only another name asks what it asked
    perform semap.refresh_pairs(array_agg(query_id), null, null, is_other)
    from (select n.query_id, not (n.enabled and o.enabled
                                  and to_jsonb(n) - '{name,payload,sql}'::text[]
                                      = to_jsonb(o) - '{name,payload,sql}'::text[]) as is_other
          from new_query n join old_query o using (query_id) where n.in_pairs) q
    group by is_other;
  elsif exists (select from semap.pair_side where query_id = any (v_query_ids))
     or exists (select from semap.pair_query where query_id = any (v_query_ids)) then
    perform semap.refresh_pairs(v_query_ids, null, null, true);
  end if;
  return null;
end $$;

create or replace trigger continuous_query_inserted after insert on semap.continuous_query
  referencing new table as new_query for each statement execute function semap.queries_changed();
create or replace trigger continuous_query_updated after update on semap.continuous_query
  referencing old table as old_query new table as new_query for each statement execute function semap.queries_changed();
create or replace trigger continuous_query_deleted after delete on semap.continuous_query
  referencing old table as old_query for each statement execute function semap.queries_changed();

-- With a map goes what happened on it: a map of the same name starts anew. Its events belong to the
-- rule worker, which deletes them when it comes to this place in the log.
create or replace function semap.map_deleted() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  delete from semap.relation where map_id in (select map_id from old_map);
  delete from semap.pair_instance where map_id in (select map_id from old_map);
  delete from semap.pair_query where map_id in (select map_id from old_map);
  delete from semap.followed_state where map_id in (select map_id from old_map);
  delete from semap.relation_change where map_id in (select map_id from old_map);
  delete from semap.relation_past where map_id in (select map_id from old_map);
  delete from semap.region where map_id in (select map_id from old_map);
  delete from semap.row_version where map_id in (select map_id from old_map);
  return null;
end $$;

create or replace trigger map_deleted after delete on semap.map
  referencing old table as old_map for each statement execute function semap.map_deleted();
