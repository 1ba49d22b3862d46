"""The clauses of a rule that are neither pattern nor condition, each read from what YAML or JSON gives.

Everything here raises InvalidInput with the path of the clause, such as `within.step`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import cast

from semap.errors import InvalidInput
from semap.rules.declaration import AfterMatch, Confidence, Input, Skip, Windows
from semap.rules.language.duration import REMEDY as DURATIONS
from semap.rules.language.duration import read_duration
from semap.rules.language.words import read_name, read_variable, unknown
from semap.rules.naming import Subsets
from semap.rules.row import PROPERTIES

INPUTS = ("query", "object_state", "map", "rule")
INPUTS_AT_MOST = 20
INPUT_REMEDY = (
    "Name queries of the map, rules or properties of objects: input: [track_in_room, door]; or say which: "
    "{query: a}, {rule: b}, {object_state: door, actor_within_m: 1.5}, {map: true}."
)
KEYS = [name for name, kind in PROPERTIES.items() if kind in ("text", "number")]
KEYS_AT_MOST = 8
SKIPS: Mapping[str, Skip] = {
    "no skip": "none",
    "skip to next row": "to next",
    "skip past last row": "past last",
    "skip to first": "to first",
    "skip to last": "to last",
    "skip to": "to last",
    "no skip, clear": "clear",
}
AT_MOST = re.compile(r"\s*,\s*at\s+most\s+(\d{1,9})\s*\Z", re.IGNORECASE)
SKIPS_TO = ("skip to first", "skip to last", "skip to")
OR_FAIL = re.compile(r"\s+or\s+fail\s*\Z", re.IGNORECASE)
SKIP_TO = re.compile(r"\s*(skip\s+to(?:\s+(?:first|last))?)\s+(\w+)\s*\Z", re.IGNORECASE)
PARAMETERS: Mapping[str, tuple[str, ...]] = {
    "lognormal": ("median_s", "sigma"),
    "normal": ("mean_s", "std_s"),
    "exponential": ("mean_s",),
}
MAY_BE_NEGATIVE = ("normal", "mean_s")
SUBSET_REMEDY = "For example: subset: {S: [A, B]}"
LONGEST_WORD = 100
"""Of what a message repeats."""

CONFIDENCE_REMEDY = (
    "Write confidence: {gap: [O, E], distribution: lognormal, median_s: 2, sigma: 0.6, at_least: 0.2}."
)


def read_mapping(value: object, where: str, remedy: str) -> Mapping[str, object]:
    """A mapping whose keys are texts, with something in it."""
    if not isinstance(value, Mapping) or not value:
        raise InvalidInput("a mapping is needed", remedy, where)
    for key in value:
        if not isinstance(key, str):
            raise InvalidInput(f"the key {key!r} is no text", "Put it in quotes.", where)
    return cast(Mapping[str, object], value)


def read_inputs(value: object) -> tuple[Input, ...]:
    """What the rule reads, one or a list."""
    if not isinstance(value, Sequence) or isinstance(value, str):
        return (_input(value, "input"),)
    if not 0 < len(value) <= INPUTS_AT_MOST:
        raise InvalidInput(f"{len(value)} inputs; 1 to {INPUTS_AT_MOST} are needed", INPUT_REMEDY, "input")
    found = tuple(_input(each, f"input[{n}]") for n, each in enumerate(value))
    for n, each in enumerate(found):
        if each.name in {before.name for before in found[:n]}:
            raise InvalidInput(f"{each.name} is there twice", "Leave one out.", f"input[{n}]")
    return found


def _input(value: object, where: str) -> Input:
    if not isinstance(value, Mapping):
        name = read_name(value, where)
        if name == "map":
            raise InvalidInput("map means something already", "Write {map: true} or {query: map}.", where)
        return Input(name)
    known = (*INPUTS, "actor_within_m")
    for key in read_mapping(value, where, INPUT_REMEDY):
        if key not in known:
            raise unknown(f"there is no key {key}", key, known, f"{where}.{key}")
    kinds = [kind for kind in INPUTS if kind in value]
    if len(kinds) != 1:
        raise InvalidInput(f"one of {', '.join(INPUTS)} is needed", INPUT_REMEDY, where)
    within_m = None
    if "actor_within_m" in value:
        within_m = _number(value["actor_within_m"], f"{where}.actor_within_m", _above_zero)
    kind = kinds[0]
    if kind != "map":
        return Input(read_name(value[kind], f"{where}.{kind}"), kind, within_m)  # type: ignore[arg-type]
    if value["map"] is not True:
        raise InvalidInput("map is true or left out", "Write {map: true}.", f"{where}.map")
    return Input("map", "map", within_m)


def read_partition(value: object) -> tuple[str, ...]:
    """The properties by which rows are told apart, one or a list; nothing is no property."""
    if value is None:
        return ()
    listed = isinstance(value, Sequence) and not isinstance(value, str)
    names = list(cast(Sequence[object], value)) if listed else [value]
    if not 0 < len(names) <= KEYS_AT_MOST:
        raise InvalidInput(
            f"{len(names)} properties; 1 to {KEYS_AT_MOST} are needed",
            "Leave it out for none.",
            "partition_by",
        )
    for n, name in enumerate(names):
        where = f"partition_by[{n}]" if listed else "partition_by"
        if not isinstance(name, str):
            raise InvalidInput("a property is needed", "Write partition_by: room, or [track, room].", where)
        head, dot, key = name.partition(".")
        if name not in KEYS and not (dot and key and PROPERTIES.get(head) == "any"):
            raise unknown(f"rows cannot be partitioned by {name}", name, [*KEYS, "attributes.KEY"], where)
        if name in names[:n]:
            raise InvalidInput(f"{name} is there twice", "Leave one out.", where)
    return tuple(cast(list[str], names))


def read_windows(value: object, variables: Collection[str]) -> Windows:
    """`within`: a duration of the whole match, or durations of match, step and variables."""
    if value is None:
        return Windows()
    if not isinstance(value, Mapping):
        return Windows(match_us=read_duration(value, "within"))
    given = read_mapping(value, "within", f"{DURATIONS} Or durations of match, step and variables.")
    known = ("match", "step", *sorted(variables))
    for name in given:
        if name not in known:
            raise unknown(f"there is no variable {name} in the pattern", name, known, f"within.{name}")
    found_us = {name: read_duration(each, f"within.{name}") for name, each in given.items()}
    return Windows(
        match_us=found_us.pop("match", None), step_us=found_us.pop("step", None), variables=found_us
    )


def read_about(value: object, variables: Collection[str]) -> str | None:
    """The variable whose instance an event is about."""
    if value is None:
        return None
    if not isinstance(value, str):
        raise InvalidInput("a variable is needed", "For example: about: R", "about")
    if value not in variables:
        raise unknown(f"no row is bound to {value}", value, sorted(variables), "about")
    return value


def read_subsets(value: object, variables: Collection[str]) -> Mapping[str, frozenset[str]]:
    """Names for several variables each."""
    if value is None:
        return {}
    found = {}
    for name, members in read_mapping(value, "subset", SUBSET_REMEDY).items():
        where = f"subset.{name}"
        read_variable(name, where)
        if name in variables:
            raise InvalidInput(f"{name} is a variable of the pattern", "Give the subset another name.", where)
        if not isinstance(members, Sequence) or isinstance(members, str) or not members:
            raise InvalidInput("a list of variables is needed", SUBSET_REMEDY, where)
        for member in members:
            if not isinstance(member, str) or member not in variables:
                raise unknown(f"no row is bound to {member}", str(member), sorted(variables), where)
        found[name] = frozenset(members)
    return found


def read_rows_per_match(value: object) -> bool:
    """Whether each row of a match makes an event."""
    words = " ".join(value.split()).lower() if isinstance(value, str) else str(value)
    if value is None or words == "one":
        return False
    if words == "all":
        return True
    raise unknown("it is neither one nor all", words[:LONGEST_WORD], ("one", "all"), "rows_per_match")


def read_after_match(value: object, variables: Collection[str], subsets: Subsets) -> AfterMatch:
    """Where the next match may begin."""
    if value is None:
        return AfterMatch()
    text = value if isinstance(value, str) else ""
    if limit := AT_MOST.search(text):
        return _limited(text[: limit.start()], int(limit[1]))
    said = " ".join(text.split()).lower()
    if said in SKIPS and said not in SKIPS_TO:
        return AfterMatch(SKIPS[said])
    strict = OR_FAIL.search(text) is not None
    to = SKIP_TO.fullmatch(OR_FAIL.sub("", text))
    if to is None:
        known = [f"{name} X" if name in SKIPS_TO else name for name in SKIPS]
        raise unknown("it does not define where to continue", said[:LONGEST_WORD], known, "after_match")
    name = to[2]
    if to[1].split()[-1].lower() == "to" and name.lower() in ("first", "last"):
        raise unknown("it does not define where to continue", said, [f"{said} X"], "after_match")
    if name not in variables and name not in subsets:
        word = name[:LONGEST_WORD]
        raise unknown(f"no row is bound to {word}", word, sorted({*variables, *subsets}), "after_match")
    members = subsets.get(name, frozenset({name}))
    return AfterMatch(SKIPS[" ".join(to[1].split()).lower()], members, strict)


def _limited(text: str, at_most: int) -> AfterMatch:
    """All matches, of which so many are told of those that end at one row."""
    skip = SKIPS.get(" ".join(text.split()).lower())
    if skip not in ("none", "clear") or at_most == 0:
        raise InvalidInput(
            "a limit is of the matches that end at one row, and above zero",
            "Write no skip, at most 100; other ways to skip give one match of each start.",
            "after_match",
        )
    return AfterMatch(skip, at_most=at_most)


def read_confidence(value: object, variables: Collection[str]) -> Confidence | None:
    """How sureness falls with the gap between two variables."""
    if value is None:
        return None
    given = read_mapping(value, "confidence", CONFIDENCE_REMEDY)
    distribution = given.get("distribution")
    if not isinstance(distribution, str) or distribution not in PARAMETERS:
        raise unknown("a distribution is needed", str(distribution), PARAMETERS, "confidence.distribution")
    names = PARAMETERS[distribution]
    known = ("gap", "distribution", "at_least", *names)
    for key in given:
        if key not in known:
            raise unknown(f"{distribution} has no {key}", key, known, f"confidence.{key}")
    gap = given.get("gap")
    if not isinstance(gap, Sequence) or isinstance(gap, str) or len(gap) != 2:
        raise InvalidInput("two variables are needed", CONFIDENCE_REMEDY, "confidence.gap")
    for n, name in enumerate(gap):
        if name not in variables:
            raise unknown(f"no row is bound to {name}", str(name), sorted(variables), f"confidence.gap[{n}]")
    parameters = {
        name: _number(
            given.get(name),
            f"confidence.{name}",
            math.isfinite if (distribution, name) == MAY_BE_NEGATIVE else _above_zero,
        )
        for name in names
    }
    at_least = _number(given.get("at_least", 0), "confidence.at_least", lambda share: 0 <= share <= 1)
    return Confidence(gap[0], gap[1], distribution, parameters, at_least)  # type: ignore[arg-type]


def _above_zero(number: float) -> bool:
    return number > 0


def _number(value: object, where: str, allowed: Callable[[float], bool]) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InvalidInput("a number is needed", "Write a number, such as 2.5.", where)
    number = float(value) if abs(value) < 1e15 else math.inf
    if not math.isfinite(number) or not allowed(number):
        raise InvalidInput(
            f"{value} is out of range", "Shares are 0 to 1; everything else is above zero.", where
        )
    return number
