"""The map: concepts, frames, descriptions with their geometry, instances."""

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
    create table semap.concept (
      concept_id  integer generated always as identity primary key,
      name        text not null unique check (name <> ''),
      parent_id   integer references semap.concept check (parent_id <> concept_id)
    )
    """,
    """
    insert into semap.concept (name) values ('Thing')
    """,
    """
    insert into semap.concept (name, parent_id)
    select child, (select concept_id from semap.concept where name = 'Thing')
    from unnest(array['Space', 'Opening', 'Agent', 'Furniture']) as child
    """,
    """
    insert into semap.concept (name, parent_id)
    select child, p.concept_id
    from (values ('Storey', 'Space'), ('Room', 'Space'), ('Door', 'Opening'),
                 ('Person', 'Agent'), ('Robot', 'Agent')) as v (child, parent)
    join semap.concept p on p.name = v.parent
    """,
    """
    create table semap.frame (
      frame_id   bigint generated always as identity primary key,
      map_id     integer not null references semap.map on delete cascade,
      name       text not null check (name <> ''),
      parent_id  bigint references semap.frame on delete cascade check (parent_id <> frame_id),
      unique (map_id, name)
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
    create table semap.description (
      description_id  bigint generated always as identity primary key,
      map_id          integer not null references semap.map on delete cascade
    )
    """,
    "create index description_map on semap.description (map_id)",
    """
    create table semap.geometry (
      geometry_id     bigint generated always as identity primary key,
      description_id  bigint not null references semap.description on delete cascade,
      type            text not null check (type in ('Body')),
      body            public.geometry(geometryz) not null,
      unique (description_id, type)
    )
    """,
    """
    create table semap.abstraction (
      abstraction_id  bigint generated always as identity primary key,
      description_id  bigint not null references semap.description on delete cascade,
      type            text not null check (type in ('Footprint', 'FootprintHull', 'Position3D')),
      geometry        public.geometry not null,
      z_min_m         double precision,
      z_max_m         double precision,
      unique (description_id, type),
      check (z_min_m < z_max_m),
      constraint footprint_is_an_area
        check (type not in ('Footprint', 'FootprintHull')
               or (geometrytype(geometry) in ('POLYGON', 'MULTIPOLYGON')
                   and not st_isempty(geometry) and st_isvalid(geometry)))
    )
    """,
    """
    create index abstraction_footprint on semap.abstraction using gist (geometry)
    where type = 'Footprint'
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
      relative_description_id  bigint unique references semap.description,
      absolute_description_id  bigint unique references semap.description,
      storey_id                bigint references semap.instance on delete set null,
      attributes               jsonb not null default '{}' check (jsonb_typeof(attributes) = 'object'),
      created_at               timestamptz not null default clock_timestamp(),
      updated_at               timestamptz not null default clock_timestamp(),
      unique (map_id, name),
      unique (map_id, uid)
    )
    """,
    "create index instance_concept on semap.instance (concept_id)",
    "create index instance_frame on semap.instance (frame_id)",
    "create index instance_storey on semap.instance (storey_id)",
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
