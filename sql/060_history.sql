-- Every change of the map is kept: each version of each row, in change sets of one transaction each. What is derived
-- from other rows is not, but for the footprints, so that a map of the past can be shown. Edits of a map are one at
-- a time, so that change sets come in the order of their stamps.

-- The change set of this transaction, begun with its first change. `semap.author` and `semap.message` say who and why.
create or replace function semap.current_change_set() returns bigint
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_id  bigint := nullif(current_setting('semap.change_set', true), '')::bigint;
begin
  -- the setting is anybody's: what it names must have begun within this transaction
  if v_id is null or not exists (select from semap.change_set where change_set_id = v_id and made_at >= now()) then
    insert into semap.change_set (made_at, author, message, undoes_id)
    values (clock_timestamp(), coalesce(nullif(current_setting('semap.author', true), ''), session_user),
            nullif(current_setting('semap.message', true), ''),
            nullif(current_setting('semap.undoes', true), '')::bigint)
    returning change_set_id into v_id;
    perform set_config('semap.change_set', v_id::text, true);
  end if;
  return v_id;
end $$;

-- For each table whose rows are kept: its key, the map that a row belongs to, which rows, and its column of shapes.
create or replace view semap.kept_table as
  select * from (values
    (1, 'concept', 'concept_id', 'null::integer', 'true', null),
    (2, 'concept_parent', 'concept_id, parent_id', 'null::integer', 'true', null),
    (3, 'concept_iri', 'concept_id, iri', 'null::integer', 'true', null),
    (4, 'map', 'map_id', 'r.map_id', 'true', null),
    (5, 'map_anchor', 'map_id', 'r.map_id', 'true', null),
    (6, 'frame', 'frame_id', 'r.map_id', 'true', null),
    (7, 'frame_pose', 'frame_id, stamp',
     'coalesce((select o.map_id from semap.frame o where o.frame_id = r.frame_id),'
     ' semap.map_of_row(''frame'', r.frame_id))',
     'true', null),
    (8, 'description', 'description_id', 'r.map_id', 'not r.is_absolute', null),
    (9, 'geometry', 'geometry_id',
     'coalesce((select o.map_id from semap.description o where o.description_id = r.description_id),'
     ' semap.map_of_row(''description'', r.description_id))',
     'true', 'body'),
    (10, 'instance', 'instance_id', 'r.map_id', 'true', null),
    (11, 'door_room', 'door_id, room_id',
     'coalesce((select o.map_id from semap.instance o where o.instance_id = r.door_id),'
     ' semap.map_of_row(''instance'', r.door_id))',
     'true', null),
    (12, 'abstraction', 'abstraction_id',
     'coalesce((select o.map_id from semap.instance o where o.instance_id = r.instance_id),'
     ' semap.map_of_row(''instance'', r.instance_id))',
     'r.type = ''Footprint'' and r.instance_id is not null', 'geometry')
  ) as t (place, table_name, key, map, which, shape);

-- The map of a frame, description or instance, which its versions remember when it is gone.
create or replace function semap.map_of_row(p_table text, p_id bigint) returns integer
language sql stable as $$
  select coalesce(
    case p_table
      when 'frame' then (select map_id from semap.frame where frame_id = p_id)
      when 'description' then (select map_id from semap.description where description_id = p_id)
      when 'instance' then (select map_id from semap.instance where instance_id = p_id)
    end,
    (select map_id from semap.row_version
     where table_name = p_table and row_key = p_id::text and map_id is not null
     order by version_id desc limit 1))
$$;

-- One function and three triggers for each kept table, made from `kept_table` and the table's columns.
do $$
declare
  v_table    record;
  v_content  text;
  v_key      text;
