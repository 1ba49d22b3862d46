-- Frames, descriptions with their geometries, and instances with their abstractions.
create type semap.pose as (
  x_m double precision, y_m double precision, z_m double precision,
  qx double precision, qy double precision, qz double precision, qw double precision
);

create table semap.frame (
  frame_id   bigint generated always as identity primary key,
  map_id     integer not null references semap.map on delete cascade,
  name       text not null check (name <> ''),
  parent_id  bigint references semap.frame on delete cascade,
  unique (map_id, name) deferrable
);
create index frame_parent on semap.frame (parent_id);

create table semap.frame_pose (
  frame_id  bigint not null references semap.frame on delete cascade,
  stamp     timestamptz not null default '-infinity',
  x_m       double precision not null default 0,
  y_m       double precision not null default 0,
  z_m       double precision not null default 0,
  qx        double precision not null default 0,
  qy        double precision not null default 0,
  qz        double precision not null default 0,
  qw        double precision not null default 1,
  primary key (frame_id, stamp),
  check (abs(qx * qx + qy * qy + qz * qz + qw * qw - 1) < 1e-6)
);

create table semap.description (
  description_id  bigint generated always as identity primary key,
  map_id          integer not null references semap.map on delete cascade,
  name            text check (name <> ''),
  is_absolute     boolean not null default false,
  unique (map_id, name) deferrable,
  check (name is null or not is_absolute)
);
create index description_map on semap.description (map_id);

create table semap.geometry (
  geometry_id     bigint generated always as identity primary key,
  description_id  bigint not null references semap.description on delete cascade,
  name            text not null default 'Body' check (name <> ''),
  type            text not null,
  body            public.geometry not null,
  x_m             double precision not null default 0,
  y_m             double precision not null default 0,
  z_m             double precision not null default 0,
  qx              double precision not null default 0,
  qy              double precision not null default 0,
  qz              double precision not null default 0,
  qw              double precision not null default 1,
  z_min_m         double precision,
  z_max_m         double precision,
  unique (description_id, name),
  check (abs(qx * qx + qy * qy + qz * qz + qw * qw - 1) < 1e-6),
  check (z_min_m < z_max_m),
  constraint heights_are_of_an_area check (z_min_m is null and z_max_m is null or type = 'POLYGON2D'),
  constraint body_is_of_its_type
    check (case type
             when 'POINT2D' then geometrytype(body) = 'POINT' and st_zmflag(body) = 0
             when 'POSE2D' then geometrytype(body) = 'POINT' and st_zmflag(body) = 0
             when 'POLYGON2D'
               then geometrytype(body) in ('POLYGON', 'MULTIPOLYGON') and st_zmflag(body) = 0
             when 'POINT3D' then geometrytype(body) = 'POINT' and st_zmflag(body) = 2
             when 'POSE3D' then geometrytype(body) = 'POINT' and st_zmflag(body) = 2
             when 'POLYGON3D' then geometrytype(body) = 'POLYGON' and st_zmflag(body) = 2
             when 'TRIANGLEMESH3D' then geometrytype(body) = 'TIN' and st_zmflag(body) = 2
             when 'POLYGONMESH3D' then geometrytype(body) = 'POLYHEDRALSURFACE' and st_zmflag(body) = 2
             else false
           end)
);

create table semap.instance (
  instance_id              bigint generated always as identity primary key,
  uid                      uuid not null default gen_random_uuid(),
  map_id                   integer not null references semap.map on delete cascade,
  name                     text not null check (name <> ''),
  alias                    text,
  concept_id               integer not null references semap.concept,
  frame_id                 bigint not null references semap.frame,
  relative_description_id  bigint references semap.description on delete set null,
  absolute_description_id  bigint unique references semap.description,
  storey_id                bigint references semap.instance on delete set null,
  attributes               jsonb not null default '{}' check (jsonb_typeof(attributes) = 'object'),
  created_at               timestamptz not null default clock_timestamp(),
  updated_at               timestamptz not null default clock_timestamp(),
  unique (map_id, name) deferrable,
  unique (map_id, uid) deferrable
);
create index instance_map on semap.instance (map_id, instance_id);
create index instance_map_name on semap.instance (map_id, name collate "C", instance_id);
create index instance_concept on semap.instance (concept_id);
create index instance_frame on semap.instance (frame_id);
create index instance_description on semap.instance (relative_description_id);
create index instance_shapeless on semap.instance (map_id) where relative_description_id is null;
create index instance_storey on semap.instance (storey_id);
create index instance_attributes on semap.instance using gin (attributes jsonb_path_ops);

create table semap.abstraction (
  abstraction_id  bigint generated always as identity primary key,
  description_id  bigint not null references semap.description on delete cascade,
  instance_id     bigint references semap.instance on delete cascade,
  type            text not null,
  geometry        public.geometry not null,
  z_min_m         double precision,
  z_max_m         double precision,
  unique (description_id, type),
  check (z_min_m < z_max_m),
  constraint abstraction_is_of_its_type
    check (case
             when type in ('Footprint', 'FootprintHull', 'FootprintBox', 'AxisAligned2D')
               then geometrytype(geometry) in ('POLYGON', 'MULTIPOLYGON')
                    and not st_isempty(geometry) and st_isvalid(geometry)
             when type = 'Line' then geometrytype(geometry) in ('LINESTRING', 'MULTILINESTRING')
               and st_zmflag(geometry) = 0 and not st_isempty(geometry) and st_length(geometry) > 0
             when type = 'Position2D' then geometrytype(geometry) = 'POINT' and st_zmflag(geometry) = 0
             when type = 'Position3D' then geometrytype(geometry) = 'POINT' and st_zmflag(geometry) = 2
             when type in ('AxisAligned3D', 'BoundingBox', 'BoundingHull')
               then geometrytype(geometry) = 'TIN'
             else false
           end)
);
create index abstraction_instance on semap.abstraction (instance_id, type);
do $$
declare
  v_type  text;
begin
  foreach v_type in array array[
    'Footprint', 'FootprintHull', 'FootprintBox', 'AxisAligned2D', 'Position2D',
    'Position3D', 'AxisAligned3D', 'BoundingBox', 'BoundingHull'
  ] loop
    execute format(
      'create index abstraction_%s on semap.abstraction using gist (geometry gist_geometry_ops_%s)
       where type = %L and instance_id is not null',
      lower(v_type), case when v_type ~ '3D|^Bounding' then 'nd' else '2d' end, v_type);
  end loop;
end $$;

create table semap.door_room (
  door_id  bigint not null references semap.instance on delete cascade,
  room_id  bigint not null references semap.instance on delete cascade,
  primary key (door_id, room_id),
  check (door_id <> room_id)
);
create index door_room_room on semap.door_room (room_id);
