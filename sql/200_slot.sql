-- The name of the rule worker's replication slot: slots belong to the whole server, so it carries
-- the database's own number.
create or replace function semap.rule_slot() returns name
language sql stable parallel safe as $$
  select ('semap_rules_' || oid)::name from pg_database where datname = current_database()
$$;

-- Make the rule worker's slot where it is missing and nothing was read through it before.
create or replace function semap.create_rule_slot() returns void
language sql as $$
  select pg_create_logical_replication_slot(semap.rule_slot(), 'pgoutput')
  where not exists (select from pg_replication_slots where slot_name = semap.rule_slot())
    and not exists (select from semap.progress where worker = 'rules')
$$;

-- What the rule worker knows of a rule, as it also comes through the log.
create or replace function semap.rule_json(p_rule semap.rule) returns jsonb
language sql stable parallel safe as $$
  select jsonb_build_object('map_id', p_rule.map_id, 'name', p_rule.name, 'version', p_rule.version,
                            'queries', p_rule.queries, 'declaration', p_rule.declaration,
                            'enabled', p_rule.enabled, 'backfill_from', p_rule.backfill_from, 'seam', p_rule.seam)
$$;

-- The rule worker begins where its slot begins, with the rules that were there before.
create or replace function semap.begin_progress() returns void
language sql as $$
  insert into semap.progress (worker, lsn, rule_state)
  select 'rules', s.confirmed_flush_lsn,
         coalesce((select jsonb_object_agg(r.rule_id, semap.rule_json(r)) from semap.rule r), '{}')
  from pg_replication_slots s where s.slot_name = semap.rule_slot()
  on conflict (worker) do nothing
$$;

-- Make the rule worker's slot anew at the present end of the log; whatever it had not read is passed.
create or replace function semap.replace_rule_slot() returns void
language plpgsql as $$
begin
  perform pg_drop_replication_slot(slot_name) from pg_replication_slots where slot_name = semap.rule_slot();
  perform pg_create_logical_replication_slot(semap.rule_slot(), 'pgoutput');
end $$;

-- Whether this statement sees what a transaction has written, given the lower 32 bits of its number. The log shows a
-- transaction an instant before other sessions do.
create or replace function semap.is_visible(p_xid bigint) returns boolean
language sql stable as $$
  select pg_visible_in_snapshot(
    (case when n.xid > n.newest + 2147483648 then n.xid - 4294967296
          when n.xid < n.newest - 2147483648 then n.xid + 4294967296
          else n.xid end)::text::xid8, n.snapshot)
  from (select s.snapshot, s.newest, s.newest - s.newest % 4294967296 + p_xid as xid
        from (select pg_current_snapshot() as snapshot,
                     pg_snapshot_xmax(pg_current_snapshot())::text::bigint as newest) s) n
$$;
