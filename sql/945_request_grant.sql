-- Who may make continuous queries may ask for them in SQL, and take back what waits; who reads may see both. A request
-- says by itself who asks and when. The worker answers as semap_api, and its maintenance drops what was answered.
grant select on semap.query_request, semap.query_requests to semap_read_map, semap_ingest_map, semap_api_map;
grant insert (map_id, name, sql), delete on semap.query_request to semap_api, semap_admin, semap_api_map;
grant update (answered_at, query_id, refusal) on semap.query_request to semap_api;
grant delete on semap.query_request to semap_worker;
