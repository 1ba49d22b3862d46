-- Debounce: what a relation is, given what it was and what is seen of it. It has three signals that may differ for a
-- while: `raw` is that of the boundary itself; `pending` changes only once it is seen deep enough inside (enters) or
-- far enough outside (leaves), and in between stays what it was; `confirmed` is the relation, and follows `pending`
-- once that has lasted.
--
--   seen                               raw      pending            confirmed
--   fresh (it appears, is edited)      as seen  as raw, since now  as raw
--   inside, not deep enough            true     stays              stays
--   enters, not pending                true     true, since now    true once it has lasted for enter_confirm
--   outside, not far enough            false    stays              stays
--   leaves, pending                    false    false, since now   false once it has lasted for leave_confirm
--   nothing but the time (all null)    stays    stays              as pending, once that has lasted

-- The state of a relation.
create or replace function semap.new_relation_state(
  query_id integer, subject_key bigint, object_key bigint, confirmed boolean, since timestamptz, pending boolean,
  pending_at timestamptz, raw boolean, raw_at timestamptz, x_m double precision default null,
  y_m double precision default null, distance_m double precision default null, distance_at timestamptz default null
) returns semap.relation_state
language sql immutable parallel safe as $$
  select row(query_id, subject_key, object_key, confirmed, since, pending, pending_at, raw, raw_at, x_m, y_m,
             distance_m, distance_at)::semap.relation_state
$$;

-- The state of a relation that is stored.
create or replace function semap.state_of_relation(p_relation semap.relation) returns semap.relation_state
language sql immutable parallel safe as $$
  select semap.new_relation_state(
    query_id => p_relation.query_id, subject_key => p_relation.subject_key, object_key => p_relation.object_key,
    confirmed => p_relation.confirmed, since => p_relation.since, pending => p_relation.pending,
    pending_at => p_relation.pending_at, raw => p_relation.raw, raw_at => p_relation.raw_at, x_m => p_relation.x_m,
    y_m => p_relation.y_m, distance_m => p_relation.distance_m, distance_at => p_relation.distance_at)
$$;

-- The state of a relation of which only is known whether it is confirmed, and since when.
create or replace function semap.relation_since(
  p_query_id integer, p_subject_key bigint, p_object_key bigint, p_confirmed boolean, p_since timestamptz
) returns semap.relation_state
language sql immutable parallel safe as $$
  select semap.new_relation_state(
    query_id => p_query_id, subject_key => p_subject_key, object_key => p_object_key, confirmed => p_confirmed,
    since => p_since, pending => p_confirmed, pending_at => p_since, raw => p_confirmed, raw_at => p_since)
$$;

-- What is seen of a relation when nothing is seen of it: the time.
create or replace function semap.time_passed(p_at timestamptz) returns semap.observation
language sql immutable parallel safe as $$
  select row(p_at, null, null, null, null, null, false, null)::semap.observation
$$;

-- When a relation that was confirmed, or ended, just now began or ended: where its boundary was crossed last, if that
-- was in the same direction; else where what is confirmed became pending.
create or replace function semap.transition_time(p_state semap.relation_state) returns timestamptz
language sql immutable parallel safe as $$
  select case when p_state.raw = p_state.confirmed then coalesce(p_state.raw_at, p_state.pending_at)
              else p_state.pending_at end
$$;

-- What a relation is after an observation, which is not before any that made its state. The place is that where the
-- boundary was crossed last; the distance is kept where one is observed.
create or replace function semap.debounce(
  p_state semap.relation_state, p_seen semap.observation, p_enter_confirm interval, p_leave_confirm interval
) returns semap.relation_state
language plpgsql immutable parallel safe as $$
begin
  if p_seen.is_fresh then
    p_state.since := case when not p_seen.raw then null when p_state.confirmed then p_state.since else p_seen.at end;
    p_state.raw := p_seen.raw;
    p_state.raw_at := p_seen.at;
    p_state.pending := p_seen.raw;
    p_state.pending_at := p_seen.at;
    p_state.confirmed := p_seen.raw;
  else
    if p_seen.raw <> p_state.raw then
      p_state.raw := p_seen.raw;
      p_state.raw_at := p_seen.at;
      p_state.x_m := p_seen.x_m;
      p_state.y_m := p_seen.y_m;
    end if;
    if p_seen.enters and not p_state.pending or p_seen.leaves and p_state.pending then
      p_state.pending := p_seen.enters;
      p_state.pending_at := p_seen.at;
    end if;
    if p_state.pending <> p_state.confirmed
       and p_seen.at >= p_state.pending_at + (case when p_state.pending then p_enter_confirm else p_leave_confirm end)
         then
      p_state.confirmed := p_state.pending;
      p_state.since := case when p_state.confirmed then semap.transition_time(p_state) end;
    end if;
  end if;
  if p_seen.is_fresh or p_state.distance_at is null or p_seen.distance_m is null or p_seen.at > p_state.distance_at then
    p_state.distance_m := p_seen.distance_m;
    p_state.distance_at := case when p_seen.distance_m is not null then p_seen.at end;
  end if;
  return p_state;
end $$;
