"""Both halves of the rule worker apart, each in a thread, and a scene that they and one worker play."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from threading import Event as Signal
from threading import Thread
from unittest.mock import patch

import shapely
from door_scene import PAPER, DoorScene
from semap_bridge.relay.collecting import collecting
from semap_bridge.relay.deriving import derive
from semap_bridge.relay.topics import Topics

from semap.store.database.connection import connect
from semap.worker import rule_worker
from semap.worker.publishing import Publishing
from semap.worker.rule_worker import work

PATIENCE_S = 30.0
STAYED = {
    "input": "track_in_room", "partition_by": ["track", "room"], "pattern": "B not followed by L",
    "define": {"B": "type = 'began'", "L": "type = 'ended'"}, "within": "3 s", "emit": "stayed",
}  # fmt: skip
AFTER = {"input": {"rule": "stayed"}, "emit": {"stayed": "settled"}}
BUILT = {"input": {"map": True}, "emit": {"added": "built"}}
EVENTS = """
    select e.event_id, e.rule_name, e.rule_version, e.type, e.cause, e.stamp, e.since, e.track_name, e.instance_name,
           e.key, e.measures, e.confidence,
           array(select row(v.uid, v.variable, v.source, v.stamp)::text
                 from semap.event_evidence v where v.event_id = e.event_id order by v.place)
    from semap.event e order by e.event_id
"""


@contextmanager
def running(run: Callable[[Signal], None]) -> Iterator[None]:
    """In a thread, which is told to stop at the end; what it raised is raised."""
    stop, raised = Signal(), []

    def body() -> None:
        try:
            run(stop)
        except Exception as error:
            raised.append(error)

    thread = Thread(target=body, daemon=True)
    with patch.multiple(rule_worker, QUIET_COMMIT_S=0.05, RECEIVE_S=0.05):
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join(PATIENCE_S)
            assert not thread.is_alive()
    if raised:
        raise raised[0]


@contextmanager
def running_relay(dsn: str, relay: Topics, state: Path, shard: str = "main") -> Iterator[None]:
    with ExitStack() as stack:
        stack.enter_context(running(partial(publishing, dsn, relay, shard)))
        stack.enter_context(running(lambda stop: derive(relay, state, stop)))
        stack.enter_context(running(lambda stop: collecting(dsn, relay, shard, stop)))
        yield


def publishing(dsn: str, relay: Topics, shard: str, stop: Signal) -> None:
    work(dsn, stop, partial(Publishing, shard=shard, send=relay.sender(relay.due).send))


def begin(scene: DoorScene) -> None:
    for name, document in {**PAPER, "stayed": STAYED, "settled": AFTER, "built": BUILT}.items():
        scene.add_rule(name, document)
    scene.passage(100, "ann", "bob")
    scene.watermark(103)


def go_on(scene: DoorScene) -> None:
    """Among others a late row, a room that is built, and rules that come, change and go."""
    scene.passage(120, "bob", "ann")
    scene.watermark(130)
    scene.world.add_room("annex", shapely.box(8, 0, 12, 4))
    scene.add_rule("looks_back", STAYED | {"within": "4 s"}, backfill_from_s=0)
    scene.world.run(
        "delete from semap.rule where map_id = %s and name = 'left_then_closed'", scene.world.map_id
    )
    scene.passage(140, "ann", "bob")
    scene.watermark(300)


def rows(dsn: str) -> list[tuple]:
    """Of what was built, no more than the name: it happened when that database committed it."""
    with connect(dsn) as connection:
        found = connection.execute(EVENTS).fetchall()
    return sorted(((row[1], row[8]) if row[1] == "built" else row[1:2] + row for row in found), key=str)


def counted(dsn: str) -> int:
    with connect(dsn) as connection:
        (count,) = connection.execute("select count(*) from semap.event").fetchone()
        return count
