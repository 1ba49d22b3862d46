-- What texts of rules name on a map, for those who write them: each word with its kind; of people, who may be many,
-- those that came last, and so many of the objects that are neither room nor door. Properties of objects are found by
-- steps through their index, however many states there are.
create or replace function semap.rule_words(p_map_id integer, p_most integer default 1000)
returns table (kind text, word text)
language sql stable as $$
  with recursive property(name) as (
    select min(s.property) from semap.object_state s where s.map_id = p_map_id
    union all
    select (select min(s.property) from semap.object_state s where s.map_id = p_map_id and s.property > p.name)
    from property p where p.name is not null),
  person as (
    select t.name from semap.track t where t.map_id = p_map_id order by t.track_id desc limit p_most),
  state(value) as (
    select s.value from semap.object_state s where s.map_id = p_map_id order by s.stamp desc limit p_most),
  of_kind(kind, concept_id) as (
    select lower(c.name), below.concept_id
    from semap.concept c
      cross join lateral semap.concepts_below(c.concept_id) below(concept_id)
    where c.name in ('Room', 'Door'))
  select distinct found.kind, found.word
  from (
    select k.kind, i.name from semap.instance i join of_kind k using (concept_id) where i.map_id = p_map_id
    union all (
      select 'instance', i.name from semap.instance i
      where i.map_id = p_map_id and not exists (select from of_kind k where k.concept_id = i.concept_id)
      order by i.instance_id limit p_most)
    union all select 'concept', c.name from semap.concept c
    union all select 'query', q.name from semap.continuous_query q where q.map_id = p_map_id
    union all select 'rule', r.name from semap.rule r where r.map_id = p_map_id
    union all select 'state', p.name from property p
    union all select 'value', s.value from state s
    union all select 'person', t.name from person t) found(kind, word)
  where found.word is not null
  order by 1, 2
$$;
