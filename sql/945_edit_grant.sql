-- Who may make continuous queries may ask for them in SQL, and take back what waits; who reads may see both. A request
-- says by itself who asks and when. The worker answers as semap_api, and its maintenance drops what was answered.
grant select on semap.query_request, semap.query_requests to semap_read_map, semap_ingest_map, semap_api_map;
grant insert (map_id, name, sql), delete on semap.query_request to semap_api, semap_admin, semap_api_map;
grant update (answered_at, query_id, refusal) on semap.query_request to semap_api;
grant delete on semap.query_request to semap_worker;

-- What kind of thing a track is, and what else is known of it, is said by who brings it in, or later by who edits; how
-- late and how far apart states of a source may be, by who edits.
grant update (concept_id, attributes) on semap.track to semap_ingest, semap_api, semap_admin, semap_api_map;
grant update (lateness, jump_m, jump_mps) on semap.source to semap_api, semap_admin, semap_api_map;
grant select on semap.relation_certainty to semap_read_map, semap_ingest_map, semap_api_map;
