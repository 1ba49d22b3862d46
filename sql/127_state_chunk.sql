-- How states come, are stored, and are read. A row of semap.state_chunk holds states within one half hour of the
-- clock, as arrays: of many tracks at one stamp, which is how a track batch comes, or of one track, which is how they
-- lie once they are compacted (sql/145). An array that is null is null throughout. Readers call semap.states, or
-- semap.states_around for so many states beside a stamp: no other function knows how states are packed, or that they
-- are. No other file of SQL names all columns of a state, but the one that writes where tracks are (sql/134).

-- The half hour of the clock in which a stamp lies.
create or replace function semap.half_hour(p_stamp timestamptz) returns timestamptz
language sql immutable strict parallel safe
return case when isfinite(p_stamp) then date_bin('30 min', p_stamp, '1800-01-01Z') else p_stamp end;

-- The length of an interval of less than a day [us].
create or replace function semap.micros(p_interval interval) returns bigint
language sql immutable strict parallel safe
return round(date_part('epoch', p_interval) * 1e6)::bigint;

-- The states of a chunk, as rows.
create or replace function semap.states_of(p_chunk semap.state_chunk) returns setof semap.track_state
language sql immutable parallel safe rows 500 as $$
  select coalesce((p_chunk).track_id, s.track_id),
         case when (p_chunk).track_id is null then (p_chunk).from_stamp else (p_chunk).from_stamp + interval '1 us' * (
           coalesce(s.offset_us, 0)
           + (s.place - 1) * semap.micros((p_chunk).to_stamp - (p_chunk).from_stamp)
             / greatest((p_chunk).states - 1, 1)) end,
         s.x_m, s.y_m, s.z_m, s.std_m, coalesce(s.is_last, false), s.heading_rad, s.speed_mps, s.length_m, s.width_m,
         s.std_across_m, s.std_yaw_rad
  from unnest((p_chunk).track_ids, (p_chunk).offsets_us, (p_chunk).x_m, (p_chunk).y_m, (p_chunk).z_m, (p_chunk).std_m,
              (p_chunk).is_last, (p_chunk).heading_rad, (p_chunk).speed_mps, (p_chunk).length_m, (p_chunk).width_m,
              (p_chunk).std_across_m, (p_chunk).std_yaw_rad) with ordinality
    s (track_id, offset_us, x_m, y_m, z_m, std_m, is_last, heading_rad, speed_mps, length_m, width_m, std_across_m,
       std_yaw_rad, place)
$$;

-- The states of chunks, as rows.
create or replace function semap.states_in(p_chunks semap.state_chunk[]) returns setof semap.track_state
language sql immutable parallel safe rows 1000 as $$
  select s.* from unnest(p_chunks) c cross join lateral semap.states_of(c) s
$$;

-- How far these stamps are off an even pace from the first to the last of them [us]; null: not at all.
create or replace function semap.offsets_us(p_stamps timestamptz[]) returns integer[]
language sql immutable strict parallel safe as $$
  select case when bool_or(offset_us <> 0) then array_agg(offset_us order by place) end
  from (select min(stamp) as from_stamp, semap.micros(max(stamp) - min(stamp)) as span_us from unnest(p_stamps) stamp) w
  cross join lateral (
    select place, (semap.micros(stamp - w.from_stamp)
                   - (place - 1) * w.span_us / greatest(cardinality(p_stamps) - 1, 1))::integer as offset_us
    from unnest(p_stamps) with ordinality u (stamp, place)) o
$$;

-- A state of which little is known.
create or replace function semap.new_state(
  track_id bigint, stamp timestamptz, x_m double precision default null, y_m double precision default null,
  is_last boolean default false
) returns semap.track_state
language plpgsql immutable parallel safe as $$
declare
  v_state  semap.track_state;
begin
  v_state.track_id := track_id;
  v_state.stamp := stamp;
  v_state.x_m := x_m;
  v_state.y_m := y_m;
  v_state.is_last := is_last;
  return v_state;
end $$;

-- A state as the last one of its track.
create or replace function semap.as_last(p_state semap.track_state) returns semap.track_state
language plpgsql immutable parallel safe as $$
begin
  p_state.is_last := true;
  return p_state;
end $$;

