-- A new track is known at once and has a present as soon as its first state arrives.
create or replace function semap.track_inserted() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  insert into semap.track_now (track_id, source_id, map_id, cell_m)
  select n.track_id, n.source_id, n.map_id, m.cell_m from new_track n join semap.map m using (map_id);
  if (select count(*) from new_track) >= 100 then
    analyze semap.track, semap.track_now;
  end if;
  return null;
end $$;
comment on function semap.track_inserted is
  'A new track is known at once and has a present as soon as its first state arrives.';

create or replace trigger track_inserted after insert on semap.track
  referencing new table as new_track for each statement execute function semap.track_inserted();

-- New states move their tracks: relations begin and end at the stamp of the first state that shows
-- it. A state within the calm of its track needs one comparison; only tracks that left theirs are
-- looked up, state by state. States at or before the present of their track change no relation:
-- they are kept and counted as late. A state that is its track's last ends the track after it.
create or replace function semap.track_state_inserted() returns trigger
language plpgsql security definer
set search_path = public, pg_temp set plan_cache_mode = force_generic_plan set enable_mergejoin = off as $$
declare
  v_source_id  integer;
  v_states     bigint;
  v_unknown    bigint;
  v_foreign    bigint;
  v_late       bigint;
  v_restless   bigint[];
  v_several    boolean;
  v_revives    boolean;
  v_ends       boolean;
  v_crossings  semap.crossing[];
begin
  select t.source_id into v_source_id
  from (select track_id from new_state limit 1) n join semap.track_now t using (track_id);
  perform semap.hold_regions();
  perform semap.hold_source(v_source_id);

  select count(*),
         min(n.track_id) filter (where t.track_id is null),
         min(n.track_id) filter (where t.source_id <> v_source_id),
         count(*) filter (where n.stamp <= t.stamp),
         array_agg(distinct n.track_id) filter (where not (
           n.x_m > t.calm_x_min_m and n.x_m < t.calm_x_max_m
           and n.y_m > t.calm_y_min_m and n.y_m < t.calm_y_max_m
           and case when n.z_m is null then t.calm_z_min_m is null
                    else n.z_m >= t.calm_z_min_m and n.z_m < t.calm_z_max_m end
           and not n.is_last) is true),
         count(*) > count(distinct n.track_id), bool_or(not t.live), bool_or(n.is_last)
    into v_states, v_unknown, v_foreign, v_late, v_restless, v_several, v_revives, v_ends
  from new_state n left join semap.track_now t using (track_id);

  if v_unknown is not null then
    raise exception 'There is no track %.', v_unknown
      using errcode = 'foreign_key_violation', hint = 'Insert the track into semap.track first.';
  end if;
  if v_foreign is not null then
    raise exception 'The states of one statement come from more than one source.'
      using errcode = 'cardinality_violation', hint = 'Insert or copy the states of each source by themselves.';
  end if;
  if v_states > 0 then
    perform semap.count_received(v_source_id, p_track_states => v_states);
  end if;
  if v_late > 0 then
    update semap.source set late_states = late_states + v_late where source_id = v_source_id;
    update semap.track_now t set first_stamp = n.stamp
    from (select track_id, min(stamp) as stamp from new_state group by track_id) n
    where t.track_id = n.track_id and n.stamp < t.first_stamp;
  end if;

  update semap.track_now t
  set stamp = n.stamp, x_m = n.x_m, y_m = n.y_m, z_m = n.z_m, std_m = n.std_m,
      heading_rad = n.heading_rad, speed_mps = n.speed_mps, length_m = n.length_m, width_m = n.width_m
  from new_state n
  where t.track_id = n.track_id and n.stamp > t.stamp
    and (v_restless is null or n.track_id <> all (v_restless))
    and (not v_several or (n.track_id, n.stamp) in
         (select track_id, max(stamp) from new_state group by track_id));

  if v_restless is not null then
    with located as (
      select n.*, t.map_id, t.cell_m, t.live, t.region_ids as present_ids,
             g.region_ids, g.z_min_m as calm_z_min_m, g.z_max_m as calm_z_max_m
      from new_state n
      join semap.track_now t using (track_id)
      cross join lateral semap.regions_at(t.map_id, t.cell_m, n.x_m, n.y_m, n.z_m) g
      where n.track_id = any (v_restless) and n.stamp > t.stamp
    ), stepped as (
      select *, lag(is_last, 1, not live) over one_track as appears,
             lead(stamp) over one_track is null as is_present, first_value(stamp) over one_track as first_stamp,
             lag(case when is_last then '{}' else region_ids end, 1, present_ids) over one_track as before_ids
      from located
      window one_track as (partition by track_id order by stamp)
    ), crossed as (
      select track_id, region_id, 'began'::semap.change_kind as kind,
             case when appears then 'appeared' else 'moved' end::semap.change_cause as cause, stamp
      from stepped, unnest(region_ids) region_id
      where region_ids <> before_ids and region_id <> all (before_ids)
      union all
      select track_id, region_id, 'ended', 'moved', stamp
      from stepped, unnest(before_ids) region_id
      where region_ids <> before_ids and region_id <> all (region_ids)
      union all
      select track_id, region_id, 'ended', 'disappeared', stamp
      from stepped, unnest(region_ids) region_id
      where is_last
    ), moved as (
      update semap.track_now t
      set live = true, first_stamp = least(t.first_stamp, n.first_stamp),
          stamp = n.stamp, x_m = n.x_m, y_m = n.y_m, z_m = n.z_m, std_m = n.std_m,
          heading_rad = n.heading_rad, speed_mps = n.speed_mps, length_m = n.length_m, width_m = n.width_m,
          region_ids = case when n.is_last then '{}' else n.region_ids end,
          calm_x_min_m = c.x_min_m, calm_x_max_m = c.x_max_m, calm_y_min_m = c.y_min_m, calm_y_max_m = c.y_max_m,
          calm_z_min_m = n.calm_z_min_m, calm_z_max_m = n.calm_z_max_m
      from stepped n cross join lateral semap.calm_rectangle(n.map_id, n.cell_m, n.x_m, n.y_m) c
      where t.track_id = n.track_id and n.is_present
    )
    select array_agg(row(c.*)::semap.crossing) into v_crossings from crossed c;
    perform semap.record_crossings(v_crossings);
    if v_revives then
      update semap.track set ended_at = null
      where ended_at is not null and track_id in
        (select track_id from semap.track_now where track_id = any (v_restless) and live);
    end if;
    if v_ends then
      update semap.track k set ended_at = n.stamp
      from new_state n join semap.track_now t using (track_id)
      where n.is_last and n.stamp = t.stamp and k.track_id = n.track_id;
    end if;
  end if;
  return null;
