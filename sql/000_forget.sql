-- Whatever an earlier version defined goes before its successor comes, so that a function whose
-- parameters changed does not live on beside the new one. What somebody else's object depends on stays
-- and is replaced in place.
do $$
declare
  v_object  record;
begin
  for v_object in
    select g.tgname, g.tgrelid::regclass as on_table
    from pg_trigger g join pg_proc p on p.oid = g.tgfoid
    where not g.tgisinternal and g.tgparentid = 0 and p.pronamespace = 'semap'::regnamespace
  loop
    execute format('drop trigger %I on %s', v_object.tgname, v_object.on_table);
  end loop;
  for v_object in
    -- what stands on others goes before them: views of queries, of concepts, then those that they are made of, the
    -- last one that was made first
    (select format('drop view %s', c.oid::regclass) as statement
     from pg_class c join pg_namespace n on n.oid = c.relnamespace
     where n.nspname in ('semap_result', 'semap_query') and c.relkind = 'v'
     order by n.nspname desc, c.relname in ('track', 'instance'))
    union all
    (select format('drop view %s', oid::regclass)
     from pg_class where relnamespace = 'semap'::regnamespace and relkind = 'v'
     order by oid desc)
    union all
    select format('drop function %s', p.oid::regprocedure)
    from pg_proc p join pg_namespace n on n.oid = p.pronamespace
    where n.nspname = 'semap_query' and p.prokind = 'f'
    union all
    select format('drop aggregate %s', oid::regprocedure)
    from pg_proc where pronamespace = 'semap'::regnamespace and prokind = 'a'
    union all
    select format('drop routine %s', oid::regprocedure)
    from pg_proc where pronamespace = 'semap'::regnamespace and prokind in ('f', 'p')
  loop
    begin
      execute v_object.statement;
    exception when dependent_objects_still_exist then
      null;
    end;
  end loop;
end $$;