-- A chunk of states, of what is known of them.
create or replace function semap.new_chunk(
  source_id integer, from_stamp timestamptz, to_stamp timestamptz, x_m double precision[], y_m double precision[],
  z_m double precision[], std_m real[], is_last boolean[], heading_rad real[], speed_mps real[], length_m real[],
  width_m real[], std_across_m real[], std_yaw_rad real[], track_ids bigint[] default null,
  track_id bigint default null, offsets_us integer[] default null
) returns semap.state_chunk
language sql immutable parallel safe as $$
  select row(source_id, track_id, from_stamp, to_stamp, cardinality(x_m), track_ids, offsets_us, x_m, y_m, z_m, std_m,
             is_last, heading_rad, speed_mps, length_m, width_m, std_across_m, std_yaw_rad)::semap.state_chunk
$$;

-- A column of a chunk as a row of a matrix, from 1 on. What is null is there what no state has, since an element is
-- found by its place only where none is null: NaN, and of standard deviations 0.1, which no real is.
create or replace function semap.as_row(p_column anyarray, p_states integer, p_null anyelement) returns anyarray
language sql immutable parallel safe as $$
  select case when p_column is null then array_fill(p_null, array[p_states])
              when array_ndims(p_column) > 1 then array(select coalesce(each, p_null) from unnest(p_column) each)
              when array_position(p_column, null) is null then p_column[:]
              else (array_replace(p_column, null, p_null))[:] end
$$;

-- Arrays, one behind the other.
create or replace aggregate semap.concatenated(anycompatiblearray) (
  sfunc = array_cat, stype = anycompatiblearray, parallel = safe
);

-- The states of these chunks of one half hour, and of so few stamps that an array of them is one piece of TOAST, as
-- chunks of one track each. Chunks of the same tracks are rows of a matrix, of which a track is a column.
create or replace function semap.chunks_of_tracks(p_chunks semap.state_chunk[]) returns setof semap.state_chunk
language sql immutable parallel safe rows 1000 as $$
  with has as (
    select count(z_m) > 0 as z_m, count(std_m) > 0 as std_m, count(is_last) > 0 as is_last,
           count(heading_rad) > 0 as heading_rad, count(speed_mps) > 0 as speed_mps, count(length_m) > 0 as length_m,
           count(width_m) > 0 as width_m, count(std_across_m) > 0 as std_across_m, count(std_yaw_rad) > 0 as std_yaw_rad
    from unnest(p_chunks)
  ), matrix as materialized (
    select row_number() over () as number, i.track_ids, array_agg(c.from_stamp) as stamps,
           array_agg(semap.as_row(c.x_m, c.states, 'NaN')) as x_m,
           array_agg(semap.as_row(c.y_m, c.states, 'NaN')) as y_m,
           array_agg(semap.as_row(c.z_m, c.states, 'NaN')) filter (where has.z_m) as z_m,
           array_agg(semap.as_row(c.std_m::double precision[], c.states, '0.1')) filter (where has.std_m) as std_m,
           array_agg(semap.as_row(c.is_last, c.states, false)) filter (where has.is_last) as is_last,
           array_agg(semap.as_row(c.heading_rad, c.states, 'NaN')) filter (where has.heading_rad) as heading_rad,
           array_agg(semap.as_row(c.speed_mps, c.states, 'NaN')) filter (where has.speed_mps) as speed_mps,
           array_agg(semap.as_row(c.length_m, c.states, 'NaN')) filter (where has.length_m) as length_m,
           array_agg(semap.as_row(c.width_m, c.states, 'NaN')) filter (where has.width_m) as width_m,
           array_agg(semap.as_row(c.std_across_m, c.states, 'NaN')) filter (where has.std_across_m) as std_across_m,
           array_agg(semap.as_row(c.std_yaw_rad, c.states, 'NaN')) filter (where has.std_yaw_rad) as std_yaw_rad
    from has cross join unnest(p_chunks) c
    cross join lateral (select semap.as_row(c.track_ids, c.states, 0::bigint) as track_ids) i group by i.track_ids
  ), by_track as (
    select track_ids[i] as track_id, array_agg(number) as numbers,
           semap.concatenated(x_m[:][i:i]) as x_m, semap.concatenated(y_m[:][i:i]) as y_m,
           array_replace(semap.concatenated(z_m[:][i:i]), 'NaN', null) as z_m,
           array_replace(semap.concatenated(std_m[:][i:i]), '0.1', null)::real[] as std_m,
           semap.concatenated(is_last[:][i:i]) as is_last,
           array_replace(semap.concatenated(heading_rad[:][i:i]), 'NaN', null) as heading_rad,
           array_replace(semap.concatenated(speed_mps[:][i:i]), 'NaN', null) as speed_mps,
           array_replace(semap.concatenated(length_m[:][i:i]), 'NaN', null) as length_m,
           array_replace(semap.concatenated(width_m[:][i:i]), 'NaN', null) as width_m,
           array_replace(semap.concatenated(std_across_m[:][i:i]), 'NaN', null) as std_across_m,
           array_replace(semap.concatenated(std_yaw_rad[:][i:i]), 'NaN', null) as std_yaw_rad
    from matrix cross join generate_subscripts(track_ids, 1) i group by track_ids[i]
  ), paced as materialized ( -- most tracks have the same stamps
    select d.numbers, semap.offsets_us(s.stamps) as offsets_us, (select min(t) from unnest(s.stamps) t) as from_stamp,
           (select max(t) from unnest(s.stamps) t) as to_stamp
    from (select distinct numbers from by_track) d cross join lateral (
      select semap.concatenated(m.stamps order by n.place) as stamps
      from unnest(d.numbers) with ordinality n (number, place) join matrix m using (number)) s
  )
  select c.*
  from by_track t join paced p using (numbers)
  cross join lateral semap.new_chunk(
    source_id => p_chunks[1].source_id, track_id => track_id, from_stamp => from_stamp, to_stamp => to_stamp,
    offsets_us => offsets_us, x_m => x_m, y_m => y_m, z_m => z_m, std_m => std_m, is_last => is_last,
    heading_rad => heading_rad, speed_mps => speed_mps, length_m => length_m, width_m => width_m,
    std_across_m => std_across_m, std_yaw_rad => std_yaw_rad) c
