"""Ready rules: each is a rule whatever it is filled with, and finds what its sentence says."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scene import DOORS, ROOMS, TRACKS, S, door, rule, visit

from semap.errors import InvalidInput, NotFound
from semap.rules.engine.run_over import run_over
from semap.rules.language.reading import parse_declaration, read_declaration
from semap.rules.language.template import TEMPLATES, fill
from semap.rules.row import Row

END_S = 1000


def found(template: str, rows: Iterable[Row], **parameters: object) -> list[tuple[object, ...]]:
    """Type, second, track and room or instance of each event, in order."""
    document = yaml.safe_load(fill(template, **parameters))
    events = run_over([rule(1, document)], rows, END_S * S)
    return sorted(
        (e.type, (e.stamp.timestamp()), e.track_name, e.key.get("room") or e.instance_name) for e in events
    )


@pytest.mark.parametrize("name", TEMPLATES)
def test_each_is_a_rule_that_says_what_it_is(name: str) -> None:
    text = fill(name)
    assert text.startswith(f"# {TEMPLATES[name].sentence}\n")
    declaration = read_declaration(text)
    assert parse_declaration(yaml.safe_load(text)) == declaration
    assert declaration.name in text
    assert "$" not in text
    for parameter in TEMPLATES[name].parameters:
        assert parameter.meaning
        assert fill(name, **{parameter.name: parameter.default}) == text


names = st.from_regex(r"[A-Za-z_][A-Za-z0-9_.-]{0,20}", fullmatch=True)


@given(
    st.text(st.characters(codec="utf-8", categories=["L", "N", "P", "S", "Zs"]), min_size=1, max_size=200),
    st.integers(1, 10**9),
    names,
)
def test_whatever_a_room_is_called(room: str, duration_us: int, name: str) -> None:
    declaration = read_declaration(fill("dwell", room=room, duration=duration_us / 1e6, query=f"q{name}"))
    assert declaration.where is not None
    assert declaration.where.args[1].value == room  # type: ignore[union-attr]
    assert declaration.within.match_us == duration_us
    assert declaration.inputs[0].name == f"q{name}"


@pytest.mark.parametrize(
    ("name", "parameters", "said"),
    [
        ("dwel", {}, "dwell"),
        ("dwell", {"rom": "x"}, "Did you mean room?"),
        ("dwell", {"duration": "ten minutes"}, "no duration"),
        ("dwell", {"room": "x" * 201}, "a name is needed"),
        ("dwell", {"room": 3}, "a name is needed"),
        ("dwell", {"name": "two words"}, "a name is needed"),
        ("dwell", {"name": "null"}, "no name to YAML"),
        ("visits", {"query": "a, b"}, "a name is needed"),
        ("count", {"more_than": "-1"}, "no count"),
        ("count", {"more_than": "four"}, "no count"),
        ("left_then_closed", {"reach_m": "0"}, "no distance"),
        ("left_then_closed", {"reach_m": "1.5.0"}, "no distance"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(name: str, parameters: dict[str, object], said: str) -> None:
    with pytest.raises((InvalidInput, NotFound)) as wrong:
        fill(name, **parameters)
    assert said in f"{wrong.value}\n{wrong.value.remedy}"
    assert wrong.value.remedy
    assert isinstance(wrong.value, NotFound) or wrong.value.where == next(iter(parameters))


Stay = tuple[str, str, float, float]
"""Track, room, from and to [s]."""


@st.composite
def stays(draw: st.DrawFn) -> list[Stay]:
    """Each track in one room at a time, with pauses; all stamps differ."""
    made: list[Stay] = []
    for shift, track in enumerate(TRACKS):
        at = 0.0
        for room in draw(st.lists(st.sampled_from(sorted(ROOMS)), max_size=5)):
            start = at + draw(st.integers(1, 30))
            at = start + draw(st.integers(1, 60))
            made.append((track, room, start + shift / 4, at + shift / 4))
    return made


def rows_of(made: Sequence[Stay], causes: bool = False) -> list[Row]:
    """Each stay as its two rows; with causes, each is an appearance and a disappearance."""
    began, ended = ({"cause": "appeared"}, {"cause": "disappeared"}) if causes else ({}, {})
    return [
        row
        for track, room, start, end in made
        for row in (
            visit(track, room, "began", start, **began),
            visit(track, room, "ended", end, start, **ended),
        )
    ]


@given(stays())
def test_visits(made: list[Stay]) -> None:
    assert found("visits", rows_of(made)) == sorted(
        event
        for track, room, start, end in made
        for event in (("entered", start, track, room), ("left", end, track, room))
    )


@given(stays(), st.integers(1, 60))
def test_a_stay_of_the_duration_or_longer_is_a_dwell_and_known_at_once(
    made: list[Stay], least_s: int
) -> None:
    assert found("dwell", rows_of(made), room="hall", duration=least_s) == sorted(
        ("dwelt", start + least_s, track, room)
        for track, room, start, end in made
        if room == "hall" and end - start >= least_s
    )


@given(stays(), st.integers(0, 1))
def test_a_room_is_crowded_from_one_too_many_until_they_are_no_longer(made: list[Stay], most: int) -> None:
    expected = []
    for room in ROOMS:
        changes = sorted(
            change
            for track, where, start, end in made
            if where == room
            for change in ((start, 1, track), (end, -1, track))
        )
        inside = 0
        for at, step, track in changes:
            inside += step
            if (inside, step) == (most + 1, 1):
                expected.append(("crowded", at, track, room))
            if (inside, step) == (most, -1):
                expected.append(("no_longer_crowded", at, track, room))
    assert found("count", rows_of(made), more_than=most) == sorted(expected)


@given(stays())
def test_first_and_last_sight_are_one_event_each_however_many_rooms_overlap(made: list[Stay]) -> None:
    rows = rows_of(made, causes=True)
    both = [
        *rows,
        *rows_of([(t, "office", start, end) for t, room, start, end in made if room == "hall"], causes=True),
    ]
    for template, type_, at in (("first_sight", "first_seen", 2), ("last_sight", "last_seen", 3)):
        expected = sorted((type_, stay[at], stay[0]) for stay in made)
        assert [event[:3] for event in found(template, both)] == expected
        assert found(template, rows_of(made)) == []


openings = st.lists(
    st.tuples(st.sampled_from(sorted(DOORS)), st.integers(1, 60), st.integers(1, 40)), max_size=4
)


@settings(max_examples=150)
@given(stays(), openings, st.integers(1, 20))
def test_open_and_nobody_there(made: list[Stay], doors: list[tuple[str, int, int]], least_s: int) -> None:
    """Time goes in quarters of a second, so that trying each says all."""
    rows, spans = rows_of(made), []
    for name in DOORS:
        at = 0.125
        for _, pause, length in (each for each in doors if each[0] == name):
            spans.append((name, at + pause, at + pause + length))
            at += pause + length
            rows += [door(name, "open", at - length), door(name, "closed", at)]
    expected = set()
    for room in ROOMS:
        opens = [(a, b) for name, a, b in spans if room in DOORS[name][1]]
        inside = [(a, b) for _, where, a, b in made if where == room]
        for start in {a for a, _ in opens} | {b for _, b in inside}:
            eighths = [start + n / 8 for n in range(8 * least_s + 1)]
            if all(
                any(a <= t < b for a, b in opens) and not any(a <= t < b for a, b in inside) for t in eighths
            ):
                expected.add((start + least_s, room))
    events = found("absence", rows, duration=least_s)
    assert {(at, room) for _, at, _, room in events} == expected


@settings(max_examples=150)
@given(
    stays(),
    st.lists(st.tuples(st.sampled_from(sorted(DOORS)), st.sampled_from(["ann", "bob", None])), max_size=12),
    st.data(),
)
def test_a_door_and_a_room_go_together_for_the_one_who_used_both(
    made: list[Stay], used: list[tuple[str, str | None]], data: st.DataObject
) -> None:
    """The oracle goes through all pairs, from each start to the first that fits and on after its end."""
    at, uses = 0.125, []
    for n, (name, actor) in enumerate(used):
        at += data.draw(st.integers(1, 15))
        uses.append((name, ("open", "closed")[n % 2], at, actor))
    rows = [*rows_of(made), *(door(*use) for use in uses)]
    entered = [(start, track, room) for track, room, start, _ in made]
    left = [(end, track, room) for track, room, _, end in made]
    opened, closed = (
        [(t, actor, room) for name, state, t, actor in uses if state == wanted for room in DOORS[name][1]]
        for wanted in ("open", "closed")
    )
    for template, firsts, seconds in (
        ("opened_then_entered", opened, entered),
        ("entered_then_closed", entered, closed),
        ("left_then_closed", left, closed),
    ):
        expected = []
        for room in ROOMS:
            free_s = 0.0
            for start, who, where in sorted(
                (each for each in firsts if each[2] == room), key=lambda each: each[0]
            ):
                ends = [
                    t for t, other, there in seconds
                    if there == room and other == who and who is not None and start < t < start + 6
                ]  # fmt: skip
                if where == room and start > free_s and ends:
                    free_s = min(ends)
                    expected.append((template, free_s, who, room))
        assert found(template, rows) == sorted(expected)
        assert found(template, rows, room="hall") == [e for e in sorted(expected) if e[3] == "hall"]
        of_ann = [
            *rows_of([stay for stay in made if stay[0] == "ann"]),
            *(door(*u) for u in uses if u[3] == "ann"),
        ]
        assert found(template, rows, person="ann") == found(template, of_ann)


@given(stays(), st.sampled_from(["", *TRACKS]), st.sampled_from(["", *sorted(ROOMS)]))
def test_a_person_and_a_room_that_are_named_are_the_only_ones(
    made: list[Stay], person: str, room: str
) -> None:
    chosen = [stay for stay in made if person in ("", stay[0]) and room in ("", stay[1])]
    assert found("visits", rows_of(made), person=person, room=room) == found("visits", rows_of(chosen))
    assert found("dwell", rows_of(made), person=person, room=room, duration=9) == found(
        "dwell", rows_of(chosen), duration=9
    )
    assert found("count", rows_of(made), more_than=1, room=room) == [
        event for event in found("count", rows_of(made), more_than=1) if room in ("", event[3])
    ]


@given(openings, st.integers(1, 60), st.sampled_from(["", *sorted(DOORS)]))
def test_a_door_that_stays_open_for_so_long(
    doors: list[tuple[str, int, int]], least_s: int, only: str
) -> None:
    rows, expected = [], []
    for name in DOORS:
        at, state = 0.125, None
        for _, pause, length in (each for each in doors if each[0] == name):
            opened, at = at + pause, at + pause + length
            # it is told a second time that it is open, which begins nothing anew
            middle = (opened + at) / 2
            rows += [door(name, "open", opened, previous=state), door(name, "open", middle, previous="open")]
            rows.append(door(name, "closed", at, previous="open"))
            state = "closed"
            if length >= least_s and only in ("", name):
                expected.append(("left_open", opened + least_s, None, name))
    assert found("left_open", rows, duration=least_s, door=only) == sorted(expected)


@given(stays(), st.integers(1, 60), st.sampled_from(["", *sorted(ROOMS)]))
def test_a_room_that_nobody_has_entered_for_so_long(made: list[Stay], least_s: int, only: str) -> None:
    expected = []
    for room in ROOMS:
        inside = [(a, b, who) for who, where, a, b in made if where == room and only in ("", room)]
        expected += [
            ("vacant", end + least_s, who, room)
            for _, end, who in inside
            if not any(a < end < b or end <= a < end + least_s for a, b, _ in inside)
        ]
    assert found("vacant", rows_of(made), duration=least_s, room=only) == sorted(expected)


rooms = st.sampled_from(["", *sorted(ROOMS)])


@given(stays(), st.integers(1, 90), rooms, rooms)
def test_who_leaves_a_room_and_enters_another_soon(
    made: list[Stay], within_s: int, left: str, entered: str
) -> None:
    expected = []
    for who, room, _, end in made:
        later = sorted(
            (start, other)
            for person, other, start, _ in made
            if person == who and other != room and entered in ("", other) and end <= start < end + within_s
        )
        if left in ("", room) and later:
            expected.append(("went_on", later[0][0], who, later[0][1]))
    assert found("went_on", rows_of(made), within=within_s, **{"from": left, "to": entered}) == sorted(
        expected
    )


@given(stays(), st.integers(1, 30), rooms)
def test_who_comes_in_right_behind_another(made: list[Stay], within_s: int, only: str) -> None:
    expected = []
    for room in ROOMS:
        entries = sorted(
            (start, who) for who, where, start, _ in made if where == room and only in ("", room)
        )
        expected += [
            ("came_behind", start, who, room)
            for (before, first), (start, who) in pairwise(entries)
            if who != first and start < before + within_s
        ]
    assert found("came_behind", rows_of(made), within=within_s, room=only) == sorted(expected)
