-- The log of changes folded: what it says holds now and held, against what is stored.

-- The changes of a map that stand: those that say that something began or ended, and that nobody took back.
create or replace function semap.standing_changes(p_map_id integer) returns setof semap.relation_change
language sql stable as $$
  select c.* from semap.relation_change c
  where c.map_id = p_map_id and c.kind in ('began', 'ended') and c.amendment is distinct from 'retracted'
    and not exists (select from semap.relation_change x where x.retracts = c.uid)
$$;

-- The changes that stand, each with the one before it of the same two things, in the order in which they happened. What
-- was amended has its place by its moment, all else by when it was written.
create or replace function semap.folded_changes(p_map_id integer) returns table (
  change semap.relation_change, before_kind semap.change_kind, before_edge_at timestamptz, is_newest boolean
)
language sql stable as $$
  with ordered as (
    select c, case when bool_or(c.amendment is not null) over one_pair then c.transition_at end as moment,
           row_number() over (partition by c.query_id, c.track_id, c.subject_instance_id, c.instance_id,
                              c.object_track_id,
                                           c.transition_at, c.kind, c.since < c.transition_at
                                             order by c.change_id) as turn
    from semap.standing_changes(p_map_id) c
    window one_pair as (partition by c.query_id, c.track_id, c.subject_instance_id, c.instance_id, c.object_track_id)
  )
  select c, lag((c).kind) over one_pair, lag((c).transition_at) over one_pair, lead((c).kind) over one_pair is null
  from ordered
  window one_pair as (partition by (c).query_id, (c).track_id, (c).subject_instance_id, (c).instance_id,
                      (c).object_track_id
                      order by moment, case when moment is not null then semap.place_in_moment(c, turn) end,
                               (c).change_id)
$$;

-- What holds now by what is stored.
create or replace function semap.held_relations(p_map_id integer) returns table (
  query_id integer, track_id bigint, subject_instance_id bigint, instance_id bigint, object_track_id bigint,
  since timestamptz
)
language sql stable as $$
  select query_id, track_id, subject_instance_id, instance_id, object_track_id, since
  from semap.relation where map_id = p_map_id and confirmed
$$;

-- Two things of a query by name, as the log tells of them.
create or replace function semap.pair_in_words(p_change semap.relation_change) returns text
language sql stable as $$
  select format('%s, %s (%s)',
                coalesce('track ' || (p_change).track_name, (p_change).subject_instance_name, 'something'),
                coalesce((p_change).instance_name, 'track ' || (p_change).object_track_name, 'something'),
                (p_change).query_name)
$$;

-- Two things of a query by name, as they are known now.
create or replace function semap.relation_in_words(
  p_query_id integer, p_track_id bigint, p_subject_instance_id bigint, p_instance_id bigint, p_object_track_id bigint
) returns text
language sql stable as $$
  select format('%s, %s (%s)',
                coalesce('track ' || (select name from semap.track where track_id = p_track_id),
                         (select name from semap.instance where instance_id = p_subject_instance_id), 'something'),
                coalesce((select name from semap.instance where instance_id = p_instance_id),
                         'track ' || (select name from semap.track where track_id = p_object_track_id), 'something'),
                (select name from semap.continuous_query where query_id = p_query_id))
$$;

-- The log against itself (what began ends before it begins again) and against what is stored to hold now. What began
-- before the oldest change that is kept is not in it.
create or replace function semap.log_differences(p_map_id integer)
returns table (change_id bigint, thing text, stored text, wanted text)
language sql stable as $$
  with kept as (
    select coalesce((select gone_before from semap.retention where kind = 'changes'), '-infinity') as since
  ), folded as materialized (
    select * from semap.folded_changes(p_map_id)
  ), open as (
    select (change).* from folded where is_newest and (change).kind = 'began'
  )
  select (change).change_id, semap.pair_in_words(change), format('%s at %s', (change).kind, (change).transition_at),
         case when before_kind is null then 'that it began, before'
              else format('not after it %s at %s', before_kind, before_edge_at) end
  from folded, kept
  where before_kind = (change).kind or before_kind is null and (change).kind = 'ended' and (change).since >= kept.since
  union all
  select (change).change_id, semap.pair_in_words(change), 'ended, since ' || (change).since, 'since ' || before_edge_at
  from folded
  where before_kind = 'began' and (change).kind = 'ended'
    and (change).since <> least(before_edge_at, (change).transition_at)
  union all
  select o.change_id,
         case when o.change_id is null
              then semap.relation_in_words(h.query_id, h.track_id, h.subject_instance_id, h.instance_id,
                                           h.object_track_id)
              else semap.pair_in_words(o) end,
         case when h.query_id is null then 'no relation' else 'a relation since ' || h.since end,
         case when o.change_id is null then 'no relation, by the log'
              else 'a relation since ' || o.transition_at || ', by the log' end
  from open o
  full join semap.held_relations(p_map_id) h
    on h.query_id = o.query_id
    and coalesce(h.track_id, 0) = coalesce(o.track_id, 0) and coalesce(h.instance_id, 0) = coalesce(o.instance_id, 0)
    and coalesce(h.subject_instance_id, 0) = coalesce(o.subject_instance_id, 0)
    and coalesce(h.object_track_id, 0) = coalesce(o.object_track_id, 0)
  where o.transition_at is distinct from h.since
    and not (o.change_id is null and h.since < (select since from kept))
$$;

-- What is over by the log against what is stored of it, as far back as the log goes.
create or replace function semap.past_differences(p_map_id integer)
returns table (thing text, stored text, wanted text)
language sql stable as $$
  with kept as (
    select coalesce((select gone_before from semap.retention where kind = 'changes'), '-infinity') as since
  ), told as (
    select c.query_id, c.track_id, c.subject_instance_id, c.instance_id, c.object_track_id, c.since,
           c.transition_at as until
    from semap.standing_changes(p_map_id) c where c.kind = 'ended' and c.transition_at >= (select since from kept)
  ), kept_past as (
    select p.query_id, p.track_id, p.subject_instance_id, p.instance_id, p.object_track_id, p.since, p.until
    from semap.relation_past p where p.map_id = p_map_id and p.until >= (select since from kept)
  ), differing as (
    select 'no stay' as stored, format('a stay from %s to %s', since, until) as wanted, *
    from (select * from told except all select * from kept_past) m
    union all
    select format('a stay from %s to %s', since, until), 'no stay', *
    from (select * from kept_past except all select * from told) m
  )
  select semap.relation_in_words(d.query_id, d.track_id, d.subject_instance_id, d.instance_id, d.object_track_id),
         d.stored, d.wanted
  from differing d
$$;
