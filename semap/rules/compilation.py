"""From what a rule declares to the program that runs it."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from semap.rules.bound import Bound, Condition
from semap.rules.condition import compile_condition, compile_measure, counts_matches, neighbours_in
from semap.rules.confidence import confidence_of
from semap.rules.declaration import (
    AfterMatch,
    Declaration,
    Edges,
    IntervalPattern,
    RowPattern,
    TemporalFormula,
)
from semap.rules.edges_program import EdgesProgram
from semap.rules.finish import Finish
from semap.rules.interval.interval_program import IntervalProgram
from semap.rules.matching.automaton import FOREVER_US, Automaton
from semap.rules.matching.neighbours import Neighbours
from semap.rules.matching.pattern_program import ALL_MATCHES, PatternProgram
from semap.rules.matching.sharing import compile_program
from semap.rules.matching.surrounded_program import SurroundedProgram
from semap.rules.matching.telling import Emits, Raw, Telling
from semap.rules.pattern import Node, has_begin
from semap.rules.program import Program
from semap.rules.row import Row, Value
from semap.rules.temporal.formula_program import FormulaProgram

OUTCOMES = ("match", "timeout", "empty", "unmatched")
"""Of row patterns, for which `emit` may name events."""


def compile_rule(declaration: Declaration) -> Program:
    """The program of a rule, whichever of its kinds it is.

    raises InvalidInput where the parts do not fit one another
    """
    emit = declaration.emit
    match declaration.body:
        case Edges():
            return EdgesProgram(emit, compile_finish(declaration))
        case RowPattern(node):
            return _pattern_program(declaration, node)
        case IntervalPattern(left, relations, right):
            return IntervalProgram(
                left,
                relations,
                right,
                declaration.within,
                _conditions(declaration),
                emit.get("match"),
                compile_finish(declaration),
            )
        case TemporalFormula(formula, when):
            return FormulaProgram(formula, when, _conditions(declaration), emit, compile_finish(declaration))


def neighbours_of(declaration: Declaration, node: Node) -> Neighbours:
    """What the rows of a row pattern are to say of those around them."""
    read = [*declaration.define.values(), *declaration.measures.values()]
    window_us = declaration.within.match_us
    return Neighbours(
        frozenset().union(*map(neighbours_in, read)),
        has_begin(node),
        FOREVER_US if window_us is None else window_us,
    )


def compile_attempts(declaration: Declaration, node: Node, after_match: AfterMatch) -> PatternProgram:
    """The program of a row pattern alone, of which each attempt is known by itself.

    Its rows say already what it asks of their neighbours.
    """
    keep_all = after_match.skip in ALL_MATCHES
    automaton = Automaton(node, _conditions(declaration), declaration.within, keep_all=keep_all)
    times_out = "timeout" in declaration.emit
    return PatternProgram(automaton, after_match, _telling(declaration), times_out=times_out, shares=False)


def _telling(declaration: Declaration) -> Telling:
    emits = Emits(**{outcome: declaration.emit.get(outcome) for outcome in OUTCOMES})
    return Telling(emits, compile_finish(declaration), declaration.each_row)


def _pattern_program(declaration: Declaration, node: Node) -> Program:
    neighbours = neighbours_of(declaration, node)
    is_counted = any(map(counts_matches, declaration.measures.values()))
    is_plain = neighbours == Neighbours(window_us=neighbours.window_us)
    is_surrounded = not is_plain or is_counted or "unmatched" in declaration.emit
    telling = _telling(declaration)
    program = compile_program(
        node,
        _conditions(declaration),
        declaration.within,
        declaration.after_match,
        Raw() if is_surrounded else telling,
        times_out="timeout" in declaration.emit,
        in_order=is_counted,
        # which rows are in a match is known by all matches, and by the attempts under way
        shares="unmatched" not in declaration.emit,
    )
    return SurroundedProgram(program, neighbours, telling, is_counted) if is_surrounded else program


def compile_where(declaration: Declaration) -> Callable[[Row], bool] | None:
    """Which rows a rule reads; None for all of its inputs."""
    if declaration.where is None:
        return None
    condition = compile_condition(declaration.where)
    return condition.test or (lambda row: condition.test_bound(row, None))


def compile_finish(declaration: Declaration) -> Finish:
    """What measures the rows of a match, and drops it where it is less sure than is asked for."""
    measures = {name: compile_measure(measure) for name, measure in declaration.measures.items()}
    confidence = declaration.confidence
    if confidence is None:
        nothing: tuple[Mapping[str, Value], None] = ({}, None)
        if not measures:
            return lambda bound, stamp_us, whole=None, number=0: nothing
        return lambda bound, stamp_us, whole=None, number=0: (
            {name: measure(bound, whole or bound, number) for name, measure in measures.items()},
            None,
        )

    def finish(
        bound: Bound, stamp_us: int, whole: Bound | None = None, number: int = 0
    ) -> tuple[Mapping[str, Value], float | None] | None:
        sureness = confidence_of(confidence, whole or bound)
        if sureness is not None and sureness < confidence.at_least:
            return None
        return {name: measure(bound, whole or bound, number) for name, measure in measures.items()}, sureness

    return finish


def _conditions(declaration: Declaration) -> Mapping[str, Condition]:
    return {name: compile_condition(condition) for name, condition in declaration.define.items()}
