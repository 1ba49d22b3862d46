"""Why and why not: what is explained of a small scene, word for word."""

from __future__ import annotations

import pytest
from conformance.case import read_rows
from scene import CLOSES_SOON, DURING, OPENED_THEN_ENTERED, STAYED, TIMED_OUT, VISITS, S, door, rule, visit

from semap.errors import InvalidInput
from semap.rules.explanation.explanation import Explanation, explain
from semap.rules.explanation.moment import Moment
from semap.rules.language.reading import parse_declaration
from semap.rules.matching import pattern_program


def told(document: dict, rows: list, at_s: float, known_s: float = 0, **key: object) -> Explanation:
    return explain(rule(1, document).declaration, rows, round(at_s * S), key, round(known_s * S))


def test_a_match_is_explained_by_its_rows_and_their_conditions() -> None:
    rows = [visit("ann", "kitchen", "began", 4), door("kitchen_door", "open", 1, actor="ann")]
    found = told(OPENED_THEN_ENTERED, rows, 3, room="kitchen")
    assert found.match is not None
    assert found.as_text() == (
        "Rule opened_then_entered, room kitchen, at 1970-01-01T00:00:03Z:\n"
        "it found entered_by_door at 1970-01-01T00:00:04Z.\n"
        "  O: door open kitchen_door at 1970-01-01T00:00:01Z\n"
        "  E: track_in_room began ann kitchen at 1970-01-01T00:00:04Z\n"
        "  gap_s = 3.0\n"
        "  O holds of door open kitchen_door at 1970-01-01T00:00:01Z\n"
        "    yes input = 'door': 'door' = 'door'\n"
        "    yes type = 'open': 'open' = 'open'\n"
        "  E holds of track_in_room began ann kitchen at 1970-01-01T00:00:04Z\n"
        "    yes input = 'track_in_room': 'track_in_room' = 'track_in_room'\n"
        "    yes type = 'began': 'began' = 'began'\n"
        "    yes track = first(O.actor): 'ann' = 'ann'"
    )


def test_what_is_missing_is_the_condition_that_failed_next() -> None:
    rows = [
        door("kitchen_door", "open", 1, actor="bob"), visit("ann", "kitchen", "began", 4),
        visit("ann", "kitchen", "ended", 5), visit("bob", "kitchen", "began", 50),
    ]  # fmt: skip
    found = told(OPENED_THEN_ENTERED, rows, 4, room="kitchen")
    assert found.match is None
    assert found.as_text() == (
        "Rule opened_then_entered, room kitchen, at 1970-01-01T00:00:04Z:\n"
        "it found nothing. The furthest that it came:\n"
        "  O: door open kitchen_door at 1970-01-01T00:00:01Z\n"
        "  What came nearest to being next:\n"
        "  E fails of track_in_room began ann kitchen at 1970-01-01T00:00:04Z\n"
        "    yes input = 'track_in_room': 'track_in_room' = 'track_in_room'\n"
        "    yes type = 'began': 'began' = 'began'\n"
        "    no  track = first(O.actor): 'ann' = 'bob'\n"
        "  Its window ended at 1970-01-01T00:00:07Z."
    )


def test_a_row_that_broke_a_strict_sequence_is_shown() -> None:
    rows = [visit("ann", "kitchen", "began", 1), visit("ann", "hall", "began", 2),
            visit("ann", "kitchen", "ended", 2.5)]  # fmt: skip
    found = told({**TIMED_OUT, "emit": "short_visit"}, rows, 2, track="ann")
    assert found.near_miss is not None
    (asked,) = found.near_miss.asked
    assert (asked.variable, asked.row.uid, [part.found for part in asked.parts]) == (
        "L",
        rows[1].uid,
        ["'began' = 'ended'"],
    )
    assert (found.near_miss.ended_us, found.near_miss.is_open) == (None, False)


def test_what_was_to_be_absent_and_came_is_shown() -> None:
    rows = [visit("ann", "kitchen", "began", 1), visit("ann", "kitchen", "ended", 3)]
    found = told(STAYED, rows, 4, track="ann", room="kitchen")
    assert found.near_miss is not None
    (came,) = found.near_miss.came
    assert (came.variable, came.row.uid) == ("L", rows[1].uid)
    assert "L was to be absent, but came:" in found.as_text()


def test_what_has_not_ended_is_under_way() -> None:
    found = told(STAYED, [visit("ann", "kitchen", "began", 1)], 2, track="ann", room="kitchen")
    assert found.near_miss is not None
    assert found.near_miss.is_open
    assert found.as_text().endswith("It is still under way.")
    absent = {**STAYED, "pattern": "B followed by L"}
    found = told(absent, [visit("ann", "kitchen", "began", 1)], 2, 100, track="ann", room="kitchen")
    assert found.as_text().endswith("Its window ended at 1970-01-01T00:00:04Z.")


