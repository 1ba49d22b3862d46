-- What an earlier version kept of openings that are crossed is brought in line with what is kept of them now: it did
-- not know openings as lines.
do $$
begin
  if exists (select from semap.query_predicate where object_compared = 'line' and enabled) then
    perform semap.lock_regions_exclusive();
    perform set_config('search_path', 'public, pg_temp', true);
    perform semap.refresh_pairs(array_agg(query_id), null)
    from semap.query_predicate where object_compared = 'line' and in_pairs and enabled;
  end if;
end $$;
