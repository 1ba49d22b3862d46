"""States of tracks as clients send them, as rows or as columns, and what came of them.

They are read by `semap_ingest/state_json`, which refuses what is wrong record by record; these models
describe them.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field

from semap_service.documents.document import LARGEST_ID, Document, InStamp, Name, Request

TOLD = 20
"""So many late or refused states are named in an answer; all are counted."""

ROW: dict[str, Any] = {
    "track": "person 3",
    "stamp": "2026-01-31T12:00:00Z",
    "x_m": 1.0,
    "y_m": 1.5,
    "std_m": 0.1,
}
COLUMNS: dict[str, Any] = {
    "track": ["person 3", "person 4"],
    "stamp": "2026-01-31T12:00:00Z",
    "x_m": [1.0, 7.5],
    "y_m": [1.5, 2.0],
}
WATERMARK = "After these the source gives no state up to this stamp, and rules may go on so far."
SEQUENCE = (
    "Number that the client gives, which rises from one to the next. What comes with one that is not above"
    " the last of this source has been taken already, and is passed over."
)

Sequence = Annotated[int, Field(ge=1, le=LARGEST_ID)]
Number = float | None


class StateRow(Request):
    """Where a track was, in the frame of the map."""

    model_config = ConfigDict(json_schema_extra={"examples": [ROW]})

    track: Name = Field(description="Its name; a track is made when it is new.")
    stamp: InStamp | None = Field(default=None, description="When; or give `stamp_us`.")
    stamp_us: int | None = Field(default=None, description="When, in microseconds since 1970.")
    x_m: float
    y_m: float
    z_m: Number = None
    std_m: Number = Field(default=None, description="Standard deviation, or along the longer axis.")
    heading_rad: Number = Field(default=None, description="Where the body faces, from x towards y.")
    speed_mps: Number = None
    length_m: Number = Field(default=None, description="Of the body, along the heading.")
    width_m: Number = None
    std_across_m: Number = Field(default=None, description="Along the shorter axis of the error ellipse.")
    std_yaw_rad: Number = Field(default=None, description="Where the longer axis points, from x towards y.")
    is_last: bool | None = Field(default=None, description="After it the track was gone.")


class StateColumns(Request):
    """The same, a list for each member: a value for each state, or one value in its place for all."""

    model_config = ConfigDict(extra="allow", json_schema_extra={"examples": [COLUMNS]})

    track: list[Name] | Name
    stamp: list[InStamp] | InStamp | None = None
    stamp_us: list[int] | int | None = None
    x_m: list[float] | float
    y_m: list[float] | float


class NewStates(Request):
    """States of tracks from a source."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {"source": "lidar", "sequence": 17, "states": [ROW]},
                {"source": "lidar", "states": COLUMNS},
            ]
        }
    )

    source: Name = Field(description="Made where it is missing.")
    sequence: Sequence | None = Field(default=None, description=SEQUENCE)
    watermark: InStamp | None = Field(default=None, description=WATERMARK)
    states: list[StateRow] | StateColumns


class RefusedState(Document):
    """A state that was not taken."""

    index: int = Field(description="Its place among those sent, from 0.")
    reason: str = Field(examples=["no stamp"])
    detail: str


class TakenStates(Document):
    """What came of states that were sent."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "accepted": 2,
                    "repeated": False,
                    "sequence": 17,
                    "late": 0,
                    "late_indexes": [],
                    "refused": 1,
                    "refusals": [{"index": 2, "reason": "no stamp", "detail": "None: give stamp"}],
                }
            ]
        }
    )

    accepted: int = Field(description="How many are stored now that were not before.")
    repeated: bool = Field(description="The sequence number was there already: nothing was done.")
    sequence: int | None = Field(description="As it was sent.")
    late: int = Field(
        description="How many of the accepted came after later ones of their track, and correct its past."
    )
    late_indexes: list[int] = Field(description="Of the first 20.")
    refused: int
    refusals: list[RefusedState] = Field(description="The first 20.")


class StatesHello(Document):
    """The first message of a socket for states."""

    type: Literal["hello"] = "hello"
    source: str
    sequence: int = Field(description="The last that was taken of this source; go on above it. 0: none.")
    window: int = Field(description="So many messages may be on their way without an answer.")


class SentStates(Request):
    """What a client sends over the socket: one message, one transaction."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"sequence": 18, "states": COLUMNS}]})

    type: Literal["states"] = "states"
    sequence: Sequence = Field(description="Above that of the message before.")
    watermark: InStamp | None = Field(default=None, description=WATERMARK)
    states: list[StateRow] | StateColumns


class Taken(TakenStates):
    """The answer to each message, in their order."""

    type: Literal["taken"] = "taken"
