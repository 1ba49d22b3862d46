-- Conditions of continuous queries. semap.store.conditions compiles each to SQL once, when a query is stored, and keeps
-- it here as a function, whose plan a session makes once; what a condition says (texts, numbers, times, keys) is in
-- none of that SQL, and is passed as `said`. The triggers that ask have the rights of the schema's owner: only
-- semap_compile may call semap.keep_condition, and a query whose condition is not kept is refused.

-- Keep a condition of queries of a map, on tracks or on instances, as what was compiled of it.
create or replace function semap.keep_condition(
  p_map_id integer, p_kind text, p_condition jsonb, p_sql text, p_said text[]
) returns void
language plpgsql security definer set search_path = pg_catalog, pg_temp as $$
declare
  v_condition_id  integer;
begin
  insert into semap.condition (map_id, kind, condition, said) values (p_map_id, p_kind, p_condition, p_said)
  on conflict (map_id, kind, md5(condition::text)) do update set said = excluded.said
  returning condition_id into v_condition_id;
  execute format('create or replace function'
                 ' semap.condition_%s(p_name text, p_also text, p_attributes jsonb, p_said text[]) returns boolean'
                 ' language plpgsql stable parallel safe as %L', v_condition_id, format('begin return %s; end', p_sql));
end $$;

-- Whether a kept condition is known to be true of a track or an instance; `also` is its source, or its alias.
create or replace function semap.condition_holds(
  p_condition_id integer, p_said text[], p_name text, p_also text, p_attributes jsonb
) returns boolean
language plpgsql stable parallel safe as $$
declare
  v_holds  boolean;
begin
  execute format('select semap.condition_%s($1, $2, $3, $4)', p_condition_id)
  into v_holds using p_name, p_also, p_attributes, p_said;
  return v_holds is true;
end $$;

-- The number of a condition as it is kept; null of none. What was not compiled is refused.
create or replace function semap.kept_condition(p_map_id integer, p_kind text, p_condition jsonb) returns integer
language plpgsql stable set search_path = pg_catalog, pg_temp as $$
declare
  v_condition_id  constant integer := (
    select condition_id from semap.condition
    where (map_id, kind, md5(condition::text)) = (p_map_id, p_kind, md5(p_condition::text))
      and condition = p_condition);
begin
  if p_condition is not null and v_condition_id is null then
    raise exception 'The condition on % has not been compiled: %', p_kind || 's', left(p_condition::text, 200)
      using errcode = 'invalid_parameter_value',
            hint = 'A plain statement cannot do that. Store the query by: semap query add, POST or PUT /queries,'
                    ' or select'
                   ' semap.create_continuous_query(name, sql).';
  end if;
  return v_condition_id;
end $$;

-- A continuous query refers to what was compiled of its conditions, whatever was written there.
create or replace function semap.query_refers() returns trigger
language plpgsql as $$
begin
  new.subject_condition_id := semap.kept_condition(new.map_id, new.subject_kind, new.subject_where);
  new.object_condition_id := semap.kept_condition(new.map_id, new.object_kind, new.object_where);
  return new;
end $$;

create or replace trigger query_refers before insert or update on semap.continuous_query
  for each row execute function semap.query_refers();

-- What no query asks for any more is forgotten.
create or replace function semap.conditions_unused() returns trigger
language plpgsql security definer set search_path = pg_catalog, pg_temp as $$
begin
  delete from semap.condition c using old_query o
  where c.condition_id in (o.subject_condition_id, o.object_condition_id)
    and not exists (select from semap.continuous_query q
                    where c.condition_id in (q.subject_condition_id, q.object_condition_id) and q.map_id = c.map_id);
  return null;
end $$;

create or replace trigger conditions_unused_after_delete after delete on semap.continuous_query
  referencing old table as old_query for each statement execute function semap.conditions_unused();
create or replace trigger conditions_unused_after_update after update on semap.continuous_query
  referencing old table as old_query for each statement execute function semap.conditions_unused();

-- A condition goes with its function.
create or replace function semap.condition_forgotten() returns trigger
language plpgsql security definer set search_path = pg_catalog, pg_temp as $$
begin
  execute format('drop function if exists semap.condition_%s', old.condition_id);
  return null;
end $$;

create or replace trigger condition_forgotten after delete on semap.condition
  for each row execute function semap.condition_forgotten();
