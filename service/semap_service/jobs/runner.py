"""Gives each job a process, a few at a time; the others wait.

The service holds each job that it has taken on by an advisory lock of one connection, and its process holds
it by another: a job that neither holds is lost, and is marked so by the next who looks.
"""

from __future__ import annotations

import logging
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import BinaryIO

from sqlalchemy import Connection, Engine

from semap.errors import SemapError, TooManyRequests
from semap.store.database.backoff import Reminder
from semap.store.database.connection import is_open, own_session
from semap.store.operate.jobs import (
    Job,
    Kind,
    add_job,
    count_unfinished,
    fail_job,
    fail_lost_jobs,
    forget_jobs,
    hold_job,
    let_go_of_job,
    next_job_id,
    start_job,
)
from semap_service.context.caller import SYSTEM, Caller, acting_as
from semap_service.database.transaction import transaction
from semap_service.jobs.failure import died, stopped
from semap_service.jobs.spool import Spool, Spooled
from semap_service.jobs.task import Task

log = logging.getLogger(__name__)

ROLE = "semap_admin"
LOOK_S = 10.0
MOST_WAITING = 8
"""Threads of the service that wait for the end of a job; it has 40, of which others want some."""
STOP_S = 5.0


@dataclass(frozen=True)
class JobSettings:
    """How jobs are run.

    folder       where files wait for their job; None: a folder of the system's for passing files
    at_once      processes at one time
    unfinished   jobs that may wait or run; more are refused
    most_bytes   of a file
    """

    folder: Path | None = None
    at_once: int = 2
    unfinished: int = 50
    most_bytes: int = 2 * 1024**3


JOBS = JobSettings()


