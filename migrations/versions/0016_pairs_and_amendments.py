"""Relations of any two sides; crossings of lines; places of crossings; changes that are taken back."""

from alembic import op

revision = "0016"
down_revision = "0015"

QUERY = (
    """
    alter table semap.continuous_query
      drop constraint predicate_is_known,
      drop constraint distance_is_given,
      add constraint predicate_is_known check (predicate in (
        'contains', 'covers', 'intersects', 'within_distance', 'nearest', 'on', 'in_front_of', 'behind',
        'left_of', 'right_of', 'crosses', 'facing', 'approaching')),
      add column subject_kind text not null default 'track' check (subject_kind in ('track', 'instance')),
      add column object_kind text not null default 'instance' check (object_kind in ('track', 'instance')),
      add column count integer check (count between 1 and 100),
      add column angle_rad double precision check (angle_rad > 0 and angle_rad <= pi()),
      add column speed_mps double precision check (speed_mps > 0),
      add column direction text check (direction in ('left_to_right', 'right_to_left')),
      add constraint count_is_given check ((count is not null) = (predicate = 'nearest')),
      add constraint angle_is_given check ((angle_rad is not null) = (predicate = 'facing')),
      add constraint speed_is_given check ((speed_mps is not null) = (predicate = 'approaching')),
      add constraint only_lines_have_a_direction check (direction is null or predicate = 'crosses'),
      add constraint distance_is_given check (case
        when predicate in ('within_distance', 'in_front_of', 'behind', 'left_of', 'right_of', 'approaching')
          then distance_m is not null
        when predicate in ('nearest', 'facing') then true
        else distance_m is null end)
    """,
    # what the regions cannot answer, which ask only where a track is
    """
    alter table semap.continuous_query
      add column in_pairs boolean not null generated always as (
        subject_kind = 'instance' or object_kind = 'track'
        or predicate in ('intersects', 'nearest', 'crosses', 'facing', 'approaching')) stored
    """,
    # two things that a query follows: held is the relation, inside what it follows once that has lasted
    """
    create table semap.pair (
      pair_id              bigint generated always as identity primary key,
      map_id               integer not null,
      query_id             integer not null,
      track_id             bigint,
      subject_instance_id  bigint,
      instance_id          bigint,
      object_track_id      bigint,
      held                 boolean not null,
      since                timestamptz,
      inside               boolean not null,
      inside_at            timestamptz,
      distance_m           double precision,
      distance_at          timestamptz,
      unique nulls not distinct (query_id, track_id, subject_instance_id, instance_id, object_track_id),
      check (num_nonnulls(track_id, subject_instance_id) = 1),
      check (num_nonnulls(instance_id, object_track_id) = 1),
      check (held = (since is not null))
    )
    """,
    "create index pair_track on semap.pair (track_id) where track_id is not null",
    "create index pair_object_track on semap.pair (object_track_id) where object_track_id is not null",
    "create index pair_instance on semap.pair (instance_id) where instance_id is not null",
    "create index pair_subject_instance on semap.pair (subject_instance_id)"
    " where subject_instance_id is not null",
)
CHANGE = (
    "alter type semap.change_kind add value 'crossed'",
    """
    alter table semap.relation_change
      alter track_id drop not null,
      alter track_name drop not null,
      alter instance_id drop not null,
      alter instance_name drop not null,
      add column subject_instance_id bigint,
      add column subject_instance_name text,
      add column object_track_id bigint,
      add column object_track_name text,
      add column direction text check (direction in ('left_to_right', 'right_to_left')),
      add column door_id bigint,
      add column door_name text,
      add column edge integer,
      add column amendment text check (amendment in ('added', 'retracted')),
      add column retracts uuid,
      add constraint subject_is_one_thing check (num_nonnulls(track_id, subject_instance_id) = 1),
      add constraint object_is_one_thing check (num_nonnulls(instance_id, object_track_id) = 1),
      add constraint retraction_says_what
        check ((retracts is not null) = (amendment is not distinct from 'retracted'))
    """,
    "create index relation_change_retracts on semap.relation_change (retracts) where retracts is not null",
    """
    alter table semap.relation_past
      alter track_id drop not null,
      alter track_name drop not null,
      alter instance_id drop not null,
      alter instance_name drop not null,
      add column subject_instance_id bigint,
      add column subject_instance_name text,
      add column object_track_id bigint,
      add column object_track_name text,
      add check (num_nonnulls(track_id, subject_instance_id) = 1),
      add check (num_nonnulls(instance_id, object_track_id) = 1)
    """,
)


def upgrade() -> None:
    for statement in (*QUERY, *CHANGE):
        op.execute(statement)
