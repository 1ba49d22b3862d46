-- Which maps a session may see. What counts is the role that was set, else the login, with all that it is a member of:
-- in a function that acts for its owner current_user is the owner. Anybody can set semap.maps, so that it is believed
-- of those alone who may see every map anyhow, as the service's login may; any other login has the maps that
-- semap.login_map names, and may narrow them.

-- Whether somebody has such a part ('usage', 'member', 'set') in one of the roles that see every map.
create or replace function semap.sees_every_map(p_role name, p_part text) returns boolean
language plpgsql stable parallel safe set search_path = pg_catalog, pg_temp as $$
begin
  return pg_has_role(p_role, 'semap_read', p_part) or pg_has_role(p_role, 'semap_api', p_part)
      or pg_has_role(p_role, 'semap_ingest', p_part) or pg_has_role(p_role, 'semap_worker', p_part)
      or pg_has_role(p_role, 'semap_admin', p_part);
end $$;

-- The maps that the caller of this transaction is restricted to; null where there is no restriction. Whoever may see
-- every map and sets the role of somebody who may not is restricted to none until semap.maps tells which.
create or replace function semap.visible_maps() returns integer[]
language plpgsql stable parallel safe security definer set search_path = pg_catalog, pg_temp as $$
declare
  v_told   integer[] := nullif(current_setting('semap.maps', true), '')::integer[];
  -- before PostgreSQL 16 each member of a role may set it
  v_might  text := case when current_setting('server_version_num')::integer < 160000 then 'member'
                        else 'usage, set' end;
begin
  if not semap.sees_every_map(session_user, v_might) then
    return array(
      select distinct map_id from semap.login_map
      where pg_has_role(session_user, login::oid, v_might) and (v_told is null or map_id = any (v_told)));
  elsif v_told is not null then
    return v_told;
  elsif not semap.sees_every_map(coalesce(nullif(current_setting('role'), 'none'), session_user), 'usage') then
    return '{}';
  end if;
  return null;
end $$;
