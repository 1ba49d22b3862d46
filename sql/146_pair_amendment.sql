-- What a log says of pairs is brought in line with a replay of them (sql/129): what the two say of each pair is
-- compared, where they fit together it is decided what is taken back and what is added, and that is written (sql/148).

-- Add changes of pairs, in their order, and the spans that they end. One that was taken back and stands again has the
-- identity that it had; one that holds since another moment than before gets one of its own, since who believes the
-- other has to know.
create or replace function semap.add_pair_changes(p_changes semap.pair_change[]) returns void
language plpgsql as $$
declare
  v_uids  uuid[];
begin
  if p_changes is null or p_changes = '{}' then
    return;
  end if;
  v_uids := array(
    select case when exists (select from semap.relation_change o where o.uid = d.uid and o.since <> d.since)
                then md5(d.uid || '|' || d.since)::uuid else d.uid end
    from semap.described_changes(p_changes) d order by d.place);
  perform semap.free_uids(v_uids);
  perform semap.write_pair_changes(p_changes, v_uids, 'added');
end $$;

-- Since when a pair can be corrected: the newest stamp of its map when the query, or an instance that counts for it,
-- got the form that it has; tracks that came to be known later are corrected from their beginning on.
create or replace function semap.pair_valid_from(p_query_id integer, p_subject_key bigint, p_object_key bigint)
returns timestamptz
language sql stable as $$
  select max(f.valid_from)
  from (select valid_from, valid_from_track_id from semap.pair_query where query_id = p_query_id
        union all
        select valid_from, valid_from_track_id from semap.query_track t
        where t.query_id = p_query_id and t.track_id in (p_subject_key, p_object_key)
        union all
        select valid_from, valid_from_track_id from semap.pair_instance m
        where m.query_id = p_query_id
          and (m.instance_id in (-p_subject_key, -p_object_key)
               or exists (select from semap.query_predicate q where q.query_id = p_query_id
                          and q.follows_from = 'rank'))) f
  where f.valid_from_track_id >= least(case when p_subject_key > 0 then p_subject_key end,
                                   case when p_object_key > 0 then p_object_key end)
$$;

-- Since when a pair holds before a moment, by these changes of it, in their order, and since when it held before them
-- (null: it does not).
create or replace function semap.held_since(
  p_held_since timestamptz, p_changes semap.pair_change[], p_before timestamptz
) returns timestamptz
language plpgsql immutable parallel safe as $$ -- which keeps its plan
declare
  v_last  record;
begin
  select c.kind, c.since into v_last
  from unnest(p_changes) with ordinality
    as c (query_id, subject_key, object_key, kind, cause, stamp, transition_at, since, x_m, y_m, direction, place)
  where c.kind <> 'crossed' and c.stamp < p_before
  order by c.place desc limit 1;
  return case when not found then p_held_since when v_last.kind = 'began' then v_last.since end;
end $$;

