-- What was when, in event time: who was in which instance, and how doors stood.

-- Which track was in which instance at some time between two moments, both included; `until` is null while it holds. A
-- stay that took no time is none, and neither is a relation of a pair: who faces a table is not in it.
create or replace function semap.stays(p_map_id integer, p_from timestamptz, p_to timestamptz)
returns table (track_id bigint, instance_id bigint, query_id integer, since timestamptz, until timestamptz)
language sql stable parallel safe as $$
  select p.track_id, p.instance_id, p.query_id, p.since, p.until
  from semap.relation_past p
  where tstzrange(p.since, p.until, '[]') && tstzrange(p_from, p_to, '[]') and p.since < p.until and p.until > p_from
    and p.map_id = p_map_id and p.track_id is not null and p.instance_id is not null
    and not exists (select from semap.continuous_query q where q.query_id = p.query_id and q.in_pairs)
  union all
  select n.track_id, n.instance_id, n.query_id, n.since, null
  from semap.relation n
  where n.map_id = p_map_id and not n.in_pairs and n.since <= p_to
$$;

-- The stays in an instance between two moments, cut to them: a track that several queries have in it at a time is in it
-- once. What holds lasts until now, or until what was seen last on the map.
create or replace function semap.stays_in(p_instance_id bigint, p_from timestamptz, p_to timestamptz)
returns table (track_id bigint, since timestamptz, until timestamptz)
language sql stable parallel safe as $$
  with ends as (
    select least(p_to, greatest(clock_timestamp(), max(c.newest_stamp))) as until
    from semap.instance i join semap.source s using (map_id) join semap.source_count c using (source_id)
    where i.instance_id = p_instance_id
  ), held as (
    select p.track_id, p.since, p.until
    from semap.relation_past p
    where p.instance_id = p_instance_id and p.until > p_from and p.since < p_to and p.since < p.until
      and p.track_id is not null
      and not exists (select from semap.continuous_query q where q.query_id = p.query_id and q.in_pairs)
    union all
    select n.track_id, n.since, e.until
    from semap.relation n cross join ends e
    where n.instance_id = p_instance_id and n.confirmed and not n.in_pairs and n.since < e.until and e.until > p_from
  )
  select h.track_id, lower(s.span), upper(s.span)
  from (
    select track_id, range_agg(tstzrange(greatest(since, p_from), least(until, p_to))) as spans
    from held
    group by track_id
  ) h
  cross join lateral unnest(h.spans) s (span)
$$;

-- How many were in an instance in each span of time between ascending moments: on average, at most and since when so
-- many, and how many different tracks. Who comes as another one leaves is not in it beside that one.
create or replace function semap.occupancy(p_instance_id bigint, p_moments timestamptz[])
returns table (
  since timestamptz, until timestamptz, mean double precision, peak bigint, peak_at timestamptz, tracks bigint
)
language sql stable as $$
  with stay as materialized (
    select s.*, width_bucket(s.since, p_moments) as first, width_bucket(s.until - interval '1 us', p_moments) as last
    from semap.stays_in(p_instance_id, p_moments[1], p_moments[cardinality(p_moments)]) s
  ), span as (
    select n, p_moments[n] as since, p_moments[n + 1] as until from generate_series(1, cardinality(p_moments) - 1) n
  ), part as (
    select n, sum(extract(epoch from least(s.until, p_moments[n + 1]) - greatest(s.since, p_moments[n]))) as seconds,
           count(distinct s.track_id) as tracks
    from stay s cross join lateral generate_series(s.first, s.last) n
    group by n
  ), step as (
    select at, sum(sum(change)) over (order by at)::bigint as inside
    from (
      select since as at, 1 as change from stay
      union all
      select until, -1 from stay
      union all
      select since, 0 from span) c
    group by at
  ), peak as (
    select distinct on (n) n, inside, at
    from (select *, width_bucket(at, p_moments) as n from step) s
    order by n, inside desc, at
  )
  select span.since, span.until, coalesce(part.seconds / extract(epoch from span.until - span.since), 0),
         peak.inside, case when peak.inside > 0 then peak.at end, coalesce(part.tracks, 0)
  from span left join part using (n) left join peak using (n)
  order by span.n
$$;

-- How the doors of a map stood between two moments, both included: the state in which each was at the first of them,
-- and each that began after it; `until` is null while it holds. A door of which nothing is known has no row.
create or replace function semap.door_states(p_map_id integer, p_from timestamptz, p_to timestamptz)
returns table (instance_id bigint, name text, state text, since timestamptz, until timestamptz)
language sql stable parallel safe as $$
  with said as (
    select d.instance_id, d.name, s.value, s.since, s.stamp
    from semap.instance d
    cross join lateral (
      (select o.value, case when o.value = o.previous then coalesce(o.since, o.stamp) else o.stamp end as since, o.stamp
       from semap.object_state o
       where o.instance_id = d.instance_id and o.property = 'door' and o.stamp <= p_from
       order by o.stamp desc, o.uid desc limit 1)
      union all
      select o.value, o.stamp, o.stamp
      from semap.object_state o
      where o.instance_id = d.instance_id and o.property = 'door' and o.stamp > p_from and o.stamp <= p_to
    ) s
    where d.map_id = p_map_id and d.concept_id in (select semap.concepts_below(semap.concept_named('Door')))
  ), begun as (
    select *, lag(value) over (partition by instance_id order by stamp) as before from said
  )
  select b.instance_id, b.name, b.value, b.since,
         coalesce(lead(b.since) over (partition by b.instance_id order by b.stamp),
                  (select n.stamp from semap.object_state n
                   where n.instance_id = b.instance_id and n.property = 'door' and n.stamp > p_to and n.value <> b.value
                   order by n.stamp limit 1))
  from begun b
  where b.before is distinct from b.value
$$;
