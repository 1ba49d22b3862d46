-- States of objects, such as a door that opened. Whoever writes one gives source, instance (by id or by name),
-- property, value and stamp; the rest follows. Its writers share the lock on regions with the writers of track
-- states, so that an exclusive one cuts both at one place.

-- The identity of an object's state: a function of what was seen, so that a replay gives the same one.
create or replace function semap.object_state_uid(
  p_map uuid, p_source text, p_instance uuid, p_property text, p_value text, p_stamp timestamptz
) returns uuid
language sql stable parallel safe
return md5(jsonb_build_array(p_map, p_source, p_instance, p_property, p_value,
                             (extract(epoch from p_stamp) * 1000000)::bigint)::text)::uuid;

create or replace trigger object_states_arrive before insert on semap.object_state
  for each statement execute function semap.keep_regions();

-- What an object was before a state, and since when, of all states that are there. Of several at one stamp the last in
-- the order of rules counts. Since when is searched for only where the state is another one: else its own row says it.
create or replace function semap.object_state_before(
  p_instance_id bigint, p_property text, p_stamp timestamptz, p_value text
) returns table (value text, since timestamptz)
language sql stable parallel safe rows 1 as $$
  select p.value,
         case when p.value = p_value then case when p.value = p.previous then p.since else p.stamp end
              else (select min(q.stamp) from semap.object_state q
                    where q.instance_id = p_instance_id and q.property = p_property and q.stamp <= p.stamp
                      and q.stamp > coalesce((
                        select r.stamp from semap.object_state r
                        where r.instance_id = p_instance_id and r.property = p_property and r.stamp < p.stamp
                          and r.value <> p.value
                        order by r.stamp desc limit 1), '-infinity')) end
  from semap.object_state p
  where p.instance_id = p_instance_id and p.property = p_property and p.stamp < p_stamp
  order by p.stamp desc, p.uid desc limit 1
$$;

-- Fill in what follows: identity, map, names, and the state before it as it is known now, with when that began.
create or replace function semap.object_state_arrives() returns trigger
language plpgsql as $$
declare
  v_source    record;
  v_instance  record;
begin
  perform semap.lock_source(new.source_id);
  select s.map_id, s.name, m.uid as map_uid, m.name as map_name into v_source
  from semap.source s join semap.map m using (map_id) where s.source_id = new.source_id;
  if not found then
    raise exception 'There is no source %.', new.source_id
      using errcode = 'no_data_found', hint = 'Insert the source into semap.source first.';
  end if;
  if new.instance_id is null then
    select instance_id, uid, name into v_instance
    from semap.instance where map_id = v_source.map_id and name = new.instance_name;
  else
    select instance_id, uid, name into v_instance
    from semap.instance where map_id = v_source.map_id and instance_id = new.instance_id;
  end if;
  if not found then
    raise exception 'There is no instance % on the map %.', coalesce(new.instance_id::text, new.instance_name),
      v_source.map_name
      using errcode = 'no_data_found', hint = 'List the instances of the map to see their names.';
  end if;
  new.map_id := v_source.map_id;
  new.instance_id := v_instance.instance_id;
  new.instance_name := v_instance.name;
  new.uid := semap.object_state_uid(v_source.map_uid, v_source.name, v_instance.uid, new.property, new.value,
                                    new.stamp);
  select b.value, b.since into new.previous, new.since
  from semap.object_state_before(new.instance_id, new.property, new.stamp, new.value) b;
  return new;
end $$;

create or replace trigger object_state_arrives before insert on semap.object_state
  for each row execute function semap.object_state_arrives();

-- Refuse a statement with states of several sources, since two of them could wait for one another, and count the
-- others.
create or replace function semap.object_states_arrived() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_first   integer;
  v_last    integer;
  v_states  bigint;
  v_newest  timestamptz;
begin
  select min(source_id), max(source_id), count(*), max(stamp) into v_first, v_last, v_states, v_newest from new_state;
  if v_first <> v_last then
    raise exception 'The states of one statement come from more than one source.'
      using errcode = 'cardinality_violation', hint = 'Insert or copy the states of each source by themselves.';
  end if;
  if v_states > 0 then
    perform semap.count_received(v_first, v_newest, p_object_states => v_states);
  end if;
  return null;
end $$;

create or replace trigger object_states_arrived after insert on semap.object_state
  referencing new table as new_state for each statement execute function semap.object_states_arrived();
