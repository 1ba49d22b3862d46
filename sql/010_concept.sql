-- The concept itself and every concept below it in the taxonomy.
create or replace function semap.concepts_below(p_concept_id integer) returns setof integer
language sql stable parallel safe as $$
  with recursive below (concept_id) as (
    select p_concept_id
    union
    select c.concept_id from semap.concept c join below b on c.parent_id = b.concept_id
  )
  select concept_id from below
$$;
comment on function semap.concepts_below is
  'The concept itself and every concept below it in the taxonomy.';
