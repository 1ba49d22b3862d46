"""Records as JSON, as brokers and files carry them: states of tracks, and of objects.

{"track": "cat", "stamp": "2026-01-31T12:00:00Z", "x_m": 1.0, "y_m": 2.0}
{"instance": "Door07", "property": "door", "value": "open", "stamp": "2026-01-31T12:00:00Z"}
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, ValidationError
from semap_ingest.named_states import Refused
from semap_ingest.state_json import states_of_lines

from semap.model.object_state import NewObjectState
from semap.store.motion.bridges import Position
from semap.timeline.stamp import EARLIEST, LATEST
from semap_bridge.adapter import Batch, Name


class _Object(BaseModel):
    model_config = ConfigDict(extra="forbid", hide_input_in_errors=True)

    instance: Name
    property: Name
    value: str = Field(max_length=1000, pattern=r"^[^\x00]*$")
    stamp: AwareDatetime = Field(ge=EARLIEST, lt=LATEST)
    attributes: dict[str, Any] = Field(default_factory=dict)


def batch_of_lines(lines: Sequence[bytes], position: Position | None = None) -> Batch:
    """What lines say; what is none of both is among the refused, by its place."""
    objects: list[NewObjectState] = []
    refused: list[Refused] = []
    of_tracks = list(lines)
    for index, line in enumerate(lines):
        if b'"instance"' not in line:
            continue
        try:
            said = _Object.model_validate(json.loads(line))
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            detail = f"{'.'.join(str(each) for each in first['loc'])}: {first['msg']}"
            refused.append(Refused(index, "no state of an object", detail))
        except (ValueError, RecursionError) as error:
            refused.append(Refused(index, "not JSON", str(error)))
        else:
            objects.append(
                NewObjectState(said.instance, said.property, said.value, said.stamp, said.attributes)
            )
        of_tracks[index] = b""
    states, flawed = states_of_lines(of_tracks)
    return Batch(states, objects, refused=[*refused, *flawed], position=position)
