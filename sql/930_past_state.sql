-- States that were, be they rows or packed, for whoever may see their tracks. The view semap.track_state_seen finds
-- what lies in a stretch of time; what it would have to sort first (the newest one before a moment, the first hundred)
-- is found here by an index. States are kept in the order of time and not of their tracks, which would make each write
-- dearer: a look at one track reads those of the others at that time, so it never leaves the time in which the track
-- was seen. All that is here acts for its owner and looks for itself which maps its caller may see.

-- When a track was seen first and last, or ended; nothing of one that the caller may not see. Its last state may be one
-- that is not written to its present (sql/135), or that was set aside (sql/131).
create or replace function semap.seen_between(p_track_id bigint, out first timestamptz, out last timestamptz)
returns setof record
language sql stable parallel safe rows 1 as $$
  select n.first_stamp, greatest(n.stamp, n.outlier_stamp, c.frame_stamp)
  from semap.track_now n left join semap.source_count c using (source_id)
  where n.track_id = p_track_id
    and ((select semap.visible_maps() is null) or n.map_id = any ((select semap.visible_maps())::integer[]))
$$;

-- The first states of a track between two moments, both included, that come after a third one. Of packed ones only so
-- many are opened as it takes.
create or replace function semap.states_of_track(
  p_track_id bigint, p_from timestamptz, p_to timestamptz, p_after timestamptz, p_limit integer
) returns setof semap.track_state
language plpgsql stable parallel safe security definer
set search_path = pg_catalog, pg_temp set plan_cache_mode = force_custom_plan as $$
declare
  v_from  timestamptz;
  v_to    timestamptz;
begin
  select greatest(p_from, first, p_after), least(p_to, last) into v_from, v_to from semap.seen_between(p_track_id);
  select least(v_to, min(to_stamp)) into v_to
  from (select to_stamp,
               sum(states) over (order by from_stamp) - first_value(states) over (order by from_stamp) as states
        from semap.track_state_packed
        where track_id = p_track_id and to_stamp >= v_from and from_stamp > v_from - interval '30 min'
          and from_stamp <= v_to
       ) packed
  where states > p_limit;
  return query
    select track_id, stamp, x_m, y_m, z_m, std_m, is_last, heading_rad, speed_mps, length_m, width_m,
           std_across_m, std_yaw_rad
    from semap.stored_state s
    where s.track_id = p_track_id and s.stamp >= v_from and s.stamp <= v_to and s.stamp > p_after
      and s.from_stamp > v_from - interval '30 min' and s.from_stamp <= v_to and s.to_stamp >= v_from
    order by s.stamp limit p_limit;
end $$;

-- The newest state of a track at a moment, not older than another moment. Of packed ones only the last is opened.
create or replace function semap.state_before(p_track_id bigint, p_at timestamptz,
                                              p_since timestamptz default '-infinity')
returns setof semap.track_state
language plpgsql stable parallel safe security definer rows 1
set search_path = pg_catalog, pg_temp set plan_cache_mode = force_custom_plan as $$
declare
  v_since  timestamptz;
  v_at     timestamptz;
begin
  select greatest(p_since, first), least(p_at, last) into v_since, v_at from semap.seen_between(p_track_id);
  select greatest(v_since, max(from_stamp)) into v_since
  from semap.track_state_packed where track_id = p_track_id and from_stamp <= v_at;
  return query
    select track_id, stamp, x_m, y_m, z_m, std_m, is_last, heading_rad, speed_mps, length_m, width_m,
           std_across_m, std_yaw_rad
    from semap.stored_state s
    where s.track_id = p_track_id and s.stamp <= v_at and s.stamp >= v_since
      and s.from_stamp > v_since - interval '30 min' and s.from_stamp <= v_at and s.to_stamp >= v_since
    order by s.stamp desc limit 1;
end $$;

-- Where a track was at the stamp of one of its states; null where it has none then. Its plan is made once, and
-- partitions of other days are left out when it is asked: in a statement about many events, each partition would cost
-- each time.
create or replace function semap.place_at(p_track_id bigint, p_stamp timestamptz) returns public.geometry
language plpgsql stable parallel safe strict security definer
set search_path = pg_catalog, pg_temp set plan_cache_mode = force_generic_plan as $$
begin
  if not exists (select from semap.seen_between(p_track_id)) then
    return null;
  end if;
  return (
    select public.st_point(s.x_m, s.y_m) from semap.stored_state s
    where s.track_id = p_track_id and s.stamp = p_stamp
      and s.from_stamp > p_stamp - interval '30 min' and s.from_stamp <= p_stamp and s.to_stamp >= p_stamp
    limit 1);
end $$;

-- The stamp of the first state of any track of a map.
create or replace function semap.first_state_of_map(p_map_id integer) returns timestamptz
language sql stable parallel safe security definer set search_path = pg_catalog, pg_temp as $$
  select nullif(min(first_stamp), 'infinity') from semap.track_now
  where map_id = p_map_id
    and ((select semap.visible_maps() is null) or p_map_id = any ((select semap.visible_maps())::integer[]))
$$;

do $$
declare
  v_role      text;
  v_function  regprocedure;
begin
  foreach v_function in array array[
    'semap.visible_maps()',
    'semap.states_of_track(bigint, timestamptz, timestamptz, timestamptz, integer)',
    'semap.state_before(bigint, timestamptz, timestamptz)',
    'semap.place_at(bigint, timestamptz)',
    'semap.first_state_of_map(integer)',
    'semap.concepts_as_of(timestamptz)'
  ]::regprocedure[] loop
    execute format('revoke execute on function %s from public', v_function);
    foreach v_role in array array[
      'semap_read', 'semap_ingest', 'semap_worker', 'semap_api', 'semap_admin',
      'semap_read_map', 'semap_ingest_map', 'semap_api_map'
    ] loop
      execute format('grant execute on function %s to %I', v_function, v_role);
    end loop;
  end loop;
end $$;
