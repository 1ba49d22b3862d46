"""States over HTTP: rows, columns and lines mean the same; a repeat is harmless; what is wrong is said by its index."""

from __future__ import annotations

import json
from contextlib import ExitStack
from datetime import UTC, datetime, timedelta

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator
from patience import PATIENCE_S
from running import START, Service
from semap_ingest.named_states import NamedStates
from semap_ingest.state_json import states_of, states_of_lines
from semap_service.documents.state import SentStates, StatesHello, Taken
from web_socket import connect
from websockets.exceptions import ConnectionClosed

from semap.timeline.stamp import rfc3339

STORED = (
    "select t.name, s.stamp, s.x_m, s.y_m, s.z_m from semap.stored_state s join semap.track t using (track_id)"
    " order by s.stamp, t.name"
)


def at(second: float) -> str:
    return rfc3339(START + timedelta(seconds=second))


def row(track: str, second: float, x_m: float, **more: object) -> dict:
    return {"track": track, "stamp": at(second), "x_m": x_m, "y_m": 0.5, **more}


def post(service: Service, states: object, status: int = 200, **more: object) -> dict:
    response = service.client.post("/maps/office/states", json={"source": "lidar", "states": states, **more})
    assert response.status_code == status, response.text
    return response.json()


def stored(service: Service) -> list[tuple]:
    return service.plain.execute(STORED).fetchall()


@pytest.fixture
def office(service: Service) -> Service:
    service.make_map()
    return service


def test_rows_columns_and_lines_store_the_same(office: Service) -> None:
    rows = [row(f"t{i}", second, i + second, z_m=None if i else 1.0) for second in range(3) for i in range(4)]
    columns = {key: [each[key] for each in rows] for key in rows[0]}
    lines = "\n".join(json.dumps(each) for each in rows)
    seen = []
    for form in ("rows", "columns", "lines"):
        if form == "lines":
            answer = office.client.post(
                "/maps/office/states", params={"source": "lidar"}, content=lines,
                headers={"Content-Type": "application/x-ndjson"},
            ).json()  # fmt: skip
        else:
            answer = post(office, rows if form == "rows" else columns)
        assert answer == {
            "accepted": 12, "repeated": False, "sequence": None, "late": 0, "late_indexes": [], "refused": 0,
            "refusals": [],
        }  # fmt: skip
        seen.append(stored(office))
        office.plain.execute("delete from semap.source")
    assert seen[0] == seen[1] == seen[2]
    assert seen[0] == [
        (f"t{i}", START + timedelta(seconds=second), float(i + second), 0.5, None if i else 1.0)
        for second in range(3)
        for i in range(4)
    ]


def test_what_is_wrong_is_refused_by_its_index_and_keeps_nothing_out(office: Service) -> None:
    answer = post(
        office,
        [
            row("a", 0, 1.0), row("a", 0, 2.0), {"track": "a"}, row("b", 0, 1e9), row("c", 0, 1.0, std_m=-1.0), 7,
            row("d", 0, 1.0, speed_mps="3"), row("e", 1e9, 1.0), row("f", 0, 1.0),
        ],
    )  # fmt: skip
    assert answer["accepted"] == 2
    assert answer["refused"] == 7
    assert [(each["index"], each["reason"]) for each in answer["refusals"]] == [
        (1, "repeated"), (2, "no stamp"), (3, "x_m out of range"), (4, "std_m out of range"), (5, "no state"),
        (6, "speed_mps is no number"), (7, "stamp in the future"),
    ]  # fmt: skip
    assert [each[0] for each in stored(office)] == ["a", "f"]
    many = post(office, [row("a", 0, 1.0)] * 1000)
    assert (many["accepted"], many["refused"], len(many["refusals"])) == (0, 1000, 20)


def test_what_came_late_is_told(office: Service) -> None:
    post(office, [row("a", 10, 1.0), row("b", 5, 1.0)])
    answer = post(office, [row("a", 11, 1.0), row("a", 9, 1.0), row("b", 6, 1.0), row("b", 4, 1.0)])
    assert (answer["accepted"], answer["late"], answer["late_indexes"]) == (4, 2, [1, 3])


def test_a_sequence_makes_a_repeat_harmless(office: Service) -> None:
    first = post(office, [row("a", 0, 1.0)], sequence=7)
    assert (first["accepted"], first["repeated"], first["sequence"]) == (1, False, 7)
    again = post(office, [row("a", 5, 1.0)], sequence=7)
    assert (again["accepted"], again["repeated"]) == (0, True)
    assert len(stored(office)) == 1
    assert post(office, [row("a", 5, 1.0)], sequence=8)["accepted"] == 1
    assert post(office, [row("a", 6, 1.0)], sequence=1, source="other")["accepted"] == 1


def test_a_watermark_moves_with_the_states(office: Service) -> None:
    post(office, [row("a", 0, 1.0)], watermark=at(3))
    post(office, [], watermark=at(2))
    assert office.plain.execute("select watermark from semap.source").fetchone() == (
        START + timedelta(seconds=3),
    )


@pytest.mark.parametrize(
    ("body", "status"),
    [
        ({"states": []}, 422), ({"source": "a"}, 422), ({"source": "a", "states": 7}, 422),
        ({"source": "", "states": []}, 422), ({"source": "a", "states": [], "more": 1}, 422),
        ({"source": "a", "states": {"track": ["a"], "x_m": [1, 2]}}, 422),
        ({"source": "a", "states": [], "sequence": 0}, 422), ({"source": "a", "states": [], "sequence": "7"}, 422),
        ({"source": "a", "states": [], "watermark": "now"}, 422),
        ({"source": "a", "states": [row("a", 0, 1.0)] * 30_000}, 413),
    ],
)  # fmt: skip
def test_what_is_no_message_is_a_problem(office: Service, body: dict, status: int) -> None:
    response = office.client.post("/maps/office/states", json=body)
    assert response.status_code == status, response.text
    assert response.json()["remedy"] or status == 413


