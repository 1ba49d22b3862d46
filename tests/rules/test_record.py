"""Records of steps: what is read is what was written, whatever rows say; each is taken once, in parts or whole."""

from __future__ import annotations

import json
import random
from collections.abc import Iterable, Sequence

import pytest
import shapely
from engine_store import Engine
from hypothesis import example, given
from hypothesis import strategies as st
from scene import ALL, MAP, VISITS, S, door, rule, visit

from semap.rules.engine import record
from semap.rules.engine.event_document import event_json
from semap.rules.engine.map_rules import MapRules
from semap.rules.engine.record import Handed, dump_record, load_steps, split_head
from semap.rules.engine.row_columns import dump_rows, load_rows
from semap.rules.engine.step import AsItComes, Due, MapGone, RuleChanged, Step
from semap.rules.row import Row

UID = "9f1c"
NAMES = ("input", "type", "track", "since", "x_m", "attributes", "neighbours", "position", "prev position")
TEXTS = st.text(max_size=3) | st.sampled_from(["kitchen", "hall"])
SHAPES = st.builds(shapely.Point, st.integers(-9, 9), st.integers(-9, 9))
PLAIN = (
    st.none() | st.booleans() | st.integers(-(2**53), 2**53) | st.floats(allow_nan=False, allow_infinity=False)
    | TEXTS | st.lists(TEXTS, max_size=2) | st.dictionaries(TEXTS, st.integers(0, 3), max_size=2)
)  # fmt: skip


@st.composite
def rows(draw: st.DrawFn) -> list[Row]:
    names = draw(st.lists(st.lists(st.sampled_from(NAMES), unique=True), min_size=1, max_size=2))
    shared = draw(st.lists(PLAIN, min_size=1, max_size=2))

    def value(name: str) -> object:
        if name.endswith("position"):
            return draw(SHAPES | st.none())
        return draw(st.sampled_from(shared) | PLAIN)

    def row() -> Row:
        values = {name: value(name) for name in draw(st.sampled_from(names))}
        concepts = draw(st.sampled_from([(), ("Room", "Space")]))
        source = draw(st.sampled_from(["relation", "map", "object_state", "event"]))
        return Row(
            draw(st.integers(-(2**60), 2**60)), draw(st.integers(0, 9)), draw(TEXTS), source, values, concepts
        )

    return [row() for _ in range(draw(st.integers(0, 9)))]


def exact(found: Iterable[Row]) -> list[str]:
    """Also of what Python takes for equal, such as 1 and true."""
    return [repr(row) for row in found]


@given(rows())
@example([Row(1, 0, "u", "map", {}), Row(2, 0, "v", "map", {})])
def test_rows_come_back_as_they_were(given_rows: list[Row]) -> None:
    assert exact(load_rows(json.loads(json.dumps(dump_rows(given_rows))))) == exact(given_rows)


def test_each_kind_of_step_comes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(record, "PART_CHARACTERS", 100)
    began = visit("ann", "kitchen", "began", 1)
    steps = [
        Due(MAP, 5, [began]), Due(MAP, 6, []), AsItComes(MAP, began), RuleChanged(MAP, 1, rule(1, VISITS)),
        RuleChanged(MAP, 1, rule(1, VISITS), [began], 3), RuleChanged(MAP, 1, None), MapGone(MAP),
        Handed(MAP, {"map": "[1, 2]"}),
    ]  # fmt: skip
    parts = [split_head(text) for text in dump_record(UID, "north", 77, steps)]
    assert {(head.map_uid, head.shard, head.lsn, head.parts) for head, _ in parts} == {
        (UID, "north", 77, len(parts))
    }
    assert [head.part for head, _ in parts] == list(range(1, len(parts) + 1))
    assert load_steps("".join(text for _, text in parts)) == steps


