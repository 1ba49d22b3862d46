-- States that left the calm of their track, on their way to relations.

-- A state with what was known of its track before it.
create or replace function semap.arrival_of(p_state semap.track_state, p_now semap.track_now) returns semap.arrival
language sql immutable parallel safe as $$
  select semap.new_arrival(
    p_state, source_id => (p_now).source_id, map_id => (p_now).map_id, cell_m => (p_now).cell_m, live => (p_now).live,
    seen_stamp => (p_now).stamp, from_x_m => (p_now).x_m, from_y_m => (p_now).y_m, from_z_m => (p_now).z_m,
    region_ids => (p_now).region_ids, outlier_stamp => (p_now).outlier_stamp)
$$;

-- Refuse a state of a track that nobody knows.
create or replace function semap.refuse_unknown(p_track_id bigint) returns void
language plpgsql as $$
begin
  raise exception 'There is no track %.', p_track_id
    using errcode = 'foreign_key_violation', hint = 'Insert the track into semap.track first.';
end $$;

-- Refuse a batch that holds states of unknown tracks, or of several sources.
create or replace function semap.refuse_strange(p_source_id integer, p_arrivals semap.arrival[]) returns void
language plpgsql as $$
declare
  v_track_id  bigint;
begin
  select min((a.state).track_id) into v_track_id from unnest(p_arrivals) a where source_id is null;
  if v_track_id is not null then
    perform semap.refuse_unknown(v_track_id);
  end if;
  raise exception 'The states of one statement come from more than one source.'
    using errcode = 'cardinality_violation', hint = 'Insert or copy the states of each source by themselves.';
end $$;

-- Bring tracks to where these states say, and give what began and ended by it with plain regions, at the stamp of the
-- first state that shows it. The states of one track come in any order, none of them late.
create or replace function semap.move_tracks(p_arrivals semap.arrival[]) returns semap.crossing[]
language plpgsql as $$
declare
  v_crossings  semap.crossing[];
begin
  with located as (
    select s.*, a.map_id, a.cell_m, a.live, a.region_ids, g.region_ids as here_ids, g.z_min_m as calm_z_min_m,
           g.z_max_m as calm_z_max_m
    from unnest(p_arrivals) a cross join lateral (select (a.state).*) s
    cross join lateral semap.regions_at(a.map_id, a.cell_m, s.x_m, s.y_m, s.z_m) g
  ), stepped as (
    select *, lag(is_last, 1, not live) over one_track as appears,
           lead(stamp) over one_track is null as is_present, first_value(stamp) over one_track as first_stamp,
           lag(case when is_last then '{}' else here_ids end, 1, region_ids) over one_track as before_ids
    from located
    window one_track as (partition by track_id order by stamp)
  ), crossed as (
    select track_id, region_id, 'began'::semap.change_kind as kind,
           case when appears then 'appeared' else 'moved' end::semap.change_cause as cause, stamp
    from stepped, unnest(here_ids) region_id
    where here_ids <> before_ids and region_id <> all (before_ids)
    union all
    select track_id, region_id, 'ended', 'moved', stamp
    from stepped, unnest(before_ids) region_id
    where here_ids <> before_ids and region_id <> all (here_ids)
    union all
    select track_id, region_id, 'ended', 'disappeared', stamp
    from stepped, unnest(here_ids) region_id
    where is_last
  ), moved as (
    update semap.track_now t
    set live = true, first_stamp = least(t.first_stamp, n.first_stamp),
        stamp = n.stamp, x_m = n.x_m, y_m = n.y_m, z_m = n.z_m,
        std_m = n.std_m, std_across_m = n.std_across_m, std_yaw_rad = n.std_yaw_rad,
        heading_rad = n.heading_rad, speed_mps = n.speed_mps, length_m = n.length_m, width_m = n.width_m,
        region_ids = case when n.is_last then '{}' else n.here_ids end,
        calm_x_min_m = c.x_min_m, calm_x_max_m = c.x_max_m, calm_y_min_m = c.y_min_m, calm_y_max_m = c.y_max_m,
        calm_z_min_m = n.calm_z_min_m, calm_z_max_m = n.calm_z_max_m, calm_std_m = c.std_m
    from stepped n cross join lateral semap.calm_rectangle(n.map_id, n.cell_m, n.x_m, n.y_m, n.std_m) c
    where t.track_id = n.track_id and n.is_present
  )
  select array_agg(row(track_id, region_id, kind, cause, stamp, stamp, null, null)::semap.crossing
                   order by stamp, cause = 'disappeared')
  into v_crossings from crossed;
  return v_crossings;
end $$;