begin
  for v_table in select * from semap.kept_table loop
    select string_agg(format('%L, r.%I', attname, attname), ', ') into v_content
    from pg_attribute
    where attrelid = format('semap.%I', v_table.table_name)::regclass and attnum > 0 and not attisdropped
      and attname is distinct from v_table.shape;
    v_key := 'concat_ws(''/'', r.' || replace(v_table.key, ', ', ', r.') || ')';
    execute format($f$
      create or replace function semap.keep_%1$s() returns trigger
      language plpgsql security definer
      set search_path = public, pg_temp set timezone = 'UTC' set datestyle = 'ISO' as $b$
      declare
        v_set  bigint;
      begin
        if tg_op = 'DELETE' then
          if exists (select from old_row r where %2$s) then
            v_set := semap.current_change_set();
            insert into semap.row_version (change_set_id, map_id, table_name, row_key)
            select v_set, %3$s, %1$L, %4$s from old_row r where %2$s and %7$s;
          end if;
        elsif exists (select from new_row r where %2$s) then
          v_set := semap.current_change_set();
          insert into semap.row_version (change_set_id, map_id, table_name, row_key, content, shape)
          select v_set, %3$s, %1$L, %4$s, jsonb_build_object(%5$s), %6$s from new_row r where %2$s;
        end if;
        return null;
      end $b$
      $f$, v_table.table_name, v_table.which, v_table.map, v_key, v_content, coalesce('r.' || v_table.shape, 'null'),
      -- the history of a map goes with it, and the deletes that follow from its own come after that
      case when v_table.map = 'null::integer' then 'true'
           else format('exists (select from semap.map m where m.map_id = %s)', v_table.map) end);
    execute format('comment on function semap.keep_%s is %L', v_table.table_name,
                   'Keep each version of the rows of ' || v_table.table_name || '.');
    execute format('create or replace trigger keep_inserted after insert on semap.%I referencing new table as new_row'
                   ' for each statement execute function semap.keep_%s()', v_table.table_name, v_table.table_name);
    execute format('create or replace trigger keep_updated after update on semap.%I referencing new table as new_row'
                   ' for each statement execute function semap.keep_%s()', v_table.table_name, v_table.table_name);
    execute format('create or replace trigger keep_deleted after delete on semap.%I referencing old table as old_row'
                   ' for each statement execute function semap.keep_%s()', v_table.table_name, v_table.table_name);
  end loop;
end $$;

-- What was there before anything was kept: the concepts that a migration made.
with missing as (
  select 'concept' as table_name, concept_id::text as row_key, to_jsonb(c) as content from semap.concept c
  union all
  select 'concept_parent', concat_ws('/', concept_id, parent_id), to_jsonb(c) from semap.concept_parent c
  union all
  select 'concept_iri', concat_ws('/', concept_id, iri), to_jsonb(c) from semap.concept_iri c
  except
  select table_name, row_key, content from semap.row_version where map_id is null
), first as (
  insert into semap.change_set (made_at, author, message)
  select 'epoch', 'semap', 'concepts that every database has' where not exists (select from semap.change_set)
  returning change_set_id
)
insert into semap.row_version (change_set_id, table_name, row_key, content)
select change_set_id, table_name, row_key, content from missing, first;

-- The rows of a table as they were at a time, those of one map or (null) of none in particular.
create or replace function semap.rows_as_of(p_table text, p_map_id integer, p_at timestamptz)
returns table (row_key text, content jsonb, shape public.geometry)
language sql stable parallel safe as $$
  select v.row_key, v.content, v.shape
  from (
    select distinct on (v.row_key) v.row_key, v.content, v.shape
    from semap.row_version v join semap.change_set c using (change_set_id)
    where v.table_name = p_table and v.map_id is not distinct from p_map_id and c.made_at <= p_at
    order by v.row_key, v.version_id desc
  ) v
  where v.content is not null
$$;

-- What concepts were called at a time. All maps share them, and so may all who ask: this acts for its owner, since the
-- versions of what belongs to no map are hidden from callers of some maps.
create or replace function semap.concepts_as_of(p_at timestamptz) returns table (concept_id integer, name text)
language sql stable parallel safe security definer set search_path = pg_catalog, pg_temp as $$
  select (r.content ->> 'concept_id')::integer, r.content ->> 'name' from semap.rows_as_of('concept', null, p_at) r
$$;

