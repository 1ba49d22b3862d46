-- States that were, for whoever may see their tracks. The view semap.track_state_seen finds what lies in a stretch of
-- time; what it would have to sort first (the newest one before a moment, the first hundred) is found here by an index.
-- All that is here acts for its owner and looks for itself which maps its caller may see.

-- Whether the caller may see a track.
create or replace function semap.may_see_track(p_track_id bigint) returns boolean
language sql stable parallel safe as $$
  select semap.visible_maps() is null
      or exists (select from semap.track where track_id = p_track_id and map_id = any (semap.visible_maps()))
$$;
comment on function semap.may_see_track is
  'Whether the caller may see a track.';

-- The first states of a track between two moments, both included, that come after a third one.
create or replace function semap.states_of_track(
  p_track_id bigint, p_from timestamptz, p_to timestamptz, p_after timestamptz, p_limit integer
) returns setof semap.track_state
language plpgsql stable parallel safe security definer
set search_path = pg_catalog, pg_temp set plan_cache_mode = force_custom_plan as $$
begin
  if semap.may_see_track(p_track_id) then
    return query
      select * from semap.track_state s
      where s.track_id = p_track_id and s.stamp >= p_from and s.stamp <= p_to and s.stamp > p_after
      order by s.stamp limit p_limit;
  end if;
end $$;
comment on function semap.states_of_track is
  'The first states of a track between two moments, both included, that come after a third one.';

-- The newest state of a track at a moment, not older than another moment.
create or replace function semap.state_before(p_track_id bigint, p_at timestamptz, p_since timestamptz default '-infinity')
returns setof semap.track_state
language plpgsql stable parallel safe security definer rows 1
set search_path = pg_catalog, pg_temp set plan_cache_mode = force_custom_plan as $$
begin
  if semap.may_see_track(p_track_id) then
    return query
      select * from semap.track_state s
      where s.track_id = p_track_id and s.stamp <= p_at and s.stamp >= p_since
      order by s.stamp desc limit 1;
  end if;
end $$;
comment on function semap.state_before is
  'The newest state of a track at a moment, not older than another moment.';

-- The stamp of the first state of any track of a map. The first p_look states of all maps are looked at together; where
-- the map began after them, its tracks are looked up one by one.
create or replace function semap.first_state_of_map(p_map_id integer, p_look integer default 10000) returns timestamptz
language plpgsql stable parallel safe security definer
set search_path = pg_catalog, pg_temp set plan_cache_mode = force_custom_plan as $$
declare
  v_first  timestamptz;
begin
  if not coalesce(p_map_id = any (semap.visible_maps()), true) then
    return null;
  end if;
  select s.stamp into v_first
  from (select e.track_id, e.stamp from semap.track_state e order by e.stamp limit p_look) s
  join semap.track t on t.track_id = s.track_id and t.map_id = p_map_id
  order by s.stamp limit 1;
  if v_first is null then
    select min(f.stamp) into v_first
    from semap.track t
    cross join lateral (select s.stamp from semap.track_state s where s.track_id = t.track_id order by s.stamp limit 1) f
    where t.map_id = p_map_id;
  end if;
  return v_first;
end $$;
comment on function semap.first_state_of_map is
  'The stamp of the first state of any track of a map.';

do $$
declare
  v_role      text;
  v_function  regprocedure;
begin
  foreach v_function in array array[
    'semap.states_of_track(bigint, timestamptz, timestamptz, timestamptz, integer)',
    'semap.state_before(bigint, timestamptz, timestamptz)',
    'semap.first_state_of_map(integer, integer)',
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
