"""A case as a question to Flink: as a query with MATCH_RECOGNIZE, as a FlinkCEP pattern, or neither.

Flink says fewer things than semap does. Where a translation would have to say something else, it raises `Unsaid`.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from itertools import product
from typing import Literal

from conformance.case import Case
from conformance.flink_condition import Tree, Unsaid, sql, tree

from bench.flink.cases import Answer, CepPattern, Item, Query, Question, ask
from bench.flink.environment import Flink
from semap.cql2 import Expression
from semap.rules.declaration import Declaration
from semap.rules.pattern import Absent, Anchor, Element, Node, Repeat, Sequence, Variable, nodes_in

Family = Literal["sql", "cep"]
FAMILIES: tuple[Family, ...] = ("sql", "cep")
MS_US = 1_000
SKIPS = {"past last": "PAST LAST ROW", "to next": "TO NEXT ROW", "to first": "TO FIRST", "to last": "TO LAST"}


def ask_flink(flink: Flink, cases: Iterable[Case]) -> dict[tuple[str, Family], Answer | Unsaid]:
    """What each family says of each case, by its name. Cases of one rule are one question."""
    streams: dict[str, dict[str, tuple[Item, ...]]] = {}
    questions: dict[str, Question] = {}
    said: dict[tuple[str, Family], Answer | Unsaid] = {}
    for case, family in product(cases, FAMILIES):
        rule = json.dumps([family, case.timeouts is not None, case.declaration.document], sort_keys=True)
        try:
            asked = _query(case) if family == "sql" else _cep(case)
            streams.setdefault(rule, {})[case.name] = _items(case)
            may_fail = family in case.flink and case.flink[family].pairs is None
            questions[rule] = Question(asked, tuple(streams[rule].values()), may_fail)
        except Unsaid as reason:
            said[case.name, family] = reason
    for rule, answers in ask(flink, questions).items():
        family = json.loads(rule)[0]
        said |= {(name, family): answer for name, answer in zip(streams[rule], answers, strict=True)}
    return said


def _items(case: Case) -> tuple[Item, ...]:
    found = []
    for row in case.rows:
        occupants = row.values.get("occupants")
        assert occupants is None or isinstance(occupants, float)
        found.append((_milliseconds(row.stamp_us), str(row.values["type"]), occupants))
    return tuple(found)


def _milliseconds(stamp_us: int) -> int:
    if stamp_us % MS_US:
        raise Unsaid("microseconds")
    return stamp_us // MS_US


def _elements(node: Node) -> tuple[Element, ...]:
    return node.elements if isinstance(node, Sequence) else (Element("next", node),)


def _sayable(case: Case) -> Declaration:
    """raises Unsaid for what neither of the two has"""
    declaration = case.declaration
    if declaration.subsets or declaration.each_row or case.unmatched is not None:
        raise Unsaid("a subset, rows one by one, rows in no match")
    if declaration.after_match.skip == "clear" or declaration.after_match.strict:
        raise Unsaid("a skip that it has not")
    if any(found.pairs[0][1] == "" for found in case.matches) or case.pattern == Sequence(()):
        raise Unsaid("an empty match")
    for node in nodes_in(case.pattern):
        if isinstance(node, Anchor) or node == Sequence(()) or (isinstance(node, Variable) and node.excluded):
            raise Unsaid("an anchor, an exclusion, an empty pattern")
    return declaration


# --- MATCH_RECOGNIZE


def _query(case: Case) -> Query:
    declaration = _sayable(case)
    elements = _elements(case.pattern)
    variables = tuple(_only_variable(element) for element in elements)
    if len(set(variables)) < len(variables):
        raise Unsaid("a variable that stands in the pattern twice")
    if case.timeouts is not None:
        raise Unsaid("timeouts")
    last = elements[-1].node
    if isinstance(last, Repeat) and last.greedy and last.least != last.most:
        raise Unsaid("a greedy quantifier at the end")
    measures = ", ".join(f"LISTAGG(CAST({name}.`number` AS STRING)) AS {name}_" for name in variables)
    define = ", ".join(
        f"{name} AS {sql(condition, name)}"
        for name, condition in declaration.define.items()
        if name in variables
    )
    text = (
        f"SELECT * FROM %s MATCH_RECOGNIZE (PARTITION BY `stream` ORDER BY stamp, `number` MEASURES {measures} ONE ROW PER MATCH"
        f" AFTER MATCH SKIP {_skip(declaration)} PATTERN ({' '.join(map(_sql_element, elements))})"
        f"{_within(declaration)} DEFINE {define or f'{variables[0]} AS TRUE'})"
    )
    return Query(text.replace("%", "%%").replace("%%s", "%s", 1), variables)


def _only_variable(element: Element) -> str:
    match element:
        case Element("next", Variable(name)):
            return name
        case Element("next", Repeat(Variable(name), joint="next", until=None)):
            return name
    raise Unsaid("all but variables, counted, one directly after the other")


def _sql_element(element: Element) -> str:
    match element.node:
        case Repeat(Variable(name), least, most, greedy):
            if (least, most, greedy) == (0, 1, False):
                raise Unsaid("a reluctant ?")
            count = f"{{{least}}}" if least == most else f"{{{least},{'' if most is None else most}}}"
            return f"{name}{count}{'' if greedy or least == most else '?'}"
        case Variable(name):
            return name
    raise AssertionError


def _skip(declaration: Declaration) -> str:
    after = declaration.after_match
    if after.skip == "none":
        raise Unsaid("no skip")
    return f"{SKIPS[after.skip]} {' '.join(after.variables)}".strip()


def _within(declaration: Declaration) -> str:
    windows = declaration.within
    if windows.step_us is not None or windows.variables:
        raise Unsaid("a window of a step")
    if windows.match_us is None:
        return ""
    # Flink counts milliseconds, and so do all stamps that are asked about
    return f" WITHIN INTERVAL '{_milliseconds(windows.match_us) / 1000:.3f}' SECOND(6, 3)"


# --- FlinkCEP


def _cep(case: Case) -> CepPattern:
    declaration = _sayable(case)
    windows, after = declaration.within, declaration.after_match
    if windows.variables:
        raise Unsaid("a window of a variable")
    counted = Counter(_variables(case.pattern))
    if any(counted[variable] > 1 for variable in after.variables):
        raise Unsaid("a skip to a variable that stands in the pattern twice")
    document = {
        "stages": _Stages(declaration).of(case.pattern),
        "within_ms": None if windows.match_us is None else _milliseconds(windows.match_us),
        "step_ms": None if windows.step_us is None else _milliseconds(windows.step_us),
        "skip": [after.skip, "".join(after.variables)],
    }
    return CepPattern(document)


def _variables(node: Node) -> Iterator[str]:
    """The variables that rows are bound to, each as often as it stands there."""
    match node:
        case Variable(name):
            yield name
        case Sequence(elements):
            for element in elements:
                yield from _variables(element.node)
        case Repeat(inner):
            yield from _variables(inner)


class _Stages:
    """Makes the stages of FlinkPattern.java; each has a name of its own."""

    def __init__(self, declaration: Declaration) -> None:
        self._define = declaration.define
        self._all_matches = declaration.after_match.skip == "none"
        self._used: Counter[str] = Counter()

    def of(self, node: Node) -> list[Mapping[str, object]]:
        return [{"joint": element.joint, **self._stage(element.node)} for element in _elements(node)]

    def _stage(self, node: Node) -> Mapping[str, object]:
        match node:
            case Variable(name):
                return {"name": self._name(name), "where": self._condition(name)}
            case Absent(name):
                return {"name": self._name(name), "where": self._condition(name), "absent": True}
            case Sequence():
                return {"stages": self.of(node)}
            case Repeat(inner) if not isinstance(inner, Repeat):
                return {**self._stage(inner), **self._counted(node)}
        raise Unsaid(f"a {type(node).__name__.lower()} within")

    def _counted(self, repeat: Repeat) -> Mapping[str, object]:
        if repeat.most == 0 or (repeat.least > 1 and repeat.most is not None and repeat.until is not None):
            raise Unsaid("these counts")
        # Of no skip, all matches are wanted; then greedy has no meaning to semap, and to Flink it drops matches.
        greedy = repeat.greedy and not self._all_matches and repeat.least != repeat.most
        if greedy and not isinstance(repeat.node, Variable):
            raise Unsaid("a greedy group")
        until = None if repeat.until is None else self._condition(repeat.until)
        return {
            "times": [repeat.least, repeat.most],
            "between": repeat.joint,
            "greedy": greedy,
            "until": until,
        }

    def _name(self, variable: str) -> str:
        self._used[variable] += 1
        number = self._used[variable]
        return variable if number == 1 else f"{variable}#{number}"

    def _condition(self, name: str) -> Tree:
        condition: Expression | None = self._define.get(name)
        return ["value", True] if condition is None else tree(condition)
