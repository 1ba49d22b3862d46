"""Kill -9 of everything while stateful queries are followed and a map is edited: relations are those computed from nothing.

`SEMAP_KILLS` says how many kills, `SEMAP_KILL_PACE` how fast the recording goes meanwhile.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import psycopg
import pytest
from editing import QUERY
from patience import any_moment, moment
from server import SETTINGS, reachable_folder
from test_kill import LOGS, Run, begin

from semap.cluster import Cluster
from semap.errors import SemapError
from semap.store.database.connection import connect
from semap.store.operate.doctor.verification import verify

KILLS = int(os.environ.get("SEMAP_KILLS", "25"))
PACE = os.environ.get("SEMAP_KILL_PACE", "2")
QUERIES = {
    "margins": "enter_margin_m, leave_margin_m) select 0.3, 0.3",
    "confirmed": "enter_confirm, leave_confirm) select interval '0.6 s', interval '1.2 s'",
    "ways": "longest_gap, fastest_mps, leave_confirm) select interval '3 s', 10, interval '0.4 s'",
    "likely": "enter_probability, leave_probability, widest_std_m) select 0.9, 0.1, 2",
}
TOLD = LOGS | {
    "changes": "select uid, query_name, track_name, instance_name, kind, cause, stamp, transition_at, since, x_m, y_m"
    f" from semap.relation_change where query_name <> '{QUERY}' order by query_name, track_name, instance_name, change_id",
    "relations": "select q.name, t.name, i.name, n.since from semap.relation n join semap.continuous_query q using (query_id)"
    " join semap.track t using (track_id) join semap.instance i using (instance_id)"
    f" where n.confirmed and q.name <> '{QUERY}' order by 1, 2, 3",
    "past": "select query_name, track_name, instance_name, since, until from semap.relation_past"
    f" where query_name <> '{QUERY}' order by 1, 2, 4, 3, 5",
}


class BusyRun(Run):
    """With an editor, and backends of the server, which may be killed as well."""

    dice = random.Random(4)

    def start(self, name: str) -> None:
        if name != "editor":
            super().start(name)
            return
        self.processes[name] = subprocess.Popen(
            [sys.executable, str(Path(__file__).with_name("editing.py"))],
            env={**os.environ, "SEMAP_DSN": self.dsn, "PYTHONPATH": str(Path(__file__).parents[1])},
        )

    def kill(self, name: str) -> None:
        if name == "backend":
            while not self._kill_backend():
                moment()
            return
        super().kill(name)

    def _kill_backend(self) -> bool:
        """One that works for somebody, with which the server takes all others down and recovers."""
        with suppress(psycopg.Error, SemapError, ProcessLookupError), connect(self.dsn) as connection:
            backends = connection.execute(
                "select pid from pg_stat_activity where datname = current_database() and pid <> pg_backend_pid()"
                " and backend_type in ('client backend', 'walsender') order by application_name"
            ).fetchall()
            if backends:
                os.kill(self.dice.choice(backends)[0], signal.SIGKILL)
                return True
        return False


def differing(dsn: str) -> list[object]:
    verification = verify(dsn, lambda said: None)
    with verification.connection:
        return [each for each in verification.look(None) if each.differ]


def prepare(dsn: str) -> None:
    """Stateful queries, before anybody is seen."""
    with connect(dsn) as connection:
        for name, values in QUERIES.items():
            columns, given = values.split(") select ")
            connection.execute(
                f"insert into semap.continuous_query (map_id, name, object_concept_id, {columns})"
                f" select map_id, '{name}', concept_id, {given} from semap.map, semap.concept c where c.name = 'Room'"
            )


@pytest.mark.slow
def test_stateful_relations_survive_kills_while_the_map_is_edited() -> None:
    dice = random.Random(20_260_405)
    with reachable_folder() as folder:
        cluster = Cluster(folder)
        cluster.start(SETTINGS)
        runs: list[Run] = []
        try:
            runs.append(begin(cluster, "calm", None, prepare))
            undisturbed = runs[0].finish(TOLD)
            assert differing(runs[0].dsn) == []
            run = begin(cluster, "killed", PACE, prepare, BusyRun)
            runs.append(run)
            run.start("editor")
            kills = dict.fromkeys(("work", "ingest", "postgres", "backend", "editor"), 0)
            while sum(kills.values()) < KILLS:
                any_moment(dice, 0.05, 1.6)
                assert not run.replayed(), f"the replay was over after {kills}"
                victim = min(kills, key=lambda name: kills[name] + dice.random() * 2)
                run.kill(victim)
                kills[victim] += 1
            while not run.replayed():
                moment()
            editor = run.processes.pop("editor")
            editor.kill()
            editor.wait()
            disturbed = run.finish(TOLD)
            assert differing(run.dsn) == []
            with connect(run.dsn) as connection:
                edited = connection.execute(
                    "select count(*) from semap.relation_change where query_name = %s and cause = 'map'",
                    [QUERY],
                ).fetchone()
        finally:
            for run in runs:
                run.stop()
            cluster.stop()
    assert min(kills.values()) >= KILLS // 10
    assert edited is not None
    assert edited[0] > 0
    assert {name for name, *_ in undisturbed["relations"]} | {
        row[1] for row in undisturbed["changes"]
    } >= set(QUERIES)
    for name in TOLD:
        assert disturbed[name] == undisturbed[name], name
