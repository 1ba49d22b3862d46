-- Jobs and webhooks are semap_admin's: the service looks after whose job is whose. Nobody else may read the keys
-- that sign, nor the events of all maps that wait as dead letters. An importer says itself that its job is done.
revoke all on semap.webhook, semap.webhook_secret, semap.webhook_dead_letter
from semap_read, semap_ingest, semap_worker, semap_api, semap_read_map, semap_ingest_map, semap_api_map;
grant select, insert, update, delete on
  semap.job, semap.webhook, semap.webhook_secret, semap.webhook_dead_letter
to semap_admin;
grant usage on sequence semap.job_job_id_seq to semap_admin;
grant execute on function semap.finish_job to semap_admin, semap_api, semap_api_map;
