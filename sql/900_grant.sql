-- Who may write what: each stage writes its own tables and reads all. Triggers keep relations on
-- everyone's behalf, so that nobody can write one without the state or the map edit that causes it.
do $$
declare
  v_role text;
begin
  foreach v_role in array array['semap_read', 'semap_ingest', 'semap_worker', 'semap_api'] loop
    if not exists (select from pg_roles where rolname = v_role) then
      begin
        execute format('create role %I nologin', v_role);
      exception when duplicate_object or unique_violation then
        null; -- another database of this server made it at the same moment
      end;
    end if;
    execute format('grant usage on schema semap to %I', v_role);
    execute format('grant select on all tables in schema semap to %I', v_role);
  end loop;
  foreach v_role in array array['semap_ingest', 'semap_worker', 'semap_api'] loop
    if not pg_has_role(current_user, v_role, 'member') then
      execute format('grant %I to current_user', v_role);
    end if;
  end loop;
end $$;

grant insert, update on semap.source, semap.recording, semap.track to semap_ingest;
grant insert on semap.track_state to semap_ingest;

grant insert on semap.event, semap.event_evidence to semap_worker;
grant insert, update on semap.progress to semap_worker;

grant insert, update, delete on
  semap.map, semap.concept, semap.frame, semap.frame_pose, semap.description, semap.geometry,
  semap.abstraction, semap.instance, semap.door_room, semap.continuous_query, semap.rule
to semap_api;
