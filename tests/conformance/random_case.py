"""Rules and streams made at random, of the kind whose meaning semap and Flink share.

Each row is true of one variable at most: where a row could be two, Flink does not go back over a greedy
quantifier, which the corpus shows.
"""

from __future__ import annotations

import random

from conformance.case import Case, declare, read_rows

from semap.rules.language.pattern_text import write
from semap.rules.pattern import Absent, Element, Joint, Repeat, Sequence, Variable

SKIPS = ("skip past last row", "skip to next row", "no skip")
COUNTS = ((0, 1), (0, None), (1, None), (2, 2), (1, 2), (2, None))


def random_cases(seed: int, rules: int, streams: int) -> tuple[Case, ...]:
    """So many rules, each over so many streams; the same for the same seed."""
    chance = random.Random(seed)
    cases = []
    for number in range(rules):
        after_match = SKIPS[number % len(SKIPS)]
        pattern = write(_all_matches(chance) if after_match == "no skip" else _strict(chance))
        document: dict[str, object] = {"pattern": pattern, "after_match": after_match, "define": {}}
        if chance.random() < 0.4:
            document["within"] = f"{chance.choice((3, 5, 8))} s"
        if chance.random() < 0.4:
            document["define"] = {"C": "type = 'c' and occupants >= first(A.occupants)"}
        if not {"A", "C"} <= set(pattern):
            document["define"] = {}
        declaration = declare(document)
        for stream in range(streams):
            text = _stream(chance, pattern)
            title = f"{document}: {text}"
            cases.append(
                Case(f"random-{number}-{stream}", title, "random", declaration, read_rows(text), matches=())
            )
    return tuple(cases)


def _strict(chance: random.Random) -> Sequence:
    """One row directly after the other. What Flink refuses is left out: an optional variable after a greedy one."""
    names = "ABCD"[: chance.randint(2, 4)]
    elements: list[Element] = []
    for name in names[:-1]:
        node: Variable | Repeat = Variable(name)
        if chance.random() < 0.6:
            least, most = chance.choice(COUNTS)
            before = elements[-1].node if elements else None
            if isinstance(before, Repeat) and before.greedy and before.least != before.most:
                least = max(least, 1)
            greedy = chance.random() < 0.5 or (least, most) == (0, 1)
            node = Repeat(node, least, most, greedy) if (least, most) != (1, 1) else node
        elements.append(Element("next", node))
    last: Variable | Repeat = Variable(names[-1])
    if chance.random() < 0.3:
        last = Repeat(last, 1, None, greedy=False)
    return Sequence((*elements, Element("next", last)))


def _all_matches(chance: random.Random) -> Sequence:
    """Any joints; of no skip, where both give every way to bind rows."""
    joints: tuple[Joint, ...] = ("next", "relaxed", "any")
    names = "ABCD"[: chance.randint(2, 4)]
    elements: list[Element] = []
    for place, name in enumerate(names):
        joint = chance.choice(joints)
        node: Variable | Repeat = Variable(name)
        if 0 < place < len(names) - 1 and chance.random() < 0.5:
            least, most = chance.choice(COUNTS)
            node = Repeat(node, least, most, joint=chance.choice(joints))
        if place and isinstance(elements[-1].node, Variable) and chance.random() < 0.2:
            elements.append(Element("relaxed", Absent("N")))
        elements.append(Element(joint, node))
    return Sequence(tuple(elements))


def _stream(chance: random.Random, pattern: str) -> str:
    """Mostly rows in the order in which the pattern asks for them, so that there is something to find."""
    asked = [letter.lower() for letter in pattern if letter.isupper()]
    place = 0
    stamp_s = 0.0
    words = []
    for _ in range(chance.randint(4, 14)):
        what = chance.random()
        place += what < 0.55
        letter = asked[place % len(asked)] if what < 0.85 else chance.choice([*asked, "x"])
        stamp_s += chance.choice((0.0, 0.5, 0.5, 1.0, 1.0))
        words.append(f"{letter}:{chance.randint(0, 3)}@{stamp_s:g}")
    return " ".join(words)