-- The instances of a map as they were at a time, or one of them, with where they stood and their footprints. A frame
-- stood where the newest pose that was known then says.
create or replace function semap.instances_as_of(
  p_map_id integer, p_at timestamptz, p_instance_id bigint default null, p_after bigint default 0,
  p_limit bigint default null
) returns table (
  instance_id bigint, uid uuid, name text, alias text, concept text, storey text, attributes jsonb, pose semap.pose,
  footprint public.geometry, z_min_m double precision, z_max_m double precision
)
language sql stable as $$
  with recursive all_rows as materialized (
    select i.* from semap.rows_as_of('instance', p_map_id, p_at) r,
           jsonb_populate_record(null::semap.instance, r.content) i
  ), wanted as materialized (
    select * from all_rows i
    where i.instance_id > p_after and (p_instance_id is null or i.instance_id = p_instance_id)
    order by i.instance_id limit p_limit
  ), frame as materialized (
    select f.* from semap.rows_as_of('frame', p_map_id, p_at) r, jsonb_populate_record(null::semap.frame, r.content) f
  ), stood as materialized (
    select distinct on (p.frame_id) p.frame_id, jsonb_populate_record(null::semap.pose, r.content) as pose
    from semap.rows_as_of('frame_pose', p_map_id, p_at) r, jsonb_populate_record(null::semap.frame_pose, r.content) p
    order by p.frame_id, p.stamp desc
  ), chain (frame_id, above_id, pose) as (
    select f.frame_id, f.parent_id, s.pose
    from frame f left join stood s using (frame_id) where f.frame_id in (select w.frame_id from wanted w)
    union all
    select c.frame_id, f.parent_id, semap.compose(s.pose, c.pose)
    from chain c join frame f on f.frame_id = c.above_id left join stood s on s.frame_id = f.frame_id
  ), concept as materialized (
    select c.* from semap.concepts_as_of(p_at) c
  ), outline as materialized (
    select (r.content ->> 'instance_id')::bigint as instance_id, r.shape,
           (r.content ->> 'z_min_m')::double precision as z_min_m,
           (r.content ->> 'z_max_m')::double precision as z_max_m
    from semap.rows_as_of('abstraction', p_map_id, p_at) r
  )
  select i.instance_id, i.uid, i.name, i.alias, c.name, s.name, i.attributes, p.pose, o.shape, o.z_min_m, o.z_max_m
  from wanted i
  left join chain p on p.frame_id = i.frame_id and p.above_id is null
  left join all_rows s on s.instance_id = i.storey_id
  left join concept c on c.concept_id = i.concept_id
  left join outline o on o.instance_id = i.instance_id
$$;

-- Refuse to undo a change set of which the caller may not see all, or whose rows were changed since. This acts with
-- the rights of its owner: what its caller may not see is not there.
create or replace function semap.refuse_undo(p_change_set_id bigint) returns void
language plpgsql as $$
declare
  v_later  text;
begin
  if not exists (select from semap.change_set where change_set_id = p_change_set_id)
     or semap.visible_maps() is not null
        and (select bool_and(v.map_id is not null and v.map_id = any ((select semap.visible_maps())::integer[]))
             from semap.row_version v where v.change_set_id = p_change_set_id) is not true then
    raise exception 'There is no change set %.', p_change_set_id
      using errcode = 'no_data_found', hint = 'List the change sets of the map.';
  end if;
  select distinct l.table_name || ' ' || coalesce(l.content ->> 'name', l.row_key)
                  || ' by change set ' || l.change_set_id
  into v_later
  from semap.row_version v
  join semap.row_version l
    on l.table_name = v.table_name and l.row_key = v.row_key and l.change_set_id <> v.change_set_id
       and l.version_id > v.version_id
  where v.change_set_id = p_change_set_id and v.table_name <> 'abstraction'
  limit 1;
  if v_later is not null then
    raise exception 'Change set % cannot be undone: % came after it.', p_change_set_id, v_later
      using errcode = 'unique_violation', hint = 'Undo the later change first.';
  end if;
  if not exists (select from semap.row_version
                 where change_set_id = p_change_set_id and table_name <> 'abstraction') then
    raise exception 'Change set % is not of rows that are there to be put back.', p_change_set_id
      using errcode = 'invalid_parameter_value', hint = 'Choose another change set.';
  end if;
end $$;

-- The rows of a change set as they were before it; without content where it made them.
create or replace function semap.rows_before(p_change_set_id bigint)
returns table (table_name text, row_key text, content jsonb, shape public.geometry)
language sql stable as $$
  select distinct on (v.table_name, v.row_key) v.table_name, v.row_key, b.content, b.shape
  from semap.row_version v
  left join lateral (
    select content, shape from semap.row_version b
    where b.table_name = v.table_name and b.row_key = v.row_key and b.change_set_id <> v.change_set_id
      and b.version_id < v.version_id
    order by b.version_id desc limit 1) b on true
  where v.change_set_id = p_change_set_id and v.table_name <> 'abstraction'
  order by v.table_name, v.row_key, v.version_id
