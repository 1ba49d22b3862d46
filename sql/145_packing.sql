-- States of past days in little room. A row of semap.track_state_packed holds up to 490 states of a track within one
-- half hour of the clock: arrays in the order of stamps, which PostgreSQL compresses. Each value comes back bit for bit.
-- A coordinate lies there in three parts, the highest bits by themselves, since only they are like those before; a stamp
-- is how far it is off an even pace. So many states that an array of theirs is one piece in the place where PostgreSQL
-- puts what is long: with more, pages are left half empty.
-- The view semap.stored_state (sql/304) has every state, be it packed or not.

-- The bits of a number.
create or replace function semap.bits_of(p_number double precision) returns bigint
language sql immutable strict parallel safe as $$
  select ('x' || encode(float8send(p_number), 'hex'))::bit(64)::bigint
$$;

-- The finite number that has these bits: sign, exponent and four bits of the fraction; sixteen more; 32 more.
create or replace function semap.number_of(p_high smallint, p_middle smallint, p_low integer) returns double precision
language sql immutable strict parallel safe as $$
  select (case when p_high < 0 then -1.0::double precision else 1 end)
         * ((case when p_high & 32752 = 0 then 0::double precision else 4503599627370496 end)
            + (p_high & 15)::double precision * 281474976710656
            + (p_middle::integer & 65535)::double precision * 4294967296
            + (p_low::bigint & 4294967295)::double precision)
         * power(2::double precision, greatest((p_high & 32752) >> 4, 1) - 1075)
$$;

-- Pack the states of the half hour that begins at a moment; says how many came as rows. What came late is put among the
-- states that are packed already; of two of one track at one stamp the one that was packed first is kept, as the key of
-- rows would have it. Writers go on meanwhile: what they add stays a row until the next time.
create or replace function semap.pack_states(p_slot timestamptz) returns bigint
language plpgsql security definer
set search_path = pg_catalog, pg_temp set plan_cache_mode = force_custom_plan as $$
declare
  v_states  bigint;
begin
  if p_slot is distinct from date_bin('30 min', p_slot, '1800-01-01Z') or p_slot >= semap.rows_since() is not false then
    raise exception 'The states from % on are not to be packed.', p_slot
      using errcode = 'invalid_parameter_value', hint = 'Say when: semap db retention --pack-states-after 7d';
  end if;
  with taken as (
    delete from semap.track_state where stamp >= p_slot and stamp < p_slot + interval '30 min' returning *
  ), opened as (
    delete from semap.track_state_packed
    where from_stamp >= p_slot and from_stamp < p_slot + interval '30 min'
      and track_id in (select track_id from taken)
    returning track_id, from_stamp
  ), stored as (
    select distinct on (track_id, stamp) * from (
      select 1 as age, * from taken
      union all
      select 0, s.track_id, s.stamp, s.x_m, s.y_m, s.z_m, s.std_m, s.is_last,
             s.heading_rad, s.speed_mps, s.length_m, s.width_m, s.std_across_m, s.std_yaw_rad
      from opened o join semap.packed_state s on s.track_id = o.track_id and s.from_stamp = o.from_stamp
    ) both_forms
    order by track_id, stamp, age
  ), numbered as (
    select *, semap.bits_of(x_m) as x_bits, semap.bits_of(y_m) as y_bits,
           (row_number() over (partition by track_id order by stamp) - 1) / 490 as part
    from stored
  ), placed as (
    select *, row_number() over one_row - 1 as place, count(*) over whole_row as states,
           min(stamp) over whole_row as from_stamp, max(stamp) over whole_row as to_stamp
    from numbered
    window one_row as (partition by track_id, part order by stamp), whole_row as (partition by track_id, part)
  ), timed as (
    select *, (extract(epoch from to_stamp - from_stamp) * 1000000)::integer as span_us,
           (extract(epoch from stamp - from_stamp) * 1000000)::integer as after_us
    from placed
  ), shifted as (
    select *, (after_us - place * span_us / greatest(states - 1, 1) + 32768)::integer as off from timed
  ), packed as (
    insert into semap.track_state_packed
    select track_id, from_stamp, to_stamp, states, span_us,
           array_agg((off >> 16)::smallint order by stamp),
           array_agg(((off << 16) >> 16)::smallint order by stamp),
           array_agg((x_bits >> 48)::smallint order by stamp),
           array_agg(((x_bits << 16) >> 48)::smallint order by stamp),
           array_agg(((x_bits << 32) >> 32)::integer order by stamp),
           array_agg((y_bits >> 48)::smallint order by stamp),
           array_agg(((y_bits << 16) >> 48)::smallint order by stamp),
           array_agg(((y_bits << 32) >> 32)::integer order by stamp),
           case when count(z_m) > 0 then array_agg(z_m order by stamp) end,
           case when count(std_m) > 0 then array_agg(std_m order by stamp) end,
           case when bool_or(is_last) then array_agg(is_last order by stamp) end,
           case when count(heading_rad) > 0 then array_agg(heading_rad order by stamp) end,
           case when count(speed_mps) > 0 then array_agg(speed_mps order by stamp) end,
           case when count(length_m) > 0 then array_agg(length_m order by stamp) end,
           case when count(width_m) > 0 then array_agg(width_m order by stamp) end,
           case when count(std_across_m) > 0 then array_agg(std_across_m order by stamp) end,
           case when count(std_yaw_rad) > 0 then array_agg(std_yaw_rad order by stamp) end
    from shifted group by track_id, part, from_stamp, to_stamp, states, span_us
  )
  select count(*) into v_states from taken;
  return v_states;
end $$;
