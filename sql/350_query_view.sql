-- The views and spatial predicates that continuous queries in SQL are written over, for plain queries too: the schema
-- semap_query has a view of tracks, one of instances, and one for each concept with the instances of it and of those
-- below it. They show what their reader may see; where semap.maps is set, they show these maps alone.

-- Each track that lives, where it is now, and the ground that it covers.
create or replace view semap_query.track with (security_invoker = true) as
  select 'track'::text as kind, p.track_id as id, k.uid, p.track as name, p.source, m.name as map, p.map_id, p.stamp,
         case when p.z_m is null then public.st_makepoint(p.x_m, p.y_m)
              else public.st_makepoint(p.x_m, p.y_m, p.z_m) end as position,
         p.footprint, p.x_m, p.y_m, p.z_m, p.std_m, p.heading_rad, p.speed_mps, p.length_m, p.width_m,
         p.std_across_m, p.std_yaw_rad, c.name as concept, k.concept_id, k.attributes
  from semap.track_present p
  join semap.track k using (track_id)
  left join semap.concept c on c.concept_id = k.concept_id
  join semap.map m on m.map_id = p.map_id
  where (select semap.visible_maps() is null) or p.map_id = any ((select semap.visible_maps())::integer[]);

-- Each instance with its absolute abstractions; its heights are without end where they are not known.
create or replace view semap_query.instance with (security_invoker = true) as
  select 'instance'::text as kind, i.instance_id as id, i.uid, i.name, i.alias, c.name as concept, i.concept_id,
         s.name as storey, m.name as map, i.map_id, i.attributes,
         position_2d.geometry as position, footprint.geometry as footprint, footprint_hull.geometry as footprint_hull,
         footprint_box.geometry as footprint_box, axis_aligned_2d.geometry as axis_aligned_2d,
         position_3d.geometry as position_3d, axis_aligned_3d.geometry as axis_aligned_3d,
         bounding_box.geometry as bounding_box, bounding_hull.geometry as bounding_hull,
         coalesce(footprint.z_min_m, public.st_zmin(axis_aligned_3d.geometry), public.st_z(position_3d.geometry),
                  '-infinity') as z_min_m,
         coalesce(footprint.z_max_m, public.st_zmax(axis_aligned_3d.geometry), public.st_z(position_3d.geometry),
                  'infinity') as z_max_m
  from semap.instance i
  join semap.concept c on c.concept_id = i.concept_id
  join semap.map m on m.map_id = i.map_id
  left join semap.instance s on s.instance_id = i.storey_id
  left join semap.abstraction position_2d on position_2d.description_id = i.absolute_description_id
    and position_2d.type = 'Position2D' and position_2d.instance_id is not null
  left join semap.abstraction footprint on footprint.description_id = i.absolute_description_id
    and footprint.type = 'Footprint' and footprint.instance_id is not null
  left join semap.abstraction footprint_hull on footprint_hull.description_id = i.absolute_description_id
    and footprint_hull.type = 'FootprintHull' and footprint_hull.instance_id is not null
  left join semap.abstraction footprint_box on footprint_box.description_id = i.absolute_description_id
    and footprint_box.type = 'FootprintBox' and footprint_box.instance_id is not null
  left join semap.abstraction axis_aligned_2d on axis_aligned_2d.description_id = i.absolute_description_id
    and axis_aligned_2d.type = 'AxisAligned2D' and axis_aligned_2d.instance_id is not null
  left join semap.abstraction position_3d on position_3d.description_id = i.absolute_description_id
    and position_3d.type = 'Position3D' and position_3d.instance_id is not null
  left join semap.abstraction axis_aligned_3d on axis_aligned_3d.description_id = i.absolute_description_id
    and axis_aligned_3d.type = 'AxisAligned3D' and axis_aligned_3d.instance_id is not null
  left join semap.abstraction bounding_box on bounding_box.description_id = i.absolute_description_id
    and bounding_box.type = 'BoundingBox' and bounding_box.instance_id is not null
  left join semap.abstraction bounding_hull on bounding_hull.description_id = i.absolute_description_id
    and bounding_hull.type = 'BoundingHull' and bounding_hull.instance_id is not null
  where (select semap.visible_maps() is null) or i.map_id = any ((select semap.visible_maps())::integer[]);

