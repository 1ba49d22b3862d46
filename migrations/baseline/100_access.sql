-- Tokens of the service and logins of the database: who may do what, on which maps.
create table semap.token (
  token_id      integer generated always as identity primary key,
  name          text not null check (length(name) between 1 and 200),
  hash          bytea not null unique check (length(hash) = 32),
  hint          text not null,
  scopes        text[] not null check (
    cardinality(scopes) > 0 and scopes <@ array['read', 'write', 'ingest', 'admin']),
  all_maps      boolean not null,
  created_at    timestamptz not null default clock_timestamp(),
  created_by    text not null,
  expires_at    timestamptz,
  last_used_at  timestamptz,
  revoked_at    timestamptz,
  constraint admin_is_for_all_maps check (all_maps or not 'admin' = any (scopes))
);
create unique index token_name on semap.token (name) where revoked_at is null;
comment on table semap.token is 'Who may call the service. A token that was revoked stays, to be seen.';
comment on column semap.token.hash is
  'SHA-256 of the token. With 256 random bits there is nothing to guess: a slow hash would add nothing.';
comment on column semap.token.hint is 'How the token begins, to be recognised.';

create table semap.token_map (
  token_id  integer not null references semap.token on delete cascade,
  map_id    integer not null references semap.place on delete cascade,
  primary key (token_id, map_id)
);
create index token_map_map on semap.token_map (map_id);
comment on table semap.token_map is
  'The maps of a token that is not for all maps. A deleted map leaves it and does not return by its name.';

create table semap.login_map (
  login   regrole not null,
  map_id  integer not null references semap.map on delete cascade,
  primary key (login, map_id)
);
create index login_map_map on semap.login_map (map_id);
comment on table semap.login_map is
  'The maps of each login, or of a role that logins are members of, that may not see every map.';
