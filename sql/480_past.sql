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
  where n.map_id = p_map_id and n.since <= p_to
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
