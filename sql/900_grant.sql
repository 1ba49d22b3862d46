-- Who may write what: each stage writes its own tables and reads all. Triggers keep relations on
-- everyone's behalf, so that nobody can write one without the state or the map edit that causes it; a
-- function that acts for its owner may be called only by whom it is for.
do $$
declare
  -- the right to SET ROLE, which since PostgreSQL 16 membership alone is not: who creates a role may just grant it
  c_act  constant text := case when current_setting('server_version_num')::integer >= 160000 then 'set'
                               else 'member' end;
  v_role      text;
  v_function  regprocedure;
begin
  foreach v_role in array array['semap_read', 'semap_ingest', 'semap_worker', 'semap_api', 'semap_admin',
                                'semap_read_map', 'semap_ingest_map', 'semap_api_map', 'semap_compile'] loop
    if not exists (select from pg_roles where rolname = v_role) then
      begin
        execute format('create role %I nologin', v_role);
      exception when duplicate_object or unique_violation then
        null; -- another database of this server made it at the same moment
      end;
    end if;
    if not pg_has_role(current_user, v_role, c_act) then
      execute format('grant %I to current_user', v_role);
    end if;
    execute format('grant usage on schema semap to %I', v_role);
    execute format('revoke all on all tables in schema semap from %I', v_role);
    if v_role not like '%\_map' and v_role <> 'semap_compile' then -- what those may read, sql/910 says
      execute format('grant select on all tables in schema semap to %I', v_role);
    end if;
  end loop;
  for v_function in
    select oid from pg_proc where pronamespace = 'semap'::regnamespace and prosecdef
  loop
    execute format('revoke execute on function %s from public', v_function);
  end loop;
end $$;

-- What was compiled of a condition runs with the rights of whoever made the schema: nobody else may say it.
grant execute on function semap.keep_condition to semap_compile;

grant insert on
  semap.source, semap.recording, semap.track, semap.track_state, semap.line_observation,
  semap.object_state,
  semap.track_amendment
to semap_ingest;
grant update (watermark, lateness, ended) on semap.source to semap_ingest;
grant update (states_done, finished_at) on semap.recording to semap_ingest;
grant update (ended_at) on semap.track to semap_ingest;
grant insert, update, delete on semap.bridge, semap.bridge_position to semap_ingest;
grant insert on semap.camera_report to semap_ingest;
grant execute on function semap.ensure_partitions, semap.add_states, semap.correct_some, semap.hand_over_tracks
to semap_ingest;

grant execute on function semap.correct_some, semap.compact_states, semap.flush_silent_sources,
  semap.complete_silent_sources,
  semap.commit_progress, semap.add_events, semap.collect_events, semap.commit_recompute,
  semap.retract_events to semap_worker;
grant execute on function
  semap.ensure_partitions, semap.drop_day, semap.drop_rows
to semap_worker;
grant update (idle) on semap.source to semap_worker;
grant update (alive_at) on semap.progress to semap_worker;
grant update (replayed_at) on semap.late_row to semap_worker;

grant insert, delete, update (name) on semap.map to semap_api;
grant insert, update, delete on
  semap.map_anchor, semap.map_grid, semap.concept, semap.concept_parent, semap.concept_iri, semap.frame,
  semap.frame_pose, semap.description, semap.geometry, semap.abstraction,
  semap.instance, semap.door_room, semap.continuous_query, semap.rule
to semap_api;
grant insert on semap.source, semap.object_state to semap_api;
grant update (watermark, lateness) on semap.source to semap_api;
grant execute on function semap.undo_change_set to semap_api;
