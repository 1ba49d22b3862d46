"""Rows that begin and end intervals, and programs driven through them in pieces."""

import json

from semap.rules.bound import Condition
from semap.rules.row import Row


def relation(stamp_us: int, kind: str, query: str, track_id: int = 1, instance_id: int = 1) -> Row:
    """A relation that began or ended."""
    uid = f"{query}-{track_id}-{instance_id}-{kind}-{stamp_us}"
    values = {
        "input": query,
        "type": kind,
        "stamp": stamp_us,
        "track_id": track_id,
        "instance_id": instance_id,
    }
    return Row(stamp_us, 3 if kind == "began" else 2, uid, "relation", values)


def new_state(stamp_us: int, input_name: str, value: str, instance_id: int = 1) -> Row:
    """An object's new state."""
    values = {"input": input_name, "type": value, "stamp": stamp_us, "instance_id": instance_id}
    return Row(stamp_us, 1, f"{input_name}-{instance_id}-{value}-{stamp_us}", "object_state", values)


def where(**wanted: str) -> Condition:
    """Each of these properties has this value."""
    asked = {"input" if name == "of" else name: value for name, value in wanted.items()}

    def test(row: Row) -> bool:
        return all(row.values.get(name) == value for name, value in asked.items())

    return Condition(test, lambda row, bound, before: test(row))


def nothing_measured(bound, stamp_us):
    return {}, None


def run(program, rows, until_us, advances=frozenset(), stored=False):
    """All matches of a stream; `advances` are watermarks given on the way, `stored` cuts after each input."""
    state, found = None, []

    def kept(given):
        state, matches = given
        found.extend(matches)
        if stored and state is not None:
            state = program.load(json.loads(json.dumps(program.dump(state))))
        return state

    for row in rows:
        for watermark_us in sorted(each for each in advances if each < row.stamp_us):
            state = kept(program.advance(state, watermark_us))
        advances = {each for each in advances if each >= row.stamp_us}
        state = kept(program.step(state, row))
    for watermark_us in sorted({*advances, until_us}):
        state = kept(program.advance(state, watermark_us))
    return state, found


def run_by_deadlines(program, rows, until_us):
    """The matches with the watermark at which each was given, where time stops only at rows and deadlines."""
    state, found = None, []

    def pass_time(before_us):
        nonlocal state
        while (deadline_us := program.deadline_us(state)) is not None and deadline_us < before_us:
            given = state
            state, matches = program.advance(state, deadline_us)
            assert matches or state != given, "a deadline at which there was nothing to do"
            found.extend((deadline_us, match) for match in matches)

    for row in rows:
        pass_time(row.stamp_us)
        state, matches = program.step(state, row)
        assert not matches, "a match that no deadline announced"
    pass_time(until_us)
    return state, found


def said(matches):
    """What matches say, in a form that can be compared and read."""
    return [
        (match.type, match.stamp_us, [(variable, row.uid) for variable, row in match.rows])
        for match in matches
    ]
