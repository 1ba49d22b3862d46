-- Who changed what on the map, and how it was before.
create table semap.change_set (
  change_set_id  bigint generated always as identity primary key,
  made_at        timestamptz not null,
  author         text not null,
  message        text,
  undoes_id      bigint references semap.change_set
);
create index change_set_made_at on semap.change_set (made_at);

create table semap.row_version (
  version_id     bigint generated always as identity primary key,
  change_set_id  bigint not null references semap.change_set,
  map_id         integer,
  table_name     text not null,
  row_key        text not null,
  content        jsonb,
  shape          public.geometry
);
create index row_version_row on semap.row_version (table_name, row_key, version_id);
create index row_version_change_set on semap.row_version (change_set_id);
create index row_version_map on semap.row_version (map_id, change_set_id);
