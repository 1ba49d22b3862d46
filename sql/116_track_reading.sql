-- Whose states are whose, once trackers have told what they had mistaken (semap.track_amendment). States stay with the
-- track that they were stored of, and most queries take them so. For one that follows amendments a track is all that
-- was seen of one person: its *reading*, stretches of states of several tracks (semap.track_reading). The live path
-- leaves amended tracks out for such a query; their readings are followed instead, as late states are (sql/149).

-- Whose the states of a track at a stamp are. From the youngest amendment of it back: what was switched goes on as the
-- other track was before, and what was merged is the other one at that stamp. So it does not matter in what order
-- amendments are found.
create or replace function semap.amended_track(p_track_id bigint, p_stamp timestamptz) returns bigint
language plpgsql stable as $$
declare
  v_track_id   bigint := p_track_id;
  v_stamp      timestamptz := p_stamp;
  v_id         bigint := 9223372036854775807;
  v_taken      bigint[] := '{}';
  v_amendment  semap.track_amendment;
begin
  loop
    select * into v_amendment from (
      select a.* from semap.track_amendment a where a.track_id = v_track_id
      union all
      select a.* from semap.track_amendment a where a.other_track_id = v_track_id and a.kind = 'switched') a
    where (a.since, a.track_amendment_id) < (v_stamp, v_id) and a.track_amendment_id <> all (v_taken)
    order by a.since desc, a.track_amendment_id desc limit 1;
    if not found then
      return v_track_id;
    end if;
    v_taken := v_taken || v_amendment.track_amendment_id;
    if v_amendment.kind = 'switched' then
      v_stamp := v_amendment.since;
      v_id := v_amendment.track_amendment_id;
    end if;
    v_track_id := case v_track_id when v_amendment.track_id then v_amendment.other_track_id
                                  else v_amendment.track_id end;
  end loop;
end $$;

-- Whether relations of a track by a query are those of its reading.
create or replace function semap.reads_amended(p_query_id integer, p_track_id bigint) returns boolean
language sql stable as $$
  select exists (select from semap.continuous_query where query_id = p_query_id and follows_amendments)
     and exists (select from semap.track_reading where state_track_id = p_track_id)
$$;

-- Whose place the present of a track is to a query; null: another track has a newer state of the same person.
create or replace function semap.subject_now(p_query_id integer, p_track_id bigint) returns bigint
language sql stable as $$
  select case when not semap.reads_amended(p_query_id, p_track_id) then p_track_id else (
    select g.track_id
    from semap.track_reading g join semap.track_now t on t.track_id = g.state_track_id and t.stamp >= g.from_stamp
    where g.state_track_id = p_track_id and g.to_stamp = 'infinity' and not exists (
      select from semap.track_reading o
      join semap.track_now n on n.track_id = o.state_track_id and n.live and n.stamp >= o.from_stamp
      where o.track_id = g.track_id and o.to_stamp = 'infinity' and o.state_track_id <> p_track_id
        and (n.stamp, n.track_id = g.track_id, n.track_id) > (t.stamp, t.track_id = g.track_id, t.track_id))) end
$$;

-- The stamp of the newest state of a track, as a query takes it.
create or replace function semap.present_stamp(p_query_id integer, p_track_id bigint) returns timestamptz
language sql stable as $$
  select coalesce(
    (select max(t.stamp) from semap.track_reading g join semap.track_now t on t.track_id = g.state_track_id
     where g.track_id = p_track_id and g.to_stamp = 'infinity' and t.stamp >= g.from_stamp
       and semap.reads_amended(p_query_id, p_track_id)),
    (select stamp from semap.track_now where track_id = p_track_id))
$$;

