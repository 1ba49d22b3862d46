-- Shards and places. A directory knows the database of each shard, and on which shard each map is; a shard knows itself
-- and the maps that the directory has placed on it. A database that was never made either is a directory of its own.
create table semap.shard (
  shard_id  smallint primary key check (shard_id between 0 and 63),
  name      text not null unique check (name ~ '^[a-z0-9][a-z0-9_-]{0,62}$'),
  dsn       text,
  draining  boolean not null default false,
  added_at  timestamptz not null default clock_timestamp()
);
create unique index shard_here on semap.shard ((dsn is null)) where dsn is null;
comment on column semap.shard.shard_id is 'Its share of all ids: 0 is the directory itself (sql/015).';
comment on column semap.shard.dsn is 'Where its database is, for semap_admin alone; null: this database.';
insert into semap.shard (shard_id, name) values (0, 'main');

create table semap.place (
  map_id    integer primary key,
  name      text not null unique check (name <> ''),
  shard_id  smallint not null references semap.shard
);
create index place_shard on semap.place (shard_id);
comment on table semap.place is
  'On which shard each map is. That names are unique over all shards is said by the directory: the uid of a map, and '
  'with it the ids of its events, are made of its name. A place may be there before its map.';