def test_where_nothing_began_the_row_that_came_nearest_is_shown() -> None:
    rows = [door("kitchen_door", "closed", 1), visit("ann", "kitchen", "began", 2)]
    found = told(OPENED_THEN_ENTERED, rows, 2, room="kitchen")
    assert found.near_miss is not None
    (asked,) = found.near_miss.asked
    assert (found.near_miss.bound, asked.row.uid, [part.holds for part in asked.parts]) == (
        (),
        rows[0].uid,
        [True, False],
    )


def test_where_no_row_was_read_what_left_it_out_is_shown() -> None:
    only_office = OPENED_THEN_ENTERED | {"where": "room = 'office' or track = 'bob'"}
    found = told(only_office, [visit("ann", "kitchen", "began", 2)], 2, room="kitchen")
    assert found.left_out is not None
    assert [part.found for part in found.left_out.parts] == ["'kitchen' = 'office'", "'ann' = 'bob'"]
    assert (
        told(only_office, [], 2, room="kitchen")
        .as_text()
        .endswith("it read no row of this key near that time.")
    )


def test_other_kinds_of_rules_are_explained_by_their_matches_and_conditions() -> None:
    opened, began = door("kitchen_door", "open", 1), visit("ann", "kitchen", "began", 2)
    during = told(DURING, [opened, began, visit("ann", "kitchen", "ended", 3)], 3, room="kitchen")
    assert during.match is not None
    assert [(asked.variable, asked.holds) for asked in during.held] == [("D", True), ("P", True)]
    nothing = told(DURING, [began], 3, room="kitchen")
    assert nothing.near_miss is not None
    assert [(asked.variable, asked.holds) for asked in nothing.near_miss.asked] == [("P", True), ("D", False)]
    fails = told(CLOSES_SOON, [opened], 3, instance="kitchen_door")
    assert (fails.match.type if fails.match else None) == "left_open"
    (held,) = fails.held
    assert (held.variable, held.holds) == ("O", True)
    visits = told(VISITS, [began], 2)
    assert (visits.match.type if visits.match else None) == "entered"


@pytest.mark.parametrize("key", [{}, {"track": "ann"}, {"room": "kitchen", "track": "ann"}])
def test_another_key_than_that_of_the_rule_is_refused(key: dict) -> None:
    with pytest.raises(InvalidInput, match="the key room") as wrong:
        told(OPENED_THEN_ENTERED, [], 1, **key)
    assert wrong.value.remedy == "Name each part of it: --key room=..."


def test_beside_a_match_it_is_said_why_nothing_was_found_at_the_moment() -> None:
    """The match is within the window of the moment, and not what was asked about."""
    rows = [
        door("kitchen_door", "open", 1, actor="ann"), visit("ann", "kitchen", "began", 4),
        door("kitchen_door", "open", 6, actor="bob"), visit("ann", "kitchen", "began", 8),
    ]  # fmt: skip
    found = told(OPENED_THEN_ENTERED, rows, 8, 100, room="kitchen")
    assert found.match is None
    assert found.as_text() == (
        "Rule opened_then_entered, room kitchen, at 1970-01-01T00:00:08Z:\n"
        "it found nothing. The furthest that it came:\n"
        "  O: door open kitchen_door at 1970-01-01T00:00:06Z\n"
        "  What came nearest to being next:\n"
        "  E fails of track_in_room began ann kitchen at 1970-01-01T00:00:08Z\n"
        "    yes input = 'track_in_room': 'track_in_room' = 'track_in_room'\n"
        "    yes type = 'began': 'began' = 'began'\n"
        "    no  track = first(O.actor): 'ann' = 'bob'\n"
        "  Its window ended at 1970-01-01T00:00:12Z.\n"
        "The nearest that it found: entered_by_door at 1970-01-01T00:00:04Z."
    )
    there = told(OPENED_THEN_ENTERED, rows, 4, room="kitchen").match
    assert there is not None
    assert there.stamp_us == 4 * S


def test_where_nothing_was_under_way_the_row_of_the_moment_says_why() -> None:
    rows = [
        door("kitchen_door", "open", 1, actor="ann"), visit("ann", "kitchen", "began", 4),
        door("kitchen_door", "closed", 5, actor="ann"), door("kitchen_door", "open", 30, actor="bob"),
    ]  # fmt: skip
    found = told(OPENED_THEN_ENTERED, rows, 5, room="kitchen")
    assert found.near_miss is not None
    assert found.near_miss.is_distant
    assert [(asked.variable, asked.row.uid) for asked in found.near_miss.beginning] == [("O", rows[2].uid)]
    assert [row.uid for _, row in found.near_miss.bound] == [rows[3].uid]
    assert (
        "no attempt was under way at that time.\n  What came nearest to beginning one:\n  O fails"
        in found.as_text()
    )
    assert found.as_text().endswith("The nearest that it found: entered_by_door at 1970-01-01T00:00:04Z.")


