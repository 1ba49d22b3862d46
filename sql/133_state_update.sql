-- States that left the safe region of their track, on their way to relations.

-- A state with what was known of its track before it.
create or replace function semap.update_of(p_state semap.track_state, p_now semap.track_now) returns semap.state_update
language sql immutable parallel safe as $$
  select semap.new_state_update(
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
create or replace function semap.refuse_strange(p_source_id integer, p_updates semap.state_update[]) returns void
language plpgsql as $$
declare
  v_track_id  bigint;
begin
  select min((a.state).track_id) into v_track_id from unnest(p_updates) a where source_id is null;
  if v_track_id is not null then
    perform semap.refuse_unknown(v_track_id);
  end if;
  raise exception 'The states of one statement come from more than one source.'
    using errcode = 'cardinality_violation', hint = 'Insert or copy the states of each source by themselves.';
end $$;