$$;

-- The states of these tracks from one stamp to another, both included, in no order; nothing of a track that the caller
-- may not see.
create or replace function semap.states(p_track_ids bigint[], p_from timestamptz, p_to timestamptz)
returns setof semap.track_state
language plpgsql stable parallel safe security definer rows 1000 set search_path = pg_catalog, pg_temp as $$
declare
  v_visible     constant integer[] := semap.visible_maps();
  v_ids         bigint[];
  v_source_ids  integer[];
  v_from        timestamptz;
begin
  select array_agg(track_id), array_agg(distinct source_id), greatest(p_from, min(first_stamp))
  into v_ids, v_source_ids, v_from
  from semap.track_now
  where track_id = any (p_track_ids) and first_stamp <= p_to and (v_visible is null or map_id = any (v_visible));
  if v_ids is null or v_from > p_to then
    return;
  end if;
  return query
    select s.* from semap.state_chunk c cross join lateral semap.states_of(c) s
    where c.track_id = any (v_ids) and c.from_stamp >= semap.half_hour(v_from) and c.from_stamp <= p_to
      and c.to_stamp >= v_from and s.stamp >= v_from and s.stamp <= p_to
    union all
    select s.*
    from semap.state_chunk c cross join lateral semap.states_of(c) s join unnest(v_ids) id on s.track_id = id
    where c.track_id is null and c.source_id = any (v_source_ids) and c.from_stamp >= v_from and c.from_stamp <= p_to;
end $$;

-- The states of all tracks of a map from one stamp to another, both included, in no order.
create or replace function semap.states_of_map(p_map_id integer, p_from timestamptz, p_to timestamptz)
returns setof semap.track_state
language sql stable parallel safe security definer rows 10000 set search_path = pg_catalog, pg_temp as $$
  select s.*
  from (select array_agg(t.track_id) as ids from semap.track_now t left join semap.source_count c using (source_id)
        where t.map_id = p_map_id and t.first_stamp <= p_to
          and greatest(t.stamp, t.outlier_stamp, case when t.live then c.newest_stamp end) >= p_from) k
  cross join lateral semap.states(k.ids, p_from, p_to) s
$$;

-- So many states of a track before a stamp, the newest of them, and so many from it on, the oldest, within two other
-- stamps, both included; nothing of a track that the caller may not see. No more chunks are opened than that takes.
create or replace function semap.states_around(
  p_track_id bigint, p_stamp timestamptz, p_before integer, p_from integer,
  p_until timestamptz default 'infinity', p_since timestamptz default '-infinity'
) returns setof semap.track_state
language plpgsql stable parallel safe security definer set search_path = pg_catalog, pg_temp as $$
declare
  v_source_id  integer;
  v_since      timestamptz;
  v_until      timestamptz := p_until;
