"""The text of a formula of metric temporal logic.

From loose to tight: implies (to the right), or, and, then until and since, then not and the words that stand
before one part. Bounds stand in brackets after such a word: [0 s, 6 s], [6 s, inf]; without, it is for ever.
`p implies q` is read as `not p or q`, `forall l p` as `not exists l not p`.
"""

from __future__ import annotations

from collections.abc import Callable

from semap.rules.formula import (
    Always,
    And,
    Atom,
    Constant,
    Eventually,
    Exists,
    Formula,
    Future,
    Historically,
    Not,
    Once,
    Or,
    Past,
    Previous,
    Since,
    Until,
)
from semap.rules.language.duration import read_duration, write_duration
from semap.rules.language.tokens import Tokens
from semap.rules.language.words import OF_FORMULAS, read_variable

REMEDY = "A formula is such as: eventually[0 s, 6 s] E, or always[0 s, 5 min] (O and not P)."
BEFORE_ONE: dict[str, type[Always | Eventually | Once | Historically | Previous]] = {
    "always": Always,
    "eventually": Eventually,
    "once": Once,
    "historically": Historically,
    "previous": Previous,
}
BETWEEN: dict[str, type[Until | Since]] = {"until": Until, "since": Since}
CONSTANTS = {"true": True, "false": False}
FOREVER = "inf"


def read(source: object, place: str = "formula") -> Formula:
    """The formula that a text says.

    raises  InvalidInput with the line and character
    """
    tokens = Tokens(source, place, REMEDY)
    formula = _implies(tokens)
    tokens.end()
    return formula


def write(formula: Formula) -> str:
    """A text that `read` takes for this."""
    match formula:
        case Atom(name):
            return name
        case Constant(value):
            return "true" if value else "false"
        case Not(inner):
            return f"not {_prefixed(inner)}"
        case Exists(name, inner):
            return f"exists {name} {_prefixed(inner)}"
        case Until(left, right) | Since(left, right):
            return f"{_prefixed(left)} {_word(formula)}{_bounds_text(formula)} {_prefixed(right)}"
        case Always(inner) | Eventually(inner) | Once(inner) | Historically(inner) | Previous(inner):
            return f"{_word(formula)}{_bounds_text(formula)} {_prefixed(inner)}"
        case And(parts):
            return " and ".join(f"({write(p)})" if isinstance(p, And | Or) else write(p) for p in parts)
        case Or(parts):
            return " or ".join(f"({write(p)})" if isinstance(p, Or) else write(p) for p in parts)


def _prefixed(formula: Formula) -> str:
    """What stands after not, always and the like, and on both sides of until and since."""
    return f"({write(formula)})" if isinstance(formula, And | Or | Until | Since) else write(formula)


def _word(formula: Future | Past) -> str:
    return type(formula).__name__.lower()


def _bounds_text(formula: Future | Past) -> str:
    if formula.from_us == 0 and formula.to_us is None:
        return ""
    to = FOREVER if formula.to_us is None else write_duration(formula.to_us)
    return f"[{write_duration(formula.from_us)}, {to}]"


def _implies(tokens: Tokens) -> Formula:
    tokens.deeper()
    left = _joined(tokens, "or", _and, Or)
    found: Formula = Or((Not(left), _implies(tokens))) if tokens.takes("implies") else left
    tokens.less_deep()
    return found


def _and(tokens: Tokens) -> Formula:
    return _joined(tokens, "and", _until, And)


def _joined(
    tokens: Tokens, word: str, part: Callable[[Tokens], Formula], joined: type[And] | type[Or]
) -> Formula:
    """One part, or several with the word between them."""
    parts = [part(tokens)]
    while tokens.takes(word):
        parts.append(part(tokens))
    return parts[0] if len(parts) == 1 else joined(tuple(parts))


def _until(tokens: Tokens) -> Formula:
    left = _unary(tokens)
    word = tokens.next.text
    if word not in BETWEEN:
        return left
    tokens.take()
    from_us, to_us = _bounds(tokens)
    right = _unary(tokens)
    if tokens.next.text in BETWEEN:
        raise tokens.refused(f"{tokens.next.text} after {word}", "Put parentheses around one of them.")
    return BETWEEN[word](left, right, from_us, to_us)


def _unary(tokens: Tokens) -> Formula:
    tokens.deeper()
    found: Formula
    if tokens.takes("not"):
        found = Not(_unary(tokens))
    elif tokens.next.text in BEFORE_ONE:
        operator = BEFORE_ONE[tokens.take().text]
        from_us, to_us = _bounds(tokens)
        found = operator(_unary(tokens), from_us, to_us)
    elif tokens.takes("exists"):
        found = Exists(_atom(tokens).name, _unary(tokens))
    elif tokens.takes("forall"):
        found = Not(Exists(_atom(tokens).name, Not(_unary(tokens))))
    elif tokens.takes("("):
        found = _implies(tokens)
        tokens.need(")")
    elif tokens.next.text in CONSTANTS:
        found = Constant(CONSTANTS[tokens.take().text])
    else:
        found = _atom(tokens)
    tokens.less_deep()
    return found


def _atom(tokens: Tokens) -> Atom:
    token = tokens.next
    if token.kind != "word" or token.text in OF_FORMULAS:
        raise tokens.refused("a variable is missing")
    tokens.take()
    return Atom(read_variable(token.text, tokens.where(token)))


def _bounds(tokens: Tokens) -> tuple[int, int | None]:
    """The bounds in microseconds; without brackets from now on for ever."""
    start = tokens.next
    if not tokens.takes("["):
        return 0, None
    from_us = _bound(tokens)
    tokens.need(",")
    to_us = None if tokens.takes(FOREVER) else _bound(tokens)
    tokens.need("]")
    if to_us is not None and from_us > to_us:
        raise tokens.refused(
            "bounds that end before they begin", "Give the smaller first: [0 s, 6 s].", start
        )
    return from_us, to_us


def _bound(tokens: Tokens) -> int:
    token = tokens.next
    if token.kind != "number":
        raise tokens.refused("a duration is missing", "Write bounds such as [0 s, 6 s], or [6 s, inf].")
    tokens.take()
    unit = tokens.take().text if tokens.next.kind == "word" else ""
    return read_duration(f"{token.text} {unit}", tokens.where(token), least_us=0)
