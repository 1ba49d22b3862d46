-- Continuous queries in SQL alone: who connects to the database asks for one by its text, and a worker, which has
-- PostgreSQL's parser, makes it or says what it cannot keep. What the database can tell by itself is refused at once.

-- The map that a query is about: the one of that name, or the only one that the caller sees.
create or replace function semap.map_of_query(p_map text) returns integer
language plpgsql stable as $$
declare
  v_maps  integer[];
begin
  v_maps := array(select map_id from semap.map
                  where (p_map is null or name = p_map)
                    and ((select semap.visible_maps() is null)
                         or map_id = any ((select semap.visible_maps())::integer[])));
  if cardinality(v_maps) = 1 then
    return v_maps[1];
  elsif cardinality(v_maps) > 1 then
    raise exception 'There are several maps, and it is not said which.'
      using errcode = 'invalid_parameter_value', hint = 'Name the map as the last argument.';
  end if;
  raise exception 'There is no map%.', coalesce(' ' || p_map, '')
    using errcode = 'no_data_found', hint = 'List the maps: select name from semap.map';
end $$;

-- The number of a continuous query by its name and map; null where there is none.
create or replace function semap.query_named(p_name text, p_map_id integer) returns integer
language sql stable as $$
  select query_id from semap.continuous_query where map_id = p_map_id and name = p_name
$$;

-- Refuse a text that is not one SELECT that PostgreSQL can plan over the views of semap_query. It is planned and not
-- run. A stable function opens no cursor for what writes, in a WITH neither. To plan a query is to fold functions of
-- its author's: they act for the caller, and whatever they do is taken back with the block.
create or replace function semap.require_select(p_sql text) returns void
language plpgsql stable set search_path = semap_query, public, pg_temp as $$
declare
  v_cursor  refcursor;
begin
  open v_cursor for execute p_sql;
  raise exception 'planned' using errcode = 'SM000';
exception
  when sqlstate 'SM000' then
    return;
  when invalid_cursor_definition or feature_not_supported then
    raise exception 'A continuous query is one SELECT, which only reads: %.', sqlerrm
      using errcode = 'invalid_parameter_value',
            hint = 'Write: select r.name, t.name from track t, room r where ST_Contains(r.footprint, t.position)';
end $$;

-- Whether a worker is there that answers requests: each holds advisory lock 7375 in share mode.
create or replace function semap.requests_are_answered() returns boolean
language sql volatile as $$
  select exists (
    select from pg_locks
    where locktype = 'advisory' and classid = 7375 and objid = 0 and objsubid = 2 and granted
      and database = (select oid from pg_database where datname = current_database()))
$$;

-- Ask for a continuous query by its text in SQL, on a map, or on the only one. Gives the number of the request, which a
-- worker answers once this transaction is committed: see semap.await_continuous_query and semap.query_requests.
create or replace function semap.create_continuous_query(p_name text, p_sql text, p_map text default null)
returns bigint
language plpgsql as $$
declare
  v_map_id      integer := semap.map_of_query(p_map);
  v_request_id  bigint;
begin
  if btrim(p_name) = '' or length(p_name) > 200 or p_name is null or p_sql is null then
    raise exception 'A continuous query has a name of at most 200 characters, and a text.'
      using errcode = 'invalid_parameter_value', hint = 'Write: semap.create_continuous_query(name, sql)';
  elsif length(p_sql) > 20000 then
    raise exception 'The text has more than 20,000 characters.'
      using errcode = 'invalid_parameter_value', hint = 'Ask for less, or make several queries.';
  elsif semap.query_named(p_name, v_map_id) is not null then
    raise exception 'There is a continuous query % already.', p_name
      using errcode = 'unique_violation', hint = 'Choose another name, or drop it: semap.drop_continuous_query';
  end if;
  perform semap.require_select(p_sql);
  insert into semap.query_request (map_id, name, sql) values (v_map_id, p_name, p_sql)
  on conflict (map_id, name) where answered_at is null do nothing
  returning request_id into v_request_id;
  if v_request_id is null then
    raise exception 'The continuous query % has been asked for, and waits for an answer.', p_name
      using errcode = 'unique_violation', hint = 'Wait for it, or take it back: semap.drop_continuous_query';
  end if;
  perform pg_notify('semap_query_request', v_request_id::text);
  if not semap.requests_are_answered() then
    raise notice 'No worker is there to answer: request % waits until one is.', v_request_id
      using hint = 'Start one: semap work';
  end if;
  return v_request_id;
end $$;

