"""Rules and streams made at random as texts, and certificates of them with something changed."""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Mapping
from typing import Any

from hypothesis import strategies as st
from rules.pattern_cases import patterns

from semap.rules.language import pattern_text
from semap.rules.row import Row

S = 1_000_000
ALONE = (
    "type = 'a'",
    "type in ('a', 'b')",
    "type = 'b' or occupants > 1",
    "not (type = 'c')",
    "type <> prev(type)",
)
OF_BOUND = (
    "count(A) <= 2", "occupants >= first(occupants)", "type = first(type)", "occupants > last(occupants, 1)",
    "A.occupants < 3 and type <> 'c'", "sum(occupants) < 5", "classifier() = 'A' or type = 'b'",
)  # fmt: skip
MEASURES = (
    "count()", "first(A.stamp)", "sum(occupants)", "array(type)", "last(B.type)", "classifier()", "prev(type)",
    "match_number()", "seconds_between(first(stamp), last(stamp))", "final(count(A))", "distinct(stamp)",
)  # fmt: skip
WITHIN = ("1 s", "3 s", {"match": "4 s", "step": "2 s"}, {"match": "6 s", "B": "2 s"}, {"step": "2 s"})
AFTER = (
    "skip past last row", "skip to next row", "skip to first B", "skip to last A", "no skip", "no skip, clear",
    "no skip, at most 1",
)  # fmt: skip
EMITS = (
    {"match": "found"}, {"match": "found", "timeout": "over"}, {"match": "found", "empty": "nothing"},
    {"match": "found", "unmatched": "alone"},
)  # fmt: skip


@st.composite
def pattern_rules(draw: st.DrawFn) -> dict[str, Any]:
    text = pattern_text.write(draw(patterns))
    names = [name for name in "ABCNMU" if name in text]
    texts = st.sampled_from(ALONE) | (
        st.sampled_from(OF_BOUND) if "A" in text and "B" in text else st.nothing()
    )
    rule: dict[str, Any] = {
        "name": "made", "input": "moves", "pattern": text, "emit": draw(st.sampled_from(EMITS)),
        "define": {name: draw(texts) for name in names},
    }  # fmt: skip
    if draw(st.booleans()):
        rule["within"] = draw(st.sampled_from(WITHIN))
    if draw(st.booleans()):
        rule["after_match"] = draw(st.sampled_from(AFTER))
    if draw(st.integers(0, 3)) == 0:
        rule["measures"] = {"m": draw(st.sampled_from(MEASURES))}
    if draw(st.integers(0, 5)) == 0:
        rule["rows_per_match"] = "all"
    if draw(st.integers(0, 5)) == 0:
        rule["confidence"] = {
            "gap": ["A", "B"],
            "distribution": "exponential",
            "mean_s": 2.0,
            "at_least": 0.4,
        }
    return rule


@st.composite
def streams(draw: st.DrawFn, most: int = 7) -> list[Row]:
    rows, stamp_us = [], 10 * S
    for number in range(draw(st.integers(1, most))):
        stamp_us += draw(st.sampled_from((0, S, S, 2 * S)))
        values = {
            "input": "moves", "type": draw(st.sampled_from("abc")), "stamp": stamp_us,
            "occupants": draw(st.integers(0, 3)), "room": "r", "room_id": draw(st.sampled_from((1, 1, 2))),
        }  # fmt: skip
        rows.append(Row(stamp_us, 2, f"{number:04}", "relation", values))
    return rows


@st.composite
def changed(draw: st.DrawFn, certificate: Mapping[str, Any]) -> dict[str, Any]:
    """The certificate with a few of its values changed, in the rule, the rows or what it claims."""
    document: dict[str, Any] = copy.deepcopy(dict(certificate))
    for _ in range(draw(st.integers(1, 3))):
        places = [*_places(document)]
        holder, key = places[draw(st.integers(0, len(places) - 1))]
        value = holder[key]
        if isinstance(value, list) and value and draw(st.booleans()):
            place = draw(st.integers(0, len(value) - 1))
            if draw(st.booleans()):
                del value[place]
            else:
                value.insert(draw(st.integers(0, len(value))), copy.deepcopy(value[place]))
            continue
        alike = [other[at] for other, at in places if type(other[at]) is type(value)]
        new = draw(st.sampled_from(alike)) if alike else None
        if isinstance(value, int) and not isinstance(value, bool):
            new = draw(st.sampled_from([value + 1, value - 1, value + S, value - S, new]))
        holder[key] = copy.deepcopy(new)
    return json.loads(json.dumps(document))


def _places(value: Any) -> Any:
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, each in items:
        yield value, key
        yield from _places(each)


ATOMS = {
    "P": "input = 'moves' and type = 'began'",
    "Q": "input = 'door' and type = 'open'",
    "R": "type = 'shut'",
}
OF_ASKED = (
    "input = 'moves' and track_id <> W.track_id", "type = 'began' and stamp > W.stamp", "type = first(W.type)",
    "instance_id <> W.instance_id",
)  # fmt: skip
RELATIONS = (
    "before",
    "meets",
    "overlaps",
    "during",
    "starts",
    "finishes",
    "equals",
    "intersects",
    "after",
    "contains",
)


def bounds() -> st.SearchStrategy[str]:
    ends = st.tuples(st.integers(0, 3), st.integers(0, 3)).map(sorted)
    return ends.map(lambda pair: f"[{pair[0]} s, {pair[1]} s]") | st.just("[1 s, inf]")


