-- Pairs follow the map, the queries, and who is on it.

-- Part whoever takes part in these queries no more: of these things or (null) of all. Gives the queries whose nearest
-- ones have to be looked up again without them.
create or replace function semap.let_members_go(p_query_ids integer[], p_keys bigint[]) returns integer[]
language plpgsql as $$
declare
  v_gone     record;
  v_nearest  integer[] := '{}';
begin
  for v_gone in
    select m.query_id, array_agg(m.key) filter (where not m.is_object) as subject_keys,
           array_agg(m.key) filter (where m.is_object) as object_keys
    from semap.pair_member m
    where m.query_id = any (p_query_ids) and (p_keys is null or m.key = any (p_keys))
      and not exists (select from semap.pair_instance_wanted w
                      where w.query_id = m.query_id and w.is_object = m.is_object and w.instance_id = m.instance_id)
      and not exists (select from semap.pair_track_wanted w
                      where w.query_id = m.query_id and w.is_object = m.is_object and w.track_id = m.track_id)
    group by m.query_id order by m.query_id
  loop
    v_nearest := v_nearest || semap.part_pairs(array[v_gone.query_id], v_gone.subject_keys, v_gone.object_keys,
                                               null, 'map');
  end loop;
  return v_nearest;
end $$;

-- Put the instances that take part in these queries where they are, of these things or (null) of all, and tell which are
-- not what they were. What rests on what depends on more than outlines, and is taken as changed.
create or replace function semap.place_instance_members(p_query_ids integer[], p_keys bigint[]) returns bigint[]
language plpgsql as $$
declare
  v_changed  bigint[];
begin
  with wanted as materialized (
    select * from semap.pair_instance_wanted w
    where w.query_id = any (p_query_ids) and (p_keys is null or w.instance_id = any (array(select -k from unnest(p_keys) k)))
  ), changed as (
    select array_agg(distinct -w.instance_id) as keys
    from wanted w
    left join semap.pair_member m on m.key = -w.instance_id and m.query_id = w.query_id and m.is_object = w.is_object
    where m.key is null or w.predicate = 'on'
       or (st_asbinary(w.place), st_asbinary(w.shape), w.z_min_m, w.z_max_m, w.yaw_rad)
          is distinct from (st_asbinary(m.place), st_asbinary(m.shape), m.z_min_m, m.z_max_m, m.yaw_rad)
  ), placed as (
    insert into semap.pair_member as m (query_id, is_object, map_id, query_name, instance_id, uid, name, place, shape, box,
                                        z_min_m, z_max_m, yaw_rad)
    select query_id, is_object, map_id, query_name, instance_id, uid, name, place, shape,
           semap.pair_box(st_xmin(shape), st_ymin(shape), st_xmax(shape), st_ymax(shape), query_id, is_object),
           z_min_m, z_max_m, yaw_rad
    from wanted
    on conflict (key, query_id, is_object) do update
    set query_name = excluded.query_name, uid = excluded.uid, name = excluded.name, place = excluded.place,
        shape = excluded.shape, box = excluded.box, z_min_m = excluded.z_min_m, z_max_m = excluded.z_max_m,
        yaw_rad = excluded.yaw_rad
  )
  select keys into v_changed from changed;
  return v_changed;
end $$;

-- Take in the tracks that take part in these queries, of these things or (null) of all, and tell which are new, or have
-- another uid, by which the nearest of two is chosen. Each is put where it is, as these queries see it.
create or replace function semap.place_track_members(p_query_ids integer[], p_keys bigint[]) returns bigint[]
language plpgsql as $$
declare
  v_new     bigint[];
  v_states  semap.arrival[];
begin
  with followed as materialized (
    select t.* from (select distinct map_id from semap.continuous_query where query_id = any (p_query_ids)) q
    cross join lateral semap.tracks_followed(q.map_id, (select array_agg(k) from unnest(p_keys) k where k > 0)) t
    where p_keys is null or exists (select from unnest(p_keys) k where k > 0)
  ), wanted as materialized (
    select w.* from semap.pair_track_wanted w join followed using (track_id) where w.query_id = any (p_query_ids)
  )
  select array_agg(distinct w.track_id) filter (where m.key is null or m.uid <> w.uid),
         (select array_agg(row(f.track_id, f.stamp, f.x_m, f.y_m, f.z_m, f.std_m, f.heading_rad, f.speed_mps, f.length_m,
                               f.width_m, false, null, null, null, true, null, null, null, null, '{}', null,
                               null, null)::semap.arrival) from followed f)
  into v_new, v_states
  from wanted w
  left join semap.pair_member m on m.key = w.track_id and m.query_id = w.query_id and m.is_object = w.is_object;
  if v_new is not null then
    insert into semap.pair_member (query_id, is_object, map_id, query_name, track_id, uid, name)
    select query_id, is_object, map_id, query_name, track_id, uid, name
    from semap.pair_track_wanted where query_id = any (p_query_ids) and track_id = any (v_new)
    on conflict do nothing;
  end if;
  update semap.pair_member m
  set query_name = w.query_name, uid = w.uid, name = w.name
  from semap.pair_track_wanted w
  where m.key = w.track_id and m.query_id = w.query_id and m.is_object = w.is_object and w.query_id = any (p_query_ids)
    and (p_keys is null or w.track_id = any (p_keys)) and (m.query_name, m.uid, m.name) is distinct from (w.query_name, w.uid, w.name);
  perform semap.place_tracks(v_states, null);
  return v_new;
