"""Which events and changes of relations a bridge gives out: CQL2 filters of its config."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Annotated

from pydantic import AfterValidator

from semap.cql2 import Kinds, check, parse
from semap.cql2.evaluate import Subject, compile_filter
from semap.cql2.logic import Code, code
from semap.errors import InvalidInput
from semap.store.event.event_selection import Selection
from semap.store.relation.changes import StoredChange
from semap.timeline.stamp import to_us

FILTERS_KEPT = 64

CHANGE_KINDS: Kinds = {
    "query": "text",
    "kind": "text",
    "cause": "text",
    "subject": "text",
    "object": "text",
    "track_id": "number",
    "subject_instance_id": "number",
    "instance_id": "number",
    "object_track_id": "number",
    "stamp": "instant",
    "transition_at": "instant",
    "since": "instant",
    "direction": "text",
    "door": "text",
    "door_id": "number",
    "amendment": "text",
}
"""What a filter may ask of a change of a relation (`StoredChange`)."""

CHANGE_CODE = {
    "stamp": "to_us(change.stamp)",
    "transition_at": "to_us(change.transition_at)",
    "since": "to_us(change.since)",
    "door": "change.door_name",
}
"""How a property is found where it is not the change's own attribute of that name."""


def takes_change(text: str | None, change: StoredChange) -> bool:
    """Whether a filter that was checked takes a change; None takes each."""
    return text is None or _compiled(text)(change)


@lru_cache(FILTERS_KEPT)
def _compiled(text: str) -> Callable[[StoredChange], bool]:
    expression = parse(text)
    check(expression, CHANGE_KINDS)
    return compile_filter(expression, _CHANGE)


def _property(name: str) -> Code:
    return code(CHANGE_CODE.get(name, f"change.{name}"))


def _is_a(concept: str) -> Code:
    raise InvalidInput(
        f"isA('{concept}'): a change is of no concept", "Ask for its kind, or its object.", "filter"
    )


_CHANGE = Subject(
    kinds=CHANGE_KINDS,
    parameters="change",
    property_of=_property,
    is_a=_is_a,
    names={"to_us": to_us},
)


def _checked(check_it: Callable[[str], object]) -> Callable[[str], str]:
    """A validator, which says what is wrong with a filter and what to do."""

    def validate(text: str) -> str:
        try:
            check_it(text)
        except InvalidInput as error:
            raise ValueError(f"{error}. {error.remedy}") from error
        return text

    return validate


EventFilter = Annotated[str, AfterValidator(_checked(lambda text: Selection(filter=text).check()))]
ChangeFilter = Annotated[str, AfterValidator(_checked(_compiled))]