-- These crossings without those of tracks that a query takes as amended.
create or replace function semap.crossings_as_told(p_crossings semap.crossing[]) returns semap.crossing[]
language plpgsql stable as $$
begin
  if p_crossings is null or not exists (
       select from unnest(p_crossings) c join semap.track_reading g on g.state_track_id = c.track_id) then
    return p_crossings;
  end if;
  return (
    select array_agg(c.one order by c.place)
    from (select p_crossings[place] as one, place from generate_subscripts(p_crossings, 1) place) c
    join semap.region r on r.region_id = (c.one).region_id
    where not semap.reads_amended(r.query_id, (c.one).track_id));
end $$;

-- Say that these tracks are to be read again from a stamp on.
create or replace function semap.read_again(p_track_ids bigint[], p_from timestamptz) returns void
language plpgsql as $$
begin
  insert into semap.reading_due (source_id, track_id, from_stamp)
  select source_id, track_id, p_from from semap.track_now where track_id = any (p_track_ids);
  if found then
    notify semap_late;
  end if;
end $$;

-- Say that the readings that some states belong to are to be read again, and let the rules of their map wait for that.
create or replace function semap.read_states_again(p_source semap.source, p_chunks semap.state_chunk[]) returns void
language plpgsql as $$
declare
  v_from  timestamptz;
begin
  if not exists (select from semap.continuous_query where map_id = p_source.map_id and follows_amendments) then
    return;
  end if;
  with due as (
    insert into semap.reading_due (source_id, track_id, from_stamp)
    select p_source.source_id, g.track_id, min(s.stamp)
    from semap.states_in(p_chunks) s
    join semap.track_reading g
      on g.state_track_id = s.track_id and s.stamp >= g.from_stamp and s.stamp < g.to_stamp
    group by g.track_id
    returning from_stamp
  )
  select min(from_stamp) into v_from from due;
  if v_from is null then
    return;
  end if;
  update semap.source s set late_from = v_from
  where source_id = p_source.source_id and v_from > semap.complete_through(s)
    and (late_from is null or late_from > v_from);
  notify semap_late;
end $$;

-- Write anew whose the states of these tracks are from a stamp on, after amendments that were found, and of all tracks
-- for which that depends on them. Gives whose it was and whose it is.
create or replace function semap.write_readings(p_track_ids bigint[], p_since timestamptz) returns bigint[]
language plpgsql as $$
declare
  v_ids     bigint[];
  v_before  bigint[];
begin
  with recursive linked (track_id) as (
    select unnest(p_track_ids)
    union
    select case l.track_id when a.track_id then a.other_track_id else a.track_id end
    from linked l join semap.track_amendment a on l.track_id in (a.track_id, a.other_track_id)
    where a.since >= p_since or a.kind = 'merged'
  )
  select array_agg(track_id) into v_ids from linked;
  insert into semap.track_reading (state_track_id, from_stamp, to_stamp, track_id, map_id)
  select track_id, '-infinity', 'infinity', track_id, map_id from semap.track k
  where track_id = any (v_ids) and not exists (select from semap.track_reading where state_track_id = k.track_id);

  v_before := array(select track_id from semap.track_reading
                    where state_track_id = any (v_ids) and to_stamp > p_since);
  delete from semap.track_reading where state_track_id = any (v_ids) and from_stamp >= p_since;
  update semap.track_reading set to_stamp = p_since where state_track_id = any (v_ids) and to_stamp > p_since;
  insert into semap.track_reading (state_track_id, from_stamp, to_stamp, track_id, map_id)
  select k.track_id, b.stamp, coalesce(b.until, 'infinity'), semap.amended_track(k.track_id, b.stamp), k.map_id
  from semap.track k
  cross join (
    select stamp, lead(stamp) over (order by stamp) as until from (
      select p_since as stamp
      union
      select since from semap.track_amendment
      where since > p_since and (track_id = any (v_ids) or other_track_id = any (v_ids))) s) b
  where k.track_id = any (v_ids);
  return array(select unnest(v_before)
               union select track_id from semap.track_reading
               where state_track_id = any (v_ids) and to_stamp > p_since);
end $$;
