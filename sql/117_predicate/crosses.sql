/*
holds = "never: a crossing is a moment, logged as one change"
relates = ["track instance"]
why_not = "only tracks cross, and only what stands still is crossed"
follows_from = "way"
object = "line"
takes = ["direction"]

[rows]
name = "crosses"
usage = "crosses(t, d)"
of_instance = true
by_track = true
*/

-- Whether the straight way of a track from the state before its present one meets the object's footprint. A query that
-- is kept tells each crossing of its line or boundary as it happens; a way that stays inside an area crosses nothing
-- then.
create or replace function semap_query.crosses(p_subject record, p_object record) returns boolean
language plpgsql stable parallel safe as $$
declare
  v_before  public.geometry;
begin
  if p_subject.map_id <> p_object.map_id then
    return false;
  end if;
  select public.st_makepoint(s.x_m, s.y_m) into v_before
  from semap.states_around(p_subject.id, p_subject.stamp, 1, 0) s;
  return public.st_intersects(public.st_makeline(v_before, public.st_makepoint(p_subject.x_m, p_subject.y_m)),
                              p_object.footprint);
end $$;
