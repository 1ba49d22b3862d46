-- Shards: the ids that each gives, and the places of maps, which are kept with the maps that are here.

-- The shard that this database is.
create or replace function semap.own_shard() returns semap.shard
language sql stable set search_path = pg_catalog, pg_temp as $$
  select s from semap.shard s where dsn is null
$$;

-- Make this database, which has no map yet, a shard of a directory. Its ids are from then on of a range of its own, so
-- that those of two shards differ, and a map can take its ids along: 2^25 where they are integers, 2^47 where they are
-- longer (less than 2^53 in all, which every reader of JSON has).
create or replace function semap.become_shard(p_shard_id integer, p_name text) returns void
language plpgsql set search_path = pg_catalog, pg_temp as $$
declare
  v_own       semap.shard := semap.own_shard();
  v_sequence  record;
  v_width     bigint;
begin
  if (v_own.shard_id, v_own.name) = (p_shard_id, p_name) then
    return;
  elsif v_own.shard_id <> 0 or exists (select from semap.shard where dsn is not null) then
    raise exception 'This database is a shard or a directory already.'
      using errcode = 'unique_violation', hint = 'Give a database of its own.';
  elsif exists (select from semap.map) then
    raise exception 'This database has maps, whose ids may be those of others.'
      using errcode = 'unique_violation', hint = 'Give an empty database, and import the maps into it.';
  end if;
  update semap.shard set shard_id = p_shard_id, name = p_name where dsn is null;
  for v_sequence in
    select sequencename, data_type::text from pg_sequences
    where schemaname = 'semap' and sequencename <> 'map_map_id_seq'
  loop
    v_width := case v_sequence.data_type when 'bigint' then 1::bigint << 47 else 1 << 25 end;
    execute format('alter sequence semap.%I minvalue %s maxvalue %s start %s restart', v_sequence.sequencename,
                   greatest(p_shard_id * v_width, 1), (p_shard_id + 1) * v_width - 1, p_shard_id * v_width);
  end loop;
end $$;

-- Give a new map its place: on a directory that of its name if it is here, else a new one; on a shard only one that the
-- directory has given.
create or replace function semap.map_placed() returns trigger
language plpgsql security definer set search_path = pg_catalog, pg_temp as $$
declare
  v_own    semap.shard := semap.own_shard();
  v_place  semap.place;
begin
  select * into v_place from semap.place where name = new.name for key share;
  if v_place.shard_id = v_own.shard_id then
    new.map_id := v_place.map_id;
  elsif found then
    raise exception 'The map % is on another shard.', new.name
      using errcode = 'unique_violation', hint = 'Ask there: semap shard list tells the shards.';
  elsif v_own.shard_id <> 0 then
    raise exception 'This database is the shard %, whose maps the directory places.', v_own.name
      using errcode = 'check_violation',
            hint = format('Tell the directory: semap map place %s --shard %s', new.name, v_own.name);
  else
    insert into semap.place (map_id, name, shard_id) values (new.map_id, new.name, 0);
  end if;
  return new;
end $$;

create or replace trigger map_placed before insert on semap.map
for each row execute function semap.map_placed();

-- Let the place of a map go, or be renamed, with it.
create or replace function semap.map_moved() returns trigger
language plpgsql security definer set search_path = pg_catalog, pg_temp as $$
begin
  if tg_op = 'DELETE' then
    delete from semap.place where map_id = old.map_id;
  elsif (semap.own_shard()).shard_id <> 0 then
    raise exception 'A map of a shard keeps the name that the directory knows.' using errcode = 'check_violation';
  else
    update semap.place set name = new.name where map_id = new.map_id;
  end if;
  return null;
end $$;

create or replace trigger map_moved after delete or update of name on semap.map
for each row execute function semap.map_moved();

-- Let a place whose map was not made go to another shard: on a shard, away.
create or replace function semap.leave_place(p_map_id integer, p_to integer) returns void
language plpgsql security definer set search_path = pg_catalog, pg_temp as $$
declare
  v_own  semap.shard := semap.own_shard();
begin
  perform from semap.place where map_id = p_map_id for update;
  if exists (select from semap.map where map_id = p_map_id) then
    raise exception 'The map % has been made on the shard %, and does not move yet.',
      (select name from semap.map where map_id = p_map_id), v_own.name
      using errcode = 'unique_violation',
            hint = 'Export it, delete it, place it, and import it there: its tracks and events do not come along.';
  elsif v_own.shard_id = 0 then
    update semap.place set shard_id = p_to where map_id = p_map_id;
  else
    delete from semap.place where map_id = p_map_id;
  end if;
end $$;

-- Forget a map that is on another shard: its place, and the events that were gathered of it.
create or replace function semap.forget_place(p_map_id integer) returns void
language plpgsql security definer set search_path = pg_catalog, pg_temp as $$
begin
  delete from semap.place where map_id = p_map_id;
  perform semap.forget_maps('rules', array[p_map_id]);
end $$;
