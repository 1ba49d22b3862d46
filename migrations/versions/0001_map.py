"""The map: concepts, frames, descriptions with their geometries, instances with their abstractions."""

from alembic import op

revision = "0001"
down_revision = None

STATEMENTS = (
    "create extension if not exists postgis with schema public",
    """
    create table semap.behaviour (
      checksum    text not null,
      applied_at  timestamptz not null default clock_timestamp()
    )
    """,
    """
    create table semap.map (
      map_id      integer generated always as identity primary key,
      uid         uuid not null unique default gen_random_uuid(),
      name        text not null unique check (name <> ''),
      cell_m      double precision not null default 4 check (cell_m between 0.1 and 1e6),
      created_at  timestamptz not null default clock_timestamp()
    )
    """,
    """
    create table semap.map_anchor (
      map_id  integer primary key references semap.map on delete cascade,
      epsg    integer not null check (epsg between 1024 and 32767),
      x_m  double precision not null default 0,
      y_m  double precision not null default 0,
      z_m  double precision not null default 0,
      qx   double precision not null default 0,
      qy   double precision not null default 0,
      qz   double precision not null default 0,
      qw   double precision not null default 1,
      check (abs(qx * qx + qy * qy + qz * qz + qw * qw - 1) < 1e-6)
    )
    """,
    """
    create table semap.map_grid (
      map_id        integer not null references semap.map on delete cascade,
      name          text not null check (name <> ''),
      resolution_m  double precision not null check (resolution_m > 0),
      origin_x_m    double precision not null,
      origin_y_m    double precision not null,
      origin_yaw_rad  double precision not null default 0,
      negate            boolean not null default false,
      occupied_thresh   double precision not null default 0.65,
      free_thresh       double precision not null default 0.196,
      mode          text not null default 'trinary' check (mode in ('trinary', 'scale', 'raw')),
      width         integer not null check (width > 0),
      height        integer not null check (height > 0),
      pixels        bytea not null,
      primary key (map_id, name),
      check (octet_length(pixels) = width * height)
    )
    """,
    """
    create table semap.concept (
      concept_id        integer generated always as identity primary key,
      name              text not null unique check (name <> ''),
      comment           text,
      attribute_schema  jsonb check (jsonb_typeof(attribute_schema) = 'object')
    )
    """,
    """
    create table semap.concept_parent (
      concept_id  integer not null references semap.concept on delete cascade,
      parent_id   integer not null references semap.concept on delete cascade,
      primary key (concept_id, parent_id),
      check (parent_id <> concept_id)
    )
    """,
    "create index concept_parent_parent on semap.concept_parent (parent_id)",
    """
    create table semap.concept_iri (
      concept_id  integer not null references semap.concept on delete cascade,
      iri         text not null check (iri ~ '^[a-z][a-z0-9+.-]*:'),
      primary key (concept_id, iri)
    )
    """,
    "create index concept_iri_iri on semap.concept_iri (iri)",
    """
    insert into semap.concept (name) values ('Thing')
    """,
    """
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
    from kind k join made m on m.name = k.name, unnest(k.iris) iri
    """,
    """
    create table semap.frame (
      frame_id   bigint generated always as identity primary key,
      map_id     integer not null references semap.map on delete cascade,
      name       text not null check (name <> ''),
      parent_id  bigint references semap.frame on delete cascade,
      unique (map_id, name) deferrable
    )
    """,
    "create index frame_parent on semap.frame (parent_id)",
    """
    create table semap.frame_pose (
      frame_id  bigint not null references semap.frame on delete cascade,
      stamp     timestamptz not null default '-infinity',
      x_m  double precision not null default 0,
      y_m  double precision not null default 0,
      z_m  double precision not null default 0,
      qx   double precision not null default 0,
      qy   double precision not null default 0,
      qz   double precision not null default 0,
      qw   double precision not null default 1,
      primary key (frame_id, stamp),
      check (abs(qx * qx + qy * qy + qz * qz + qw * qw - 1) < 1e-6)
    )
    """,
    """
    create type semap.pose as (
      x_m double precision, y_m double precision, z_m double precision,
      qx double precision, qy double precision, qz double precision, qw double precision
    )
    """,
    """
    create table semap.description (
      description_id  bigint generated always as identity primary key,
      map_id          integer not null references semap.map on delete cascade,
      name            text check (name <> ''),
      is_absolute     boolean not null default false,
      unique (map_id, name) deferrable,
      check (name is null or not is_absolute)
    )
    """,
    "create index description_map on semap.description (map_id)",
    """
    create table semap.geometry (
      geometry_id     bigint generated always as identity primary key,
      description_id  bigint not null references semap.description on delete cascade,
      name            text not null default 'Body' check (name <> ''),
      type            text not null,
      body            public.geometry not null,
      x_m  double precision not null default 0,
      y_m  double precision not null default 0,
      z_m  double precision not null default 0,
      qx   double precision not null default 0,
      qy   double precision not null default 0,
      qz   double precision not null default 0,
      qw   double precision not null default 1,
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
    )
    """,
    """
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
    )
    """,
    "create index instance_concept on semap.instance (concept_id)",
    "create index instance_frame on semap.instance (frame_id)",
    "create index instance_description on semap.instance (relative_description_id)",
    "create index instance_attributes on semap.instance using gin (attributes jsonb_path_ops)",
    "create index instance_storey on semap.instance (storey_id)",
    """
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
                 when type = 'Position2D' then geometrytype(geometry) = 'POINT' and st_zmflag(geometry) = 0
                 when type = 'Position3D' then geometrytype(geometry) = 'POINT' and st_zmflag(geometry) = 2
                 when type in ('AxisAligned3D', 'BoundingBox', 'BoundingHull')
                   then geometrytype(geometry) = 'TIN'
                 else false
               end)
    )
    """,
    "create index abstraction_instance on semap.abstraction (instance_id, type)",
    *(
        f"create index abstraction_{type_.lower()} on semap.abstraction using gist (geometry {operators})"
        f" where type = '{type_}' and instance_id is not null"
        for types, operators in (
            (
                ("Footprint", "FootprintHull", "FootprintBox", "AxisAligned2D", "Position2D"),
                "gist_geometry_ops_2d",
            ),
            (("Position3D", "AxisAligned3D", "BoundingBox", "BoundingHull"), "gist_geometry_ops_nd"),
        )
        for type_ in types
    ),
    """
    create table semap.door_room (
      door_id  bigint not null references semap.instance on delete cascade,
      room_id  bigint not null references semap.instance on delete cascade,
      primary key (door_id, room_id),
      check (door_id <> room_id)
    )
    """,
    "create index door_room_room on semap.door_room (room_id)",
)


def upgrade() -> None:
    for statement in STATEMENTS:
        op.execute(statement)
