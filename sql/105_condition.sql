-- Conditions in CQL2's JSON form (OGC 21-065r2), asked of named values in JSON while a trigger runs. They mean what
-- semap.cql2.evaluate makes of them in Python, each value being of the kind `any`: its kind is that of the JSON.
-- Nothing here runs text: a condition is walked, part by part, and an operator that is not known raises. What a
-- condition may say is checked once, where it is stored (sql/104).

-- What a name stands for: the value of that name, or what lies under the keys that dots separate (lists go by index);
-- null where there is none, and for JSON's null.
create or replace function semap.condition_property(p_name text, p_values jsonb) returns jsonb
language sql immutable parallel safe as $$
  select nullif(case when p_values ? p_name then p_values -> p_name
                     else p_values #> string_to_array(p_name, '.') end, 'null'::jsonb)
$$;

-- The kind that a part of a condition has by itself: text, number, boolean, null, array, instant, interval, or `any`
-- for a property.
create or replace function semap.condition_kind(p_part jsonb) returns text
language sql immutable parallel safe as $$
  select case jsonb_typeof(p_part)
    when 'string' then 'text'
    when 'object' then case
      when p_part ? 'property' then 'any'
      when p_part ? 'op' then case
        when lower(p_part ->> 'op') in ('+', '-', '*', '/', '^', '%', 'div') then 'number'
        when lower(p_part ->> 'op') in ('casei', 'accenti') then 'text'
        else 'boolean' end
      when p_part ? 'interval' then 'interval'
      else 'instant' end
    else jsonb_typeof(p_part) end
$$;

-- The number that a JSON is, in double precision; null where it is none, or beyond 1.7e308. One too small for a float
-- is 0.
create or replace function semap.json_number(p_json jsonb) returns double precision
language sql immutable parallel safe as $$
  select case when jsonb_typeof(p_json) = 'number' then case
    when abs(p_json::numeric) between 1e-300 and 1.7e308 then p_json::double precision
    when abs(p_json::numeric) <= 2.4703282292062328e-324 then 0
    when abs(p_json::numeric) < 1 then p_json::double precision end end
$$;

-- CQL2's arithmetic in double precision; null where there is no real and finite result, and 0 for one that is too
-- small. The size of a result is looked at before, since PostgreSQL raises an error on what overflows, and a trigger
-- must not.
create or replace function semap.real_arithmetic(p_op text, p_a double precision, p_b double precision)
returns double precision
language plpgsql immutable parallel safe as $$
declare
  c_half      constant double precision := 8.988465674311579e307; -- of the largest number
  c_largest   constant double precision := 709.7827;  -- its natural logarithm, and that of half of the smallest,
  c_smallest  constant double precision := -745.133;  -- each with room for what the logarithms are rounded by
  v_size      double precision;
begin
  if p_a is null or p_b is null then
    return null;
  end if;
  if p_op in ('+', '-') then
    v_size := case p_op when '+' then p_b else -p_b end;
    if least(abs(p_a), abs(v_size)) > 1e290 and abs(p_a / 2 + v_size / 2) > c_half then
      return null;
    end if;
    return p_a + v_size;
  end if;
  if p_b = 0 then
    return case when p_op = '^' then 1 when p_op = '*' then 0 end;
  end if;
  if p_a = 0 then
    return case when p_op <> '^' or p_b > 0 then 0 end;
  end if;
  if p_op = '^' and p_a < 0 and p_b <> trunc(p_b) then
    return null;
  end if;
  v_size := case p_op
    when '*' then ln(abs(p_a)) + ln(abs(p_b))
    when '^' then case when abs(p_b) > 1e-300 and abs(p_a) <> 1
                       then sign(p_b) * least(abs(p_b), 1e300) * ln(abs(p_a)) else 0 end
    else ln(abs(p_a)) - ln(abs(p_b)) end;
  if v_size > c_largest then
    return null;
  elsif v_size < c_smallest then
    return case when p_op = '%' then p_a else 0 end;
  end if;
  case p_op
    when '*' then return p_a * p_b;
    when '/' then return p_a / p_b;
    when 'div' then return trunc(p_a / p_b);
    when '%' then return p_a - p_b * trunc(p_a / p_b);
    when '^' then return power(p_a, p_b);
    else return null;
  end case;
end $$;

-- A part of a condition as a number; null where it is none.
create or replace function semap.condition_number(p_part jsonb, p_values jsonb) returns double precision
language plpgsql immutable parallel safe as $$
declare
  v_json  jsonb := p_part;
begin
  if jsonb_typeof(p_part) = 'object' then
    if p_part ? 'op' then
      return semap.real_arithmetic(lower(p_part ->> 'op'),
                                   semap.condition_number(p_part #> '{args,0}', p_values),
                                   semap.condition_number(p_part #> '{args,1}', p_values));
    end if;
    v_json := semap.condition_property(p_part ->> 'property', p_values);
  end if;
  return semap.json_number(v_json);
end $$;

-- A part of a condition as a text; null where it is none.
create or replace function semap.condition_text(p_part jsonb, p_values jsonb) returns text
language plpgsql immutable parallel safe as $$
declare
  v_json  jsonb := p_part;
begin
  if p_part ? 'op' and jsonb_typeof(p_part) = 'object' then
    case lower(p_part ->> 'op')
      when 'casei' then return semap.lower_case(semap.condition_text(p_part #> '{args,0}', p_values));
      when 'accenti' then return semap.without_accents(semap.condition_text(p_part #> '{args,0}', p_values));
      else return null;
    end case;
  elsif jsonb_typeof(p_part) = 'object' then
    v_json := semap.condition_property(p_part ->> 'property', p_values);
  end if;
  return case when jsonb_typeof(v_json) = 'string' then v_json #>> '{}' end;
end $$;

-- A part of a condition as an instant; a text is the one that it says (RFC 3339), and null where it says none.
create or replace function semap.condition_instant(p_part jsonb, p_values jsonb) returns timestamptz
language plpgsql immutable parallel safe as $$
declare
  v_json  jsonb;
begin
  if p_part ? 'property' then
    v_json := semap.condition_property(p_part ->> 'property', p_values);
    return case when jsonb_typeof(v_json) = 'string' then semap.instant_of(v_json #>> '{}') end;
  end if;
  return semap.instant_of(coalesce(p_part ->> 'timestamp', p_part ->> 'date'));
end $$;

-- Whether two parts of a condition compare so; null where that is not known. They are compared as what the left one is
-- by itself, or else the right one, and a value of another kind is not known: numbers in double precision, texts by
-- code points. Of two properties the kinds must be equal; then numbers and texts have an order, all else is equal or
-- not.
create or replace function semap.condition_compare(p_op text, p_a jsonb, p_b jsonb, p_values jsonb) returns boolean
language plpgsql immutable parallel safe as $$
declare
  v_kind   text := coalesce(nullif(semap.condition_kind(p_a), 'any'), semap.condition_kind(p_b));
  v_a      jsonb;
  v_b      jsonb;
  v_order  integer;
begin
  if v_kind = 'any' then
    v_a := semap.condition_property(p_a ->> 'property', p_values);
    v_b := semap.condition_property(p_b ->> 'property', p_values);
    if jsonb_typeof(v_a) is distinct from jsonb_typeof(v_b) then
      return null;
    elsif p_op in ('=', '<>') then
      return (v_a = v_b) = (p_op = '=');
    end if;
    v_kind := case jsonb_typeof(v_a) when 'number' then 'number' when 'string' then 'text' end;
  end if;
  case v_kind
    when 'number' then
      v_order := btfloat8cmp(semap.condition_number(p_a, p_values), semap.condition_number(p_b, p_values));
    when 'text' then
      v_order := bttextcmp(semap.condition_text(p_a, p_values) collate "C", semap.condition_text(p_b, p_values));
    when 'boolean' then
      v_order := btboolcmp(semap.condition_truth(p_a, p_values), semap.condition_truth(p_b, p_values));
    when 'instant' then
      v_order := timestamptz_cmp(semap.condition_instant(p_a, p_values), semap.condition_instant(p_b, p_values));
    else
      return null;
  end case;
  case p_op
    when '=' then return v_order = 0;
    when '<>' then return v_order <> 0;
    when '<' then return v_order < 0;
    when '<=' then return v_order <= 0;
    when '>' then return v_order > 0;
    when '>=' then return v_order >= 0;
  end case;
end $$;

-- From when to when a part of a condition lasts: an instant is both; `..` is without an end.
create or replace function semap.condition_span(
  p_part jsonb, p_values jsonb, out start timestamptz, out ending timestamptz
)
language plpgsql immutable parallel safe as $$
declare
  v_end  jsonb;
begin
  if not p_part ? 'interval' then
    start := semap.condition_instant(p_part, p_values);
    ending := start;
    return;
  end if;
  v_end := p_part #> '{interval,0}';
  start := case when v_end = '".."' then '-infinity'
                when jsonb_typeof(v_end) = 'string' then semap.instant_of(v_end #>> '{}')
                else semap.condition_instant(v_end, p_values) end;
  v_end := p_part #> '{interval,1}';
  ending := case when v_end = '".."' then 'infinity'
                 when jsonb_typeof(v_end) = 'string' then semap.instant_of(v_end #>> '{}')
                 else semap.condition_instant(v_end, p_values) end;
end $$;

-- Whether two instants or intervals lie to one another as a temporal operator of CQL2 says; null where not known.
create or replace function semap.condition_in_time(p_op text, p_a jsonb, p_b jsonb, p_values jsonb) returns boolean
language plpgsql immutable parallel safe as $$
declare
  a  record := semap.condition_span(p_a, p_values);
  b  record := semap.condition_span(p_b, p_values);
begin
  case p_op
    when 't_after' then return a.start > b.ending;
    when 't_before' then return a.ending < b.start;
    when 't_contains' then return a.start < b.start and a.ending > b.ending;
    when 't_disjoint' then return a.start > b.ending or a.ending < b.start;
    when 't_during' then return a.start > b.start and a.ending < b.ending;
    when 't_equals' then return a.start = b.start and a.ending = b.ending;
    when 't_finishedby' then return a.start < b.start and a.ending = b.ending;
    when 't_finishes' then return a.start > b.start and a.ending = b.ending;
    when 't_intersects' then return a.start <= b.ending and a.ending >= b.start;
    when 't_meets' then return a.ending = b.start;
    when 't_metby' then return a.start = b.ending;
    when 't_overlappedby' then return a.start > b.start and a.start < b.ending and a.ending > b.ending;
    when 't_overlaps' then return a.start < b.start and a.ending > b.start and a.ending < b.ending;
    when 't_startedby' then return a.start = b.start and a.ending > b.ending;
    when 't_starts' then return a.start = b.start and a.ending < b.ending;
    else
      raise exception 'A condition cannot ask for %.', p_op
        using errcode = 'invalid_parameter_value', hint = 'Ask semap.check_condition what it may say.';
  end case;
end $$;

-- Whether a part of a condition is known to have no value.
create or replace function semap.condition_is_null(p_part jsonb, p_values jsonb) returns boolean
language plpgsql immutable parallel safe as $$
begin
  case semap.condition_kind(p_part)
    when 'any' then return semap.condition_property(p_part ->> 'property', p_values) is null;
    when 'number' then return semap.condition_number(p_part, p_values) is null;
    when 'text' then return semap.condition_text(p_part, p_values) is null;
    when 'boolean' then return semap.condition_truth(p_part, p_values) is null;
    else return false;
  end case;
end $$;

-- Whether a part of a condition is true or false of values; null where that is not known.
create or replace function semap.condition_truth(p_part jsonb, p_values jsonb) returns boolean
language plpgsql immutable parallel safe as $$
declare
  v_json   jsonb := p_part;
  v_op     text;
  v_args   jsonb;
  v_list   jsonb;
  v_part   boolean;
  v_found  boolean;
begin
  if jsonb_typeof(p_part) = 'object' then
    v_op := lower(p_part ->> 'op');
    if v_op is null then
      v_json := semap.condition_property(p_part ->> 'property', p_values);
    end if;
  end if;
  if v_op is null then
    return case when jsonb_typeof(v_json) = 'boolean' then v_json::boolean end;
  end if;
  v_args := p_part -> 'args';
  if v_op in ('=', '<>', '<', '<=', '>', '>=') then
    return semap.condition_compare(v_op, v_args -> 0, v_args -> 1, p_values);
  elsif v_op in ('and', 'or') then
    v_found := v_op = 'and';
    for i in 0 .. jsonb_array_length(v_args) - 1 loop
      v_part := semap.condition_truth(v_args -> i, p_values);
      if v_part = (v_op = 'or') then
        return v_part;
      elsif v_part is null then
        v_found := null;
      end if;
    end loop;
    return v_found;
  end if;
  case v_op
    when 'not' then
      return not semap.condition_truth(v_args -> 0, p_values);
    when 'isnull' then
      return semap.condition_is_null(v_args -> 0, p_values);
    when 'between' then
      return semap.condition_compare('>=', v_args -> 0, v_args -> 1, p_values)
         and semap.condition_compare('<=', v_args -> 0, v_args -> 2, p_values);
    when 'in' then
      v_list := v_args -> 1;
      v_found := false;
      for i in 0 .. jsonb_array_length(v_list) - 1 loop
        v_part := semap.condition_compare('=', v_args -> 0, v_list -> i, p_values);
        if v_part then
          return true;
        elsif v_part is null then
          v_found := null;
        end if;
      end loop;
      return v_found;
    when 'like' then
      return semap.condition_text(v_args -> 0, p_values) like semap.condition_text(v_args -> 1, p_values);
    else
      return semap.condition_in_time(v_op, v_args -> 0, v_args -> 1, p_values);
  end case;
end $$;

-- Whether a condition in CQL2's JSON form is known to be true of named values; one that is null asks for nothing.
-- A name is that of a value, or leads into it by keys with dots between; what is missing, or of another kind than is
-- wanted of it, is not known, neither true nor false (see semap.condition_compare), and what is not known is not true.
create or replace function semap.condition_holds(p_condition jsonb, p_values jsonb) returns boolean
language sql immutable parallel safe as $$
  select p_condition is null or coalesce(semap.condition_truth(p_condition, p_values), false)
$$;
