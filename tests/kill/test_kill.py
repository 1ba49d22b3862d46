"""Kill -9 of the rule worker, the ingest worker and PostgreSQL during a replay: nothing lost, nothing twice."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from patience import any_moment, moment, until
from play import bring_in
from semap_service import demo
from server import SETTINGS, reachable_folder

from semap.cluster import Cluster
from semap.formats import read_building
from semap.store.database.connection import connect
from semap.store.operate.schema import migrate

FOLDER = Path(demo.__file__).parent
PATIENCE_S = 300.0
LOGS = {
    # which of two rules is first with the same news depends on how many states come at once
    "events": "select rule_name, row_number() over (partition by rule_name order by seq), event_id, rule_version,"
    " type, stamp, cause, track_name, instance_name, since, key from semap.event order by 1, 2",
    "numbers": "select min(seq), max(seq), count(*) from semap.event",
    "evidence": "select event_id, place, uid, variable, source, stamp from semap.event_evidence order by 1, 2",
    "changes": "select uid, query_name, track_name, instance_name, kind, cause, stamp, since"
    " from semap.relation_change order by change_id",
    "relations": "select track, instance, since from semap.relation_now order by 1, 2",
    "states": "select t.name, s.stamp, s.x_m, s.y_m, s.z_m, s.std_m, s.is_last"
    " from semap.stored_state s join semap.track t using (track_id) order by 1, 2",
}
ALL_MADE = """
    select (select count(*) from semap.relation_change where query_name = 'track_in_room')
           = (select count(*) from semap.event where rule_name = 'room_visits')
      and (select bool_and((p.watermarks #>> array['maps', s.map_id::text, 'released_us'])::bigint
                           = (extract(epoch from s.watermark) * 1000000)::bigint)
           from semap.source s, semap.progress p)
"""
PAUSES = """
    insert into semap.rule (map_id, name, queries, declaration)
    select map_id, 'pauses', jsonb_build_object(q.name, q.query_id), %s::jsonb
    from semap.continuous_query q where q.name = 'track_in_room'
"""
# its states, timers and waiting rows are killed with the worker, too
STAYED = {
    "input": "track_in_room", "partition_by": ["track", "room"], "pattern": "B not followed by L",
    "define": {"B": "type = 'began'", "L": "type = 'ended'"}, "within": "3 s", "emit": "stayed",
}  # fmt: skip


@dataclass
class Run:
    """The server, a rule worker and a replay, each a process that may be killed and started again."""

    cluster: Cluster
    dsn: str
    pace: str | None
    processes: dict[str, subprocess.Popen] = field(default_factory=dict)

    def start(self, name: str) -> None:
        arguments = {
            "work": ["work"],
            "ingest": ["ingest", "tracks", str(FOLDER / "walk.csv"), "--map", "office", "--batch", "20",
                       *([] if self.pace is None else ["--realtime", self.pace])],
        }[name]  # fmt: skip
        self.processes[name] = subprocess.Popen(
            [sys.executable, "-m", "semap_service", *arguments], env={**os.environ, "SEMAP_DSN": self.dsn},
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip

    def kill(self, name: str) -> None:
        if name == "postgres":
            postmaster = int((self.cluster.data / "postmaster.pid").read_text().split()[0])
            os.kill(postmaster, signal.SIGKILL)
            until(lambda: not self.cluster.is_running())
            self.cluster.start(SETTINGS)
            return
        self.processes[name].kill()
        self.processes[name].wait()
        self.start(name)

    def replayed(self) -> bool:
        return self.processes["ingest"].poll() == 0

    def finish(self, logs: dict[str, str] = LOGS) -> dict[str, list[tuple]]:
        """Wait until every change is an event, stop all, and read the logs."""
        deadline_s = time.monotonic() + PATIENCE_S
        while not (self.replayed() and self._all_made()):
            assert time.monotonic() < deadline_s
            moment()
        self.processes["work"].terminate()
        assert self.processes["work"].wait(PATIENCE_S) == 0
        with connect(self.dsn) as connection:
            return {name: connection.execute(statement).fetchall() for name, statement in logs.items()}

    def _all_made(self) -> bool:
        with connect(self.dsn) as connection:
            row = connection.execute(ALL_MADE).fetchone()
        return bool(row and row[0])

    def stop(self) -> None:
        for process in self.processes.values():
            process.kill()
            process.wait()


def begin(
    cluster: Cluster,
    name: str,
    pace: str | None,
    prepare: Callable[[str], None] = lambda dsn: None,
    kind: type[Run] = Run,
) -> Run:
    cluster.create_database(name)
    migrate(cluster.dsn(name))
    bring_in(cluster.dsn(name), "office", read_building(FOLDER / "office.geojson"))
    with connect(cluster.dsn(name)) as connection:
        connection.execute(PAUSES, [json.dumps(STAYED)])
    prepare(cluster.dsn(name))
    run = kind(cluster, cluster.dsn(name), pace)
    run.start("work")
    run.start("ingest")
    return run


@pytest.mark.slow
@pytest.mark.parametrize(("wanted", "pace"), [(21, "3"), (150, "0.4")], ids=["21", "150"])
def test_kills_at_random_moments_change_nothing(wanted: int, pace: str) -> None:
    dice = random.Random(20_260_131)
    with reachable_folder() as folder:
        cluster = Cluster(folder)
        cluster.start(SETTINGS)
        runs = []
        try:
            runs.append(begin(cluster, "calm", None))
            undisturbed = runs[0].finish()
            runs.append(run := begin(cluster, "killed", pace))
            kills = dict.fromkeys(("work", "ingest", "postgres"), 0)
            while sum(kills.values()) < wanted:
                any_moment(dice, 0.05, 1.6)
                assert not run.replayed(), f"the replay was over after {kills}"
                victim = min(kills, key=lambda name: kills[name] + dice.random() * 2)
                run.kill(victim)
                kills[victim] += 1
            disturbed = run.finish()
        finally:
            for run in runs:
                run.stop()
            cluster.stop()
    assert min(kills.values()) >= 4
    assert len(undisturbed["events"]) > 20
    assert any(event[0] == "pauses" for event in undisturbed["events"])
    for name in LOGS:
        assert disturbed[name] == undisturbed[name], name
