"""How a rule begins: with the past that it is to run over, with what holds now, or with nothing.

The rows up to the seam come from the tables, those after it through the log. The database noted the seam
while nobody wrote, so that each row is on one side of it.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence

import psycopg

from semap.errors import InvalidInput
from semap.intake.enrichment import enriched
from semap.intake.history_rows import FOR_EVER, Span, history_rows, unwritten_rows
from semap.intake.inputs import RuleChange
from semap.intake.kept import require_kept
from semap.intake.place import Place
from semap.model.event import Event
from semap.rules.declaration import Declaration, IntervalPattern, TemporalFormula
from semap.rules.engine.rule import Rule
from semap.rules.engine.step import NEVER_US, RuleChanged
from semap.rules.needs import needs_of, properties_read
from semap.rules.row import Row
from semap.timeline.stamp import to_datetime, to_us

log = logging.getLogger(__name__)

FOR_EVER_US = to_us(FOR_EVER)
ENRICHED_AT_ONCE = 1000


def begin_rule(
    connection: psycopg.Connection, place: Place, change: RuleChange, made: Sequence[Event] = ()
) -> Iterator[RuleChanged]:
    """A rule is in force as it is declared now; where it was in force, with what it begins with.

    made  events that are not stored yet
    """
    intake, rule = place.intake, change.rule
    known = intake.rules.get(change.rule_id)
    try:
        intake.change_rule(change.rule_id, rule)
    except InvalidInput as error:
        log.error("Rule %d is not in force: %s", change.rule_id, error)
        intake.change_rule(change.rule_id, rule := None)
    if rule is None:
        place.seams.pop(change.rule_id, None)
        if known is not None:
            yield RuleChanged(known.map_id, change.rule_id, None)
        return
    seam = change.seam if change.seam != place.seams.get(rule.rule_id) else None
    span = None
    if rule.enabled and (rule != known or seam is not None):
        span = _span(rule.declaration, change, seam, intake.released_us(rule.map_id))
        if seam is not None:
            place.seams[rule.rule_id] = seam
    if span is None or span.from_us is None:
        yield RuleChanged(rule.map_id, rule.rule_id, rule)
        return
    _say_what_is_gone(connection, rule, span)
    names = frozenset(each.name for each in intake.rules.values() if each.map_id == rule.map_id)
    rows = history_rows(connection, rule, names, span, place.facts)
    rows += unwritten_rows(rule, names, span, made, place.facts)
    ready = enriched_for(connection, rule, list({row.uid: row for row in rows}.values()))
    yield RuleChanged(rule.map_id, rule.rule_id, rule, intake.begin(rule.map_id, ready), span.from_us)


def _say_what_is_gone(connection: psycopg.Connection, rule: Rule, span: Span) -> None:
    """A rule begins all the same, with what is left of its past."""
    if span.from_us is None or span.from_us >= FOR_EVER_US:
        return
    try:
        require_kept(connection, "changes", to_datetime(span.from_us))
    except InvalidInput as error:
        log.warning("Rule %s runs over what is left of the past: %s.", rule.name, error)


def enriched_for(connection: psycopg.Connection, rule: Rule, rows: Sequence[Row]) -> Iterator[Row]:
    """Rows with what one rule needs of them."""
    needs = needs_of(rule.declaration)
    for start in range(0, len(rows), ENRICHED_AT_ONCE):
        yield from enriched(connection, rule.map_id, rows[start : start + ENRICHED_AT_ONCE], needs)


def looks_back(declaration: Declaration) -> bool:
    """Whether a rule asks what holds, which began before it did."""
    if isinstance(declaration.body, IntervalPattern | TemporalFormula):
        return True
    return "occupants" in properties_read(declaration)


def _span(
    declaration: Declaration, change: RuleChange, seam: Mapping[str, int] | None, released_us: int
) -> Span | None:
    """The rows that a rule begins with; events before the span are not its own."""
    held = looks_back(declaration)
    if seam is not None and change.backfill_from_us is not None:
        return Span(change.backfill_from_us, seam=seam, with_held=held)
    if not held:
        return None
    return Span(FOR_EVER_US if released_us == NEVER_US else released_us + 1, seam=seam, with_held=True)