def test_a_row_that_ended_an_attempt_is_named() -> None:
    rows = [
        visit("ann", "kitchen", "began", 1),
        visit("ann", "hall", "began", 2),
        visit("ann", "hall", "ended", 20),
    ]
    found = told({**TIMED_OUT, "emit": "short_visit"}, rows, 1, track="ann")
    assert found.near_miss is not None
    assert found.near_miss.ended_by == rows[1]
    assert found.as_text().endswith("It was ended by track_in_room began ann hall at 1970-01-01T00:00:02Z.")


TWICE = {
    "name": "twice", "input": "track_in_room", "partition_by": "track", "pattern": "A followed by B followed by C",
    "define": {"A": "type = 'began'", "B": "type = 'began'", "C": "type = 'began'"}, "within": "1 min", "emit": "came",
}  # fmt: skip


def test_what_matches_and_was_skipped_is_told_with_what_skipped_it() -> None:
    rows = [visit("ann", "kitchen", "began", at_s) for at_s in (1, 2, 3, 4)]
    found = told(TWICE, rows, 4, track="ann")
    assert found.match is None
    assert found.near_miss is not None
    assert [row.stamp_us // S for _, row in found.near_miss.bound] in ([2, 3, 4],)
    assert (
        "They were skipped after another match (after_match): came at 1970-01-01T00:00:03Z."
        in found.as_text()
    )
    every = told({**TWICE, "after_match": "skip to next row"}, rows, 4, track="ann")
    assert every.match is not None
    assert every.match.stamp_us == 4 * S


def test_what_matches_and_is_too_unsure_is_told_with_its_confidence() -> None:
    unsure = {
        **OPENED_THEN_ENTERED,
        "confidence": {"gap": ["O", "E"], "distribution": "exponential", "mean_s": 1, "at_least": 0.9},
    }
    rows = [door("kitchen_door", "open", 1, actor="ann"), visit("ann", "kitchen", "began", 6)]
    found = told(unsure, rows, 6, room="kitchen")
    assert found.match is None
    assert "It was too unsure: confidence 0.00674 is less than at_least." in found.as_text()


def test_a_moment_within_a_match_tells_what_else_came_to_nothing_then() -> None:
    rows = [
        door("kitchen_door", "open", 1, actor="ann"), door("kitchen_door", "open", 2, actor="bob"),
        visit("ann", "kitchen", "began", 6),
    ]  # fmt: skip
    found = told(OPENED_THEN_ENTERED | {"after_match": "skip to next row"}, rows, 3, room="kitchen")
    assert found.match is not None
    assert found.near_miss is not None
    assert [row.uid for _, row in found.near_miss.bound] == [rows[1].uid]
    assert told(OPENED_THEN_ENTERED, rows, 6, room="kitchen").near_miss is None


def test_what_was_given_up_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pattern_program, "RUNS_AT_MOST", 2)
    rows = [visit("ann", "kitchen", "began", at_s) for at_s in (1, 2, 3)]
    document = {**TWICE, "after_match": "skip to next row", "pattern": "A followed by B",
                "define": {"A": "type = 'began'", "B": "type = 'ended'"}}  # fmt: skip
    found = told(document, rows, 1, track="ann")
    assert found.near_miss is not None
    assert found.near_miss.given_up
    assert "It was given up: too much was under way in this key." in found.as_text()
    assert "Around that time: It gave up 1 attempt" in found.as_text()


@pytest.mark.parametrize(
    ("at_us", "until_us"), [(5 * S, 6 * S - 1), (5 * S + 7_000, 5 * S + 7_999), (5 * S + 7, 5 * S + 7)]
)
def test_a_moment_is_as_long_as_it_was_given_exactly(at_us: int, until_us: int) -> None:
    """An event of 12:00:04.250 is at 12:00:04 for whoever reads it off a clock."""
    assert Moment.at(at_us) == Moment(at_us, until_us)
    found = told(VISITS, [visit("ann", "kitchen", "began", 5.000007)], at_us / S)
    assert (found.match is not None) is (at_us != 5 * S + 7_000)


def test_of_a_row_in_no_match_it_says_why_it_is_in_none() -> None:
    document = {
        "input": "moves", "pattern": "^ A {- B -} C", "subset": {"S": ["A", "B"]},
        "define": {"A": "type = 'a'", "B": "type = 'b' and occupants > prev(occupants)",
                   "C": "type = 'c' and count(S) = 3 and last(classifier(), 1) = 'B'"},
        "emit": {"match": "found", "unmatched": "alone"},
    }  # fmt: skip
    rows = [row.saying({**row.values, "input": "moves"}) for row in read_rows("a:1 b:2 c")]
    text = explain(parse_declaration(document, "r"), rows, 1_000_000, known_us=3_000_000).as_text()
    assert "it found alone at" in text
    assert "no  count(S.stamp) = 3: 2 = 3" in text
    assert "yes last(classifier(), 1) = 'B': 'B' = 'B'" in text
