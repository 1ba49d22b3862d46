-- The states of the tracks that the caller of this transaction may see; the rights are those of its owner.
create or replace view semap.track_state_seen with (security_barrier) as
  select s.* from semap.stored_state s
  where (select semap.visible_maps() is null)
     or exists (select from semap.track t
                where t.track_id = s.track_id and t.map_id = any ((select semap.visible_maps())::integer[]));
