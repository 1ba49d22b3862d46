-- What differs from what it follows from (sql/500, 505) is made anew, map by map, while nobody writes. What a client or
-- a rule has to know is told as any change of the map is: a relation began or ended, with the cause `map`.

-- Write the present of each track of a map anew where it is not that of its newest state.
create or replace function semap.repair_presents(p_map_id integer) returns void
language plpgsql as $$
declare
  v_ids  bigint[];
begin
  perform semap.flush_maps(array[p_map_id]);
  select array_agg(distinct track_id) into v_ids from semap.present_differences(p_map_id);
  if v_ids is null then
    return;
  end if;
  insert into semap.track_now (track_id, source_id, map_id, cell_m)
  select k.track_id, k.source_id, k.map_id, m.cell_m from semap.track k join semap.map m using (map_id)
  where k.track_id = any (v_ids)
  on conflict (track_id) do update
  set source_id = excluded.source_id, map_id = excluded.map_id, cell_m = excluded.cell_m;
  perform semap.write_presents(v_ids, array(select s from semap.newest_states(v_ids, '-infinity') s));
end $$;

-- Write the regions of a map anew where they are not what the queries and the map ask for, and the cells and edges of
-- all. Those that nobody asks for stay, for what ends with them. Says which stateful ones are other ones now.
create or replace function semap.repair_regions(p_map_id integer) returns integer[]
language plpgsql as $$
declare
  v_columns   text;
  v_excluded  text;
  v_changed   integer[];
begin
  select string_agg(quote_ident(attname), ', '), string_agg('excluded.' || quote_ident(attname), ', ')
    into v_columns, v_excluded
  from pg_attribute where attrelid = 'semap.region_wanted'::regclass and attnum > 0;
  execute format(
    'with written as ('
    ' insert into semap.region (%1$s) select %1$s from semap.region_wanted'
    ' where map_id = $1 and (query_id, instance_id) in (select query_id, instance_id from semap.region_differences($1))'
    ' on conflict (query_id, instance_id) do update set (%1$s) = row(%2$s) returning region_id, stateful)'
    ' select array_agg(region_id) filter (where stateful) from written', v_columns, v_excluded)
  into v_changed using p_map_id;
  perform semap.index_regions(array_agg(region_id)) from semap.region where map_id = p_map_id;
  return coalesce(v_changed, '{}');
end $$;

-- Take back one of two changes in a row of a map that say the same.
create or replace function semap.take_back_repeated(p_map_id integer) returns void
language sql as $$
  insert into semap.relation_change (uid, map_id, query_id, query_name, track_id, track_name, instance_id,
                                     instance_name,
                                     subject_instance_id, subject_instance_name, object_track_id, object_track_name,
                                     kind, cause, stamp, transition_at, since, x_m, y_m, amendment, retracts)
  select gen_random_uuid(), c.map_id, c.query_id, c.query_name, c.track_id, c.track_name, c.instance_id,
         c.instance_name,
         c.subject_instance_id, c.subject_instance_name, c.object_track_id, c.object_track_name,
         c.kind, 'map', c.stamp, c.transition_at, c.since, c.x_m, c.y_m, 'retracted', c.uid
  from semap.log_differences(p_map_id) d
  join semap.relation_change c using (change_id)
  join semap.folded_changes(p_map_id) f on (f.change).change_id = c.change_id
  where f.before_kind = c.kind or f.before_kind is null and c.kind = 'ended'
$$;

-- End in the log of a map what holds by it in regions that are gone, each at the last stamp of its track.
create or replace function semap.end_in_gone_regions(p_map_id integer) returns void
language sql as $$
  with open as (
    select (f.change).* from semap.folded_changes(p_map_id) f
    where f.is_newest and (f.change).kind = 'began' and (f.change).track_id is not null
      and (f.change).instance_id is not null
      and not exists (select from semap.continuous_query q where q.query_id = (f.change).query_id and q.in_pairs)
  ), adrift as (
    select o.* from open o left join semap.region r using (query_id, instance_id) where r.region_id is null
  ), moment as (
    select a.change_id, greatest(t.stamp, a.transition_at) as at from adrift a left join semap.track_now t
      using (track_id)
  )
  insert into semap.relation_change (uid, map_id, query_id, query_name, track_id, track_name, instance_id,
                                     instance_name,
                                     kind, cause, stamp, transition_at, since)
  select gen_random_uuid(), map_id, query_id, query_name, a.track_id, track_name, instance_id, instance_name,
         'ended', 'map', at, at, transition_at
  from adrift a join moment using (change_id)