-- What was asked for in SQL, and what became of it: waiting, made, or refused at a place of the text for a reason.
create or replace view semap.query_requests with (security_invoker = true) as
  select r.request_id, m.name as map, r.name,
         case when r.answered_at is null then 'waiting' when r.refusal is null then 'made' else 'refused' end as state,
         r.query_id, (r.refusal ->> 'line')::integer as line, (r.refusal ->> 'column')::integer as "column",
         r.refusal ->> 'reason' as reason, r.refusal ->> 'remedy' as remedy,
         r.asked_by, r.asked_at, r.answered_at, r.sql, r.map_id
  from semap.query_request r join semap.map m on m.map_id = r.map_id;

-- How it stands with a continuous query: kept, resting, or, where there is none yet, waiting or refused.
create or replace function semap.continuous_query_state(
  p_name text, p_map text default null,
  out state text, out query_id integer, out line integer, out "column" integer, out reason text, out remedy text
)
language plpgsql stable as $$
declare
  v_map_id  integer := semap.map_of_query(p_map);
begin
  select case when q.enabled then 'kept' else 'resting' end, q.query_id into state, query_id
  from semap.continuous_query q where q.map_id = v_map_id and q.name = p_name;
  if found then
    return;
  end if;
  select r.state, r.line, r."column", r.reason, r.remedy
  into state, line, "column", reason, remedy
  from semap.query_requests r where r.map_id = v_map_id and r.name = p_name
  order by r.request_id desc limit 1;
  if not found or state = 'made' then -- and dropped since
    perform semap.no_such_query(p_name);
  end if;
end $$;

-- Say that there is no continuous query of a name.
create or replace function semap.no_such_query(p_name text) returns void
language plpgsql stable as $$
begin
  raise exception 'There is no continuous query %.', p_name
    using errcode = 'no_data_found', hint = 'List them: select name from semap.continuous_query';
end $$;

-- Wait until a request is answered, and give the number of the query; a refusal is an error with its place and its
-- remedy. A request of the same statement is committed first: call semap.await_continuous_query(
-- semap.create_continuous_query(...)) makes a query, or says why not. Within a transaction a request can be waited for
-- that was committed before.
create or replace procedure semap.await_continuous_query(
  p_request_id bigint, p_timeout interval default '30 s', inout query_id integer default null
)
language plpgsql as $$
declare
  v_until    timestamptz := clock_timestamp() + p_timeout;
  v_request  semap.query_requests;
begin
  if pg_current_xact_id_if_assigned() is not null then
    commit;
  end if;
  perform semap.require_read_committed();
  loop
    select * into v_request from semap.query_requests r where r.request_id = p_request_id;
    if not found then
      raise exception 'There is no request %.', p_request_id
        using errcode = 'no_data_found', hint = 'List them: select * from semap.query_requests';
    end if;
    exit when v_request.state <> 'waiting' or clock_timestamp() >= v_until;
    perform pg_sleep(0.02);
  end loop;
  if v_request.state = 'waiting' then
    raise exception 'Request % was not answered within %.', p_request_id, p_timeout
      using errcode = 'query_canceled',
            hint = case when semap.requests_are_answered() then 'It still waits: wait for it again.'
                        else 'It still waits, and no worker is there to answer. Start one: semap work' end;
  elsif v_request.state = 'refused' then
    raise exception using
      message = case when v_request.line is null then ''
                     else format('line %s, column %s: ', v_request.line, v_request."column") end || v_request.reason,
      errcode = 'invalid_parameter_value', hint = v_request.remedy;
  end if;
  query_id := v_request.query_id;
end $$;

-- Delete a continuous query, so that its relations end, or take a request back that waits. One that rules read is
-- refused.
create or replace function semap.drop_continuous_query(p_name text, p_map text default null) returns void
language plpgsql as $$
declare
  v_map_id    integer := semap.map_of_query(p_map);
  v_query_id  integer := semap.query_named(p_name, v_map_id);
  v_rules     text;
begin
  select string_agg(r.name, ', ' order by r.name) into v_rules
  from semap.rule_query q join semap.rule r using (rule_id) where q.query_id = v_query_id;
  if v_rules is not null then
    raise exception 'Rules read the query %: %.', p_name, v_rules
      using errcode = 'foreign_key_violation', hint = 'Delete them first.';
  end if;
  if v_query_id is null then
    delete from semap.query_request where map_id = v_map_id and name = p_name and answered_at is null;
  else
    delete from semap.continuous_query where query_id = v_query_id;
  end if;
  if not found then
    perform semap.no_such_query(p_name);
  end if;
end $$;

-- Let a continuous query keep relations, from the present state on, or end all of them and rest.
create or replace function semap.enable_continuous_query(p_name text, p_enabled boolean, p_map text default null)
returns void
language plpgsql as $$
declare
  v_map_id  integer := semap.map_of_query(p_map);
begin
  update semap.continuous_query set enabled = p_enabled where map_id = v_map_id and name = p_name;
  if not found then
    perform semap.no_such_query(p_name);
  end if;
end $$;
