-- Concepts, maps, and what a map has as a whole: where it lies on Earth, and its grids.
create extension if not exists postgis with schema public;

create table semap.concept (
  concept_id        integer generated always as identity primary key,
  name              text not null unique check (name <> ''),
  comment           text,
  attribute_schema  jsonb check (jsonb_typeof(attribute_schema) = 'object')
);

create table semap.concept_parent (
  concept_id  integer not null references semap.concept on delete cascade,
  parent_id   integer not null references semap.concept on delete cascade,
  primary key (concept_id, parent_id),
  check (parent_id <> concept_id)
);
create index concept_parent_parent on semap.concept_parent (parent_id);

create table semap.concept_iri (
  concept_id  integer not null references semap.concept on delete cascade,
  iri         text not null check (iri ~ '^[a-z][a-z0-9+.-]*:'),
  primary key (concept_id, iri)
);
create index concept_iri_iri on semap.concept_iri (iri);

insert into semap.concept (name) values ('Thing');

with kind (name, parent, iris) as (values
  ('Space', 'Thing', array['bot:Zone', 'ifc:IfcSpatialElement']),
  ('Storey', 'Space', array['bot:Storey', 'ifc:IfcBuildingStorey', 'brick:Floor']),
  ('Room', 'Space', array['bot:Space', 'ifc:IfcSpace', 'brick:Room']),
  ('Opening', 'Thing', array['ifc:IfcOpeningElement']),
  ('Door', 'Opening', array['ifc:IfcDoor']),
  ('Window', 'Opening', array['ifc:IfcWindow']),
  ('Agent', 'Thing', array['foaf:Agent']),
  ('Person', 'Agent', array['foaf:Person']),
  ('Robot', 'Agent', array[]::text[]),
  ('Furniture', 'Thing', array['ifc:IfcFurnishingElement', 'brick:Furniture']),
  ('Chair', 'Furniture', array[]::text[]),
  ('Table', 'Furniture', array[]::text[]),
  ('Cupboard', 'Furniture', array[]::text[]),
  ('Obstacle', 'Thing', array[]::text[]),
  ('Passage', 'Thing', array[]::text[]),
  ('Stair', 'Passage', array['ifc:IfcStair']),
  ('Ramp', 'Passage', array['ifc:IfcRamp']),
  ('Lift', 'Passage', array['ifc:IfcTransportElement'])
), made as (
  insert into semap.concept (name) select name from kind returning concept_id, name
), known as (
  select concept_id, name from made union all select concept_id, name from semap.concept
), below as (
  insert into semap.concept_parent (concept_id, parent_id)
  select m.concept_id, p.concept_id
  from kind k join made m on m.name = k.name join known p on p.name = k.parent
)
insert into semap.concept_iri (concept_id, iri)
select m.concept_id,
       case split_part(iri, ':', 1)
         when 'bot' then 'https://w3id.org/bot#'
         when 'ifc' then 'https://standards.buildingsmart.org/IFC/DEV/IFC4/ADD2/OWL#'
         when 'brick' then 'https://brickschema.org/schema/Brick#'
         when 'foaf' then 'http://xmlns.com/foaf/0.1/'
       end || split_part(iri, ':', 2)
from kind k join made m on m.name = k.name, unnest(k.iris) iri;

create table semap.map (
  map_id      integer generated always as identity primary key,
  uid         uuid not null unique default gen_random_uuid(),
  name        text not null unique check (name <> ''),
  cell_m      double precision not null default 4 check (cell_m between 0.1 and 1e6),
  created_at  timestamptz not null default clock_timestamp()
);

create table semap.map_anchor (
  map_id  integer primary key references semap.map on delete cascade,
  epsg    integer not null check (epsg between 1024 and 32767),
  x_m     double precision not null default 0,
  y_m     double precision not null default 0,
  z_m     double precision not null default 0,
  qx      double precision not null default 0,
  qy      double precision not null default 0,
  qz      double precision not null default 0,
  qw      double precision not null default 1,
  check (abs(qx * qx + qy * qy + qz * qz + qw * qw - 1) < 1e-6)
);

create table semap.map_grid (
  map_id           integer not null references semap.map on delete cascade,
  name             text not null check (name <> ''),
  resolution_m     double precision not null check (resolution_m > 0),
  origin_x_m       double precision not null,
  origin_y_m       double precision not null,
  origin_yaw_rad   double precision not null default 0,
  negate           boolean not null default false,
  occupied_thresh  double precision not null default 0.65,
  free_thresh      double precision not null default 0.196,
  mode             text not null default 'trinary' check (mode in ('trinary', 'scale', 'raw')),
  width            integer not null check (width > 0),
  height           integer not null check (height > 0),
  pixels           bytea not null,
  primary key (map_id, name),
  check (octet_length(pixels) = width * height)
);
