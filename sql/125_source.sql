-- Say how late states of a source may come in one form of all intervals: hours, minutes and seconds.
create or replace function semap.source_lateness() returns trigger
language plpgsql as $$
begin
  new.lateness := make_interval(secs => extract(epoch from new.lateness)::double precision);
  return new;
end $$;
comment on function semap.source_lateness is
  'Say how late states of a source may come in one form of all intervals: hours, minutes and seconds.';

create or replace trigger source_lateness before insert or update of lateness on semap.source
  for each row execute function semap.source_lateness();

-- A source whose watermark moves has not ended, unless the same statement says that it has.
create or replace function semap.source_speaks() returns trigger
language plpgsql as $$
begin
  if new.watermark > old.watermark and new.ended and old.ended then
    new.ended := false;
  end if;
  return new;
end $$;
comment on function semap.source_speaks is
  'A source whose watermark moves has not ended, unless the same statement says that it has.';

-- Count what a source has brought in, within the transaction that brings it and holds the source.
create or replace function semap.count_received(
  p_source_id integer, p_track_states bigint default 0, p_lines bigint default 0, p_object_states bigint default 0
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
end $$;
comment on function semap.count_received is
  'Count what a source has brought in, within the transaction that brings it and holds the source.';

create or replace trigger source_speaks before update of watermark on semap.source
  for each row execute function semap.source_speaks();