def formula_texts(operators: tuple[str, ...], binary: tuple[str, ...]) -> st.SearchStrategy[str]:
    def larger(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
        return (
            inner.map(lambda one: f"not ({one})")
            | st.tuples(inner, st.sampled_from(("and", "or")), inner).map(
                lambda x: f"({x[0]}) {x[1]} ({x[2]})"
            )
            | st.tuples(st.sampled_from(operators), bounds(), inner).map(lambda x: f"{x[0]}{x[1]} ({x[2]})")
            | st.tuples(inner, st.sampled_from(binary), bounds(), inner).map(
                lambda x: f"({x[0]}) {x[1]}{x[2]} ({x[3]})"
            )
        )

    return st.recursive(st.sampled_from(("P", "Q")), larger, max_leaves=4)


@st.composite
def formula_rules(draw: st.DrawFn) -> dict[str, Any]:
    text = draw(
        formula_texts(("always", "eventually", "once", "historically", "previous"), ("until", "since"))
    )
    when = draw(st.sampled_from((None, "P", "R")))
    atoms = dict(ATOMS)
    if when is not None and draw(st.booleans()):
        atoms["Q"] = draw(st.sampled_from(OF_ASKED)).replace("W", when)
    used = [name for name in ATOMS if name in text or name == when]
    emit = draw(st.sampled_from(({"holds": "yes"}, {"fails": "no"}, {"holds": "yes", "fails": "no"})))
    rule = {"name": "made", "input": ["moves", {"object_state": "door"}], "formula": text, "emit": emit,
            "define": {name: atoms[name] for name in used}}  # fmt: skip
    return {**rule, "when": when} if when else rule


QUANTIFIED = {
    "L": "input = 'moves' and type = 'began'", "K": "track_id <> L.track_id", "N": "input = 'door' and stamp > L.stamp",
    "P": "input = 'door' and type = 'open'",
}  # fmt: skip


@st.composite
def quantified_rules(draw: st.DrawFn) -> dict[str, Any]:
    inner = draw(st.sampled_from(("K", "not K", "N", "P and not N", "once[0 s, 3 s] K", "eventually[1 s, 2 s] N",
                                  "historically[0 s, 2 s] (K or P)", "K until[0 s, 3 s] N", "previous[0 s, 3 s] K")))  # fmt: skip
    word = draw(st.sampled_from(("exists", "forall")))
    before = draw(
        st.sampled_from(("", "not ", "once[0 s, 4 s] ", "eventually[0 s, 3 s] ", "always[0 s, 2 s] not "))
    )
    text = f"{before}({word} L ({inner}))"
    when = draw(st.sampled_from((None, "P", "R")))
    define = {**QUANTIFIED, "R": ATOMS["R"]}
    if when is not None and draw(st.booleans()):
        define["L"] = f"input = 'moves' and stamp <= {when}.stamp"
    used = [name for name in define if re.search(rf"\b{name}\b", text) or name == when]
    emit = draw(st.sampled_from(({"holds": "yes"}, {"fails": "no"}, {"holds": "yes", "fails": "no"})))
    rule = {"name": "made", "input": ["moves", {"object_state": "door"}], "formula": text, "emit": emit,
            "define": {name: define[name] for name in used}}  # fmt: skip
    return {**rule, "when": when} if when else rule


@st.composite
def interval_rules(draw: st.DrawFn) -> dict[str, Any]:
    named = "|".join(draw(st.lists(st.sampled_from(RELATIONS), min_size=1, max_size=3, unique=True)))
    return {
        "name": "made", "input": ["moves", {"object_state": "door"}], "pattern": f"P {named} Q", "within": "6 s",
        "define": {"P": ATOMS["P"], "Q": ATOMS["Q"]}, "emit": "found", "measures": {"who": "first(P.track_id)"},
    }  # fmt: skip


@st.composite
def edge_rules(draw: st.DrawFn) -> dict[str, Any]:
    where = draw(st.sampled_from((None, "track_id = 1", "input = 'moves'")))
    rule = {"name": "made", "input": ["moves", {"object_state": "door"}], "emit": {"began": "came", "open": "opened"},
            "measures": {"who": "track_id", "when": "stamp"}}  # fmt: skip
    return {**rule, "where": where} if where else rule


@st.composite
def changes(draw: st.DrawFn, most: int = 8) -> list[Row]:
    """Rows that begin and end intervals, several at one stamp."""
    rows, stamp_us = [], 10 * S
    for number in range(draw(st.integers(1, most))):
        stamp_us += draw(st.sampled_from((0, S, S, 2 * S)))
        if draw(st.booleans()):
            kind = draw(st.sampled_from(("began", "ended")))
            values = {
                "input": "moves",
                "type": kind,
                "track_id": draw(st.sampled_from((1, 2))),
                "instance_id": 5,
            }
            rows.append(
                Row(
                    stamp_us, 2 + (kind == "began"), f"{number:04}", "relation", {**values, "stamp": stamp_us}
                )
            )
        else:
            values = {"input": "door", "type": draw(st.sampled_from(("open", "shut"))), "instance_id": 7}
            rows.append(Row(stamp_us, 1, f"{number:04}", "object_state", {**values, "stamp": stamp_us}))
    return sorted(rows, key=lambda row: row.order)
