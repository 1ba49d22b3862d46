"""The process of one job: `python -m semap_service.jobs.process`, with its task on standard input.

The main thread works. Another has a connection of its own, by which it holds the job, says how far it is, and
sees whether it is to stop: then it cancels the statement that runs, and where that does not help within some
seconds it ends the process. The transaction of the import also ends the job, so that there is no import
without its job being done, and none that was cancelled and came in nevertheless.
"""

from __future__ import annotations

import logging
import os
import resource
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress

from sqlalchemy import Connection, Engine

from semap.errors import SemapError
from semap.store.database.connection import canceller, open_engine, own_session
from semap.store.operate.jobs import fail_job, finish_job, hold_job, report, stop_job
from semap_service.context.caller import SYSTEM, acting_as
from semap_service.database.transaction import Editing, Writing, transaction
from semap_service.jobs.failure import out_of_memory, problem_of, stopped, unexpected, unreadable
from semap_service.jobs.kinds import KINDS
from semap_service.jobs.task import Task

log = logging.getLogger(__name__)

LOOK_S = 0.3
STOP_WITHIN_S = 3.0
CANCEL_S = 5.0
NICENESS = 5
OUT_OF_MEMORY_FIRST = "800"
MEMORY_SHARE = 0.5


class Stopped(Exception):
    """The job is to stop; raised in the midst of the work."""


class Watch:
    """What both threads know.

    stopping  the job is to stop
    told      it was told to by a signal, as the service stops, or the service is gone
    """

    def __init__(self, task: Task, engine: Engine) -> None:
        self.stopping = threading.Event()
        self.told = False
        self._task = task
        self._engine = engine
        self._progress = (0.0, "")
        self._cancel: Callable[[], None] | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def end(self) -> None:
        self._ended.set()
        self._thread.join()

    def say(self, share: float, message: str) -> None:
        """How far it is, for whoever asks.

        raises  Stopped
        """
        if self.stopping.is_set():
            raise Stopped
        self._progress = (min(max(share, 0.0), 1.0), message)

    def on(self, connection: Connection) -> None:
        """This connection works."""
        self._cancel = canceller(connection, CANCEL_S)
        self.say(*self._progress)

    def _run(self) -> None:
        try:
            with acting_as(SYSTEM):
                while not self._ended.wait(LOOK_S) and not self.is_to_stop():
                    pass
            if not self._ended.is_set():
                self._stop()
        except Exception:
            log.exception("The job %s has lost its database", self._task.job_id)
            os._exit(1)

    def is_to_stop(self) -> bool:
        """Ask the database, and tell it how far the job is."""
        if os.getppid() != self._task.service_pid:
            self.told = True
        if self.told:
            return True
        with transaction(self._engine) as connection:
            return report(connection, self._task.job_id, *self._progress)

    def _stop(self) -> None:
        self.stopping.set()
        waited_s = 0.0
        while waited_s < STOP_WITHIN_S:
            if self._cancel is not None:
                self._cancel()
            if self._ended.wait(LOOK_S):
                return
            waited_s += LOOK_S
        end_stopped(self._task, self._engine, told=self.told)
        os._exit(0)


def main() -> None:
    """Do one job, and say what came of it."""
    logging.basicConfig(level=logging.WARNING, format="%(asctime)s %(name)s: %(message)s", datefmt="%H:%M:%S")
    task = Task.from_json(sys.stdin.read())
    _be_modest()
    control = open_engine(task.dsn, application=f"semap job {task.job_id}", size=1)
    work = open_engine(task.dsn, application=f"semap job {task.job_id} work", size=1)
    with acting_as(SYSTEM):
        holder = own_session(task.dsn, application=f"semap job {task.job_id} holder")
        hold_job(holder, task.job_id)
        watch = Watch(task, control)
        signal.signal(signal.SIGTERM, lambda *_: setattr(watch, "told", True))
        watch.start()
        try:
            _do(task, work, watch)
        finally:
            task.path.unlink(missing_ok=True)
            holder.close()


def _do(task: Task, work: Engine, watch: Watch) -> None:
    problem = None
    try:
        with acting_as(task.caller, "write"):
            _import(task, work, watch)
    except Stopped:
        pass
    except SemapError as error:
        problem = problem_of(error, task.job_id)
    except (RecursionError, OverflowError, UnicodeEncodeError) as error:
        problem = unreadable(task.job_id, error)
    except MemoryError:
        problem = out_of_memory(task.job_id)
    except Exception:
        log.exception("The job %s failed", task.job_id)
        problem = unexpected(task.job_id)
    watch.end()
    if watch.stopping.is_set() or (problem is not None and watch.is_to_stop()):
        end_stopped(task, work, told=watch.told)
    elif problem is not None:
        with transaction(work) as connection:
            fail_job(connection, task.job_id, problem)


def _import(task: Task, work: Engine, watch: Watch) -> None:
    kind = KINDS[task.kind]
    prepared = kind.prepare(task, watch.say)
    shard_dsn = kind.shard_of(task, prepared) or task.dsn
    here = shard_dsn == task.dsn
    shard = work if here else open_engine(shard_dsn, application=f"semap job {task.job_id} work", size=1)
    writing = Writing(shard, task.author, task.message)
    editing = Editing(writing, task.if_match, may_create=task.kind == "mesh_upload")
    with editing.begin(lambda connection: kind.current(connection, task)) as connection:
        watch.on(connection)
        result = kind.write(connection, task, prepared, watch.say)
        if here:
            finish_job(connection, task.job_id, result)
    if not here:  # two databases: killed in between, the job looks lost, and its import is there
        with transaction(work) as connection:
            finish_job(connection, task.job_id, result)


def end_stopped(task: Task, engine: Engine, *, told: bool) -> None:
    """Say of a job that has not ended why it ends: somebody cancelled it, or the service was stopped."""
    with acting_as(SYSTEM), transaction(engine) as connection:
        if told:
            fail_job(connection, task.job_id, stopped(task.job_id))
        else:
            stop_job(connection, task.job_id)


def _be_modest() -> None:
    """Let others go first, also where memory runs out."""
    os.nice(NICENESS)
    with suppress(OSError), open("/proc/self/oom_score_adj", "w") as wanted:
        wanted.write(OUT_OF_MEMORY_FIRST)
    bytes_ = int(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") * MEMORY_SHARE)
    resource.setrlimit(resource.RLIMIT_DATA, (bytes_, bytes_))


if __name__ == "__main__":
    main()
