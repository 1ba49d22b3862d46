-- How probable relations are of queries that ask for certainty. The error of a position is taken as a normal
-- distribution with the covariance that its error ellipse says (sql/106, 107).

-- How probable it is that a track is where a relation says, from its present position and covariance; null of a track
-- that does not live, and of a query that does not ask for certainty. Without a deviation, and by its height where both
-- have one, it is 1 or 0.
create or replace function semap.relation_probability(p_track_id bigint, p_region_id integer) returns double precision
language sql stable as $$
  select case when t.z_m is not null and not (t.z_m >= r.z_min_m and t.z_m < r.z_max_m) then 0
              else (semap.probability_inside(r.footprint, t.x_m, t.y_m, c.xx, c.xy, c.yy)).probability end
  from semap.region r
  join semap.track_present t on t.map_id = r.map_id and t.track_id = p_track_id
  cross join lateral semap.error_covariance(t.std_m, t.std_across_m, t.std_yaw_rad) c
  where r.region_id = p_region_id and r.enter_stds is not null
$$;

-- What holds now by queries that ask for certainty, and how probable each of it is now.
create or replace view semap.relation_certainty with (security_invoker = true) as
  select m.name as map, r.query_name as query, n.track_id, t.name as track, n.instance_id, r.instance_name as instance,
         n.since, semap.relation_probability(n.track_id, r.region_id) as probability, n.map_id
  from semap.relation n
  join semap.region r on r.query_id = n.query_id and r.instance_id = n.instance_id
  join semap.track t using (track_id)
  join semap.map m on m.map_id = n.map_id
  where n.confirmed and r.enter_stds is not null;
