-- What of the past is asked of one state at a time, by whoever may see its track.

-- Where a track was at the stamp of one of its states; null where it has none then.
create or replace function semap.place_at(p_track_id bigint, p_stamp timestamptz) returns public.geometry
language sql stable parallel safe as $$
  select public.st_point(s.x_m, s.y_m) from semap.states(array[p_track_id], p_stamp, p_stamp) s
$$;

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
    'semap.states(bigint[], timestamptz, timestamptz)',
    'semap.states_around(bigint, timestamptz, integer, integer, timestamptz, timestamptz)',
    'semap.states_of_map(integer, timestamptz, timestamptz)',
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