$$;

-- Make relations of a map what its log says that they are, since that is what clients and rules believe; a stay in a
-- region that is gone ends. Says which pairs were written.
create or replace function semap.relate_as_logged(p_map_id integer)
returns table (track_id bigint, region_id integer)
language plpgsql as $$
begin
  perform semap.take_back_repeated(p_map_id);
  perform semap.end_in_gone_regions(p_map_id);
  return query
  with open as (
    select r.query_id, r.map_id, (f.change).track_id, r.instance_id, (f.change).transition_at as since
    from semap.folded_changes(p_map_id) f
    join semap.region r on r.query_id = (f.change).query_id and r.instance_id = (f.change).instance_id
    where f.is_newest and (f.change).kind = 'began' and (f.change).track_id is not null
  ), unsaid as (
    delete from semap.relation n
    where n.map_id = p_map_id and not n.in_pairs
      and not exists (select from open o
                      where o.query_id = n.query_id and o.track_id = n.track_id and o.instance_id = n.instance_id)
      and (n.since >= coalesce((select gone_before from semap.retention where kind = 'changes'), '-infinity')
           or not exists (select from semap.region r where r.query_id = n.query_id and r.instance_id = n.instance_id
                          and (n.confirmed or r.stateful)))
    returning n.query_id, n.track_id, n.instance_id
  ), said as (
    insert into semap.relation as n (query_id, map_id, track_id, instance_id, confirmed, since, pending, raw)
    select o.query_id, o.map_id, o.track_id, o.instance_id, true, o.since, true, true from open o
    on conflict on constraint relation_pkey do update set confirmed = true, since = excluded.since
    where n.since is distinct from excluded.since
    returning n.query_id, n.track_id, n.instance_id
  )
  select w.track_id, r.region_id
  from (select * from unsaid union select * from said) w
  join semap.region r on r.query_id = w.query_id and r.instance_id = w.instance_id;
end $$;

-- Who should be related to what on a map by now: of these relations (tracks and regions), which begin anew, each is
-- looked at; other stateful ones stay as they are.
create or replace function semap.wanted_relations(p_map_id integer, p_anew semap.crossing[])
returns table (track_id bigint, region_id integer)
language sql stable as $$
  with truth as (
    select track_id, region_id from semap.plain_relations(p_map_id)
    union all
    select h.track_id, r.region_id
    from semap.relation h join semap.region r using (query_id, instance_id) join semap.track_now t using (track_id)
    where h.map_id = p_map_id and h.confirmed and r.stateful
      -- how a reading stands to a region its own replay says
      and (semap.reads_amended(r.query_id, h.track_id)
           or t.live and not exists (select from unnest(p_anew) p
                                     where p.track_id = h.track_id and p.region_id = r.region_id))
    union all
    select t.track_id, r.region_id
    from unnest(p_anew) p
    join semap.track_now t on t.track_id = p.track_id and t.live
    join semap.region r on r.region_id = p.region_id and r.stateful
    where not semap.reads_amended(r.query_id, t.track_id)
      and (select raw from semap.stands(r, t.x_m, t.y_m, t.z_m, t.std_m))
      and (r.subject is null or exists (select from semap.query_track s
                                        where s.query_id = r.query_id and s.track_id = t.track_id and not s.is_object))
  )
  select t.track_id, t.region_id from truth t join semap.region r using (region_id)
  join semap.region_wanted w using (query_id, instance_id)
$$;

-- Make all that is kept of the relations of a map what it follows from. Relations with stateful regions that are named
-- (tracks and regions, in pairs) begin anew, as after an edit. Says how many relations began or ended by it.
create or replace function semap.repair_relations(p_map_id integer, p_track_ids bigint[], p_region_ids integer[])
returns bigint
language plpgsql set search_path = public, pg_temp as $$
declare
  v_changed    integer[];
  v_told       semap.crossing[];
  v_anew       semap.crossing[];
  v_crossings  semap.crossing[];
  v_pairs      bigint;
