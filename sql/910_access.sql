-- Who may see what of which map. semap_admin may do what writers and sources of the service may, and keeps tokens and
-- webhooks. The roles that end in _map are for callers who are restricted to maps: row-level security keeps them within
-- semap.visible_maps(), and without any they see nothing. All others see every row.

-- Which maps are a caller's own is asked once for a statement; a table without map_id follows its parent, whose rows
-- the caller sees or does not. Restricted roles cannot read the tables of
-- states, but ask semap.states.
do $$
declare
  c_all  constant text := 'semap_read, semap_ingest, semap_worker, semap_api, semap_admin';
  c_own  constant text := 'semap_read_map, semap_ingest_map, semap_api_map';
  v_table  record;
begin
  set constraints all immediate; -- no table can be altered whose constraints have yet to be checked
  for v_table in
    with own (name, condition) as (
      select c.relname::text, 'map_id = any ((select semap.visible_maps())::integer[])'
      from pg_class c join pg_attribute a on a.attrelid = c.oid and a.attname = 'map_id' and not a.attisdropped
      where c.relnamespace = 'semap'::regnamespace and c.relkind in ('r', 'p') and not c.relispartition
        and c.relname <> 'token_map'
      union all values
        ('frame_pose', 'exists (select from semap.frame p where p.frame_id = frame_pose.frame_id)'),
        ('geometry', 'exists (select from semap.description p where p.description_id = geometry.description_id)'),
        ('abstraction', 'exists (select from semap.description p where p.description_id = abstraction.description_id)'),
        ('door_room', 'exists (select from semap.instance p where p.instance_id = door_room.door_id)'
                      ' and exists (select from semap.instance p where p.instance_id = door_room.room_id)'),
        ('door_now', 'exists (select from semap.instance p where p.instance_id = door_now.instance_id)'),
        ('track_end', 'exists (select from semap.track p where p.track_id = track_end.track_id)'),
        ('source_count', 'exists (select from semap.source p where p.source_id = source_count.source_id)'),
        ('recording', 'exists (select from semap.source p where p.source_id = recording.source_id)'),
        ('rule_query', 'exists (select from semap.rule p where p.rule_id = rule_query.rule_id)'),
        ('event_evidence', 'exists (select from semap.event p where p.event_id = event_evidence.event_id)'),
        ('event_place', 'exists (select from semap.event p where p.event_id = event_place.event_id)'),
        ('event_amendment', 'exists (select from semap.event p where p.event_id = event_amendment.event_id)'),
        ('change_set', 'exists (select from semap.row_version p where p.change_set_id = change_set.change_set_id)'))
    -- what is as it should be is left alone: to alter a table is to wait for all who read it
    select o.name, o.condition, md5(c_all || c_own || o.condition) as version
    from own o
    join pg_class c on c.relname = o.name and c.relnamespace = 'semap'::regnamespace
    left join pg_policy p on p.polrelid = c.oid and p.polname = 'own_maps'
    where not c.relrowsecurity
       or obj_description(p.oid, 'pg_policy') is distinct from md5(c_all || c_own || o.condition)
  loop
    execute format('alter table semap.%I enable row level security', v_table.name);
    execute format('drop policy if exists every_map on semap.%I', v_table.name);
    execute format('create policy every_map on semap.%I to %s using (true)', v_table.name, c_all);
    execute format('drop policy if exists own_maps on semap.%I', v_table.name);
    execute format('create policy own_maps on semap.%I to %s using (%s)', v_table.name, c_own, v_table.condition);
    execute format('comment on policy own_maps on semap.%I is %L', v_table.name, v_table.version);
  end loop;
  execute 'grant select on'
    ' semap.map, semap.place, semap.map_anchor, semap.map_grid, semap.concept, semap.concept_parent, semap.concept_iri,'
    ' semap.frame, semap.frame_pose, semap.description, semap.geometry, semap.abstraction, semap.instance,'
    ' semap.door_room, semap.door_leaf, semap.door_now, semap.change_set, semap.row_version, semap.source,'
    ' semap.recording, semap.camera_report, semap.bridge, semap.bridge_position, semap.track,'
    ' semap.track_now, semap.track_amendment, semap.track_reading,'
    ' semap.predicate, semap.continuous_query, semap.condition, semap.region, semap.relation,'
    ' semap.relation_change, semap.relation_past,'
    ' semap.query_track, semap.pair_query, semap.pair_instance, semap.followed_state, semap.pair_progress,'
    ' semap.track_end, semap.object_state, semap.rule,'
    ' semap.rule_query, semap.rule_version, semap.rule_given_up, semap.late_row, semap.event_number, semap.event_count,'
    ' semap.event_evidence, semap.event_place,'
    ' semap.event_amendment, semap.recompute_run, semap.source_count, semap.kept_table,'
    ' semap.behaviour, semap.schema_version, semap.door_present, semap.relation_held, semap.relation_now,'
    ' semap.relation_span,'
    ' semap.track_place, semap.track_present, semap.track_amended, semap.retention'
    ' to ' || c_own;
  -- the place of an event among those of all maps, and how far the log is, would tell how much happens on others
  execute (
    select format('grant select (%s) on semap.event to %s', string_agg(quote_ident(attname), ', '), c_own)
    from pg_attribute
    where attrelid = 'semap.event'::regclass and attnum > 0 and not attisdropped and attname <> 'seq');
  execute 'grant select (worker) on semap.progress to ' || c_own;
