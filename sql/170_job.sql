-- Say within an import's own transaction that its job is done, so that there is never one without the other.
create or replace function semap.finish_job(p_job_id integer, p_result jsonb) returns void
language plpgsql security definer set search_path = public, pg_temp as $$
begin
  update semap.job
  set state = 'done', progress = 1, message = '', result = p_result, finished_at = clock_timestamp()
  where job_id = p_job_id and state = 'running' and not cancel_requested
    -- this runs with the rights of its owner: a job that is not of the caller's maps is not there
    and ((select semap.visible_maps() is null)
         or map = any (select name from semap.map where map_id = any ((select semap.visible_maps())::integer[])));
  if not found then
    raise exception 'The job % is not running any more, or is to stop.', p_job_id using errcode = 'query_canceled';
  end if;
end $$;

-- Hold a job, so that others see that it is not lost, until this connection ends or lets it go.
create or replace function semap.hold_job(p_job_id integer) returns void
language sql as $$
  select pg_advisory_lock_shared(7369, p_job_id)
$$;

-- Mark unfinished jobs that nobody holds as failed: the process that had them is gone.
create or replace function semap.fail_lost_jobs() returns integer
language sql as $$
  with lost as (
    update semap.job j
    set state = 'failed', message = '', finished_at = clock_timestamp(),
        problem = jsonb_build_object(
          'type', 'urn:semap:problem:job-lost', 'title', 'Internal Server Error', 'status', 500,
          'detail', 'The service stopped before the job was done; nothing of it was brought in.',
          'instance', '/jobs/' || j.job_id, 'remedy', 'Send the file again.', 'errors', jsonb_build_array(),
          'request_id', '')
    where j.finished_at is null
      and not exists (
        select from pg_locks l
        where l.locktype = 'advisory' and l.classid = 7369 and l.objid = j.job_id::oid and l.objsubid = 2
          and l.database = (select oid from pg_database where datname = current_database()))
    returning 1
  )
  select count(*)::integer from lost
$$;
