-- What holds now by each continuous query, be it kept by regions or by pairs: a track or an instance of each side.
create or replace view semap.relation_held with (security_invoker = true) as
  select query_id, map_id, track_id, null::bigint as subject_instance_id, instance_id, null::bigint as object_track_id, since
  from semap.relation
  union all
  select query_id, map_id, track_id, subject_instance_id, instance_id, object_track_id, since
  from semap.pair where held;
comment on view semap.relation_held is
  'What holds now by each continuous query, be it kept by regions or by pairs.';
