"""From what a rule declares to the program that runs it."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from semap.rules.bound import Bound, Condition
from semap.rules.condition import compile_condition, compile_measure
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
from semap.rules.matching.pattern_program import PatternProgram
from semap.rules.pattern import Node
from semap.rules.program import Program
from semap.rules.row import Row, Value
from semap.rules.temporal.formula_program import FormulaProgram


def compile_rule(declaration: Declaration) -> Program:
    """The program of a rule, whichever of its kinds it is.

    raises InvalidInput where the parts do not fit one another
    """
    emit = declaration.emit
    match declaration.body:
        case Edges():
            return EdgesProgram(emit, compile_finish(declaration))
        case RowPattern(node):
            return compile_pattern(declaration, node, declaration.after_match)
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


def compile_pattern(declaration: Declaration, node: Node, after_match: AfterMatch) -> PatternProgram:
    """The program of a row pattern, with the other clauses of the declaration.

    raises InvalidInput as `PatternProgram.compile`
    """
    return PatternProgram.compile(
        node,
        _conditions(declaration),
        declaration.within,
        after_match,
        declaration.emit.get("match"),
        declaration.emit.get("timeout"),
        compile_finish(declaration),
    )


def compile_where(declaration: Declaration) -> Callable[[Row], bool] | None:
    """Which rows a rule reads; None for all of its inputs."""
    if declaration.where is None:
        return None
    condition = compile_condition(declaration.where)
    return condition.test or (lambda row: condition.test_bound(row, None, None))


def compile_finish(declaration: Declaration) -> Finish:
    """What measures the rows of a match, and drops it where it is less sure than is asked for."""
    measures = {name: compile_measure(measure) for name, measure in declaration.measures.items()}
    confidence = declaration.confidence
    if confidence is None:
        nothing: tuple[Mapping[str, Value], None] = ({}, None)
        if not measures:
            return lambda bound, stamp_us: nothing
        return lambda bound, stamp_us: ({name: measure(bound) for name, measure in measures.items()}, None)

    def finish(bound: Bound, stamp_us: int) -> tuple[Mapping[str, Value], float | None] | None:
        sureness = confidence_of(confidence, bound)
        if sureness is not None and sureness < confidence.at_least:
            return None
        return {name: measure(bound) for name, measure in measures.items()}, sureness

    return finish


def _conditions(declaration: Declaration) -> Mapping[str, Condition]:
    return {name: compile_condition(condition) for name, condition in declaration.define.items()}
