"""A bridge of lines: every state is in once, whoever is away or killed meanwhile."""

from __future__ import annotations

import json
import socket
from pathlib import Path

import pytest
import shapely
from bridging import config, entry, line, report, run_to_its_end, running, stored
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from making import make_events
from patience import until
from semap_bridge import intake
from semap_bridge.config import read_config
from semap_bridge.delivery import Past
from semap_service.processes.port import free_port
from world import SECOND_US, World

from semap.errors import Conflict, InvalidInput, ServerUnavailable
from semap.store.motion import bridges

FIRST_US = 1_700_000_000 * SECOND_US


def walk(states: int, tracks: int = 3) -> list[tuple]:
    return [(f"t{i % tracks}", FIRST_US + i // tracks * SECOND_US, i * 0.1, 0.0) for i in range(states)]


def as_lines(states: list[tuple]) -> bytes:
    return b"".join(line(*each) for each in states)


def test_a_file_is_in_once(world: World, tmp_path: Path) -> None:
    states = walk(2500)
    (tmp_path / "walk.ndjson").write_bytes(as_lines(states))
    one = entry(tmp_path, read="walk.ndjson")
    run_to_its_end(world, one)
    assert stored(world) == states
    told = report(world)
    assert (told["state"], told["received"], told["committed"], told["refused"]) == ("ended", 2500, 2500, 0)
    run_to_its_end(world, one)
    assert stored(world) == states
    assert report(world)["received"] == 0
    more = [(name, stamp_us + 10_000 * SECOND_US, *place) for name, stamp_us, *place in states]
    with (tmp_path / "walk.ndjson").open("ab") as file:
        file.write(as_lines(more))
    run_to_its_end(world, one)
    assert stored(world) == states + more


def test_bad_lines_are_counted_by_reason_and_keep_no_other_out(world: World, tmp_path: Path) -> None:
    good = walk(4)
    bad = [
        b"no json\n", b"[1]\n", b"\xff\xfe\n", b'{"track": "a", "x_m": 1, "y_m": 2}\n',
        line("a", FIRST_US, float("nan")), line("", FIRST_US, 1.0), line("a", FIRST_US, 1e9),
        line("a", 4_000_000_000 * SECOND_US, 1.0), line("a", FIRST_US, 1.0, speed_mps="fast"),
        line("a", FIRST_US, 1.0, colour="red"), line(*good[0]), line("\ud800", FIRST_US, 1.0),
        b'{"instance": "no door", "property": "door", "value": "open", "stamp": "2026-01-31T12:00:00Z"}\n',
        b'{"instance": "door"}\n', b'{"track":' + b"[" * 5000 + b"\n",
    ]  # fmt: skip
    (tmp_path / "walk.ndjson").write_bytes(as_lines(good[:2]) + b"".join(bad) + as_lines(good[2:]))
    run_to_its_end(world, entry(tmp_path, read="walk.ndjson"))
    assert stored(world) == good
    assert report(world)["refusals"] == {
        "not JSON": 3, "no state": 1, "no stamp": 1, "x_m out of range": 2, "no name of a track": 2,
        "stamp in the future": 1, "speed_mps is no number": 1, "unknown member": 1, "repeated": 1,
        "no such instance": 1, "no state of an object": 1,
    }  # fmt: skip


def test_what_is_stored_is_passed_over(world: World, tmp_path: Path) -> None:
    """Live sources say things twice: each state is there once, and the first one counts."""
    states = walk(30)
    (tmp_path / "walk.ndjson").write_bytes(as_lines(states[:20]))
    run_to_its_end(world, entry(tmp_path, read="walk.ndjson"))
    (tmp_path / "again.ndjson").write_bytes(
        as_lines([(n, s, x + 1.0, y) for n, s, x, y in states[:20]] + states[20:])
    )
    world.run("delete from semap.bridge_position")
    run_to_its_end(world, entry(tmp_path, read="again.ndjson"))
    assert stored(world) == states
    assert report(world)["refusals"] == {"repeated": 20}


def test_a_deleted_track_is_made_anew(world: World, tmp_path: Path) -> None:
    (tmp_path / "walk.ndjson").write_bytes(b"")
    states = walk(2, tracks=1)
    with running(world, entry(tmp_path, read="walk.ndjson", follow=True)):
        for each in states:
            with (tmp_path / "walk.ndjson").open("ab") as file:
                file.write(line(*each))
            until(lambda stamp_us=each[1]: any(stamp_us == known[1] for known in stored(world)))
            world.run("delete from semap.track where %s", each is states[0])
    assert stored(world) == states[1:]


def test_it_waits_for_its_map(world: World, tmp_path: Path) -> None:
    world.run("update semap.map set name = 'elsewhere'")
    (tmp_path / "walk.ndjson").write_bytes(as_lines(walk(3)))
    with running(world, entry(tmp_path, read="walk.ndjson")):
        connected = "select count(*) from pg_stat_activity where application_name = 'semap bridge'"
        until(lambda: world.one(connected) > 0)
        world.run("update semap.map set name = 'world'")
        until(lambda: len(stored(world)) == 3)


def test_a_second_bridge_of_a_name_is_told_so(
    world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("semap_bridge.running.HOLD_TRIES", 2)
    (tmp_path / "walk.ndjson").write_bytes(as_lines(walk(3)))
    one = entry(tmp_path, read="walk.ndjson", follow=True)
    with running(world, one):
        until(lambda: len(stored(world)) == 3)
        with pytest.raises(Conflict, match="Another process runs the bridge lines") as told:
            run_to_its_end(world, one)
        assert "name of its own" in told.value.remedy


def test_a_position_that_moved_meanwhile_is_refused(world: World, tmp_path: Path) -> None:
    (tmp_path / "walk.ndjson").write_bytes(as_lines(walk(3)))
    told = pytest.raises(Conflict, match="moved by somebody else")
    with told, running(world, entry(tmp_path, read="walk.ndjson", follow=True)) as thread:
        until(lambda: len(stored(world)) == 3)
        world.run("update semap.bridge_position set position = '{\"offset\": 7}'")
        with (tmp_path / "walk.ndjson").open("ab") as file:
            file.write(line("late", FIRST_US + 100 * SECOND_US, 1.0))
        until(lambda: not thread.is_alive())
    assert len(stored(world)) == 3


class Killed(BaseException):
    """As kill -9: nothing of the process goes on."""


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    states=st.integers(1, 40),
    kills=st.lists(st.tuples(st.sampled_from(["before", "after", "lost"]), st.integers(1, 4)), max_size=6),
)
def test_kills_lose_and_double_nothing(
    world: World, tmp_path: Path, states: int, kills: list[tuple[str, int]]
) -> None:
    """Killed before a commit, or after it; or the answer to it is lost, and it is tried again."""
    world.run("delete from semap.source where name = 'lines'")
    world.run("delete from semap.bridge_position")
    said = walk(states)
    (tmp_path / "walk.ndjson").write_bytes(as_lines(said))
    one = entry(tmp_path, read="walk.ndjson", queue=8)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("semap_bridge.adapters.ndjson.LINES", 3)
        patch.setattr(intake, "TOGETHER", 6)
        patch.setattr("semap_bridge.pausing.FIRST_RETRY_S", 0.0)
        for how, at in kills:
            with pytest.MonkeyPatch.context() as once:
                _kill(once, how, at)
                try:
                    run_to_its_end(world, one)
                except Killed:
                    continue
        run_to_its_end(world, one)
    assert stored(world) == said
    position = world.one("select position from semap.bridge_position where way = 'in'")
    assert position == {"offset": len(as_lines(said))}


def _kill(patch: pytest.MonkeyPatch, how: str, at: int) -> None:
    commits = 0
    commit, move = intake.Intake._commit, bridges.move_position

    async def counted(self: intake.Intake, *given: object) -> None:
        nonlocal commits
        commits += 1
        await commit(self, *given)
        if commits == at and how == "after":
            raise Killed
        if commits == at and how == "lost":
            self._position = self._before
            raise ServerUnavailable("The answer is lost.")

    def moved(connection: object, place: object, was: object, now: object) -> None:
        move(connection, place, was, now)
        if commits == at and how == "before":
            raise Killed

    async def remembering(self: intake.Intake, *given: object) -> None:
        self._before = self._position
        await counted(self, *given)

    patch.setattr(intake.Intake, "_commit", remembering)
    patch.setattr(intake, "move_position", moved)


def test_what_comes_live_over_tcp_is_stored(world: World, tmp_path: Path) -> None:
    states = walk(50)
    port = free_port()
    with running(world, entry(tmp_path, listen=f"127.0.0.1:{port}")):
        until(lambda: _sent(port, as_lines(states)))
        until(lambda: len(stored(world)) == 50)
    assert stored(world) == states
    assert world.one("select count(*) from semap.bridge_position") == 0


def _sent(port: int, data: bytes) -> bool:
    try:
        with socket.create_connection(("127.0.0.1", port)) as connection:
            connection.sendall(data)
    except ConnectionError:
        return False
    return True


def test_the_oldest_of_what_comes_live_is_dropped_while_the_database_is_slow(
    world: World, tmp_path: Path
) -> None:
    states = [(f"t{i}", FIRST_US, float(i), 0.0) for i in range(100)]
    port = free_port()
    with running(world, entry(tmp_path, listen=f"127.0.0.1:{port}", queue=10)):
        until(lambda: _sent(port, line("first", FIRST_US, 0.0)))
        until(lambda: len(stored(world)) == 1)
        with world.connection.transaction():
            world.run("select semap.lock_regions_exclusive()")
            for first, end in ((0, 95), (95, 100)):  # connections are heard in any order
                for each in states[first:end]:
                    _sent(port, line(*each))
                until(lambda end=end: report(world)["received"] == end + 1)
            # those in hand, and the newest: what is between was driven out
        until(lambda: report(world)["committed"] + report(world)["dropped"] == 101)
    dropped = report(world)["dropped"]
    assert 80 <= dropped <= 90
    kept = {each[0] for each in stored(world)}
    assert len(kept) == 101 - dropped
    assert kept >= {f"t{i}" for i in range(95, 100)}


def test_a_config_is_refused_at_its_line(tmp_path: Path) -> None:
    wrong = {
        "  - name: a\n    kind: nothing\n": (":4:11", "ndjson"),
        "  - name: a\n    kind: ndjson\n    raed: x\n": (":5", "known are"),
        "  - kind: ndjson\n    read: x\n": (":3", "name"),
        "  - name: a\n    kind: ndjson\n    read: x\n    queue: 0\n": (":6", "queue"),
        "  - name: a\n    kind: ndjson\n    read: x\n  - name: a\n    kind: ndjson\n    read: y\n": (
            ":6:11",
            "another",
        ),
        "  - name: a\n    kind: ndjson\n    write: x\n    filter: colour = 1\n": (":6", "no property colour"),
        "  - name: a\n    kind: ndjson\n    write: x\n    changes_filter: kind =\n": (":6", "changes_filter"),
        "  []\n": (":3", "1 or more"),
    }
    for text, (where, said) in wrong.items():
        with pytest.raises(InvalidInput) as refused:
            read_config(config(tmp_path, text))
        assert where in str(refused.value)
        assert said in f"{refused.value} {refused.value.remedy}"


def test_a_new_bridge_gives_out_what_happens_from_its_command_on(world: World, tmp_path: Path) -> None:
    """Its command starts others, too, which may be quicker."""
    out = tmp_path / "events.ndjson"
    make_events(world, 3)
    past = Past(*world.rows("select max(seq), 0 from semap.event")[0])
    made = make_events(world, 4)
    with running(world, entry(tmp_path, write="events.ndjson"), past):
        until(lambda: out.exists() and out.read_bytes().count(b"\n") == 4)
    assert [json.loads(each)["id"] for each in out.read_bytes().splitlines()] == made


def test_events_go_out_in_their_order_once(world: World, tmp_path: Path) -> None:
    """A file of events has each once, though its bridge was killed in the middle of a line."""
    world.add_room("kitchen", shapely.box(0, 0, 4, 4))
    out = tmp_path / "events.ndjson"
    one = entry(tmp_path, write="events.ndjson", from_start=True)
    made = make_events(world, 30)
    with running(world, one):
        until(lambda: out.exists() and out.read_bytes().count(b"\n") == 30)
    out.write_bytes(out.read_bytes()[:-25])
    made += make_events(world, 5)
    with running(world, one):
        until(lambda: report(world)["delivered"] == 6)
    written = [json.loads(each) for each in out.read_bytes().splitlines()]
    assert [each["id"] for each in written] == made
    assert [int(each["sequence"]) for each in written] == sorted(int(each["sequence"]) for each in written)


def test_events_that_a_filter_does_not_take_are_passed_over(world: World, tmp_path: Path) -> None:
    """So is the cursor: none is looked at again by a bridge that gives out more later."""
    out = tmp_path / "events.ndjson"
    made = make_events(world, 9)
    numbers = [seq for (seq,) in world.rows("select seq from semap.event order by seq")]
    wanted = f"seq IN ({numbers[1]}, {numbers[4]}) OR (type = 'left' AND instance = 'nowhere')"
    one = entry(tmp_path, write="events.ndjson", from_start=True, filter=wanted)
    with running(world, one):
        until(lambda: report(world).get("delivered") == 2)
    assert [json.loads(each)["id"] for each in out.read_bytes().splitlines()] == [made[1], made[4]]