def scene() -> list[list[Step]]:
    """Transactions of a log: rules, then rows out of order within the lateness, and one that is too late."""
    dice = random.Random(5)
    arriving = []
    for number in range(120):
        at_s = 1 + number * 0.5
        track, room = dice.choice(["ann", "bob"]), dice.choice(["kitchen", "hall", "office"])
        if dice.random() < 0.3:
            arriving.append(
                door(
                    dice.choice(["kitchen_door", "office_door"]), dice.choice(["open", "closed"]), at_s, track
                )
            )
        else:
            arriving.append(visit(track, room, dice.choice(["began", "ended"]), at_s, at_s - dice.random()))
    engine, transactions = Engine(), []
    begun: list[Step] = []
    for number, document in enumerate(ALL, 1):
        engine.change_rule(number, rule(number, document))
        begun.append(RuleChanged(MAP, number, rule(number, document)))
    transactions.append(begun)
    for start in range(0, len(arriving), 6):
        some = arriving[start : start + 6]
        dice.shuffle(some)
        steps: list[Step] = [step for row in some if (step := engine.intake.arrive(MAP, row)) is not None]
        engine.watermark(MAP, 1, some[-1].stamp_us)
        transactions.append([*steps, *engine.intake.due()])
    transactions.append([Due(MAP, 300 * S, [])])
    return transactions


def told_by_steps(transactions: Sequence[Sequence[Step]]) -> list[object]:
    engine = Engine()
    return [
        json.loads(json.dumps(event_json(event)))
        for steps in transactions
        for step in steps
        for event in engine.half.take(step)
    ]


def events(made: Iterable[str]) -> list[object]:
    return [said["event"] for text in made if "event" in (said := json.loads(text))]


def apply(entries: dict[str, str], rules: MapRules) -> None:
    for name, text in rules.changes().items():
        if text is None:
            entries.pop(name, None)
        else:
            entries[name] = text


@pytest.mark.parametrize("part_characters", [900_000, 700])
def test_records_make_what_steps_make_doubled_and_wherever_the_process_is_made_anew(
    part_characters: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(record, "PART_CHARACTERS", part_characters)
    dice, transactions = random.Random(9), scene()
    expected = told_by_steps(transactions)
    assert len({event["rule_name"] for event in expected}) == len(ALL)
    texts = [text for lsn, steps in enumerate(transactions) for text in dump_record(UID, "north", lsn, steps)]
    entries: dict[str, str] = {}
    rules, made, place = MapRules(entries), [], 0
    while place < len(texts):
        made += rules.take(texts[place])
        place += 1
        if dice.random() < 0.3:
            apply(entries, rules)
            rules = MapRules(entries)
        if dice.random() < 0.2:  # who sends was killed, and goes on from where it had committed
            lsn = split_head(texts[place - 1])[0].lsn
            first = max(lsn - dice.randrange(3), 0)
            place = next(number for number, text in enumerate(texts) if split_head(text)[0].lsn == first)
    assert events(made) == expected


def test_a_map_is_handed_over_amid_what_is_under_way() -> None:
    transactions = scene()
    expected = told_by_steps(transactions)
    entries: dict[str, str] = {}
    before, made = MapRules(entries), []
    for lsn, steps in enumerate(transactions[:9]):
        made += before.take(*dump_record(UID, "north", lsn, steps))
    apply(entries, before)
    left = {name: text for name, text in entries.items() if not name.startswith("at/")}
    assert any(name.startswith("state/") for name in left)
    after = MapRules({})
    made += after.take(*dump_record(UID, "south", 3, [Handed(MAP, left)]))
    for lsn, steps in enumerate(transactions[9:], 4):
        made += after.take(*dump_record(UID, "south", lsn, steps))
    assert events(made) == expected


def test_a_map_that_goes_leaves_nothing_but_its_place() -> None:
    entries: dict[str, str] = {}
    rules = MapRules(entries)
    transactions = scene()
    for lsn, steps in enumerate([*transactions[:9], [MapGone(MAP)]]):
        rules.take(*dump_record(UID, "north", lsn, steps))
    apply(entries, rules)
    assert entries.keys() == {"at/north", "map"}
    assert rules.take(*dump_record(UID, "north", 30, transactions[10])) == []
