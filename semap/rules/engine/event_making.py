"""From a match to the event that it is, and from an event to the row that other rules read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from uuid import UUID

from semap.model.event import Event, Evidence
from semap.rules.declaration import Edges, TemporalFormula
from semap.rules.engine.event_identity import EventIdentity, uuid_of
from semap.rules.engine.partition import BY_ID, Key
from semap.rules.engine.rule import Rule
from semap.rules.program import Match
from semap.rules.row import RANKS, Row, Value
from semap.timeline.stamp import to_datetime

NOTHING: Mapping[str, Value] = {}
OF_TRACK = ("track", "track_id")
OF_OTHERS = ("subject", "subject_id", "other", "other_id", "direction")
OF_INSTANCE = (
    "instance",
    "instance_id",
    "room",
    "room_id",
    "room_uid",
    "rooms",
    "concept",
    "attributes",
    "neighbours",
    "footprint",
)


class EventMaker:
    """Makes the events of one rule."""

    def __init__(self, rule: Rule) -> None:
        declaration = rule.declaration
        self._map_id, self._name, self._version = rule.map_id, rule.name, rule.version
        self._identity = EventIdentity(rule.name, rule.version, declaration)
        self._about = declaration.about
        self._edges = isinstance(declaration.body, Edges)
        # a verdict is about whom it was asked of, whoever decided it
        self._asked = isinstance(declaration.body, TemporalFormula) and declaration.body.when is not None
        partition_by = declaration.partition_by
        self._by_track = tuple(partition_by) == ("track",)
        self._named = [(place, name, BY_ID.get(name)) for place, name in enumerate(partition_by)]
        self._room_place = partition_by.index("room") if "room" in partition_by else None

    def event(self, key: Key, match: Match) -> Event:
        """The event that a match in this key is."""
        evidence: list[Evidence] = []
        of_track = of_instance = NOTHING
        last_us = None
        for variable, row in match.rows:
            values = row.values
            last_us = row.own_stamp_us
            evidence.append(Evidence(uuid_of(row.uid), variable, row.source, to_datetime(last_us)))
            if values.get("track_id") is not None:
                of_track = values
            if values.get("instance_id") is not None:
                of_instance = values
        if self._about is not None or self._asked:
            of_instance = self._subject(match)
        if self._asked:
            of_track = self._of_track(match)
        return Event(
            self._event_id(key, match),
            self._map_id,
            self._name,
            self._version,
            match.type,
            evidence[-1].stamp if match.stamp_us == last_us else to_datetime(match.stamp_us),
            evidence[0].stamp if evidence and not self._edges else to_datetime(self._since_us(match)),
            match.rows[-1][1].values.get("cause") if self._edges else None,  # type: ignore[arg-type]
            of_track.get("track_id"),  # type: ignore[arg-type]
            of_track.get("track"),  # type: ignore[arg-type]
            of_instance.get("instance_id"),  # type: ignore[arg-type]
            of_instance.get("instance"),  # type: ignore[arg-type]
            self._key_by_name(key, match, of_track),
            self._told(match),
            match.confidence,
            tuple(evidence),
        )

    def row(self, event: Event, match: Match, known_us: int) -> Row:
        """The row that rules which read this one get, standing where the event was known."""
        rows = [row for _, row in match.rows]
        since_us = self._since_us(match)
        of_track = self._of_track(match)
        of_instance = self._subject(match)
        values: dict[str, Value] = {
            "input": event.rule_name,
            "type": event.type,
            "stamp": match.stamp_us,
            "since": since_us,
            "duration_s": (match.stamp_us - since_us) / 1e6,
            "cause": event.cause,
            "confidence": event.confidence,
            "measures": event.measures,
            **{name: of_track[name] for name in OF_TRACK if name in of_track},
            **{name: of_instance[name] for name in OF_INSTANCE if name in of_instance},
        }
        if self._room_place is not None:
            values.pop("rooms", None)
        concepts = next((row.concepts for row in reversed(rows) if row.values is of_instance), ())
        return Row(known_us, RANKS["event"], str(event.event_id), "event", values, concepts)

    def _subject(self, match: Match) -> Mapping[str, Value]:
        """The values of the row whose instance the event is about."""
        if self._about is None:
            return self._usual(match, "instance_id")
        rows = [row for variable, row in match.rows if variable == self._about]
        return _last_with(rows or [row for _, row in match.rows], "instance_id")

    def _of_track(self, match: Match) -> Mapping[str, Value]:
        """The values of the row whose track the event is about."""
        return self._usual(match, "track_id")

    def _usual(self, match: Match, name: str) -> Mapping[str, Value]:
        """The values of the last row that has this property, or of the row that a formula was asked of."""
        rows = [row for _, row in match.rows]
        return _last_with([*rows[1:], rows[0]] if self._asked and rows else rows, name)

    def _since_us(self, match: Match) -> int:
        """When the first row was; for a row of its own, when the relation or the former state began."""
        if not match.rows:
            return match.stamp_us
        first = match.rows[0][1]
        since = first.values.get("since") if self._edges else None
        return since if isinstance(since, int) else first.own_stamp_us

    def _told(self, match: Match) -> Mapping[str, Value]:
        """What the match measures, with what a change of a relation says for which an event has no place."""
        told = _with_confirmation(match)
        if not self._edges:
            return told
        values = match.rows[-1][1].values
        return {**{name: values[name] for name in OF_OTHERS if values.get(name) is not None}, **told}

    def _event_id(self, key: Key, match: Match) -> UUID:
        if self._room_place is not None and any("rooms" in row.values for _, row in match.rows):
            in_room = _last_with([row for _, row in match.rows], "room_uid")
            return self._identity.event_id(match, str(in_room["room_uid"]))
        return self._identity.event_id(match)

    def _key_by_name(self, key: Key, match: Match, of_track: Mapping[str, Value]) -> dict[str, object]:
        """The key with names in place of ids."""
        if self._by_track:
            return {"track": of_track.get("track")}
        rows = [row for _, row in match.rows]
        return {
            name: key[place] if id_name is None else _last_with(rows, id_name).get(name)
            for place, name, id_name in self._named
        }


def _last_with(rows: Sequence[Row], name: str) -> Mapping[str, Value]:
    """The values of the last row that has this property."""
    for row in reversed(rows):
        if row.values.get(name) is not None:
            return row.values
    return NOTHING


def _with_confirmation(match: Match) -> Mapping[str, Value]:
    """What a match measures, and as `confirmed` when it was known, if that was later than it was."""
    known_us = max((row.stamp_us for _, row in match.rows if "confirmed" in row.values), default=None)
    if known_us is None or known_us <= match.stamp_us:
        return match.measures
    return {"confirmed": to_datetime(known_us).isoformat(), **match.measures}
