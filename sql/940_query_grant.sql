-- Everybody who reads semap may read semap_query and semap_result; their views act for their reader.
do $$
begin
  execute 'grant usage on schema semap_result to semap_read, semap_ingest, semap_worker, semap_api, semap_admin,'
          ' semap_read_map, semap_ingest_map, semap_api_map';
  execute 'grant usage on schema semap_query to semap_read, semap_ingest, semap_worker, semap_api, semap_admin,'
          ' semap_read_map, semap_ingest_map, semap_api_map';
  execute 'grant select on semap_query.track, semap_query.instance to semap_read, semap_ingest, semap_worker,'
          ' semap_api, semap_admin, semap_read_map, semap_ingest_map, semap_api_map';
  perform semap.make_concept_views();
  perform semap.make_result_views();
end $$;
