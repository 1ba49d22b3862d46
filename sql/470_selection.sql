-- What operators are given: instances by what is known of them; and their answers as documents.

-- The ids of instances of a map, in their order: of a concept (name or IRI) or one below it, with one of these names or
-- aliases, among these ids, whose attributes contain these; null asks for nothing.
create or replace function semap.instances(
  p_map text, p_concept text default null, p_names text[] default null, p_ids bigint[] default null,
  p_attributes jsonb default null
) returns bigint[]
language plpgsql stable parallel safe set search_path = public, pg_temp as $$
begin
  if not exists (select from semap.map where name = p_map) then
    raise exception 'There is no map %.', p_map
      using errcode = 'no_data_found', hint = 'List the maps to see their names.';
  end if;
  if p_concept is not null and semap.concept_named(p_concept) is null then
    raise exception 'There is no concept %.', p_concept
      using errcode = 'no_data_found', hint = 'List the concepts to see their names and IRIs.';
  end if;
  return array(
    select i.instance_id
    from semap.instance i join semap.map m using (map_id)
    where m.name = p_map
      and (p_ids is null or i.instance_id = any (p_ids))
      and (p_names is null or i.name = any (p_names) or i.alias = any (p_names))
      and (p_concept is null or i.concept_id in (select semap.concepts_below(semap.concept_named(p_concept))))
      and (p_attributes is null or i.attributes @> p_attributes)
    order by i.instance_id);
end $$;

-- A text without its accents, so that é and e are alike: decomposed (NFD), without combining marks.
create or replace function semap.without_accents(p_text text) returns text
language sql immutable parallel safe as $$
  select regexp_replace(normalize(p_text, nfd), '[\u0300-\u036F]', '', 'g')
$$;

-- Whether one of a text's characters has a lower case that only Unicode after version 14 knows, or might have.
create or replace function semap.has_new_letter(p_text text) returns boolean
language sql immutable parallel safe as $$
  select p_text ~ '[\u1C89-\u1C8F\uA7CB-\uA7CF\uA7D2-\uA7D5\uA7DA-\uA7F4\U00010000-\U000103FF\U00010428-\U000104AF'
    '\U000104D4-\U0001056F\U00010596-\U00010C7F\U00010CB3-\U0001189F\U000118C0-\U00016E3F\U00016E60-\U0001E8FF'
    '\U0001E922-\U0010FFFF]'
$$;

-- A text in lower case, character by character, so that É and é are alike whatever the language of the server is;
-- letters that are newer than Unicode 14 are left as they are, so that servers and Pythons of all versions agree.
create or replace function semap.lower_case(p_text text) returns text
language sql immutable parallel safe as $$
  select case
    when octet_length(p_text) = length(p_text) then lower(p_text collate "C") collate "default"
    -- a Σ is a σ wherever it stands, and an İ one character
    when not semap.has_new_letter(p_text)
      then lower(translate(p_text, 'Σİ', 'σi') collate "und-x-icu") collate "default"
    else (select string_agg(case when semap.has_new_letter(c) then c else semap.lower_case(c) end, '' order by n)
          from regexp_split_to_table(p_text, '') with ordinality as t (c, n))
  end
$$;

-- The instant that a text of RFC 3339 says, a date being its first instant in UTC; null where it says none. Each part
-- is looked at before the cast, which then cannot fail: a block that catches errors could not run in a parallel plan.
create or replace function semap.instant_of(p_text text) returns timestamptz
language plpgsql immutable parallel safe as $$
declare
  v_zone_at   integer := length(p_text) - case when right(p_text, 1) in ('Z', 'z') then 0 else 5 end;
  v_fraction  text;
  v_month     date;
begin
  if p_text ~ '^[0-9]{4}-(0[1-9]|1[0-2])-[0-9]{2}'
              '([Tt][0-9]{2}:[0-5][0-9]:[0-9]{2}(\.[0-9]+)?([Zz]|[+-][0-9]{2}:[0-5][0-9]))?$'
     is not true or left(p_text, 4) = '0000' then
    return null;
  end if;
  v_month := make_date(left(p_text, 4)::integer, substr(p_text, 6, 2)::integer, 1);
  if substr(p_text, 9, 2)::integer not between 1 and (v_month + interval '1 month')::date - v_month then
    return null;
  elsif length(p_text) = 10 then
    return (p_text || 'T00:00:00Z')::timestamptz;
  end if;
  v_fraction := '0' || substr(p_text, 20, least(v_zone_at - 20, 20));
  if substr(p_text, 18, 2) > '60'
     or substr(p_text, 12, 2)::integer * 3600 + substr(p_text, 15, 2)::integer * 60 + substr(p_text, 18, 2)::integer
        + round(v_fraction::double precision * 1e6) / 1e6 > 86400
     or substr(p_text, v_zone_at + 1, 2) > '15' then
    return null;
  end if;
  return (left(p_text, 19) || substr(v_fraction, 2) || substr(p_text, v_zone_at))::timestamptz;
end $$;

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

-- Whether each of two arrays contains all items of the other.
create or replace function semap.has_same_items(p_a jsonb, p_b jsonb) returns boolean
language sql immutable parallel safe as $$
  select p_a @> p_b and p_b @> p_a
$$;

-- Whether an array contains any item of another.
create or replace function semap.shares_items(p_a jsonb, p_b jsonb) returns boolean
language sql immutable parallel safe as $$
  select case when p_a is not null and p_b is not null then
    exists (select from jsonb_array_elements(p_a) item where p_b @> jsonb_build_array(item)) end
$$;

-- A geometry as GeoJSON in metres, to the last digit; the faces of a mesh as a MultiPolygon with heights.
create or replace function semap.geojson(p_geometry public.geometry) returns jsonb
language sql immutable strict parallel safe set search_path = public, pg_temp as $$
  select case
    when geometrytype(p_geometry) in ('TIN', 'POLYHEDRALSURFACE', 'TRIANGLE') then
      (select st_asgeojson(st_collect(st_makepolygon(st_exteriorring(geom)) order by path), 15, 0)::jsonb
       from st_dump(p_geometry))
    else st_asgeojson(p_geometry, 15, 0)::jsonb end
$$;
