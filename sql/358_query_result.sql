-- What holds by each continuous query, as a view of its own in the schema semap_result, named MAP/QUERY: the columns
-- that the query selects (all names and ids where it selects none), and since when.
create schema if not exists semap_result;

-- The column list of a query's result: each name of its payload with the column of a side that it is, t the subject and
-- o the object. Without a payload it is the names and ids, called after what they are where that tells them apart.
create or replace function semap.result_columns(p_payload jsonb, p_subject_kind text, p_object_kind text) returns text
language sql stable parallel safe as $$
  select coalesce(string_agg(format('%s.%I as %I', side, source, name), ', ' order by name),
                  case when p_subject_kind = 'track' and p_object_kind = 'instance'
                       then 't.id as track_id, t.name as track, o.id as instance_id, o.name as instance'
                       else 't.id as subject_id, t.name as subject, o.id as object_id, o.name as object' end)
         || case when bool_or(name = 'since') then '' else ', n.since' end
  from (
    select p.key as name, case split_part(p.value, '.', 1) when 'subject' then 't' else 'o' end as side,
           split_part(p.value, '.', 2) as source,
           'semap_query.' || case split_part(p.value, '.', 1) when 'subject' then p_subject_kind else p_object_kind end
             as of_view
    from jsonb_each_text(p_payload) p) said
  where exists (select from pg_attribute where attrelid = of_view::regclass and attname = source and attnum > 0)
$$;

-- What a query's result is of: n, what holds by it, with the two sides t and o.
create or replace function semap.result_source(p_query semap.continuous_query) returns text
language sql stable parallel safe as $$
  select format(
    'semap.relation n join semap_query.%I t on t.id = n.%I join semap_query.%I o on o.id = n.%I'
    ' where n.query_id = %s and n.confirmed',
    p_query.subject_kind, case p_query.subject_kind when 'track' then 'track_id' else 'subject_instance_id' end,
    p_query.object_kind, case p_query.object_kind when 'track' then 'object_track_id' else 'instance_id' end,
    p_query.query_id)
$$;

-- What holds by a query now, as its view has it, after a place in the order of its ids (null: from the first); each row
-- as JSON (shapes as GeoJSON, in metres of the map) with its place.
create or replace function semap.result_page(p_query_id integer, p_after bigint[], p_limit integer)
returns table (place bigint[], result jsonb)
language plpgsql stable parallel safe as $$
declare
  v_query  semap.continuous_query;
begin
  select * into v_query from semap.continuous_query q where q.query_id = p_query_id;
  if not found then
    return;
  end if;
  return query execute format(
    'select array[n.subject_key, n.object_key], (select to_jsonb(r) from (select %s) r) from %s'
    ' and ($1 is null or (n.subject_key, n.object_key) > ($1[1], $1[2])) order by n.subject_key, n.object_key limit $2',
    semap.result_columns(v_query.payload, v_query.subject_kind, v_query.object_kind),
    semap.result_source(v_query))
    using p_after, p_limit;
end $$;

-- Make the view of each continuous query that has none or another one, and drop those of queries that are gone.
create or replace function semap.make_result_views() returns void
language plpgsql security definer set search_path = pg_catalog, pg_temp as $$
declare
  v_view  record;
begin
  for v_view in
    with wanted as (
      select distinct on (name) *
      from (select (m.name || '/' || q.name)::name::text as name, q.query_id, c.shown,
                   format('What holds by the continuous query %s now: %s', q.query_id, md5(c.shown)) as comment
            from semap.continuous_query q
            join semap.map m using (map_id)
            cross join lateral (
              select format('select %s from %s', semap.result_columns(q.payload, q.subject_kind, q.object_kind),
                            semap.result_source(q)) as shown) c) named
      order by name, query_id
    ), present as (
      select relname::text as name, obj_description(oid, 'pg_class') as comment
      from pg_class
      where relnamespace = 'semap_result'::regnamespace and relkind = 'v'
        and obj_description(oid, 'pg_class') like 'What holds by the continuous query %'
    )
    select coalesce(w.name, p.name) as name, w.query_id, w.shown, w.comment, p.name is not null as is_there
    from wanted w full join present p on p.name = w.name
    where w.comment is distinct from p.comment
    order by w.query_id nulls first
  loop
    begin
      if v_view.is_there then
        execute format('drop view semap_result.%I', v_view.name);
      end if;
      if v_view.query_id is not null then
        execute format('create view semap_result.%I with (security_invoker = true) as %s', v_view.name, v_view.shown);
        execute format('comment on view semap_result.%I is %L', v_view.name, v_view.comment);
        execute format('grant select on semap_result.%I to semap_read, semap_ingest, semap_worker, semap_api,'
                       ' semap_admin, semap_read_map, semap_ingest_map, semap_api_map', v_view.name);
      end if;
    exception when dependent_objects_still_exist or duplicate_table or wrong_object_type then
      null; -- somebody's view stands on it, or somebody has put a table there
    end;
  end loop;
end $$;

-- Each continuous query has its view as soon as it is there.
create or replace function semap.result_views_kept() returns trigger
language plpgsql security definer set search_path = pg_catalog, pg_temp as $$
begin
  perform semap.make_result_views();
  return null;
end $$;

create or replace trigger result_views_kept
  after insert or delete or update of name, payload, predicate, subject_kind, object_kind on semap.continuous_query
  for each statement execute function semap.result_views_kept();
create or replace trigger result_views_kept after delete or update of name on semap.map
  for each statement execute function semap.result_views_kept();
