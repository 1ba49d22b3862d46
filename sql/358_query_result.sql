-- What holds by each continuous query, as a view of its own in the schema semap_result, named MAP/QUERY: the columns that
-- the query selects (all names and ids where it selects none), and since when.
create schema if not exists semap_result;
comment on schema semap_result is
  'A view of each continuous query: what holds by it now.';

-- The column list of a query's result: each name of its payload with the column of a side that it is.
create or replace function semap.result_columns(p_payload jsonb) returns text
language sql stable parallel safe as $$
  select coalesce(string_agg(format('%s.%I as %I', side, source, name), ', ' order by name),
                  't.id as track_id, t.name as track, o.id as instance_id, o.name as instance')
         || case when bool_or(name = 'since') then '' else ', n.since' end
  from (
    select p.key as name, case split_part(p.value, '.', 1) when 'subject' then 't' else 'o' end as side,
           split_part(p.value, '.', 2) as source,
           case split_part(p.value, '.', 1) when 'subject' then 'semap_query.track' else 'semap_query.instance' end as of_view
    from jsonb_each_text(p_payload) p) said
  where exists (select from pg_attribute where attrelid = of_view::regclass and attname = source and attnum > 0)
$$;
comment on function semap.result_columns is
  'The column list of a query''s result: each name of its payload with the column of a side that it is.';

-- Make the view of each continuous query that has none or another one, and drop those of queries that are gone.
create or replace function semap.make_result_views() returns void
language plpgsql security definer set search_path = pg_catalog, pg_temp as $$
declare
  v_view  record;
begin
  for v_view in
    with wanted as (
      select distinct on (name) *
      from (select (m.name || '/' || q.name)::name::text as name, q.query_id, c.columns,
                   format('What holds by the continuous query %s now: %s', q.query_id, md5(c.columns)) as comment
            from semap.continuous_query q
            join semap.map m using (map_id)
            cross join lateral (select semap.result_columns(q.payload) as columns) c) named
      order by name, query_id
    ), present as (
      select relname::text as name, obj_description(oid, 'pg_class') as comment
      from pg_class
      where relnamespace = 'semap_result'::regnamespace and relkind = 'v'
        and obj_description(oid, 'pg_class') like 'What holds by the continuous query %'
    )
    select coalesce(w.name, p.name) as name, w.query_id, w.columns, w.comment, p.name is not null as is_there
    from wanted w full join present p on p.name = w.name
    where w.comment is distinct from p.comment
    order by w.query_id nulls first
  loop
    begin
      if v_view.is_there then
        execute format('drop view semap_result.%I', v_view.name);
      end if;
      if v_view.query_id is not null then
        execute format(
          'create view semap_result.%I with (security_invoker = true) as select %s from semap.relation n'
          ' join semap_query.track t on t.id = n.track_id join semap_query.instance o on o.id = n.instance_id'
          ' where n.query_id = %s', v_view.name, v_view.columns, v_view.query_id);
        execute format('comment on view semap_result.%I is %L', v_view.name, v_view.comment);
        execute format('grant select on semap_result.%I to semap_read, semap_ingest, semap_worker, semap_api,'
                       ' semap_admin, semap_read_map, semap_ingest_map, semap_api_map', v_view.name);
      end if;
    exception when dependent_objects_still_exist or duplicate_table or wrong_object_type then
      null; -- somebody's view stands on it, or somebody has put a table there
    end;
  end loop;
end $$;
comment on function semap.make_result_views is
  'Make the view of each continuous query that has none or another one, and drop those of queries that are gone.';

-- Each continuous query has its view as soon as it is there.
create or replace function semap.result_views_kept() returns trigger
language plpgsql security definer set search_path = pg_catalog, pg_temp as $$
begin
  perform semap.make_result_views();
  return null;
end $$;
comment on function semap.result_views_kept is
  'Each continuous query has its view as soon as it is there.';

create or replace trigger result_views_kept after insert or delete or update of name, payload on semap.continuous_query
  for each statement execute function semap.result_views_kept();
create or replace trigger result_views_kept after delete or update of name on semap.map
  for each statement execute function semap.result_views_kept();
