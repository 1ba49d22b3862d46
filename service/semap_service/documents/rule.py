"""What documents of rules share: what a rule declares, and where it gave up."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from semap_service.documents.document import Document, Stamp

EDGES = {"input": "track_in_room", "emit": {"began": "entered", "ended": "left"}}
PATTERN = {
    "input": ["track_in_room", "door"],
    "partition_by": "room",
    "pattern": "O followed by E",
    "define": {
        "O": "input = 'door' and type = 'open'",
        "E": "input = 'track_in_room' and type = 'began'",
    },
    "measures": {"gap_s": "seconds_between(first(O.stamp), last(E.stamp))"},
    "within": "6 s",
    "emit": "opened_then_entered",
}
Declaration = Annotated[
    dict[str, Any],
    Field(
        description="What it reads, and the events that it makes of it; the clauses are in docs/rules.md.",
        examples=[EDGES, PATTERN],
    ),
]


class GivenUpDocument(Document):
    """Where a rule began to give up: too much was under way in one key at once."""

    first: Stamp = Field(description="Events that begin here or later may be missing.")
    key: dict[str, Any] = Field(description="By the names in `partition_by`.", examples=[{"track": "ann"}])