class JobRunner:
    """Takes jobs on, from any thread."""

    def __init__(self, dsn: str, engine: Engine, settings: JobSettings) -> None:
        self.settings = settings
        self.engine = engine
        self.waiting = threading.BoundedSemaphore(MOST_WAITING)
        self._dsn = dsn
        self._spool = Spool(settings.folder)
        self._threads = ThreadPoolExecutor(settings.at_once, "job")
        self._lock = threading.Lock()
        self._holder: Connection | None = None
        self._held: dict[int, Spooled] = {}
        self._processes: dict[int, subprocess.Popen[bytes]] = {}
        self._stopping = threading.Event()
        self._caretaker = threading.Thread(target=self._look_after, name="jobs", daemon=True)

    @property
    def processes(self) -> dict[int, int]:
        """The process of each job that runs."""
        return {job_id: process.pid for job_id, process in list(self._processes.items())}

    def start(self) -> None:
        """Begin to look after jobs."""
        self._caretaker.start()

    def stop(self) -> None:
        """End what runs and waits; it is marked as failed."""
        self._stopping.set()
        self._threads.shutdown(wait=False, cancel_futures=True)
        for process in list(self._processes.values()):
            process.terminate()
        for process in list(self._processes.values()):
            try:
                process.wait(STOP_S)
            except subprocess.TimeoutExpired:
                process.kill()
        self._threads.shutdown(wait=True)
        self._caretaker.join()
        for job_id, spooled in self._held.items():
            self._try(partial(fail_job, job_id=job_id, problem=stopped(job_id)))
            spooled.remove()
        if self._holder is not None:
            self._holder.close()

    def accept(
        self,
        kind: Kind,
        file: BinaryIO,
        *,
        given: str,
        caller: Caller,
        author: str,
        message: str = "",
        map_name: str | None = None,
        if_match: str | None = None,
        options: Mapping[str, object] | None = None,
        shard_dsn: str | None = None,
    ) -> Job:
        """Take a job on.

        given      what the sender calls the file; its suffix says the format
        shard_dsn  the database where its map is, if that is another one
        raises     TooManyRequests where too many wait already; ServerUnavailable where there is no room
        """
        with acting_as(SYSTEM), transaction(self.engine) as connection:
            if count_unfinished(connection) >= self.settings.unfinished:
                raise TooManyRequests(
                    f"{self.settings.unfinished} jobs wait or run already.",
                    "Try again when some are done.",
                    30,
                )
            job_id = next_job_id(connection)
        spooled = self._spool.take(file, Path(given).suffix)
        try:
            self._hold(job_id, spooled)
            task = Task(
                dsn=self._dsn,
                job_id=job_id,
                kind=kind,
                file=given,
                path=spooled.path,
                caller=caller,
                author=author,
                message=message,
                if_match=if_match,
                options=options or {},
                shard_dsn=shard_dsn,
            )
            with acting_as(SYSTEM), transaction(self.engine) as connection:
                job = add_job(
                    connection,
                    job_id,
                    kind,
                    file=given,
                    map_name=map_name,
                    token_id=caller.token_id,
                    created_by=caller.name,
                )
            self._threads.submit(self._run, task, spooled)
        except BaseException:
            self._let_go(job_id)
            spooled.remove()
            raise
        return job

    def _run(self, task: Task, spooled: Spooled) -> None:
        """In a thread of the runner's: a job from its start to its end."""
        try:
            with acting_as(SYSTEM), transaction(self.engine) as connection:
                wanted = not self._stopping.is_set() and start_job(connection, task.job_id)
            if wanted:
                status = self._process(task, spooled)
                problem = stopped(task.job_id) if self._stopping.is_set() else died(task.job_id, status)
                self._try(partial(fail_job, job_id=task.job_id, problem=problem))
        except SemapError as error:
            log.warning("The job %s cannot be run: %s", task.job_id, error)
        except Exception:
            log.exception("The job %s cannot be run", task.job_id)
        finally:
            spooled.remove()
            self._let_go(task.job_id)

    def _process(self, task: Task, spooled: Spooled) -> int:
        """Run the job's process to its end; its exit status."""
        process = subprocess.Popen(
            [sys.executable, "-m", "semap_service.jobs.process"],
            stdin=subprocess.PIPE,
            pass_fds=[spooled.lock],
            start_new_session=True,
        )
        self._processes[task.job_id] = process
        try:
            if self._stopping.is_set():
                process.terminate()
            process.communicate(task.to_json().encode())
            return process.returncode
        finally:
            del self._processes[task.job_id]

    def _look_after(self) -> None:
        """Keep hold of this service's jobs, mark those as lost that nobody holds, and forget old ones."""
        reminder = Reminder(log, "Jobs wait for the database")
        while True:
            self._spool.sweep()
            try:
                with self._lock:
                    self._hold_all()
                self._try(fail_lost_jobs)
                self._try(forget_jobs)
                reminder.over()
            except SemapError as error:
                reminder.say(error)
            except Exception:
                log.exception("Jobs are not looked after for a while")
            if self._stopping.wait(LOOK_S):
                return

    def _hold(self, job_id: int, spooled: Spooled) -> None:
        with self._lock:
            holder = self._hold_all()
            hold_job(holder, job_id)
            self._held[job_id] = spooled

    def _let_go(self, job_id: int) -> None:
        with self._lock:
            if self._held.pop(job_id, None) is None:
                return
            if self._holder is not None and is_open(self._holder):
                with suppress(SemapError):  # one that is lost holds nothing
                    let_go_of_job(self._holder, job_id)

    def _hold_all(self) -> Connection:
        """The connection that holds this service's jobs, made again where it was lost."""
        if self._holder is not None and not is_open(self._holder):
            self._holder.close()
            self._holder = None
        if self._holder is None:
            self._holder = own_session(self._dsn, ROLE, application="semap jobs")
            for job_id in self._held:
                hold_job(self._holder, job_id)
        return self._holder

    def _try(self, work: Callable[[Connection], object]) -> None:
        """Write where the database can be had; where not, the next who looks sees that the job is lost."""
        try:
            with acting_as(SYSTEM), transaction(self.engine) as connection:
                work(connection)
        except SemapError as error:
            log.warning("The state of a job could not be written: %s", error)
