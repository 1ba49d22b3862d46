-- What a condition may say (what it means, sql/105 says): all that semap.cql2 takes of a filter whose properties are of
-- the kind `any`, without shapes, functions of arrays, and isA. A condition is checked once, when it is stored.

-- Refuse a part of a condition: where it stands, why, and what to write instead.
create or replace function semap.refuse_condition(p_place text, p_reason text, p_hint text) returns text
language plpgsql immutable parallel safe as $$
begin
  raise exception '%: %', p_place, p_reason using errcode = 'invalid_parameter_value', hint = p_hint;
end $$;

-- The instant that a condition writes out; refuses what is none, or outside of the years 1 to 9999.
create or replace function semap.check_condition_instant(p_text text, p_place text) returns timestamptz
language plpgsql immutable parallel safe as $$
declare
  v_found  timestamptz := semap.instant_of(p_text);
begin
  if p_text !~ '^[0-9-]{10}(T([01][0-9]|2[0-3]):[0-5][0-9]:[0-5][0-9]([.][0-9]{1,6})?(Z|[+-][0-9:]{5}))?$'
     or v_found >= '10000-01-01 00:00:00Z' or v_found < '0001-01-01 00:00:00Z' or v_found is null then
    perform semap.refuse_condition(p_place, format('%s is no time', p_text),
                                   'Write 2026-01-31, or 2026-01-31T12:00:00Z.');
  end if;
  return v_found;
end $$;

-- Refuse an interval that ends before it begins, or has an end that is no time; each end is a time, a property, or
-- `..`.
create or replace function semap.check_condition_interval(p_ends jsonb, p_place text, p_depth integer, p_names text[])
returns text
language plpgsql immutable parallel safe as $$
declare
  v_end    jsonb;
  v_kind   text;
  v_found  timestamptz[] := '{-infinity,infinity}';