end $$;

-- Bring the members of these queries in line, of these things or (null) of all, and compare again whoever is not what it
-- was; everybody, where the queries ask something else now.
create or replace function semap.refresh_pairs(p_query_ids integer[], p_keys bigint[], p_is_other boolean default false)
returns void
language plpgsql as $$
declare
  v_nearest  integer[];
  v_changed  bigint[];
begin
  if p_query_ids is null then
    return;
  end if;
  perform semap.flush_positions(array_agg(source_id order by source_id))
  from semap.source where map_id in (select map_id from semap.pair_side where query_id = any (p_query_ids));
  perform semap.begin_following(array_agg(distinct map_id)) from semap.continuous_query where query_id = any (p_query_ids);
  v_nearest := semap.let_members_go(p_query_ids, p_keys);
  v_changed := semap.place_instance_members(p_query_ids, p_keys) || semap.place_track_members(p_query_ids, p_keys);
  if p_is_other then
    v_changed := array(select distinct key from semap.pair_member where query_id = any (p_query_ids));
    perform semap.note_pair_forms(p_query_ids);
  elsif v_nearest <> '{}' then
    v_changed := v_changed || array(select key from semap.pair_member where query_id = any (v_nearest) and not is_object);
  end if;
  update semap.pair_member m
  set formed_stamp = p.through, formed_track_id = n.track_id
  from (select map_id, max(track_id) as track_id from semap.track_now
        where map_id in (select map_id from semap.continuous_query where query_id = any (p_query_ids)) group by map_id) n
  join semap.pair_progress p using (map_id)
  where m.query_id = any (p_query_ids) and m.key = any (v_changed) and m.map_id = n.map_id;
  perform semap.record_pair_changes(semap.settle_pairs(p_query_ids, v_changed, null, null, 'map'));
end $$;

-- Bring pairs in line with these instances, which were added, edited or removed.
create or replace function semap.refresh_pairs_of(p_instance_ids bigint[]) returns void
language plpgsql as $$
declare
  v_keys  bigint[];
begin
  if not exists (select from semap.continuous_query where in_pairs) then
    return;
  end if;
  v_keys := array(select -id from unnest(p_instance_ids) id);
  perform semap.refresh_pairs(array_agg(query_id), v_keys)
  from (select q.query_id from semap.continuous_query q
        where q.in_pairs and q.enabled
          and q.map_id in (select map_id from semap.instance where instance_id = any (p_instance_ids))
        union
        select m.query_id from semap.pair_member m where m.key = any (v_keys)) concerned;
end $$;

-- Bring pairs in line with these tracks, which are described in another way now.
create or replace function semap.redescribe_tracks(p_track_ids bigint[]) returns void
language plpgsql as $$
declare
  v_source_ids  integer[];
  v_map_ids     integer[];
begin
  select array_agg(distinct t.source_id order by t.source_id), array_agg(distinct t.map_id order by t.map_id)
  into v_source_ids, v_map_ids
  from semap.track t
  where t.track_id = any (p_track_ids)
    and exists (select from semap.continuous_query q where q.map_id = t.map_id and q.in_pairs and q.enabled);
  if v_source_ids is null then
    return;
  end if;
  perform semap.hold_regions();
  perform semap.hold_source(source_id) from unnest(v_source_ids) source_id;
  perform semap.hold_pairs(map_id) from unnest(v_map_ids) map_id;
  perform semap.refresh_pairs(array_agg(query_id), p_track_ids)
  from semap.continuous_query where map_id = any (v_map_ids) and in_pairs and enabled;
end $$;

-- Part tracks that ended, each at the end that it has now, from all that they are paired with, where their pairs were followed
-- up to that end; an end that is further on is met there.
create or replace function semap.part_ended(p_track_ids bigint[]) returns void
language plpgsql as $$
declare
  v_moment  record;
begin
  if not exists (select from semap.pair_member where key = any (p_track_ids)) then
    return;
  end if;
  perform semap.hold_pairs(map_id)
  from (select distinct map_id from semap.pair_member where key = any (p_track_ids) order by map_id) m;
  for v_moment in
    select greatest(k.ended_at, t.stamp) as stamp, array_agg(k.track_id) as track_ids
    from semap.track k join semap.track_now t using (track_id) join semap.pair_progress p on p.map_id = k.map_id
    where k.track_id = any (p_track_ids) and greatest(k.ended_at, t.stamp) <= p.through
    group by 1 order by 1
  loop
    perform semap.let_tracks_go(v_moment.track_ids, v_moment.stamp, 'disappeared');
  end loop;
end $$;