-- The pairs in which a replay from p_from on differs from one without the late states, the first of which is of
-- p_late_from: what the log tells of each, and since when it holds before the late states and at p_to, as found by the
-- replay and as told by the log.
create or replace function semap.compared_pairs(
  p_map_id integer, p_query_ids integer[], p_track_ids bigint[], p_from timestamptz, p_late_from timestamptz,
  p_to timestamptz, p_with semap.pair_change[], p_without semap.pair_change[],
  p_pairs semap.relation_state[], p_pairs_without semap.relation_state[]
) returns setof semap.compared_pair
language sql stable as $$
  with differing as (
    select query_id, subject_key, object_key from (
      (select * from unnest(p_with) except select * from unnest(p_without))
      union all
      (select * from unnest(p_without) except select * from unnest(p_with))) d
    where query_id = any (p_query_ids)
    union
    select query_id, subject_key, object_key from semap.differing_pairs(p_pairs, p_pairs_without) d
    where query_id = any (p_query_ids)
  ), found as (
    select (c).query_id, (c).subject_key, (c).object_key, array_agg(c order by place) as said
    from (select c, row_number() over () as place from unnest(p_with) c) w
    group by (c).query_id, (c).subject_key, (c).object_key
  ), logged as (
    select c, s as said, s.query_id, s.subject_key, s.object_key,
           row_number() over (partition by s.query_id, s.subject_key, s.object_key, c.transition_at, c.kind,
                                           c.since < c.transition_at, c.stamp <= p_to order by c.change_id) as turn
    from semap.relation_change c
    cross join lateral semap.change_said(c) s
    join differing d
      on (s.query_id, s.subject_key, s.object_key) = (d.query_id, d.subject_key, d.object_key)
    where c.map_id = p_map_id and c.stamp > p_from and c.query_id = any (p_query_ids)
      and c.amendment is distinct from 'retracted'
      and not exists (select from semap.relation_change r where r.retracts = c.uid)
  ), told as (
    select query_id, subject_key, object_key, array_agg(said order by place) as said,
           array_agg(row((c).uid, said)::semap.told_change order by place) as changes
    from (select *, row_number() over (order by (c).stamp, (c).transition_at, semap.place_in_moment(c, turn),
                                                (c).change_id) as place from logged) l
    group by query_id, subject_key, object_key
  )
  select query_id, subject_key, object_key, t.changes,
         semap.held_since(h.since, f.said, p_late_from), semap.held_since(h.since, t.said, p_late_from),
         semap.held_since(h.since, f.said, p_to + interval '1 us'),
         semap.held_since(h.since, t.said, p_to + interval '1 us')
  from differing
  left join semap.pairs_held_at(p_query_ids, p_track_ids, p_from) h using (query_id, subject_key, object_key)
  left join found f using (query_id, subject_key, object_key)
  left join told t using (query_id, subject_key, object_key)
$$;

-- Whether what the log tells of a pair from p_from on can be amended up to p_to: a replay and the log agree on whether
-- it held before the first late state and, but for a replay up to the present, on whether it holds after it; and
-- neither an edit of the map nor the form of the query is of that time.
create or replace function semap.is_sound(
  p_pair semap.compared_pair, p_from timestamptz, p_to timestamptz, p_is_present boolean
) returns boolean
language plpgsql stable as $$ -- which keeps its plan
begin
  return (p_pair.found_before is null) = (p_pair.told_before is null)
    and (p_is_present or (p_pair.found_since is null) = (p_pair.told_since is null))
    and not exists (
      select from (
        select (said).cause, (said).kind, lag((said).kind) over (order by place) as before_kind
        from unnest(p_pair.told) with ordinality t (uid, said, place)
        where (said).kind <> 'crossed' and (said).stamp <= p_to) k
      where cause = 'map' or kind = before_kind)
    and (semap.pair_valid_from(p_pair.query_id, p_pair.subject_key, p_pair.object_key) > p_from) is not true;
end $$;

