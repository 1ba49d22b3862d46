-- Openings as lines, on which they are passed.

-- A length in metres that attributes say; null for what is no number above 0 and at most 100.
create or replace function semap.length_said(p_attributes jsonb, p_key text) returns double precision
language sql immutable parallel safe as $$
  select case when jsonb_typeof(p_attributes -> p_key) = 'number'
    and (p_attributes -> p_key)::numeric between 0.001 and 100
              then (p_attributes -> p_key)::double precision end
$$;

-- The line that halves the smallest rectangle around an outline along its longer side, towards x, or else y.
create or replace function semap.middle_line(p_outline public.geometry) returns public.geometry
language sql immutable parallel safe as $$
  select public.st_makeline(public.st_point(x_m - way_x_m / 2, y_m - way_y_m / 2),
                            public.st_point(x_m + way_x_m / 2, y_m + way_y_m / 2))
  from (
    select public.st_x(middle) as x_m, public.st_y(middle) as y_m, sign * s.way_x_m as way_x_m,
           sign * s.way_y_m as way_y_m
    from (select public.st_orientedenvelope(p_outline) as box offset 0) b
    cross join lateral (select public.st_centroid(b.box) as middle, public.st_exteriorring(b.box) as ring offset 0) c
    cross join lateral (
      select public.st_x(public.st_pointn(ring, n + 1)) - public.st_x(public.st_pointn(ring, n)) as way_x_m,
             public.st_y(public.st_pointn(ring, n + 1)) - public.st_y(public.st_pointn(ring, n)) as way_y_m
      from unnest(array[1, 2]) n) s
    cross join lateral (select sqrt(s.way_x_m ^ 2 + s.way_y_m ^ 2) as length_m) l
    cross join lateral (select case when s.way_x_m > 1e-6 * length_m or s.way_x_m > -1e-6 * length_m and s.way_y_m > 0
                                    then 1 else -1 end as sign) d
    order by round(length_m::numeric, 6) desc, abs(s.way_x_m) desc limit 1) longer
$$;

-- The line on which an opening is passed, with its heights, in the map's frame. It leads through the middle of its
-- outline along the longer side, or, without one, along the x axis of its own frame, as wide as `width_m` says; in
-- either case towards the x, or else the y, of that frame. Nothing for what is nowhere, tilted, or has neither. An
-- outline without heights has none.
create or replace function semap.doorway(
  p_instance semap.instance, out line public.geometry, out z_min_m double precision, out z_max_m double precision
)
language plpgsql stable as $$
declare
  v_pose     semap.pose;
  v_width_m  constant double precision := semap.length_said(p_instance.attributes, 'width_m');
  v_outline  public.geometry;
  v_middle   public.geometry := public.st_makeline(public.st_point(-v_width_m / 2, 0),
                                                   public.st_point(v_width_m / 2, 0));
begin
  v_pose := (
    select f.pose from semap.frames_in_root(array[p_instance.frame_id]) f
    join semap.frame root on root.frame_id = f.root_id and root.name = 'map'
    where semap.is_upright(f.pose));
  if v_pose is null then
    return;
  end if;
  select geometry into v_outline
  from semap.abstraction where description_id = p_instance.relative_description_id and type = 'Footprint';
  if v_outline is not null then
    v_middle := semap.middle_line(v_outline);
    select a.z_min_m, a.z_max_m into z_min_m, z_max_m
    from semap.abstraction a where a.description_id = p_instance.absolute_description_id and a.type = 'Footprint';
  else
    z_min_m := (v_pose).z_m;
    z_max_m := z_min_m + coalesce(semap.length_said(p_instance.attributes, 'height_m'), 2);
  end if;
  select public.st_makeline(public.st_point(f.x_m, f.y_m), public.st_point(t.x_m, t.y_m)) into line
  from semap.carry(v_pose, public.st_x(public.st_startpoint(v_middle)), public.st_y(public.st_startpoint(v_middle)),
                   0) f,
       semap.carry(v_pose, public.st_x(public.st_endpoint(v_middle)), public.st_y(public.st_endpoint(v_middle)), 0) t
  where v_middle is not null;
end $$;
