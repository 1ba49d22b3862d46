-- The identity of a change: a function of what happened, so that a replay gives the same one.
create or replace function semap.change_uid(
  p_query text, p_track uuid, p_instance uuid, p_kind text, p_cause text, p_edge_at timestamptz
) returns uuid
language sql stable parallel safe
return md5(p_query || '|' || p_track || '|' || p_instance || '|' || p_kind || '|' || p_cause || '|'
           || (extract(epoch from p_edge_at) * 1000000)::bigint)::uuid;

-- Through what a boundary was crossed at a place on it: the number of the edge, as the vertices of the outline follow
-- on one another (1 is from the first to the second), and the nearest door of the instance, not further away than a
-- thick wall: by its outline, else its line (sql/119), else its origin. A place that is not on the outline was not
-- crossed at.
create or replace function semap.crossed_at(
  p_region_id integer, p_x_m double precision, p_y_m double precision,
  out edge integer, out door_id bigint, out door_name text
) language plpgsql stable strict as $$ -- an outline is taken apart only where there is an edge to be found
declare
  c_near_m       constant double precision := 0.001;
  v_point        public.geometry := public.st_point(p_x_m, p_y_m);
  v_instance_id  bigint;
begin
  select r.instance_id, s.ordinal into v_instance_id, edge
  from semap.region r, public.st_dumpsegments(r.footprint) with ordinality as s (path, geom, ordinal)
  where r.region_id = p_region_id and r.compared = 'ground'
    and public.st_dwithin(public.st_boundary(r.footprint), v_point, c_near_m)
    and s.geom operator(public.&&) public.st_expand(v_point, c_near_m)
    and public.st_distance(s.geom, v_point) <= c_near_m
  order by public.st_distance(s.geom, v_point), ordinal limit 1;
  if edge is null then
    return;
  end if;
  select i.instance_id, i.name into door_id, door_name
  from semap.door_room j
  join semap.instance i on i.instance_id = j.door_id
  left join semap.abstraction a on a.description_id = i.absolute_description_id and a.type = 'Footprint'
  cross join lateral (
    select coalesce(a.geometry, (semap.doorway(i)).line, public.st_force2d(semap.origin_in_root(i.frame_id))) as shape
    offset 0) door
  where j.room_id = v_instance_id and public.st_dwithin(door.shape, v_point, 0.5)
  order by public.st_distance(door.shape, v_point), i.uid limit 1;
end $$;

-- What of relations is remembered goes, and what holds stays: these begin anew where they are looked at next.
create or replace function semap.settle_relations(p_relations semap.relation[]) returns void
language sql as $$
  with gone as (
    delete from semap.relation n using unnest(p_relations) s
    where n.query_id = s.query_id and n.subject_key = s.subject_key and n.object_key = s.object_key and not n.confirmed
  )
  update semap.relation n
  set pending = true, pending_at = null, raw = true, raw_at = null, x_m = null, y_m = null
  from unnest(p_relations) s
  where n.query_id = s.query_id and n.subject_key = s.subject_key and n.object_key = s.object_key and n.confirmed
    and not (n.pending and n.raw)
$$;

-- Write crossings to relation_change in the order of their stamps, bring relation up to date, and keep what is over in
-- relation_past. Those of one track and region come in the order in which they happened. An edit of the map has no
-- event time of its own and takes the last stamp of each track, so the same crossing may happen twice at one stamp: its
-- identity is random.
create or replace function semap.record_crossings(p_crossings semap.crossing[]) returns void
language plpgsql set random_page_cost = 1.1 as $$ -- few rows are found by their place, and no table is read for them
begin
  if p_crossings is null then
    return;
  end if;

  -- the fenced look-ups keep the plan on the keys, whatever relations held when it was planned
  with told as materialized (
    select c.track_id, c.region_id, c.kind, c.cause, c.stamp, c.transition_at, c.x_m, c.y_m, c.place,
           r.map_id, r.query_id, r.query_name, r.instance_id, r.instance_uid, r.instance_name,
           t.uid as track_uid, t.name as track_name, n.place as relation_place,
           n.is_remembered and r.stateful and c.cause = 'moved' as is_remembered,
           case when c.kind = 'began' then c.transition_at
                else least(coalesce(lag(c.transition_at) over one_pair, n.since), c.transition_at) end as since,
           lead(c.kind) over one_pair is null as is_final, w.edge, w.door_id, w.door_name
    from unnest(p_crossings) with ordinality
      as c (track_id, region_id, kind, cause, stamp, transition_at, x_m, y_m, place)
    cross join lateral (select * from semap.region r where r.region_id = c.region_id offset 0) r
    cross join lateral (select uid, name from semap.track t where t.track_id = c.track_id offset 0) t
    left join lateral (select since, ctid as place, pending or raw as is_remembered from semap.relation n
                       where n.query_id = r.query_id and n.subject_key = c.track_id and n.object_key = -r.instance_id
                       offset 0) n on true
    left join lateral semap.crossed_at(c.region_id, case when c.cause = 'moved' then c.x_m end, c.y_m) w on true
    window one_pair as (partition by c.track_id, c.region_id order by c.place)
  ), changed as (
    insert into semap.relation_change (uid, map_id, query_id, query_name, track_id, track_name,
                                       instance_id, instance_name, kind, cause, stamp, transition_at, since, x_m, y_m,
                                       edge, door_id, door_name)
    select case when cause = 'map' then gen_random_uuid()
                else semap.change_uid(query_name, track_uid, instance_uid, kind::text, cause::text, transition_at) end,
           map_id, query_id, query_name, track_id, track_name, instance_id, instance_name, kind, cause, stamp,
           transition_at, since, x_m, y_m, edge, door_id, door_name
    from told
    order by stamp, transition_at, track_name collate "C", track_uid, cause = 'disappeared', kind desc, instance_uid,
             place
  ), past as (
    insert into semap.relation_past (map_id, query_id, query_name, track_id, track_name, instance_id, instance_name,
                                     since, until)
    select map_id, query_id, query_name, track_id, track_name, instance_id, instance_name, since, transition_at
    from told where kind = 'ended' order by transition_at, place
  ), gone as (
    delete from semap.relation where ctid = any (array(
      select relation_place from told where is_final and kind = 'ended' and not is_remembered))
  ), ended as (
    update semap.relation set confirmed = false, since = null where ctid = any (array(
      select relation_place from told where is_final and kind = 'ended' and is_remembered))
  )
  insert into semap.relation (query_id, map_id, track_id, instance_id, confirmed, since, pending, raw)
  select query_id, map_id, track_id, instance_id, true, since, true, true from told where is_final and kind = 'began'
  on conflict (query_id, subject_key, object_key) do update set confirmed = true, since = excluded.since;
end $$;