begin
  for i in 0 .. 1 loop
    v_end := p_ends -> i;
    if v_end <> '".."' then
      v_kind := case when jsonb_typeof(v_end) = 'string' then 'instant'
                     else semap.check_condition_part(v_end, format('%s.interval[%s]', p_place, i), p_depth + 1,
                                                     p_names) end;
      if v_kind not in ('instant', 'any') or v_end ? 'op' then
        return semap.refuse_condition(p_place, 'an end of an interval that is no time',
                                      'Give a time, a property, or "..".');
      elsif v_kind = 'instant' then
        v_found[i + 1] := semap.check_condition_instant(
          coalesce(v_end ->> 'timestamp', v_end ->> 'date', v_end #>> '{}'), format('%s.interval[%s]', p_place, i));
      end if;
    end if;
  end loop;
  if v_found[1] > v_found[2] then
    return semap.refuse_condition(p_place, 'an interval that ends before it begins', 'Give the earlier time first.');
  end if;
  return 'interval';
end $$;

-- Refuse a comparison of kinds that are not alike, or that have no such comparison.
create or replace function semap.check_condition_alike(
  p_op text, p_kinds text[], p_ordered boolean, p_place text
) returns text
language plpgsql immutable parallel safe as $$
declare
  v_known  text[] := array(select distinct k from unnest(p_kinds) k where k <> 'any' order by k);
begin
  if 'null' = any (v_known) then
    return semap.refuse_condition(p_place, 'a comparison with null is never true', 'Ask isNull.');
  elsif cardinality(v_known) > 1 then
    return semap.refuse_condition(p_place, format('%s of a %s', p_op, array_to_string(v_known, ' and a ')),
                                  'Compare like with like; write times as {"timestamp": "2026-01-31T12:00:00Z"}.');
  elsif not v_known <@ array['number', 'text', 'instant'] and (p_ordered or not v_known <@ array['boolean']) then
    return semap.refuse_condition(p_place, format('%s of a %s', p_op, v_known[1]),
                                  'Use it for number, text, instant'
                                  || case when p_ordered then '.' else ', boolean.' end);
  end if;
  return 'boolean';
end $$;

-- Refuse what like cannot take as a pattern: a text, perhaps within casei and accenti, that does not end in an escape.
create or replace function semap.check_condition_pattern(p_part jsonb, p_place text) returns text
language plpgsql immutable parallel safe as $$
begin
  if p_part ? 'op' and jsonb_typeof(p_part) = 'object' then
    return semap.check_condition_pattern(p_part #> '{args,0}', p_place); -- the operator is checked to be one of texts
  elsif jsonb_typeof(p_part) <> 'string' then
    return semap.refuse_condition(p_place, 'like of something that is no pattern',
                                  'Give a text; % stands for any, _ for one character.');
  elsif p_part #>> '{}' ~ '(^|[^\\])(\\\\)*\\$' then
    return semap.refuse_condition(p_place, 'a pattern that ends with \', 'Write \\ for a backslash.');
  end if;
  return 'boolean';
end $$;

-- The kind of an operator applied to parts; refuses one that is not known, or that cannot be applied to these.
create or replace function semap.check_condition_call(p_part jsonb, p_place text, p_depth integer, p_names text[])
returns text
language plpgsql immutable parallel safe as $$
declare
  c_reals   constant text[] := '{+,-,*,/,^,%,div}';
  c_times   constant text[] := '{t_after,t_before,t_contains,t_disjoint,t_during,t_equals,t_finishedby,t_finishes,'
                               't_intersects,t_meets,t_metby,t_overlappedby,t_overlaps,t_startedby,t_starts}';
  v_op      text := lower(p_part ->> 'op');
  v_args    jsonb := p_part -> 'args';
  v_count   integer := jsonb_array_length(v_args);
  v_wanted  text[] := case
    when v_op in ('and', 'or', 'not') then '{boolean,any}'
    when v_op = any (c_reals) then '{number,any}'
    when v_op in ('like', 'casei', 'accenti') then '{text,any}'
    when v_op = any (c_times) then '{instant,interval,any}' end;
  v_least   integer := case when v_op in ('not', 'isnull', 'casei', 'accenti') then 1
                            when v_op = 'between' then 3 else 2 end;
  v_kinds   text[];
begin
  if v_wanted is null and v_op not in ('=', '<>', '<', '<=', '>', '>=', 'between', 'in', 'isnull') then
    return semap.refuse_condition(
      p_place, format('a condition cannot ask for %s', p_part ->> 'op'),
      'There are and, or, not, =, <>, <, <=, >, >=, between, in, like, isNull, casei, accenti, +, -, *, /, ^, %, div,'
      ' and t_after to t_starts. Say shapes by the predicate of the query, and a concept by its side.');
  elsif v_count < v_least or (v_count > v_least and v_op not in ('and', 'or')) then
    return semap.refuse_condition(p_place, format('%s of %s parts', v_op, v_count), format('Give it %s.', v_least));
  end if;
  for i in 0 .. v_count - 1 loop
    v_kinds[i + 1] := semap.check_condition_part(v_args -> i, format('%s.args[%s]', p_place, i), p_depth + 1, p_names);
    if v_kinds[i + 1] <> all (v_wanted) then
      return semap.refuse_condition(format('%s.args[%s]', p_place, i), format('%s of a %s', v_op, v_kinds[i + 1]),
                                    format('Give it a %s.', array_to_string(array_remove(v_wanted, 'any'), ' or ')));
    end if;
  end loop;
  if v_op = 'like' then
    return semap.check_condition_pattern(v_args -> 1, p_place || '.args[1]');
  elsif v_op = 'isnull' and v_kinds[1] in ('null', 'array', 'interval') then
    return semap.refuse_condition(p_place, format('isNull of a %s', v_kinds[1]), 'Ask it of a property.');
  elsif v_op = 'in' and v_kinds[2] <> 'array' then
    return semap.refuse_condition(p_place || '.args[1]', 'in of something that is no list', 'Give a list.');
  elsif v_op = 'in' then
    for i in 0 .. jsonb_array_length(v_args -> 1) - 1 loop
      perform semap.check_condition_alike(v_op, array[v_kinds[1], semap.condition_kind(v_args #> array['1', i::text])],
                                          false, format('%s.args[1][%s]', p_place, i));
    end loop;
  elsif v_wanted is null and v_op <> 'isnull' then
    return semap.check_condition_alike(v_op, v_kinds, v_op not in ('=', '<>'), p_place);
  end if;
  return semap.condition_kind(p_part);
end $$;

-- The kind of a part of a condition, and of all in it; refuses what cannot be understood.
create or replace function semap.check_condition_part(p_part jsonb, p_place text, p_depth integer, p_names text[])
returns text
language plpgsql immutable parallel safe as $$
declare
  v_type  text := jsonb_typeof(p_part);
  v_keys  text[];
  v_name  text;
begin
  if p_depth > 50 then
    return semap.refuse_condition(p_place, 'more than 50 levels', 'Ask for less.');
  elsif v_type = 'number' and abs(p_part::numeric) > 1.7e308 then
    return semap.refuse_condition(p_place, 'a number that is too large for a float', 'Give a number.');
  elsif v_type = 'array' then
    for i in 0 .. jsonb_array_length(p_part) - 1 loop
      if semap.check_condition_part(p_part -> i, format('%s[%s]', p_place, i), p_depth + 1, p_names)
         in ('array', 'interval', 'null') then
        return semap.refuse_condition(format('%s[%s]', p_place, i), 'a list of other things than texts, numbers, times'
                                      ' or truth values', 'Leave it out.');
      end if;
    end loop;
  end if;
  if v_type <> 'object' then
    return semap.condition_kind(p_part);
  end if;
  v_keys := array(select k || ' ' || jsonb_typeof(p_part -> k) from jsonb_object_keys(p_part) k order by k collate "C");
  case v_keys
    when '{args array,op string}' then
      return semap.check_condition_call(p_part, p_place, p_depth, p_names);
    when '{property string}' then
      v_name := p_part ->> 'property';
      if v_name = '' or (v_name <> all (p_names) and (strpos(v_name, '.') in (0, length(v_name))
                                                      or split_part(v_name, '.', 1) <> all (p_names))) then
        return semap.refuse_condition(p_place, format('there is no property %s', v_name),
                                      format('There are %s.', array_to_string(p_names, ', ')));
      end if;
      return 'any';
    when '{timestamp string}', '{date string}' then
      if (p_part ? 'date') <> (length(coalesce(p_part ->> 'date', p_part ->> 'timestamp')) = 10) then
        return semap.refuse_condition(p_place, 'a date with a time, or a timestamp without',
                                      'Write {"date": "2026-01-31"} or {"timestamp": "2026-01-31T12:00:00Z"}.');
      end if;
      perform semap.check_condition_instant(coalesce(p_part ->> 'date', p_part ->> 'timestamp'), p_place);
      return 'instant';
    when '{interval array}' then
      if jsonb_array_length(p_part -> 'interval') = 2 then
        return semap.check_condition_interval(p_part -> 'interval', p_place, p_depth, p_names);
      end if;
    else
      null;
  end case;
  return semap.refuse_condition(p_place, 'it is none of op, property, timestamp, date and interval',
                                'Give a part as CQL2 JSON writes it (OGC 21-065r2); shapes are not known here.');
end $$;

-- Refuse a condition that semap.condition_holds would not understand, is nested deeper than 50 levels, or longer than
-- 100 kB; p_names are the names of values that there will be, null any. One that is null asks for nothing.
create or replace function semap.check_condition(p_condition jsonb, p_names text[] default null) returns void
language plpgsql immutable parallel safe as $$
begin
  if p_condition is null then
    return;
  elsif octet_length(p_condition::text) > 100000 then
    perform semap.refuse_condition('condition', 'more than 100 kB', 'Ask for less.');
  elsif semap.check_condition_part(p_condition, 'condition', 0, p_names) not in ('boolean', 'any') then
    perform semap.refuse_condition('condition', 'it is neither true nor false', 'Compare it with something.');
  end if;
end $$;
