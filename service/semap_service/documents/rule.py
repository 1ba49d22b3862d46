"""What documents of rules share: what a rule declares, and where it gave up."""

from __future__ import annotations

from typing import Annotated, Any, Literal

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
    """Where a rule began to give up: too much was under way in one key, or ended there at once."""

    attempts: int = Field(description="How many it gave up.")
    first: Stamp = Field(description="Events that begin here or later may be missing.")
    key: dict[str, Any] = Field(description="By the names in `partition_by`.", examples=[{"track": "ann"}])
    matches: int = Field(0, description="How many it found and did not tell, as too many ended at one row.")


class RulePart(Document):
    """One box of a rule's drawing, with those in it, which are read from the first to the last."""

    kind: Literal["step", "never", "event", "sequence", "choice", "all", "repeat"] = Field(
        description="A row; one that must not come; what is made; or what holds parts: one after the other,"
        " one of them, all of them, the same several times."
    )
    label: str = Field(description="The variable, or the event; may be empty.", examples=["O"])
    text: str = Field(description="In words.", examples=["door becomes open"])
    joint: str = Field(description="How it follows the part before; may be empty.", examples=["later"])
    parts: list[RulePart]


class RuleLikeness(Document):
    """The template that says the same as a rule, or the likest one."""

    template: str = Field(examples=["dwell"])
    values: dict[str, str] | None = Field(
        description="Of its parameters; null: it does not say the same.", examples=[{"room": "kitchen"}]
    )
    differs: list[str] = Field(description="The clauses in which they differ.", examples=[["pattern"]])
