create schema row_trigger;

create table row_trigger.fence (fence_id integer primary key, area geometry(Polygon) not null);

-- Room on each page lets an update stay on its own, and touch no index.
create table row_trigger.track_current (
  track_id   bigint primary key,
  stamp      timestamptz not null,
  position   geometry(Point) not null,
  fence_ids  integer[] not null
) with (fillfactor = 50);

create table row_trigger.track_position (
  track_id  bigint not null,
  stamp     timestamptz not null,
  x_m       float8 not null,
  y_m       float8 not null,
  z_m       float8,
  std_m     real,
  is_last   boolean not null
);

create table row_trigger.fence_event (
  event_id  bigint generated always as identity primary key,
  track_id  bigint not null,
  fence_id  integer not null,
  kind      text not null,
  stamp     timestamptz not null
);

-- A new position moves its track: the fences that it has entered and left become events, of which listeners are told.
create function row_trigger.position_inserted() returns trigger language plpgsql as $$
declare
  v_position  geometry := ST_MakePoint(new.x_m, new.y_m);
  v_before    integer[];
  v_now       integer[];
  v_event     row_trigger.fence_event;
begin
  v_now := array(select fence_id from row_trigger.fence where ST_Contains(area, v_position) order by fence_id);

  select fence_ids into v_before from row_trigger.track_current where track_id = new.track_id for update;
  if not found then
    v_before := '{}';
    insert into row_trigger.track_current values (new.track_id, new.stamp, v_position, v_now);
  else
    update row_trigger.track_current set stamp = new.stamp, position = v_position, fence_ids = v_now
    where track_id = new.track_id and stamp < new.stamp;
    if not found then
      return null;
    end if;
  end if;

  if v_now <> v_before then
    for v_event in
      insert into row_trigger.fence_event (track_id, fence_id, kind, stamp)
      select new.track_id, fence_id, 'enter', new.stamp from unnest(v_now) fence_id
      where fence_id <> all (v_before)
      union all
      select new.track_id, fence_id, 'exit', new.stamp from unnest(v_before) fence_id
      where fence_id <> all (v_now)
      returning *
    loop
      perform pg_notify('fence_event', row_to_json(v_event)::text);
    end loop;
  end if;
  return null;
end $$;

create trigger position_inserted after insert on row_trigger.track_position
  for each row execute function row_trigger.position_inserted();
