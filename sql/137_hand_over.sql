-- A track may go on at another source: a person who walks out of the sight of one tracker into that of the next and is
-- known to be the same. From then on the other source alone writes its states. Its relations hold meanwhile, since
-- nothing is known to have ended.

-- Bring the relations of a track in line with queries that began or ceased to be about it: they begin or end now, at its
-- last stamp.
create or replace function semap.choose_anew(p_track_id bigint) returns void
language plpgsql as $$
declare
  v_before     integer[] := array(select query_id from semap.query_track where track_id = p_track_id);
  v_differing  integer[];
  v_crossings  semap.crossing[];
begin
  perform semap.choose_tracks(null, array[p_track_id]);
  v_differing := array(
    select query_id
    from unnest(v_before) query_id full join (select query_id from semap.query_track where track_id = p_track_id) n using (query_id)
    where n.query_id is null or query_id <> all (v_before));
  if v_differing = '{}' then
    return;
  end if;
  perform semap.settle_places(array(select source_id from semap.track where track_id = p_track_id));
  with held as (
    select region_id from semap.relation where track_id = p_track_id and query_id = any (v_differing)
  ), inside as (
    select r.region_id
    from semap.track_now t
    join semap.region r on r.map_id = t.map_id and r.query_id = any (v_differing)
    join semap.query_track s on s.query_id = r.query_id and s.track_id = t.track_id
    where t.track_id = p_track_id and t.live and (select side from semap.stands(r, t.x_m, t.y_m, t.z_m, t.std_m))
  )
  select array_agg(row(t.track_id, region_id, case when h.region_id is null then 'began' else 'ended' end, 'map',
                       t.stamp, t.stamp, null, null)::semap.crossing) into v_crossings
  from held h full join inside i using (region_id) cross join semap.track_now t
  where t.track_id = p_track_id and (h.region_id is null or i.region_id is null);
  perform semap.record_crossings(v_crossings);
  delete from semap.verge v using semap.region r
  where v.track_id = p_track_id and r.region_id = v.region_id and r.query_id = any (v_differing);
  update semap.track_now
  set calm_x_min_m = 'infinity',
      careful_ids = array(select n.region_id from semap.relation n join semap.region r using (region_id)
                          where n.track_id = p_track_id and r.careful order by n.region_id)
  where track_id = p_track_id;
end $$;
comment on function semap.choose_anew is
  'Bring the relations of a track in line with queries that began or ceased to be about it.';

-- A track that goes on at another source, or is described in another way. Both sources write their places at once, and
-- know anew what a whole frame of theirs is.
create or replace function semap.track_described() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  if new.map_id <> old.map_id
     or new.map_id is distinct from (select map_id from semap.source where source_id = new.source_id) then
    raise exception 'The track % stays on its map.', old.name
      using errcode = 'integrity_constraint_violation', hint = 'Hand it to a source of the same map.';
  end if;
  if new.source_id <> old.source_id then
    perform semap.settle_places(array[old.source_id, new.source_id]);
    update semap.source_count set frame_stamp = '-infinity', placed_stamp = '-infinity', frame_tracks = null
    where source_id in (old.source_id, new.source_id);
    update semap.track_now set source_id = new.source_id where track_id = new.track_id;
  end if;
  perform semap.choose_anew(new.track_id);
  return null;
end $$;
comment on function semap.track_described is
  'A track goes on at another source, or is described in another way: its relations follow.';

create or replace trigger track_described after update on semap.track
  for each row when ((new.source_id, new.map_id, new.name, new.concept_id, new.attributes, new.uid)
                     is distinct from (old.source_id, old.map_id, old.name, old.concept_id, old.attributes, old.uid))
  execute function semap.track_described();

-- Hand tracks to another source of their map, in a transaction of its own: whoever holds a source already might wait for
-- one who hands tracks the other way. Writers of sources that are not concerned go on meanwhile.
create or replace function semap.hand_over_tracks(p_track_ids bigint[], p_source_id integer) returns void
language plpgsql security definer set search_path = public, pg_temp set semap.source_is_held = 'on' as $$
declare
  v_source_ids  integer[];
begin
  if exists (select from pg_locks where pid = pg_backend_pid() and locktype = 'advisory' and classid = 7364) then
    raise exception 'Tracks are handed over in a transaction of its own.'
      using errcode = 'invalid_transaction_state', hint = 'Commit what was written before, then hand them over.';
  end if;
  perform semap.hold_regions();
  v_source_ids := array(select source_id from semap.track where track_id = any (p_track_ids) union select p_source_id order by 1);
  perform semap.hold_source(source_id) from unnest(v_source_ids) source_id;
  if exists (select from semap.track where track_id = any (p_track_ids) and source_id <> all (v_source_ids)) then
    raise exception 'Some of these tracks were just handed to another source.'
      using errcode = 'serialization_failure', hint = 'Look where they are, and try again.';
  end if;
  update semap.track set source_id = p_source_id where track_id = any (p_track_ids) and source_id <> p_source_id;
end $$;
comment on function semap.hand_over_tracks is
  'Hand tracks to another source of their map, in a transaction of its own.';
