"""The text of a row pattern, and of a pattern of two intervals.

alternatives  sequence | sequence ...
sequence      element, then elements each with the joint before it
joint         next (or nothing), followed by, followed by any; not next N, not followed by N
element       VARIABLE, (alternatives), (), {- alternatives -}, ^, $,
              permute(alternatives, ...) [relaxed | any]; then a quantifier
quantifier    ? * + {n} {n,} {n,m} {,m} {,}; ? after it: reluctant; then relaxed or any: between its rounds;
              then until U

intervals     P during D, P starts|during D
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Literal

from semap.rules.declaration import IntervalPattern, RowPattern
from semap.rules.interval.allen import relations_named
from semap.rules.language.tokens import Token, Tokens
from semap.rules.language.words import OF_PATTERNS, is_relation, read_variable
from semap.rules.matching.follow import POSITIONS_AT_MOST
from semap.rules.pattern import (
    Absent,
    Alternation,
    Anchor,
    Element,
    Joint,
    Node,
    Permutation,
    Repeat,
    Sequence,
    Variable,
)

REMEDY = "A pattern is such as: O followed by E, or A B+ (C | D)?, or P during D."
QUANTIFIERS: dict[str, tuple[int, int | None]] = {"?": (0, 1), "*": (0, None), "+": (1, None)}
WORDS: dict[Joint, str] = {"next": "", "relaxed": "followed by ", "any": "followed by any "}
ANCHORS: dict[str, Literal["begin", "end"]] = {"^": "begin", "$": "end"}
BETWEEN: dict[Joint, str] = {"next": "", "relaxed": " relaxed", "any": " any"}


def read(source: object, place: str = "pattern") -> RowPattern | IntervalPattern:
    """The pattern that a text says; of two intervals if a relation of intervals is among its words.

    raises  InvalidInput with the line and character
    """
    tokens = Tokens(source, place, REMEDY)
    if any(token.kind == "word" and is_relation(token.text) for token in tokens.all):
        return _intervals(tokens)
    node = _alternatives(tokens)
    tokens.end()
    if _length(node) > POSITIONS_AT_MOST:
        raise tokens.refused(
            f"more than {POSITIONS_AT_MOST} positions, its counts written out",
            "Use smaller counts, or + with a condition on count().",
            tokens.all[0],
        )
    return RowPattern(node)


def write(node: Node) -> str:
    """The shortest text that `read` takes for this."""
    match node:
        case Variable(name, excluded):
            return f"{{- {name} -}}" if excluded else name
        case Absent(name):
            return name
        case Anchor(at):
            return next(sign for sign, where in ANCHORS.items() if where == at)
        case Sequence(()):
            return "()"
        case Sequence(elements):
            return " ".join(_written(each, first=n == 0) for n, each in enumerate(elements))
        case Alternation(options):
            return " | ".join(
                f"({write(each)})" if isinstance(each, Alternation) else write(each) for each in options
            )
        case Permutation(nodes, joint):
            return f"permute({', '.join(map(write, nodes))}){BETWEEN[joint]}"
        case Repeat():
            inner = write(node.node)
            if not isinstance(node.node, Variable | Anchor) and inner != "()":
                inner = f"({inner})"
            until = f" until {node.until}" if node.until is not None else ""
            return f"{inner}{_quantifier(node)}{BETWEEN[node.joint]}{until}"


def write_intervals(pattern: IntervalPattern) -> str:
    """The text of a pattern of two intervals."""
    return f"{pattern.left} {'|'.join(sorted(pattern.relations))} {pattern.right}"


def _length(node: Node) -> int:
    """How many variables it has once counts and permutations are written out; found without doing so."""
    match node:
        case Variable() | Absent() | Anchor():
            return 1
        case Sequence(elements):
            return sum(_length(element.node) for element in elements)
        case Alternation(options):
            return sum(map(_length, options))
        case Permutation(nodes):
            return sum(map(_length, nodes)) << (len(nodes) - 1)
        case Repeat(inner, least, most):
            return _length(inner) * max(least, most or 1)


def _written(element: Element, first: bool) -> str:
    if isinstance(element.node, Absent):
        return f"not {'next' if element.joint == 'next' else 'followed by'} {element.node.name}"
    text = write(element.node)
    if isinstance(element.node, Sequence | Alternation) and text != "()":
        text = f"({text})"
    return text if first else f"{WORDS[element.joint]}{text}"


def _quantifier(node: Repeat) -> str:
    sign = next((sign for sign, counts in QUANTIFIERS.items() if counts == (node.least, node.most)), None)
    if sign is None:
        least = str(node.least or "")
        most = "" if node.most is None else str(node.most)
        sign = f"{{{most}}}" if most and node.least == node.most else f"{{{least},{most}}}"
    return sign if node.greedy else f"{sign}?"


def _intervals(tokens: Tokens) -> IntervalPattern:
    left = _variable(tokens)
    names: list[Token] = []
    while not names or tokens.takes("|"):
        if not is_relation(tokens.next.text):
            raise tokens.refused(
                "a relation of two intervals is missing",
                "A pattern of intervals is of three words, such as: P during D, or P starts|during D.",
            )
        names.append(tokens.take())
    right = _variable(tokens)
    tokens.end()
    if left == right:
        raise tokens.refused(
            f"{left} stands on both sides", "Give the two intervals a variable each.", tokens.all[0]
        )
    return IntervalPattern(left, relations_named(name.text for name in names), right)


def _alternatives(tokens: Tokens) -> Node:
    tokens.deeper()
    options = [_sequence(tokens)]
    while tokens.takes("|"):
        options.append(_sequence(tokens))
    tokens.less_deep()
    return options[0] if len(options) == 1 else Alternation(tuple(options))


def _sequence(tokens: Tokens) -> Node:
    elements = [Element("next", _element(tokens))]
    while (tokens.next.kind != "end") and tokens.next.text not in ("|", ")", ",", "-}"):
        elements.append(_joined(tokens))
    return elements[0].node if len(elements) == 1 else Sequence(tuple(elements))


def _joined(tokens: Tokens) -> Element:
    """An element with the joint before it."""
    if tokens.takes("not"):
        joint: Joint = "next" if tokens.takes("next") else "relaxed"
        if joint == "relaxed":
            tokens.need("followed")
            tokens.need("by")
        return Element(joint, Absent(_variable(tokens)))
    if tokens.takes("followed"):
        tokens.need("by")
        return Element("any" if tokens.takes("any") else "relaxed", _element(tokens))
    tokens.takes("next")
    return Element("next", _element(tokens))


def _element(tokens: Tokens) -> Node:
    node = _unquantified(tokens)
    if tokens.next.text in QUANTIFIERS:
        least, most = QUANTIFIERS[tokens.take().text]
    elif tokens.next.text == "{":
        least, most = _counts(tokens)
    else:
        return node
    greedy = not tokens.takes("?")
    joint = _between(tokens)
    until = _variable(tokens) if tokens.takes("until") else None
    if tokens.next.text in (*QUANTIFIERS, "{"):
        raise tokens.refused("a quantifier after a quantifier", "Put parentheses around the first.")
    return Repeat(node, least, most, greedy, joint, until)


def _unquantified(tokens: Tokens) -> Node:
    if tokens.next.text in ANCHORS:
        return Anchor(ANCHORS[tokens.take().text])
    if tokens.takes("{-"):
        node = _excluded(_alternatives(tokens))
        tokens.need("-}")
        return node
    if tokens.takes("("):
        if tokens.takes(")"):
            return Sequence(())
        node = _alternatives(tokens)
        tokens.need(")")
        return node
    if tokens.takes("permute"):
        tokens.need("(")
        nodes = [_alternatives(tokens)]
        while tokens.takes(","):
            nodes.append(_alternatives(tokens))
        tokens.need(")")
        return Permutation(tuple(nodes), _between(tokens))
    if tokens.next.text == "not":
        raise tokens.refused(
            "nothing stands before it",
            "Write what must not come after the element that it follows: A not followed by N.",
        )
    return Variable(_variable(tokens))


def _excluded(node: Node) -> Node:
    """The node with all its rows excluded."""
    match node:
        case Variable(name):
            return Variable(name, excluded=True)
        case Sequence(elements):
            return Sequence(tuple(Element(each.joint, _excluded(each.node)) for each in elements))
        case Alternation(nodes):
            return Alternation(tuple(map(_excluded, nodes)))
        case Permutation(nodes):
            return replace(node, nodes=tuple(map(_excluded, nodes)))
        case Repeat(inner):
            return replace(node, node=_excluded(inner))
    return node


def _between(tokens: Tokens) -> Joint:
    """The joint between rounds, or between the parts of a permutation."""
    if tokens.takes("relaxed"):
        return "relaxed"
    return "any" if tokens.takes("any") else "next"


def _counts(tokens: Tokens) -> tuple[int, int | None]:
    """{n}, {n,}, {n,m}, {,m} or {,}."""
    start = tokens.take()
    least = _count(tokens)
    comma = tokens.takes(",")
    most = _count(tokens) if comma else least
    tokens.need("}")
    if (least is None and not comma) or most == 0 or (most is not None and (least or 0) > most):
        raise tokens.refused(
            "a quantifier of no rounds, or of more at least than at most",
            "Write {2}, {2,}, {2,5} or {,5}.",
            start,
        )
    return least or 0, most


def _count(tokens: Tokens) -> int | None:
    if tokens.next.kind != "number":
        return None
    token = tokens.take()
    if not re.fullmatch(r"\d{1,6}", token.text):
        raise tokens.refused(f"{token.text} is no count", "Write a whole number.", token)
    return int(token.text)


def _variable(tokens: Tokens) -> str:
    token = tokens.next
    if token.kind != "word" or token.text in OF_PATTERNS:
        raise tokens.refused("a variable is missing")
    tokens.take()
    return read_variable(token.text, tokens.where(token))
