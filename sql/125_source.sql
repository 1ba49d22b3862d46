-- Say how late states of a source may come in one form of all intervals: hours, minutes and seconds.
create or replace function semap.source_lateness() returns trigger
language plpgsql as $$
begin
  new.lateness := make_interval(secs => extract(epoch from new.lateness)::double precision);
  return new;
end $$;

create or replace trigger source_lateness before insert or update of lateness on semap.source
  for each row execute function semap.source_lateness();

-- Up to where all states of a source have come: what its watermark says; of one that says none, all before its newest
-- stamp, and those at it where that is whole. Late ones may still come, unless it has ended.
create or replace function semap.complete_through(p_source semap.source) returns timestamptz
language sql stable parallel safe as $$
  select least(
    coalesce((p_source).watermark,
             (p_source).newest_stamp - case when (p_source).newest_is_whole or (p_source).ended then interval '0'
                                            else interval '1 us' end, '-infinity')
      - case when (p_source).ended then interval '0' else (p_source).lateness end,
    (p_source).late_from - interval '1 us')
$$;

-- A source that speaks has not ended, unless the same statement says that it has, and is not idle.
create or replace function semap.source_speaks() returns trigger
language plpgsql as $$
begin
  if (new.watermark, new.newest_stamp) is distinct from (old.watermark, old.newest_stamp) then
    new.ended := new.ended and not old.ended;
    new.idle := false;
  end if;
  return new;
end $$;

-- Note the newest stamp of a source that says no watermark. p_is_whole: all of its states at that stamp are there.
create or replace function semap.note_newest(p_source_id integer, p_stamp timestamptz, p_is_whole boolean default false)
returns void
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  update semap.source
  set newest_stamp = p_stamp, newest_is_whole = p_is_whole
  where source_id = p_source_id and watermark is null
    and (newest_stamp is null or newest_stamp < p_stamp or newest_stamp = p_stamp and p_is_whole
         and not newest_is_whole);
end $$;

-- Take the newest stamps of sources that say no watermark, and have been silent for so long, for whole. What follows
-- from it shares the regions (sql/147), which come before rows: while somebody edits, nothing is done.
create or replace function semap.complete_silent_sources(p_silent interval default '1 s') returns void
language sql security definer set search_path = public, pg_temp as $$
  update semap.source s set newest_is_whole = true
  from semap.source_count c
  where c.source_id = s.source_id and c.received_at < clock_timestamp() - p_silent
    and s.watermark is null and s.newest_stamp is not null and not s.newest_is_whole
    and s.source_id in (select source_id from semap.source
                        where watermark is null and not newest_is_whole and pg_try_advisory_xact_lock_shared(7363, 0)
                        for no key update skip locked)
$$;

-- Count what a source has brought in, up to a stamp, within the transaction that brings it and holds the source.
create or replace function semap.count_received(
  p_source_id integer, p_newest timestamptz, p_track_states bigint default 0, p_lines bigint default 0,
  p_object_states bigint default 0
) returns void
language plpgsql as $$  -- which keeps its plan
begin
  update semap.source_count c
  set track_states = c.track_states + p_track_states, lines = c.lines + p_lines,
      object_states = c.object_states + p_object_states, received_at = clock_timestamp()
  where source_id = p_source_id;
  if not found then
    insert into semap.source_count (source_id, track_states, lines, object_states)
    values (p_source_id, p_track_states, p_lines, p_object_states);
  end if;
  perform semap.note_newest(p_source_id, p_newest);
end $$;

create or replace trigger source_speaks before update of watermark, newest_stamp on semap.source
  for each row execute function semap.source_speaks();
