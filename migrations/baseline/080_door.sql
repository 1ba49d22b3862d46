-- The leaves of doors, and how they stand.
create table semap.door_leaf (
  instance_id        bigint primary key references semap.instance on delete cascade,
  map_id             integer not null,
  hinge_x_m          double precision not null,
  hinge_y_m          double precision not null,
  closed_rad         double precision not null,
  sense              smallint not null check (sense in (-1, 1)),
  width_m            double precision not null check (width_m > 0),
  max_rad            double precision not null check (max_rad > 0),
  z_min_m            double precision not null,
  z_max_m            double precision not null,
  opening_above_rad  double precision not null,
  open_from_rad      double precision not null,
  turns_by_rad       double precision not null,
  closed_below_rad   double precision not null,
  rests_within_rad   double precision not null,
  rests_for          interval not null,
  range_of_motion    public.geometry not null
);
create index door_leaf_range_of_motion on semap.door_leaf using gist (range_of_motion);
comment on column semap.door_leaf.closed_rad is
  'Direction in the map frame from the hinge to the free edge of the closed leaf.';
comment on column semap.door_leaf.sense is
  'Opens counter-clockwise (1) or clockwise (-1), seen from above.';

create table semap.door_now (
  instance_id    bigint primary key references semap.door_leaf on delete cascade,
  stamp          timestamptz not null default '-infinity',
  state          text check (state in ('opening', 'open', 'closing', 'closed')),
  since          timestamptz,
  angle_rad      double precision,
  angle_std_rad  double precision,
  extreme_rad    double precision,
  rest_rad       double precision,
  rest_since     timestamptz,
  doubt          text
) with (fillfactor = 40);
comment on column semap.door_now.extreme_rad is
  'The largest angle since it began to open, or the smallest since it began to close.';
comment on column semap.door_now.rest_rad is 'Where the leaf has stayed since rest_since.';
comment on column semap.door_now.doubt is 'The state that the last observation alone would have made.';