begin
  select source_id, greatest(p_since, first_stamp) into v_source_id, v_since
  from semap.track_now where track_id = p_track_id and first_stamp <= p_until;
  if v_source_id is null then
    return;
  end if;
  if p_before > 0 then
    -- of a chunk that reaches beyond the stamp, only the first state is known to be before it
    select coalesce(max(from_stamp), v_since) into v_since from (
      select from_stamp, sum(states) over (order by from_stamp desc) as total from (
        (select c.from_stamp, case when c.to_stamp < p_stamp then c.states else 1 end as states from semap.state_chunk c
         where c.track_id = p_track_id and c.from_stamp < p_stamp and c.from_stamp >= semap.half_hour(v_since)
         order by c.from_stamp desc limit p_before)
        union all
        (select c.from_stamp, 1 from semap.state_chunk c
         where c.track_id is null and c.source_id = v_source_id and c.from_stamp < p_stamp and c.from_stamp >= v_since
           and p_track_id = any (c.track_ids)
         order by c.from_stamp desc limit p_before)) c) counted
    where total >= p_before and from_stamp >= v_since;
    return query
      select * from semap.states(array[p_track_id], v_since, least(p_until, p_stamp)) s
      where s.stamp < p_stamp order by s.stamp desc limit p_before;
  end if;
  if p_from > 0 then
    select coalesce(min(to_stamp), p_until) into v_until from (
      select to_stamp, sum(states) over (order by to_stamp) as total from (
        (select c.to_stamp, case when c.from_stamp >= p_stamp then c.states else 1 end as states
         from semap.state_chunk c
         where c.track_id = p_track_id and c.to_stamp >= p_stamp and c.from_stamp >= semap.half_hour(p_stamp)
           and c.from_stamp <= p_until
         order by c.from_stamp limit p_from)
        union all
        (select c.to_stamp, 1 from semap.state_chunk c
         where c.track_id is null and c.source_id = v_source_id and c.from_stamp >= p_stamp and c.from_stamp <= p_until
           and p_track_id = any (c.track_ids)
         order by c.from_stamp limit p_from)) c) counted
    where total >= p_from and to_stamp <= p_until;
    return query
      select * from semap.states(array[p_track_id], greatest(p_since, p_stamp), v_until) s
      order by s.stamp limit p_from;
  end if;
end $$;

-- The newest state of each of these tracks at or before a stamp. Most have one shortly before it, so these are read at
-- once.
create or replace function semap.states_at(p_track_ids bigint[], p_at timestamptz) returns setof semap.track_state
language plpgsql stable parallel safe rows 100 as $$
declare
  c_shortly  constant interval := '2 s';
  v_found    semap.track_state[];
begin
  v_found := array(
    select distinct on (s.track_id) s from semap.states(p_track_ids, p_at - c_shortly, p_at) s
    order by s.track_id, s.stamp desc);
  return query select f.* from unnest(v_found) f;
  return query
    select b.*
    from unnest(p_track_ids) id left join unnest(v_found) f on f.track_id = id
    cross join lateral semap.states_around(id, p_at + interval '1 us', 1, 0) b
    where f.track_id is null;
end $$;

-- Every state that is stored.
create or replace view semap.stored_state as
  select s.* from semap.state_chunk c cross join lateral semap.states_of(c) s;

-- Take what one source says of many tracks at one stamp: a value for each of these tracks, or null in place of an array
-- of which nothing is known. All that the source has to say of that stamp is in it.
create or replace function semap.add_states(
  source_id integer, stamp timestamptz, track_ids bigint[], x_m double precision[], y_m double precision[],
  z_m double precision[] default null, std_m real[] default null, is_last boolean[] default null,
  heading_rad real[] default null, speed_mps real[] default null, length_m real[] default null,
  width_m real[] default null, std_across_m real[] default null, std_yaw_rad real[] default null
) returns void
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_chunk  constant semap.state_chunk := semap.new_chunk(
    source_id => source_id, from_stamp => stamp, to_stamp => stamp, track_ids => track_ids, x_m => x_m, y_m => y_m,
    z_m => z_m, std_m => std_m, is_last => is_last, heading_rad => heading_rad, speed_mps => speed_mps,
    length_m => length_m, width_m => width_m, std_across_m => std_across_m, std_yaw_rad => std_yaw_rad);
