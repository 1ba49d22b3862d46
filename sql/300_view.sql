-- Which relations hold, and which did.

-- What holds now by every continuous query. The subject is a track (track_id) or an instance (subject_instance_id), the
-- object an instance (instance_id) or a track (object_track_id).
create or replace view semap.relation_held with (security_invoker = true) as
  select query_id, map_id, track_id, subject_instance_id, instance_id, object_track_id, since
  from semap.relation where confirmed;

-- What holds now by every continuous query, by name; subject and object are the names of whichever kind they are.
create or replace view semap.relation_now with (security_invoker = true) as
  select m.name as map, q.name as query, n.track_id, t.name as track, n.instance_id, o.name as instance, n.since,
         n.map_id,
         n.query_id, n.subject_instance_id, s.name as subject_instance, n.object_track_id, u.name as object_track,
         coalesce(t.name, s.name) as subject, coalesce(o.name, u.name) as object
  from semap.relation_held n
  join semap.map m on m.map_id = n.map_id
  join semap.continuous_query q on q.query_id = n.query_id
  left join semap.track t on t.track_id = n.track_id
  left join semap.instance s on s.instance_id = n.subject_instance_id
  left join semap.instance o on o.instance_id = n.instance_id
  left join semap.track u on u.track_id = n.object_track_id;

-- Who was related to what, since when, until when and how long: what is over, under the names that things had when it
-- ended, and what holds, whose until and duration are null.
create or replace view semap.relation_span with (security_invoker = true) as
  select m.name as map, p.query_name as query, coalesce(p.track_name, p.subject_instance_name) as subject,
         coalesce(p.instance_name, p.object_track_name) as object, p.since, p.until, p.until - p.since as duration,
         p.map_id, p.query_id, p.track_id, p.track_name as track, p.subject_instance_id,
         p.subject_instance_name as subject_instance, p.instance_id, p.instance_name as instance, p.object_track_id,
         p.object_track_name as object_track
  from semap.relation_past p
  join semap.map m on m.map_id = p.map_id
  union all
  select n.map, n.query, n.subject, n.object, n.since, null, null, n.map_id, n.query_id, n.track_id, n.track,
         n.subject_instance_id, n.subject_instance, n.instance_id, n.instance, n.object_track_id, n.object_track
  from semap.relation_now n;

-- What held at a moment of event time: what had begun by then, and ended later or not at all. A relation that took no
-- time held at none.
create or replace function semap.relations_as_of(p_at timestamptz) returns setof semap.relation_span
language sql stable parallel safe as $$
  select s.* from semap.relation_span s
  where tstzrange(s.since, s.until, '[]') @> p_at and (s.until > p_at or s.until is null)
$$;