end $$;
comment on function semap.track_state_inserted is
  'New states move their tracks: relations begin and end at the stamp of the first state that shows it.';

create or replace trigger track_state_inserted after insert on semap.track_state
  referencing new table as new_state for each statement execute function semap.track_state_inserted();

-- A track that ended leaves every region it was in, at its end. A state after that revives it.
create or replace function semap.track_updated() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_ended      bigint[];
  v_crossings  semap.crossing[];
begin
  select array_agg(n.track_id) into v_ended
  from new_track n join old_track o using (track_id)
  where n.ended_at is not null and n.ended_at is distinct from o.ended_at;
  if v_ended is null then
    return null;
  end if;
  perform semap.hold_regions();
  perform semap.hold_source(source_id)
  from (select distinct source_id from new_track where track_id = any (v_ended) order by source_id) s;

  select array_agg(row(r.track_id, r.region_id, 'ended', 'disappeared',
                       greatest(n.ended_at, t.stamp))::semap.crossing) into v_crossings
  from new_track n
  join semap.track_now t using (track_id)
  join semap.relation r using (track_id)
  where n.track_id = any (v_ended);
  perform semap.record_crossings(v_crossings);

  update semap.track_now t
  set live = false, region_ids = '{}', calm_x_min_m = 'infinity', stamp = greatest(t.stamp, n.ended_at)
  from new_track n
  where t.track_id = n.track_id and n.track_id = any (v_ended);
  return null;
end $$;
comment on function semap.track_updated is
  'A track that ended leaves every region it was in, at its end.';

create or replace trigger track_updated after update on semap.track
  referencing old table as old_track new table as new_track
  for each statement execute function semap.track_updated();

-- A track that is deleted leaves every region it is in. Nobody keeps that it did, but the rule worker reads it in the
-- log, since what its rules know of the track would hold for ever.
create or replace function semap.track_leaves() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  if exists (select from semap.map where map_id = old.map_id) then
    insert into semap.relation_change (uid, map_id, query_id, query_name, track_id, track_name,
                                       instance_id, instance_name, kind, cause, stamp, since)
    select gen_random_uuid(), r.map_id, r.query_id, r.query_name, old.track_id, old.name,
           r.instance_id, r.instance_name, 'ended', 'map', t.stamp, n.since
    from semap.relation n
    join semap.region r using (region_id)
    join semap.track_now t using (track_id)
    where n.track_id = old.track_id
    order by r.instance_uid, r.query_id;
  end if;
  return old;
end $$;
comment on function semap.track_leaves is
  'A track that is deleted leaves every region it is in.';

create or replace trigger track_leaves before delete on semap.track
  for each row execute function semap.track_leaves();

-- With a track go its states and what they changed; a track of the same name starts anew.
create or replace function semap.track_deleted() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  delete from semap.relation where track_id in (select track_id from old_track);
  delete from semap.relation_change where track_id in (select track_id from old_track);
  delete from semap.track_state where track_id in (select track_id from old_track);
  return null;
end $$;
comment on function semap.track_deleted is
  'With a track go its states and what they changed; a track of the same name starts anew.';

create or replace trigger track_deleted after delete on semap.track
  referencing old table as old_track for each statement execute function semap.track_deleted();
