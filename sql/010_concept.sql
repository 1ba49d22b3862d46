-- The concept itself and every concept below it in the taxonomy.
create or replace function semap.concepts_below(p_concept_id integer) returns setof integer
language sql stable parallel safe as $$
  with recursive below (concept_id) as (
    select p_concept_id
    union
    select c.concept_id from semap.concept_parent c join below b on c.parent_id = b.concept_id
  )
  select concept_id from below
$$;

-- The concept itself and every concept above it in the taxonomy.
create or replace function semap.concepts_above(p_concept_id integer) returns setof integer
language sql stable parallel safe as $$
  with recursive above (concept_id) as (
    select p_concept_id
    union
    select c.parent_id from semap.concept_parent c join above a using (concept_id)
  )
  select concept_id from above
$$;

-- The id of the concept of a name or an IRI; null where there is none.
create or replace function semap.concept_named(p_name text) returns integer
language sql stable parallel safe as $$
  select coalesce((select concept_id from semap.concept where name = p_name),
                  (select min(concept_id) from semap.concept_iri where iri = p_name))
$$;

-- Whether a concept is another one or lies below it, both by name or IRI; null where one is unknown.
create or replace function semap.is_a(p_concept text, p_ancestor text) returns boolean
language sql stable parallel safe as $$
  select case when semap.concept_named(p_concept) is not null and semap.concept_named(p_ancestor) is not null
              then semap.concept_named(p_ancestor) in (select semap.concepts_above(semap.concept_named(p_concept)))
         end
$$;

-- Refuse a parent that lies below its child: the taxonomy has no circles. Edits of it are one at a time.
create or replace function semap.concept_parent_checked() returns trigger
language plpgsql set search_path = public, pg_temp as $$
declare
  v_circle  record;
begin
  select c.name as child, p.name as parent into v_circle
  from new_row n
  join semap.concept c on c.concept_id = n.concept_id
  join semap.concept p on p.concept_id = n.parent_id
  where n.parent_id in (select semap.concepts_below(n.concept_id))
  limit 1;
  if found then
    raise exception '% lies below % already.', v_circle.parent, v_circle.child
      using errcode = 'check_violation', hint = 'A taxonomy has no circles: remove the other parent first.';
  end if;
  return null;
end $$;

create or replace trigger concept_parent_checked_insert after insert on semap.concept_parent
  referencing new table as new_row for each statement execute function semap.concept_parent_checked();
create or replace trigger concept_parent_checked_update after update on semap.concept_parent
  referencing new table as new_row for each statement execute function semap.concept_parent_checked();
