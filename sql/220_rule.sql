-- Rules as they are declared. A rule is another version whenever what it says or reads is another, and no version of
-- a name is given twice on a map, also when its rule was deleted: ids of events are made of name and version.

create or replace trigger lock_regions before insert or update of name, queries, declaration, backfill_from
  on semap.rule for each statement execute function semap.lock_regions();

-- Number the version of a rule. One that is to run over the past gets its seam: the last rows that are past, while
-- nobody writes any, so that each row is either before the seam or after this rule in the log.
create or replace function semap.rule_declaring() returns trigger
language plpgsql as $$
declare
  v_newest  integer;
  v_is_new  boolean := true;
begin
  if tg_op = 'UPDATE' then
    v_is_new := (new.name, new.queries, new.declaration) is distinct from (old.name, old.queries, old.declaration);
    new.version := old.version;
  end if;
  if v_is_new then
    select max(version) into v_newest from semap.rule_version where map_id = new.map_id and name = new.name;
    new.version := 1 + greatest(v_newest, case when tg_op = 'UPDATE' then old.version end, 0);
  end if;
  if new.backfill_from is null then
    new.seam := null;
  elsif v_is_new or new.backfill_from is distinct from old.backfill_from then
    new.seam := jsonb_build_object(
      'change_id', (select coalesce(max(change_id), 0) from semap.relation_change),
      'object_state_id', (select coalesce(max(object_state_id), 0) from semap.object_state));
  else
    new.seam := old.seam;
  end if;
  return new;
end $$;

create or replace trigger rule_declaring before insert or update of name, queries, declaration, backfill_from
  on semap.rule for each row execute function semap.rule_declaring();

-- Keep the version of a rule, and which queries it reads: those cannot be deleted.
create or replace function semap.rule_declared() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  if exists (select from jsonb_each_text(new.queries) r
             where not exists (select from semap.continuous_query q
                               where q.query_id = r.value::integer and q.map_id = new.map_id)) then
    raise exception 'The rule % reads a query that is not on its map.', new.name
      using errcode = 'foreign_key_violation', hint = 'Add the query to the map first.';
  end if;
  insert into semap.rule_version (rule_id, version, map_id, name, declaration)
  values (new.rule_id, new.version, new.map_id, new.name, new.declaration)
  on conflict (rule_id, version) do nothing;
  delete from semap.rule_query where rule_id = new.rule_id;
  insert into semap.rule_query (rule_id, query_id)
  select distinct new.rule_id, r.value::integer from jsonb_each_text(new.queries) r;
  return null;
end $$;

create or replace trigger rule_declared after insert or update of name, queries, declaration, backfill_from
  on semap.rule for each row execute function semap.rule_declared();

-- A query that rules read keeps its name, by which they read it.
create or replace function semap.query_renamed() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_rules  text;
begin
  select string_agg(r.name, ', ' order by r.name) into v_rules
  from semap.rule_query q join semap.rule r using (rule_id) where q.query_id = old.query_id;
  if v_rules is not null then
    raise exception 'Rules read the query %: %.', old.name, v_rules
      using errcode = 'foreign_key_violation',
        hint = 'Add a query of the new name, let the rules read it, and delete this one.';
  end if;
  return null;
end $$;

create or replace trigger query_renamed after update of name on semap.continuous_query
  for each row when (new.name <> old.name) execute function semap.query_renamed();

-- What rules gave up since their version is in force, because too much was under way in a key: how many attempts, the
-- stamp and the key with which the earliest began, and how many matches they did not tell. The rights are those of its
-- owner; restricted roles see their own maps.
create or replace view semap.rule_given_up with (security_barrier) as
  select r.rule_id, r.map_id, (g.said ->> 'attempts')::bigint as attempts, (g.said ->> 'first')::timestamptz as first,
         g.said -> 'key' as key, coalesce((g.said ->> 'matches')::bigint, 0) as matches
  from semap.progress p
  cross join lateral jsonb_each(p.watermarks -> 'given_up') as g (rule_id, said)
  join semap.rule r on r.rule_id = g.rule_id::integer and r.version = (g.said ->> 'version')::integer
  where p.worker = 'rules'
    and ((select semap.visible_maps() is null) or r.map_id = any ((select semap.visible_maps())::integer[]));