end $$;

-- Tokens are secrets of those who keep them: what can be seen by all others is not that they exist.
revoke all on semap.token, semap.token_map
from semap_read, semap_ingest, semap_worker, semap_api, semap_read_map, semap_ingest_map, semap_api_map;
grant insert, delete on semap.login_map to semap_admin;
grant insert, update (last_used_at, revoked_at) on semap.token to semap_admin;
grant insert on semap.token_map to semap_admin;

-- The way into other databases, maybe with a password, is for those who keep tokens; others see which shards there are.
revoke select on semap.shard from semap_read, semap_ingest, semap_worker, semap_api;
grant select (shard_id, name, draining, added_at) on semap.shard
to semap_read, semap_ingest, semap_worker, semap_api;
grant update (draining) on semap.shard to semap_admin;
grant insert, update, delete on semap.place to semap_admin;
grant usage on sequence semap.map_map_id_seq to semap_admin;
grant execute on function semap.forget_place, semap.leave_place to semap_admin;

-- semap_admin: all that writers and sources may.
grant insert, delete, update (name) on semap.map to semap_admin;
grant insert, update, delete on
  semap.map_anchor, semap.map_grid, semap.concept, semap.concept_parent, semap.concept_iri, semap.frame,
  semap.frame_pose, semap.description, semap.geometry, semap.abstraction,
  semap.instance, semap.door_room, semap.continuous_query, semap.rule
to semap_admin;
grant insert on
  semap.source, semap.recording, semap.track, semap.track_state, semap.line_observation,
  semap.object_state,
  semap.track_amendment
to semap_admin;
grant update (watermark, lateness, ended) on semap.source to semap_admin;
grant update (states_done, finished_at) on semap.recording to semap_admin;
grant update (ended_at) on semap.track to semap_admin;
grant execute on function
  semap.ensure_partitions, semap.add_states, semap.undo_change_set, semap.drop_day, semap.drop_rows
to semap_admin;
grant update (drop_after) on semap.retention to semap_admin;

-- A writer of some maps: as semap_api, but no maps are made, and no concepts, which all maps share.
grant delete, update (name) on semap.map to semap_api_map;
grant insert, update, delete on
  semap.map_anchor, semap.map_grid, semap.frame, semap.frame_pose, semap.description, semap.geometry,
  semap.abstraction, semap.instance, semap.door_room, semap.continuous_query, semap.rule
to semap_api_map;
grant execute on function semap.undo_change_set to semap_api_map;

-- A source of some maps, as far as the service takes what sources say.
grant insert on semap.source, semap.object_state to semap_ingest_map;
grant update (watermark, lateness, ended) on semap.source to semap_ingest_map;