$$;

-- Make the rows that pg_temp.undone names what it says: those that were there first, since others refer to them.
create or replace function semap.put_rows_back() returns void
language plpgsql as $$
declare
  v_table    record;
  v_columns  text;
  v_values   text;
  v_update   text;
  v_match    text;
begin
  for v_table in select * from semap.kept_table where table_name <> 'abstraction' order by place loop
    select string_agg(quote_ident(attname), ', '),
           string_agg(case when attname = v_table.shape then 'u.shape' else 'r.' || quote_ident(attname) end, ', '),
           string_agg(format('%1$I = excluded.%1$I', attname), ', ')
             filter (where attname <> all (string_to_array(v_table.key, ', ')))
    into v_columns, v_values, v_update
    from pg_attribute
    where attrelid = format('semap.%I', v_table.table_name)::regclass and attnum > 0 and not attisdropped
      and attname <> 'absolute_description_id';
    execute format(
      'insert into semap.%1$I (%2$s) overriding system value select %3$s'
      ' from pg_temp.undone u, jsonb_populate_record(null::semap.%1$I, u.content) r'
      ' where u.table_name = %1$L and u.content is not null on conflict (%4$s) do %5$s',
      v_table.table_name, v_columns, v_values, v_table.key, coalesce('update set ' || v_update, 'nothing'));
  end loop;
  for v_table in select * from semap.kept_table where table_name <> 'abstraction' order by place desc loop
    v_match := 'concat_ws(''/'', r.' || replace(v_table.key, ', ', ', r.') || ')';
    execute format('delete from semap.%I r using pg_temp.undone u'
                   ' where u.table_name = %L and u.content is null and u.row_key = %s'
                   ' and %s', v_table.table_name, v_table.table_name, v_match, v_table.which);
  end loop;
end $$;

-- Put every row of a change set back to its version before, as a change set of its own, and say which descriptions
-- have other geometries now: their abstractions are for the caller to derive. Refused where a row was changed since,
-- or where something that came later would go with a row.
create or replace function semap.undo_change_set(p_change_set_id bigint) returns bigint[]
language plpgsql security definer set search_path = public, pg_temp set timezone = 'UTC' set datestyle = 'ISO' as $$
declare
  v_later  text;
begin
  perform semap.lock_regions_exclusive();
  perform semap.refuse_undo(p_change_set_id);
  perform set_config('semap.change_set', '', true);
  perform set_config('semap.undoes', p_change_set_id::text, true);
  set constraints all deferred;
  drop table if exists pg_temp.undone;
  create temporary table undone on commit drop as select * from semap.rows_before(p_change_set_id);
  if exists (select from pg_temp.undone where table_name = 'map' and content is null) then
    raise exception 'Change set % made the map.', p_change_set_id
      using errcode = 'unique_violation', hint = 'Delete the map itself.';
  end if;
  perform semap.put_rows_back();
  select distinct v.table_name || ' ' || coalesce(b.content ->> 'name', v.row_key) into v_later
  from semap.row_version v
  left join lateral (
    select content from semap.row_version b
    where b.table_name = v.table_name and b.row_key = v.row_key and b.version_id < v.version_id
    order by b.version_id desc limit 1) b on true
  where v.change_set_id = semap.current_change_set() and v.table_name <> 'abstraction'
    and not exists (select from pg_temp.undone u where u.table_name = v.table_name and u.row_key = v.row_key)
  limit 1;
  if v_later is not null then
    raise exception 'Change set % cannot be undone: % came after it and needs it.', p_change_set_id, v_later
      using errcode = 'unique_violation', hint = 'Undo the later change first.';
  end if;
  set constraints all immediate;
  return array(
    select distinct (v.content ->> 'description_id')::bigint
    from pg_temp.undone u join semap.row_version v using (table_name, row_key)
    where u.table_name in ('geometry', 'description') and v.content is not null
      and exists (select from semap.description d where d.description_id = (v.content ->> 'description_id')::bigint));
end $$;