begin
  perform semap.lock_regions_exclusive(), semap.correct_all(p_map_id);
  perform semap.repair_presents(p_map_id);
  perform semap.choose_tracks(array_agg(query_id), null) from semap.continuous_query where map_id = p_map_id
  having count(*) > 0;
  v_changed := semap.repair_regions(p_map_id);
  select array_agg(row(track_id, region_id, null, null, null, null, null, null)::semap.crossing) into v_told
  from semap.relate_as_logged(p_map_id);

  select array_agg(row(track_id, region_id, null, null, null, null, null, null)::semap.crossing) into v_anew
  from (
    select track_id, region_id from unnest(p_track_ids, p_region_ids) p (track_id, region_id)
    union select track_id, region_id from unnest(v_told)
    union select n.track_id, r.region_id from semap.region r join semap.track_now n using (map_id)
    where r.region_id = any (v_changed)) p;
  perform semap.settle_relations(array_agg(n))
  from unnest(v_anew) p join semap.region r using (region_id)
  join semap.relation n on n.query_id = r.query_id and n.track_id = p.track_id and n.instance_id = r.instance_id;

  with crossed as (
    select coalesce(w.track_id, h.track_id) as track_id, coalesce(w.region_id, h.region_id) as region_id,
           case when h.track_id is null then 'began' else 'ended' end::semap.change_kind as kind
    from semap.wanted_relations(p_map_id, v_anew) w
    full join (select n.track_id, r.region_id from semap.relation n join semap.region r using (query_id, instance_id)
               where n.map_id = p_map_id and n.confirmed) h using (track_id, region_id)
    where w.track_id is null or h.track_id is null
  )
  select array_agg(row(c.track_id, c.region_id, c.kind, 'map', t.stamp, t.stamp, null, null)::semap.crossing)
    into v_crossings
  from crossed c join semap.track_now t using (track_id);
  perform semap.record_crossings(v_crossings);
  delete from semap.region r
  where r.map_id = p_map_id and not exists (
    select from semap.region_wanted w where w.query_id = r.query_id and w.instance_id = r.instance_id);

  -- whatever is kept of a track is looked up at its next state
  update semap.track_now t
  set region_ids = h.plain_ids, stateful_ids = h.stateful_ids, safe_x_min_m = 'infinity'
  from semap.regions_held(array(select track_id from semap.track_now where map_id = p_map_id)) h
  where t.track_id = h.track_id;
  v_pairs := semap.repair_pairs(p_map_id);
  perform semap.repair_past(p_map_id);
  return coalesce(cardinality(v_crossings), 0) + v_pairs;
end $$;

-- Make what is over on a map what its log says of it, as far back as that goes.
create or replace function semap.repair_past(p_map_id integer) returns void
language sql as $$
  with kept as (
    select coalesce((select gone_before from semap.retention where kind = 'changes'), '-infinity') as since
  ), told as (
    select c.*, row_number() over (partition by query_id, track_id, subject_instance_id, instance_id, object_track_id,
                                                since, transition_at order by change_id) as copy
    from semap.standing_changes(p_map_id) c where kind = 'ended' and transition_at >= (select since from kept)
  ), stored as (
    select p.*, row_number() over (partition by query_id, track_id, subject_instance_id, instance_id, object_track_id,
                                                since, until order by relation_past_id) as copy
    from semap.relation_past p where map_id = p_map_id and until >= (select since from kept)
  ), compared as (
    select s.relation_past_id, t.change_id
    from told t full join stored s
      on s.query_id = t.query_id and s.since = t.since and s.until = t.transition_at and s.copy = t.copy
      and coalesce(s.track_id, 0) = coalesce(t.track_id, 0) and coalesce(s.instance_id, 0) = coalesce(t.instance_id, 0)
      and coalesce(s.subject_instance_id, 0) = coalesce(t.subject_instance_id, 0)
      and coalesce(s.object_track_id, 0) = coalesce(t.object_track_id, 0)
    where s.relation_past_id is null or t.change_id is null
  ), gone as (
    delete from semap.relation_past
    where relation_past_id in (select relation_past_id from compared where relation_past_id is not null)
  )
  insert into semap.relation_past (map_id, query_id, query_name, track_id, track_name, subject_instance_id,
                                   subject_instance_name, instance_id, instance_name, object_track_id,
                                   object_track_name,
                                   since, until)
  select map_id, query_id, query_name, track_id, track_name, subject_instance_id, subject_instance_name,
         instance_id, instance_name, object_track_id, object_track_name, since, transition_at
  from semap.relation_change where change_id in (select change_id from compared where change_id is not null)
$$;