-- The name of a concept's view: snake case, at most 63 bytes; null of a concept that has none, since nothing is left of
-- its name, or it is that of another view or of a table of PostgreSQL.
create or replace function semap.view_name(p_concept text) returns text
language plpgsql immutable parallel safe as $$
declare
  v_snake  text := regexp_replace(p_concept, '([A-Z]+)([A-Z][a-z])', '\1_\2', 'g');
  v_name   text;
begin
  v_snake := regexp_replace(v_snake, '([a-z0-9])([A-Z])', '\1_\2', 'g');
  v_snake := regexp_replace(v_snake, '[\x01-\x2f\x3a-\x40\x5b-\x60\x7b-\x7f]+', '_', 'g');
  v_snake := btrim(translate(v_snake, 'ABCDEFGHIJKLMNOPQRSTUVWXYZ', 'abcdefghijklmnopqrstuvwxyz'), '_');
  v_name := v_snake::name::text;
  return case when v_name not in ('', 'track', 'instance') and v_name not like 'pg\_%' then v_name end;
end $$;

-- Make the view of each concept that has none yet, and drop those of concepts that are gone; what is as it should be is
-- left alone. Of concepts whose views would have one name the oldest has it. A view that somebody else's object depends
-- on stays. Edits of concepts are one at a time (semap.lock_regions_exclusive), so that no two make one view.
create or replace function semap.make_concept_views() returns void
language plpgsql security definer set search_path = pg_catalog, pg_temp as $$
declare
  v_view  record;
begin
  for v_view in
    with wanted as (
      select distinct on (semap.view_name(c.name)) semap.view_name(c.name) as name, c.concept_id,
             format('Instances of the concept %s (%s) and of those below it.', c.name, c.concept_id) as comment
      from semap.concept c
      where semap.view_name(c.name) is not null
      order by semap.view_name(c.name), c.concept_id
    ), present as (
      select relname::text as name, obj_description(oid, 'pg_class') as comment
      from pg_class
      where relnamespace = 'semap_query'::regnamespace and relkind = 'v' and relname not in ('track', 'instance')
        and obj_description(oid, 'pg_class') like 'Instances of the concept %'
    )
    select coalesce(w.name, p.name) as name, w.concept_id, w.comment
    from wanted w full join present p on p.name = w.name
    where w.comment is distinct from p.comment
    order by w.concept_id nulls first
  loop
    begin
      if v_view.concept_id is null then
        execute format('drop view semap_query.%I', v_view.name);
      else
        execute format(
          'create or replace view semap_query.%I with (security_invoker = true) as'
          ' select * from semap_query.instance where concept_id in (select semap.concepts_below(%s))',
          v_view.name, v_view.concept_id);
        execute format('comment on view semap_query.%I is %L', v_view.name, v_view.comment);
        execute format('grant select on semap_query.%I to semap_read, semap_ingest, semap_worker, semap_api,'
                       ' semap_admin, semap_read_map, semap_ingest_map, semap_api_map', v_view.name);
      end if;
    exception when dependent_objects_still_exist or invalid_table_definition or wrong_object_type then
      null; -- somebody's view stands on it, or somebody has put a table there
    end;
  end loop;
end $$;

-- Each concept has its view as soon as it is there.
create or replace function semap.concept_views_kept() returns trigger
language plpgsql security definer set search_path = pg_catalog, pg_temp as $$
begin
  perform semap.make_concept_views();
  return null;
end $$;

create or replace trigger concept_views_kept after insert or delete or update of name on semap.concept
  for each statement execute function semap.concept_views_kept();
