-- Number events within their maps, in the order of the log and without gaps: what a reader of one map is told. Events
-- are written by one transaction at a time, so that whoever has seen number n of a map has seen all before it.
create or replace function semap.event_inserted() returns trigger
language plpgsql as $$
begin
  with counted as (
    insert into semap.event_count as c (map_id, newest)
    select map_id, count(*) from made group by map_id
    on conflict (map_id) do update set newest = c.newest + excluded.newest
    returning map_id, newest)
  insert into semap.event_number (event_id, map_id, number)
  select m.event_id, m.map_id, c.newest + 1 - row_number() over (partition by m.map_id order by m.seq desc)
  from made m join counted c using (map_id);
  return null;
end $$;

create or replace trigger event_inserted after insert on semap.event
referencing new table as made for each statement execute function semap.event_inserted();
