"""Who is where: the subjects related to each instance by each query, as of the row taken last.

They are tracks by their ids, or instances, whose ids are texts so that no track is taken for one.

It belongs to one rule, which reads `occupants`: a rule that runs alone over the past counts by itself.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import TypeAlias

from semap.rules.row import Row, Value

Place: TypeAlias = tuple[str, int]
"""The name of a query and the id of an instance."""


class Presence:
    """Mutable; `changed` names the places whose tracks are not the ones that were read last."""

    def __init__(self) -> None:
        self._tracks: dict[Place, set[Value]] = {}
        self._changed: set[Place] = set()

    def after(self, row: Row) -> Row:
        """Take a row; gives it with its `occupants`, or as it is where it is no relation to an instance."""
        values = row.values
        if row.source != "relation" or values.get("instance_id") is None:
            return row
        place = (str(values.get("input")), int(str(values.get("instance_id"))))
        tracks = self._tracks.setdefault(place, set())
        before = len(tracks)
        if values.get("type") == "began":
            tracks.add(_subject(values))
        elif values.get("type") == "ended":
            tracks.discard(_subject(values))
        if len(tracks) != before:
            self._changed.add(place)
        if not tracks:
            del self._tracks[place]
        counted = {**values, "occupants": len(tracks)}
        return row.saying(counted)

    def changes(self) -> Iterable[tuple[str, object]]:
        """What is to be stored since the last call: places with their tracks, None where nobody is."""
        changed, self._changed = self._changed, set()
        for place in changed:
            tracks = self._tracks.get(place)
            yield _text(place), None if tracks is None else sorted(tracks, key=str)

    def load(self, text: str, tracks: Iterable[Value]) -> None:
        """Take what was stored of one place."""
        self._tracks[_place(text)] = set(tracks)

    def texts(self) -> Iterable[str]:
        """The places at which somebody is, as they are stored."""
        return [_text(place) for place in self._tracks]


def _subject(values: Mapping[str, Value]) -> Value:
    number = values.get("track_id")
    return f"instance {values.get('subject_id')}" if number is None else number


def is_place(text: str) -> bool:
    """Whether a stored key is a place, and not the key of a rule's partition, which is an array."""
    return text.startswith("{")


def _text(place: Place) -> str:
    query, instance_id = place
    return json.dumps(
        {"occupants_by": query, "instance_id": instance_id}, ensure_ascii=False, separators=(",", ":")
    )


def _place(text: str) -> Place:
    document = json.loads(text)
    return document["occupants_by"], document["instance_id"]