-- In what the log of these pairs, between the first late state and p_to, differs from a replay (p_with): which of its
-- changes do not stand, which are missing, and which pairs hold since another moment than was known: after a replay up
-- to the present all of them, whether they hold or not.
create or replace function semap.pair_amendments(
  p_pairs semap.compared_pair[], p_with semap.pair_change[], p_late_from timestamptz, p_to timestamptz,
  p_is_present boolean, out gone uuid[], out missing semap.pair_change[], out held semap.relation_state[]
)
language plpgsql stable as $$ -- which keeps its plan
begin
  with pair as materialized (
    -- what held before the first late state holds since when the log says
    select *, case when found_since = found_before then told_before else found_since end as now_since
    from unnest(p_pairs)
  ), told as (
    select t.* from pair p cross join lateral unnest(p.told) t
    where (t.said).stamp >= p_late_from and (t.said).stamp <= p_to
  ), found as (
    select case when c.kind = 'ended' and c.since = p.found_before and p.found_before <> p.told_before
                then jsonb_populate_record(c.said, jsonb_build_object('since', least(p.told_before, c.transition_at)))
                else c.said end as said, c.place
    from (select w.*, w as said, row_number() over () as place from unnest(p_with) w) c
    join pair p using (query_id, subject_key, object_key)
    where c.stamp >= p_late_from and c.stamp <= p_to
  ), moment as (
    -- what happens at one moment is written together, so that it stands in the order in which it happened
    select distinct (said).query_id, (said).subject_key, (said).object_key, (said).transition_at from (
      (select said from told except select said from found)
        union all (select said from found except select said from told)) d
  ), tail as (
    -- it holds since another moment: so says its end, too, which came later
    select t.uid, jsonb_populate_record(t.said, jsonb_build_object('since', p.now_since)) as said
    from pair p
    cross join lateral (
      select uid, said from unnest(p.told)
      where (said).kind = 'ended' and (said).stamp > p_to order by (said).stamp limit 1) t
    where not p_is_present and p.found_since is not null and p.now_since <> p.told_since
  )
  select array(select uid from told
               where ((said).query_id, (said).subject_key, (said).object_key, (said).transition_at) in (table moment)
               union all select uid from tail),
         array(select said from found
               where ((said).query_id, (said).subject_key, (said).object_key, (said).transition_at) in (table moment)
               order by place) || array(select said from tail),
         array(select semap.relation_since(query_id, subject_key, object_key, now_since is not null, now_since)
               from pair where p_is_present or now_since <> told_since)
  into gone, missing, held;
end $$;

-- Hold pairs since when these say at p_to; after a replay up to the present (p_pairs: what pairs are at its end) they
-- are what that says otherwise.
create or replace function semap.hold_pairs(
  p_map_id integer, p_held semap.relation_state[], p_to timestamptz, p_is_present boolean,
  p_pairs semap.relation_state[]
) returns void
language plpgsql as $$
begin
  if p_is_present then
    delete from semap.relation p using unnest(p_held) h
    where (p.query_id, p.subject_key, p.object_key) = (h.query_id, h.subject_key, h.object_key);
    perform semap.keep_pairs(p_map_id, '{}', array(
      select jsonb_populate_record(p, jsonb_build_object('since', h.since))
      from unnest(p_pairs) p
      join unnest(p_held) h on (p.query_id, p.subject_key, p.object_key) = (h.query_id, h.subject_key, h.object_key)));
  else
    update semap.relation p set since = h.since
    from unnest(p_held) h
    where (p.query_id, p.subject_key, p.object_key) = (h.query_id, h.subject_key, h.object_key) and p.confirmed
      and p.since < p_to;
  end if;
end $$;

-- Write in what the log differs from a replay (p_with) of it from p_from on up to p_to, of the pairs in which that
-- replay differs from one without the late states (p_without), the first of which is of p_late_from, and which are
-- sound.
create or replace function semap.write_pair_amendments(
  p_map_id integer, p_query_ids integer[], p_track_ids bigint[], p_from timestamptz, p_late_from timestamptz,
  p_to timestamptz,
  p_is_present boolean, p_with semap.pair_change[], p_without semap.pair_change[],
  p_pairs semap.relation_state[], p_pairs_without semap.relation_state[]
) returns void
language plpgsql as $$
declare
  v_sound    constant semap.compared_pair[] := array(
    select c
    from semap.compared_pairs(p_map_id, p_query_ids, p_track_ids, p_from, p_late_from, p_to, p_with, p_without,
                              p_pairs, p_pairs_without) c
    where semap.is_sound(c, p_from, p_to, p_is_present));
  v_amended  record;
begin
  v_amended := semap.pair_amendments(v_sound, p_with, p_late_from, p_to, p_is_present);
  perform semap.retract_changes(v_amended.gone);
  perform semap.add_pair_changes(v_amended.missing);
  perform semap.hold_pairs(p_map_id, v_amended.held, p_to, p_is_present, p_pairs);
end $$;
