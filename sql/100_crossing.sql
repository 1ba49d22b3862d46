-- The identity of a change: a function of what happened, so that a replay gives the same one.
create or replace function semap.change_uid(
  p_query text, p_track uuid, p_instance uuid, p_kind text, p_cause text, p_stamp timestamptz
) returns uuid
language sql stable parallel safe
return md5(p_query || '|' || p_track || '|' || p_instance || '|' || p_kind || '|' || p_cause || '|'
           || (extract(epoch from p_stamp) * 1000000)::bigint)::uuid;
comment on function semap.change_uid is
  'The identity of a change: a function of what happened, so that a replay gives the same one.';

-- Write crossings to relation_change in the order of their stamps, and bring relation up to date.
-- An edit of the map has no event time of its own and takes the last stamp of each track, so the
-- same crossing may happen twice at one stamp: its identity is random.
create or replace function semap.record_crossings(p_crossings semap.crossing[]) returns void
language plpgsql set plan_cache_mode = force_generic_plan set enable_seqscan = off set enable_mergejoin = off as $$
begin
  if p_crossings is null then
    return;
  end if;

  insert into semap.relation_change (uid, map_id, query_id, query_name, track_id, track_name,
                                     instance_id, instance_name, kind, cause, stamp, since)
  select case when c.cause = 'map' then gen_random_uuid()
              else semap.change_uid(r.query_name, t.uid, r.instance_uid, c.kind::text, c.cause::text, c.stamp) end,
         r.map_id, r.query_id, r.query_name, c.track_id, t.name,
         r.instance_id, r.instance_name, c.kind, c.cause, c.stamp,
         case when c.kind = 'began' then c.stamp
              else coalesce(lag(c.stamp) over one_pair, n.since) end
  from unnest(p_crossings) c
  join semap.region r using (region_id)
  join semap.track t using (track_id)
  left join semap.relation n using (track_id, region_id)
  window one_pair as (partition by c.track_id, c.region_id order by c.stamp, c.cause = 'disappeared')
  order by c.stamp, t.name collate "C", t.uid, c.cause = 'disappeared', c.kind desc, r.instance_uid;

  -- the fenced look-up keeps the plan on the key, whatever relation held when it was planned
  with final as (
    select distinct on (c.track_id, c.region_id) c.*
    from unnest(p_crossings) c
    order by c.track_id, c.region_id, c.stamp desc, c.cause = 'disappeared' desc
  ), gone as (
    delete from semap.relation where ctid = any (array(
      select n.ctid
      from final f
      cross join lateral (select ctid from semap.relation n
                          where n.track_id = f.track_id and n.region_id = f.region_id offset 0) n
      where f.kind = 'ended'))
  )
  insert into semap.relation as n (track_id, region_id, query_id, instance_id, map_id, since)
  select f.track_id, f.region_id, r.query_id, r.instance_id, r.map_id, f.stamp
  from final f join semap.region r using (region_id)
  where f.kind = 'began'
  on conflict (track_id, region_id) do update set since = excluded.since;
end $$;
comment on function semap.record_crossings is
  'Write crossings to relation_change in the order of their stamps, and bring relation up to date.';
