"""`semap doctor`: each thing that can break is broken, and named with its remedy."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections import namedtuple
from collections.abc import Iterator
from pathlib import Path

import pytest
import shapely
import shapely.geometry
from rule_work import running_worker
from semap_service.operations.doctor import machine_checks
from semap_service.operations.doctor.examination import (
    DATABASE_CHECKS,
    examine,
    examine_database,
    examine_machine,
)
from semap_service.operations.doctor.machine_checks import MACHINE_CHECKS
from server import fresh_database
from sqlalchemy import Connection, text

from semap.cluster import Cluster
from semap.formats.geojson import parse_geojson
from semap.model.continuous_query import Declaration, Side
from semap.store.database.connection import connect, one_session, one_transaction, own_session
from semap.store.map.building import import_building
from semap.store.map.maps import create_map
from semap.store.operate.doctor import server_checks
from semap.store.operate.doctor.content_checks import CONTENT_CHECKS
from semap.store.operate.doctor.finding import DatabaseCheck, Level
from semap.store.operate.doctor.flow_checks import FLOW_CHECKS
from semap.store.operate.rule_slot import ensure_slot
from semap.store.relation.queries import add_query

CHECKS = {check.name: check for check in DATABASE_CHECKS}
ON_MACHINE = {check.name: check for check in MACHINE_CHECKS}

MAP = "insert into semap.map (name) values ('office')"
SOURCE = "insert into semap.source (map_id, name) select map_id, 'lidar' from semap.map"
TOKEN = (
    "insert into semap.token (name, hash, hint, scopes, all_maps, created_by, expires_at, last_used_at)"
    " values ('robot', sha256('x'), 'x', array['read'], true, 'me', {}, now())"
)
WEBHOOK = "insert into semap.webhook (url, cursor, created_by, state, state_reason) values ('https://e.example', 0, 'me', {})"
ROOM = (
    "insert into semap.region (query_id, query_name, instance_id, instance_uid, instance_name, map_id, footprint, z_min_m,"
    " z_max_m) select 1, 'q', 7, gen_random_uuid(), 'bow', map_id, 'polygon((0 0, 2 2, 2 0, 0 2, 0 0))', 0, 3 from semap.map"
)
RULE = "insert into semap.rule (map_id, name, declaration) select map_id, 'visits', '{}' from semap.map"
FAILED = (
    "update semap.progress set rule_state = '{}', watermarks = watermarks ||"
    " jsonb_build_object('committed_at_us', extract(epoch from now() + interval '1 h') * 1e6)"
)
GIVEN_UP = (
    "update semap.progress set watermarks = watermarks || jsonb_build_object('given_up', jsonb_build_object(rule_id::text,"
    " jsonb_build_object('version', 1, 'attempts', 12, 'first', '2026-01-31T12:00:00+00:00', 'key', '{\"track\": \"ann\"}'::jsonb)))"
    " from semap.rule"
)
BRIDGE = (
    "insert into semap.bridge (map_id, name, kind, state, trouble, dropped, refused, told_at)"
    " select map_id, 'robot', 'ros2', 'waiting', {} from semap.map"
)
JOB = (
    "insert into semap.job (kind, file, created_by, created_at) values"
    " ('map_import', 'a.geojson', 'me', now() - interval '1 h')"
)
LATE_ROW = (
    "insert into semap.late_row (map_id, uid, input, stamp, watermark, row) select map_id, 'u', 'q', now(), now(), '{}'"
    " from semap.map"
)

OLD_DAY = (
    "select semap.ensure_partitions(array[(now() at time zone 'UTC')::date - 7])",
    "do $$ declare p record; begin for p in select partition from semap.day_partitions() loop"
    " execute format('comment on table %s is null', p.partition); end loop; end $$",
)

BROKEN = [
    ("worker", [], Level.WRONG, "no rule worker runs", "semap work"),
    ("schema", ["update semap.behaviour set checksum = 'other'"], Level.WRONG, "not as semap leaves", "semap db migrate"),
    ("schema", ["update semap.schema_version set version_num = '9999'"], Level.WRONG, "newer", "newer semap"),
    ("schema", ["drop schema semap cascade"], Level.WRONG, "no schema", "semap db migrate"),
    ("roles", ["revoke insert on semap.track_state from semap_ingest"], Level.WRONG, "semap_ingest", "migrate"),
    ("clocks", [MAP, SOURCE, "update semap.source set watermark = now() + interval '1 h'"], Level.WARN,
     "in the future: office/lidar", "clock"),
    ("sources", [MAP, SOURCE, "update semap.source set idle = true"], Level.WARN, "silent sources", "semap ingest"),
    ("sources", [MAP, SOURCE, "update semap.source set late_states = 50",
                 "insert into semap.source_count (source_id, track_states) select source_id, 100 from semap.source"],
     Level.WARN, "of 100 states of source office/lidar, 50 came late: they corrected relations", "order of stamps"),
    ("sources", [MAP, SOURCE, "update semap.source set late_states = 50",
                 "insert into semap.source_count (source_id, lines) select source_id, 100 from semap.source"],
     Level.WARN, "of 100 states of source office/lidar, 50 came too late to move a door", "order of stamps"),
    ("rules", [MAP, RULE, FAILED], Level.WRONG, "out of force: office/visits", "semap rule replace"),
    ("rules", [MAP, RULE, GIVEN_UP], Level.WARN, "office/visits: it gave up 12 attempts, as more than 10,000 were under way in"
     " one key; events that begin at 2026-01-31T12:00:00Z or later may be missing (first of track ann)", "window"),
    ("bridges", [MAP, BRIDGE.format("'peer: away', 0, 0, now()")], Level.WRONG, "office/robot waits: peer: away", "log"),
    ("bridges", [MAP, BRIDGE.format("'', 0, 0, now() - interval '1 h'")], Level.WRONG, "does not run", "semap bridge"),
    ("bridges", [MAP, BRIDGE.format("'', 7, 0, now()")], Level.WARN, "dropped 7 records", "queue"),
    ("bridges", [MAP, BRIDGE.format("'', 0, 5, now()")], Level.WARN, "refused 5 records", "semap bridge check"),
    ("late rows", [MAP, LATE_ROW], Level.WARN, "1 rows came after their watermark", "replay-late"),
    ("shapes", [MAP, ROOM], Level.WRONG, "no valid area: office/bow", "again"),
    ("partitions", ["insert into semap.state_chunk (source_id, from_stamp, to_stamp, states, track_ids, x_m, y_m)"
                    " values (1, now(), now(), 1, '{1}', '{0}', '{0}')"],
     Level.WARN, "default partition", "ensure_partitions"),
    ("partitions", ["update semap.retention set drop_after = '3 d' where kind = 'states'",
                    *OLD_DAY], Level.WARN, "should have been dropped", "semap db maintain"),
    ("partitions", ["update semap.retention set drop_after = '3 d' where kind = 'lines'",
                    *OLD_DAY], Level.WARN, "have been dropped by now", "semap work"),
    ("webhooks", [WEBHOOK.format("'disabled', 'it answered 410'")], Level.WRONG, "410", "semap webhook"),
    ("webhooks", [WEBHOOK.format("'active', ''"),
                  "insert into semap.webhook_dead_letter (webhook_id, seq, event_id, map, type, body, attempts, error)"
                  " select webhook_id, 1, gen_random_uuid(), 'office', 't', '', 1, '' from semap.webhook"],
     Level.WARN, "1 events that it did not take", "dead-letters"),
    ("jobs", [JOB], Level.WRONG, "without a process", "semap serve"),
    ("jobs", [JOB, "select pg_advisory_xact_lock_shared(7369, job_id) from semap.job"], Level.WARN, "wait for long", "cancel"),
    ("tokens", [TOKEN.format("now() + interval '2 days'")], Level.WARN, "within a week: robot", "semap token add"),
    ("tokens", [TOKEN.format("now() - interval '1 h'")], Level.WARN, "until they expired: robot", "semap token add"),
]  # fmt: skip


@pytest.fixture(scope="module")
def hospital(cluster: Cluster, template: str) -> Iterator[Connection]:
    """A database that is broken again and again; what a test does to it is rolled back."""
    with fresh_database(cluster, template) as dsn, one_session(dsn) as engine:
        with connect(dsn) as plain:
            ensure_slot(plain)
        with engine.connect() as connection:
            yield connection


@pytest.fixture
def patient(hospital: Connection) -> Iterator[Connection]:
    yield hospital
    hospital.rollback()


def test_states_of_a_day_without_a_partition_are_told(patient: Connection) -> None:
    check = next(each for each in CONTENT_CHECKS if each.name == "partitions")
    assert list(check.look(patient)) == []
    patient.exec_driver_sql(
        "insert into semap.state_chunk (source_id, from_stamp, to_stamp, states, track_ids, x_m, y_m)"
        " values (1, '2026-01-31Z', '2026-01-31Z', 1, '{1}', '{0}', '{0}')"
    )
    assert [trouble.message for trouble in check.look(patient)] == [
        "rows of state_chunk lie in its default partition, and are slower to find"
    ]


@pytest.mark.parametrize(("name", "breaking", "level", "message", "remedy"), BROKEN)
def test_what_is_broken_is_named(
    patient: Connection, name: str, breaking: list[str], level: Level, message: str, remedy: str
) -> None:
    for statement in breaking:
        patient.execute(text(statement))
    found = list(examine(CHECKS[name], patient))
    assert [each.level for each in found] == [level]
    assert message in found[0].message
    assert remedy in found[0].remedy


FLAT = {
    "type": "FeatureCollection",
    "features": [
        {"type": "Feature", "properties": {"name": name}, "geometry": shapely.geometry.mapping(shapely.box(x, 0, x + 4, 4))}
        for name, x in (("hall", 0), ("office", 4))
    ]
    + [
        {"type": "Feature", "properties": {"name": "door", "concept": "Door", "joins": ["hall", "office"]},
         "geometry": {"type": "LineString", "coordinates": [[4, 1], [4, 2]]}},
    ],
}  # fmt: skip


def test_a_door_drawn_as_a_line_can_be_crossed_and_not_be_stood_in(database: str) -> None:
    """What a query can compare depends on the query: that it works is no trouble."""
    door = Side("instance", concept="Door")
    with one_transaction(database) as connection:
        create_map(connection, "flat")
        import_building(connection, "flat", parse_geojson(FLAT))
        add_query(
            connection, "flat", Declaration("through", "crosses", Side("track"), door, abstraction="Line")
        )
    with own_session(database) as connection:
        assert [each.level for each in examine(CHECKS["shapes"], connection)] == [Level.OK]
    with one_transaction(database) as connection:
        add_query(connection, "flat", Declaration("in_door", "contains", Side("track"), door))
    with own_session(database) as connection:
        [found] = examine(CHECKS["shapes"], connection)
    assert found.message.startswith("instances that the query in_door watches")
    assert found.message.endswith("flat/door")


def test_all_is_well_where_it_is_and_a_lost_slot_is_told(database: str) -> None:
    with running_worker(database):
        found = list(examine_database(database))
    assert [each.check for each in found] == ["database", *CHECKS]
    assert {each.message for each in found if each.level != Level.OK} == set()
    with own_session(database) as connection:
        connection.exec_driver_sql("select pg_drop_replication_slot(semap.rule_slot())")
        [lost] = examine(CHECKS["slot"], connection)
    assert (lost.level, lost.message) == (Level.WRONG, "the rule worker's replication slot is missing")
    assert "semap db resync" in lost.remedy


def test_other_slots_and_open_transactions(database: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server_checks, "LONG_TRANSACTION", "0 s")
    monkeypatch.setattr("semap.store.operate.doctor.flow_checks.BEHIND_BYTES", -1)
    with (
        own_session(database) as connection,
        connect(database, application="sleeper", autocommit=False) as other,
    ):
        other.execute("select 1")
        [found] = [each for each in examine(CHECKS["transactions"], connection) if "sleeper" in each.message]
        assert f"pg_terminate_backend({other.info.backend_pid})" in found.remedy
        name = f"left_{other.info.backend_pid}"
        connection.exec_driver_sql("select pg_create_physical_replication_slot(%s, true)", (name,))
        try:
            said = [each.remedy for each in examine(CHECKS["other slots"], connection)]
        finally:
            connection.exec_driver_sql("select pg_drop_replication_slot(%s)", (name,))
    assert any(f"pg_drop_replication_slot('{name}')" in each for each in said)


def test_a_server_that_is_not_as_needed(database: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        server_checks, "examine", lambda _: [("wal_level = logical (it is replica)", "ALTER SYSTEM")]
    )
    monkeypatch.setattr(server_checks, "CLOCKS_APART_S", -1)
    with own_session(database) as connection:
        [server] = examine(CHECKS["server"], connection)
        [clock] = examine(CHECKS["clocks"], connection)
    assert (server.level, server.remedy) == (Level.WRONG, "ALTER SYSTEM")
    assert "NTP" in clock.remedy


def test_a_role_that_is_gone_or_not_ours(database: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server_checks, "ROLES", ("semap_read", "semap_gone"))
    with own_session(database) as connection:
        [found] = examine(CHECKS["roles"], connection)
    assert "semap_gone" in found.message
    assert "migrate" in found.remedy


def test_a_check_that_cannot_be_made_does_not_stop_the_others(database: str) -> None:
    def fails(connection: Connection) -> list:
        connection.exec_driver_sql("select 1 / 0 as password")
        return []

    with own_session(database) as connection:
        [found] = examine(DatabaseCheck("odd", "", fails), connection)
        assert found.level == Level.WARN
        assert "could not be looked at" in found.message
        assert all(list(examine(check, connection)) for check in (*FLOW_CHECKS, *CONTENT_CHECKS))


Usage = namedtuple("Usage", "free")

ON_THIS_MACHINE: list[tuple[str, str, object, Level, str, str]] = [
    (
        "disk",
        "shutil.disk_usage",
        lambda _: Usage(10 * 1024**2),
        Level.WRONG,
        "10 MiB are free",
        "SEMAP_HOME",
    ),
    (
        "disk",
        "shutil.disk_usage",
        lambda _: Usage(2 * 1024**3),
        Level.WARN,
        "2 048 MiB are free",
        "SEMAP_HOME",
    ),
    ("page", "FILES", Path("/nowhere"), Level.WARN, "not built", "./dev page"),
    ("extras", "EXTRAS", (("ifc", ("no_such_module",), "none"),), Level.WARN, "no_such_module", "semap[ifc]"),
]


@pytest.mark.parametrize(("name", "where", "value", "level", "message", "remedy"), ON_THIS_MACHINE)
def test_what_this_machine_lacks_is_named(
    name: str,
    where: str,
    value: object,
    level: Level,
    message: str,
    remedy: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    target = shutil if where.startswith("shutil.") else machine_checks
    monkeypatch.setattr(target, where.rpartition(".")[2], value)
    found = list(examine_machine(ON_MACHINE[name]))
    assert found[0].level == level
    assert message in found[0].message
    assert remedy in found[0].remedy


def doctor(*arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    known = {name: value for name, value in os.environ.items() if not name.startswith("SEMAP")}
    return subprocess.run([sys.executable, "-m", "semap_service", "doctor", *arguments], env=known | variables, text=True,
                          capture_output=True, timeout=60, check=False)  # fmt: skip


@pytest.mark.parametrize(
    "dsn", ["postgresql://me:geheim@127.0.0.1:1/semap", "password=geheim port=1 host=::1", "nonsense"]
)
def test_a_database_that_does_not_answer(dsn: str) -> None:
    [found] = examine_database(dsn)
    assert (found.check, found.level) == ("database", Level.WRONG)
    assert "geheim" not in found.message
    assert "SEMAP_DSN" in found.remedy


def test_for_programs() -> None:
    ran = doctor("--json", SEMAP_DSN="postgresql://me:geheim@127.0.0.1:1/semap")
    said = json.loads(ran.stdout)
    assert (ran.returncode, said["ok"]) == (1, False)
    assert {each["check"] for each in said["findings"]} == {"database", *ON_MACHINE}
    assert "geheim" not in ran.stdout + ran.stderr


def test_for_people(database: str, tmp_path: Path) -> None:
    ran = doctor(SEMAP_DSN=database)
    lines = ran.stdout.splitlines()
    assert ran.returncode == 1, ran.stderr
    place = next(i for i, line in enumerate(lines) if line.startswith("wrong  worker"))
    assert lines[place + 1].strip() == "-> Start it: semap work (or semap up, or systemctl start semap-work)."
    own = doctor(SEMAP_HOME=str(tmp_path / "none"))
    assert own.stdout.startswith("wrong  database")
    assert "semap up" in own.stdout
    assert list(tmp_path.iterdir()) == []
