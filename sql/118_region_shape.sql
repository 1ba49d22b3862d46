-- The band of heights in which a region answers, of an abstraction with its heights [m].
create or replace function semap.region_band(
  p_compared text, p_dimensions smallint, p_distance_m double precision,
  p_z_min_m double precision, p_z_max_m double precision, out z_min_m double precision, out z_max_m double precision
) language sql immutable parallel safe as $$
  select case when p_compared = 'top' then p_z_max_m - 0.1 when p_dimensions = 3
    then p_z_min_m - coalesce(p_distance_m, 0) end,
         case when p_compared = 'top' then p_z_max_m + 0.5 when p_dimensions = 3
           then p_z_max_m + coalesce(p_distance_m, 0) end
$$;

-- A shape grown (or, by a negative distance, shrunk), round at its corners to half a millimetre.
create or replace function semap.grown(p_shape public.geometry, p_by_m double precision) returns public.geometry
language sql immutable parallel safe as $$
  select case when p_by_m = 0 then p_shape
    else public.st_buffer(p_shape, p_by_m,
      'quad_segs=' || greatest(8, ceil(pi() / 4 / acos(1 - 0.0005 / greatest(abs(p_by_m), 0.001)))::integer)) end
$$;

-- The area to the front (x), back, left (y) or right of a shape as its own frame has it, at a yaw [rad]: the side of
-- its box in that frame, swept outwards by a reach [m].
create or replace function semap.area_beside(
  p_shape public.geometry, p_yaw_rad double precision, p_side text, p_reach_m double precision
) returns public.geometry
language sql immutable parallel safe as $$
  select public.st_rotate(
    case p_side
      when 'front' then public.st_makeenvelope(x_max, y_min, x_max + p_reach_m, y_max)
      when 'back' then public.st_makeenvelope(x_min - p_reach_m, y_min, x_min, y_max)
      when 'left' then public.st_makeenvelope(x_min, y_max, x_max, y_max + p_reach_m)
      else public.st_makeenvelope(x_min, y_min - p_reach_m, x_max, y_min) end, p_yaw_rad)
  from (select public.st_xmin(s) as x_min, public.st_xmax(s) as x_max, public.st_ymin(s) as y_min,
        public.st_ymax(s) as y_max
        from public.st_rotate(p_shape, -p_yaw_rad) s) e
$$;

-- Whether an area to a side of a thing is compared.
create or replace function semap.is_side(p_compared text) returns boolean
language sql immutable parallel safe return p_compared in ('front', 'back', 'left', 'right');

-- Every region that the continuous queries ask for: one for each instance that a query is about and that has the
-- abstraction it compares. `footprint` is where the relation holds, as a polygon; `shape` what the predicate compares;
-- `enter_area` and `reach` where it is entered and left, if the query has margins.
create or replace view semap.region_wanted as
  select q.query_id, q.name as query_name, i.instance_id, i.uid as instance_uid, i.name as instance_name, i.map_id,
         f.footprint, coalesce(b.z_min_m, '-infinity') as z_min_m, coalesce(b.z_max_m, 'infinity') as z_max_m,
         q.region_test as test, q.object_compared as compared,
         case when q.stateful then s.shape end as shape, q.by_m as distance_m,
         case when q.enter_margin_m > 0 then semap.grown(s.shape, coalesce(q.by_m, 0) - q.enter_margin_m) end
           as enter_area,
         case when q.leave_margin_m > 0 then semap.grown(s.shape, coalesce(q.by_m, 0) + q.leave_margin_m) end
           as leave_area,
         q.enter_confirm, q.leave_confirm, semap.normal_quantile(q.enter_probability) as enter_stds,
         -semap.normal_quantile(q.leave_probability) as leave_stds, q.widest_std_m, q.longest_gap, q.fastest_mps,
         q.subject, q.stateful
  from (
    select c.*, p.region_test, p.object_compared, case when p.region_test = 'dwithin' then distance_m end as by_m,
           t.subject,
           p.region_test <> 'contains' or p.object_compared <> 'ground' or enter_margin_m > 0 or leave_margin_m > 0
           or enter_confirm > '0' or leave_confirm > '0' or enter_probability is not null or longest_gap is not null
           or t.subject is not null as stateful
    from semap.continuous_query c
    join semap.predicate p on p.name = c.predicate
    cross join lateral (
      select nullif(concat_ws('|', subject_concept_id, subject_uids, subject_where), '') as subject) t
  ) q
  cross join lateral (
    select semap.concepts_below(q.object_concept_id) as concept_id
    union all
    select concept_id from semap.concept where q.object_concept_id is null) c
  join semap.instance i on i.map_id = q.map_id and i.concept_id = c.concept_id
  join semap.abstraction a on a.description_id = i.absolute_description_id and a.type = q.abstraction
  cross join lateral semap.region_band(q.object_compared, q.dimensions, q.by_m, a.z_min_m, a.z_max_m) b
  cross join lateral (
    select case when semap.is_side(q.object_compared)
             then (select semap.area_beside(a.geometry, semap.yaw(f.pose), q.object_compared, q.distance_m)
                   from semap.frames_in_root(array[i.frame_id]) f)
             else a.geometry end) s (shape)
  cross join lateral (select semap.grown(s.shape, coalesce(q.by_m, 0))) f (footprint)
  left join semap.condition oc on oc.condition_id = q.object_condition_id
  where q.enabled and not q.in_pairs
    and (q.object_uids is null or i.uid = any (q.object_uids))
    and (q.object_condition_id is null
         or semap.condition_holds(oc.condition_id, oc.said, i.name, i.alias, i.attributes))
    and public.st_dimension(f.footprint) = 2;

