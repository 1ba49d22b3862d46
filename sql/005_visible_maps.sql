-- The maps that the caller of this transaction is restricted to; null where there is no restriction. A role for some
-- maps is restricted to none until it is told which, also where a function acts for its owner.
create or replace function semap.visible_maps() returns integer[]
language sql stable parallel safe as $$
  select coalesce(nullif(current_setting('semap.maps', true), ''),
                  case when current_setting('role') ~ '_map$' then '{}' end)::integer[]
$$;
comment on function semap.visible_maps is
  'The maps that the caller of this transaction is restricted to; null where there is no restriction.';