def test_an_unknown_map_is_told(office: Service) -> None:
    response = office.client.post("/maps/nowhere/states", json={"source": "a", "states": []})
    assert response.status_code == 404


SCHEMAS = {
    kind: Draft202012Validator(
        model.model_json_schema(mode="serialization"), format_checker=Draft202012Validator.FORMAT_CHECKER
    )
    for kind, model in (("hello", StatesHello), ("taken", Taken))
}
SENT = Draft202012Validator(SentStates.model_json_schema())


class Talk:
    """A client of the socket that holds both sides against the published documents."""

    def __init__(self, service: Service, source: str = "lidar") -> None:
        url = f"{service.url.replace('http', 'ws')}/maps/office/states/live?source={source}"
        self._open = ExitStack()
        self.socket = self._open.enter_context(connect(url))
        self.hello = self.next()

    def __enter__(self) -> Talk:
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def next(self) -> dict:
        said = json.loads(self.socket.recv(timeout=PATIENCE_S))
        if said["type"] != "error":
            SCHEMAS[said["type"]].validate(said)
        return said

    def say(self, sequence: int, states: object, **more: object) -> dict:
        message = {"sequence": sequence, "states": states, **more}
        SENT.validate(message)
        self.socket.send(json.dumps(message))
        return self.next()


def test_a_socket_answers_each_message(office: Service) -> None:
    columns = {"track": ["a", "b"], "stamp": at(0), "x_m": [1.0, 2.0], "y_m": 0.5}
    with Talk(office) as talk:
        assert talk.hello == {"type": "hello", "source": "lidar", "sequence": 0, "window": 16}
        assert talk.say(1, columns)["accepted"] == 2
        assert talk.say(2, [row("a", 1, 1.0), row("b", -1, 2.0)])["late_indexes"] == [1]
    with Talk(office) as again:
        assert again.hello["sequence"] == 2
        assert again.say(2, columns)["repeated"]
        assert again.say(5, [row("a", 9, 1.0)])["accepted"] == 1
    assert len(stored(office)) == 5


def test_two_clients_that_count_for_one_source_are_told(office: Service) -> None:
    with Talk(office) as one, Talk(office) as other:
        assert one.say(1, [row("a", 0, 1.0)])["accepted"] == 1
        told = other.say(1, [row("b", 0, 1.0)])
        assert told["type"] == "error"
        assert "Another client" in told["detail"]
        with pytest.raises(ConnectionClosed) as closed:
            other.socket.recv(timeout=PATIENCE_S)
        assert closed.value.rcvd.code == 4400


@pytest.mark.parametrize(
    "text", ["", "[]", "no json", '{"states": []}', '{"sequence": 1, "states": [], "x": 2}']
)
def test_a_socket_says_what_is_no_message(office: Service, text: str) -> None:
    with Talk(office) as talk:
        talk.socket.send(text)
        assert talk.next()["type"] == "error"


VALUES = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5), st.just(at(0)), st.just([]),
    st.integers(10**18, 10**25),
)  # fmt: skip
MEMBERS = st.sampled_from(["track", "stamp", "stamp_us", "x_m", "y_m", "z_m", "is_last", "std_m", "odd"])
ROWS = st.lists(st.one_of(st.dictionaries(MEMBERS, VALUES), VALUES), max_size=6)


@settings(max_examples=300)
@given(ROWS)
def test_the_decoder_takes_or_refuses_each_record(rows: list) -> None:
    states, refused = states_of(rows)
    indexes = [*states.index.tolist(), *(each.index for each in refused)]
    assert sorted(indexes) == list(range(len(rows)))
    assert all(len(each) == len(states) for each in states.values.values())
    by_line, _ = states_of_lines([json.dumps(each).encode() for each in rows])
    assert by_line.names == states.names


@settings(max_examples=200, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(st.binary(max_size=30), max_size=5))
def test_the_decoder_takes_any_bytes(lines: list[bytes]) -> None:
    states, _ = states_of_lines(lines)
    assert len(states) == 0


@given(
    st.lists(
        st.tuples(st.sampled_from("abc"), st.integers(0, 10), st.floats(-100, 100), st.none() | st.floats(0, 5)),
        min_size=1, max_size=10,
    )
)  # fmt: skip
def test_rows_and_columns_are_read_alike(said: list[tuple]) -> None:
    rows = [{"track": t, "stamp": at(s), "x_m": x, "y_m": x, "z_m": z} for t, s, x, z in said]
    columns = {key: [each[key] for each in rows] for key in rows[0]}
    of_rows, of_columns = states_of(rows)[0], states_of(columns)[0]
    for read in (of_rows, of_columns):
        assert list(read.names) == [each[0] for each in said]
        assert [datetime.fromtimestamp(us / 1e6, UTC) for us in read.stamp_us] == [
            START + timedelta(seconds=each[1]) for each in said
        ]
        assert read.value("x_m").tolist() == [each[2] for each in said]
    assert repr(of_rows.value("z_m").tolist()) == repr(of_columns.value("z_m").tolist())
    assert len(NamedStates.joined([of_rows, of_columns])) == 2 * len(said)
