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

create or replace trigger source_speaks before update of watermark on semap.source
  for each row execute function semap.source_speaks();
