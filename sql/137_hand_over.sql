-- A track may go on at another source: a person who walks out of the sight of one tracker into that of the next and is
-- known to be the same. From then on the other source alone writes its states. Its relations hold meanwhile, since
-- nothing is known to have ended.

-- A track that goes on at another source. Its states up to then get chunks of their own, since nobody looks for them
-- among those of another source than its own. Which queries are about it now is said after this
-- (semap.track_described).
create or replace function semap.track_handed_over() returns trigger
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  if new.map_id <> old.map_id
     or new.map_id is distinct from (select map_id from semap.source where source_id = new.source_id) then
    raise exception 'The track % stays on its map.', old.name
      using errcode = 'integrity_constraint_violation', hint = 'Hand it to a source of the same map.';
  end if;
  if new.source_id <> old.source_id then
    perform semap.compact_all(array[old.source_id]);
    update semap.track_now set source_id = new.source_id where track_id = new.track_id;
  end if;
  return null;
end $$;

create or replace trigger track_handed_over after update on semap.track
  for each row when ((new.source_id, new.map_id) is distinct from (old.source_id, old.map_id))
  execute function semap.track_handed_over();

-- Hand tracks to another source of their map, in a transaction of its own: whoever holds a source already might wait
-- for one who hands tracks the other way. Writers of sources that are not concerned go on meanwhile.
create or replace function semap.hand_over_tracks(p_track_ids bigint[], p_source_id integer) returns void
language plpgsql security definer set search_path = public, pg_temp as $$
declare
  v_source_ids  integer[];
  v_source_id   integer;
begin
  if exists (select from pg_locks where pid = pg_backend_pid() and locktype = 'advisory' and classid = 7364) then
    raise exception 'Tracks are handed over in a transaction of its own.'
      using errcode = 'invalid_transaction_state', hint = 'Commit what was written before, then hand them over.';
  end if;
  perform semap.lock_regions_shared();
  v_source_ids := array(
    select source_id from semap.track where track_id = any (p_track_ids) union select p_source_id order by 1);
  perform semap.lock_source(source_id) from unnest(v_source_ids) source_id;
  if exists (select from semap.track where track_id = any (p_track_ids) and source_id <> all (v_source_ids)) then
    raise exception 'Some of these tracks were just handed to another source.'
      using errcode = 'serialization_failure', hint = 'Look where they are, and try again.';
  end if;
  -- what came late is corrected by the states of the source that it came from
  foreach v_source_id in array v_source_ids loop
    while semap.correct_tracks(v_source_id) > 0 loop
    end loop;
  end loop;
  perform set_config('semap.source_is_locked', 'on', true);
  update semap.track set source_id = p_source_id where track_id = any (p_track_ids) and source_id <> p_source_id;
  perform set_config('semap.source_is_locked', 'off', true);
end $$;