begin
  if not exists (select from semap.source s where s.source_id = add_states.source_id) then
    raise exception 'There is no source %.', source_id
      using errcode = 'foreign_key_violation', hint = 'Insert the source into semap.source first.';
  elsif num_nulls(stamp, track_ids, x_m, y_m) > 0 then
    raise exception 'A batch of states needs a stamp, track_ids, x_m and y_m.'
      using errcode = 'not_null_violation', hint = 'Give these; of all else null may be said.';
  elsif v_chunk.states <> cardinality(track_ids) or v_chunk.states <> any (array[
       cardinality(y_m), cardinality(z_m), cardinality(std_m), cardinality(is_last), cardinality(heading_rad),
       cardinality(speed_mps), cardinality(length_m), cardinality(width_m), cardinality(std_across_m),
       cardinality(std_yaw_rad)]) then
    raise exception 'The arrays of a batch of states differ in length.'
      using errcode = 'array_subscript_error',
            hint = 'Give each a value for each of track_ids, or null in place of the array.';
  elsif v_chunk.states = 0 then
    return;
  end if;
  -- what no state may say is refused by the constraints of rows, which would be parsed anew for each batch
  if (stamp between '1800-01-01Z' and '9999-01-01Z' and array_position(track_ids, null) is null
      and -1e7 <= all (x_m) and 1e7 >= all (x_m) and -1e7 <= all (y_m) and 1e7 >= all (y_m)
      and coalesce(-1e7 <= all (z_m) and 1e7 >= all (z_m), true)
      and coalesce(-7 <= all (heading_rad) and 7 >= all (heading_rad), true)
      and coalesce(0 <= all (speed_mps) and 1e4 >= all (speed_mps), true)
      and coalesce(0 < all (length_m) and 1e4 >= all (length_m), true)
      and coalesce(0 < all (width_m) and 1e4 >= all (width_m), true)
      and (std_across_m is null and std_yaw_rad is null or not exists (
        select from semap.states_of(v_chunk) s
        where case when s.std_across_m is null then s.std_yaw_rad is null
                   else s.std_across_m between 0 and s.std_m and s.std_m < 1e15 and abs(s.std_yaw_rad) <= 7
                   end is not true))) is not true then
    insert into semap.track_state select * from semap.states_of(v_chunk);
    perform semap.note_newest(source_id, stamp, true);
    return;
  end if;
  perform semap.take_states(source_id, array[v_chunk], true);
end $$;

-- Rows of states become chunks of one stamp each, or of one track each where there are more stamps than tracks.
create or replace function semap.track_state_inserted() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_source_id  integer;
  v_chunks     semap.state_chunk[];
begin
  select source_id into v_source_id
  from (select track_id from new_state limit 1) n join semap.track_now using (track_id);
  if v_source_id is null then
    perform semap.refuse_unknown(track_id) from new_state limit 1;
  end if;
  select array_agg(c) into v_chunks from (
    select semap.new_chunk(
      source_id => v_source_id, from_stamp => stamp, to_stamp => stamp, track_ids => array_agg(track_id),
      x_m => array_agg(x_m), y_m => array_agg(y_m), z_m => case when count(z_m) > 0 then array_agg(z_m) end,
      std_m => case when count(std_m) > 0 then array_agg(std_m) end,
      is_last => case when bool_or(is_last) then array_agg(is_last) end,
      heading_rad => case when count(heading_rad) > 0 then array_agg(heading_rad) end,
      speed_mps => case when count(speed_mps) > 0 then array_agg(speed_mps) end,
      length_m => case when count(length_m) > 0 then array_agg(length_m) end,
      width_m => case when count(width_m) > 0 then array_agg(width_m) end,
      std_across_m => case when count(std_across_m) > 0 then array_agg(std_across_m) end,
      std_yaw_rad => case when count(std_yaw_rad) > 0 then array_agg(std_yaw_rad) end) as c
    from new_state group by stamp) chunk;
  if cardinality(v_chunks) > 1 and cardinality(v_chunks) > (select count(distinct track_id) from new_state) then
    v_chunks := array(
      select c
      from (select array_agg(c order by from_stamp) as chunks from (
              select c, from_stamp, half_hour,
                     (row_number() over (partition by half_hour order by from_stamp) - 1) / 240 as part
              from unnest(v_chunks) c cross join lateral semap.half_hour(c.from_stamp) half_hour) n
            group by half_hour, part) g
      cross join lateral semap.chunks_of_tracks(g.chunks) c);
  end if;
  if v_chunks is not null then
    perform semap.take_states(v_source_id, v_chunks, false);
  end if;
  return null;
end $$;

create or replace trigger track_state_inserted after insert on semap.track_state
  referencing new table as new_state for each statement execute function semap.track_state_inserted();
