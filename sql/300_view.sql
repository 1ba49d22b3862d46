-- Which track is in which instance now, by name.
create or replace view semap.relation_now with (security_invoker = true) as
  select m.name as map, r.query_name as query, n.track_id, t.name as track, n.instance_id,
         r.instance_name as instance, n.since, n.map_id
  from semap.relation n
  join semap.region r using (region_id)
  join semap.track t using (track_id)
  join semap.map m on m.map_id = n.map_id;
comment on view semap.relation_now is
  'Which track is in which instance now, by name.';
