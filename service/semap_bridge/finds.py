"""What perception finds, as batches: persons and lines are sources of their own, as of a recording."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from semap_ingest.named_states import NO_STATES, NamedStates
from semap_ingest.pipeline.found import Found, LinesAt
from semap_ingest.pipeline.ingest_recording import QUIET_US
from semap_ingest.pipeline.registration import lines_source, persons_source
from semap_ingest.pipeline.writing import MIDDLE_M, columns_of
from semap_ingest.sensing.track_states import TrackAmendment
from sqlalchemy import Connection, text

from semap.timeline.stamp import to_datetime
from semap_bridge.adapter import Batch

ADD_LINES = text("""
    insert into semap.line_observation
      (source_id, stamp, x1_m, y1_m, x2_m, y2_m, z_m, angle_std_rad, offset_std_m, points)
    select s.source_id, l.*
    from semap.source s join semap.map m using (map_id),
         unnest(cast(:stamps as timestamptz[]), cast(:x1 as float8[]), cast(:y1 as float8[]),
                cast(:x2 as float8[]), cast(:y2 as float8[]), cast(:z as float8[]), cast(:angle as float4[]),
                cast(:offset as float4[]), cast(:points as integer[])) l
    where m.name = :map and s.name = :source
""")
ADD_AMENDMENTS = text("""
    insert into semap.track_amendment (source_id, track_id, other_track_id, kind, since, found)
    select t.source_id, t.track_id, o.track_id, a.kind, a.since, a.found
    from unnest(cast(:tracks as text[]), cast(:others as text[]), cast(:kinds as text[]),
                cast(:since as timestamptz[]), cast(:found as timestamptz[]))
         a (track, other, kind, since, found)
    join semap.source s on s.name = :source
    join semap.map m on m.map_id = s.map_id and m.name = :map
    join semap.track t on t.source_id = s.source_id and t.name = a.track
    join semap.track o on o.source_id = s.source_id and o.name = a.other
    on conflict do nothing
""")
OPEN = text("""
    select t.name, (extract(epoch from n.stamp) * 1000000)::bigint
    from semap.track t join semap.source s using (source_id) join semap.map m on m.map_id = s.map_id
    join semap.track_place n using (track_id)
    where m.name = :map and s.name = :source and t.ended_at is null
""")


class FindBatches:
    """Mutable: how far watermarks have come.

    session  told in the names of tracks, which begin with 1 each time
    """

    def __init__(self, map_name: str, source: str, session: str, floor_z_m: float) -> None:
        self._map_name = map_name
        self._persons, self._lines = persons_source(source), lines_source(source)
        self._session = session
        self._middle_m = floor_z_m + MIDDLE_M
        self._marked_us = {self._persons: 0, self._lines: 0}

    def batches(self, found: Found) -> list[Batch]:
        """In the order in which they are to be written; none where nothing is new."""
        return [*self._persons_of(found), *self._lines_of(found)]

    def _persons_of(self, found: Found) -> Iterable[Batch]:
        every = [each.states for each in found.persons]
        mark_us = self._moved(self._persons, found.persons_watermark_us, bool(every))
        seen = [each for each in every if len(each)]
        ended = [(self._name(track), each.stamp_us) for each in every for track, _ in each.ended]
        amendments = [one for each in every for one in each.amendments]
        if not (seen or ended or amendments) and mark_us is None:
            return
        states = NO_STATES
        if seen:
            states = NamedStates.of_columns(
                [self._name(int(track)) for each in seen for track in each.track],
                np.repeat([each.stamp_us for each in seen], [len(each) for each in seen]),
                **columns_of(seen, self._middle_m),
            )
        also = self._amend(amendments) if amendments else None
        yield Batch(states, ended=ended, watermark_us=mark_us, source=self._persons, also=also)

    def _lines_of(self, found: Found) -> Iterable[Batch]:
        lines = [each for each in found.lines if len(each.lines)]
        mark_us = self._moved(self._lines, found.lines_watermark_us, bool(lines))
        if lines or mark_us is not None:
            also = self._add_lines(lines) if lines else None
            yield Batch(watermark_us=mark_us, source=self._lines, also=also)

    def _moved(self, source: str, mark_us: int | None, is_something: bool) -> int | None:
        """The watermark where it is worth being told."""
        if mark_us is None or mark_us - self._marked_us[source] < (1 if is_something else QUIET_US):
            return None
        self._marked_us[source] = mark_us
        return mark_us

    def _name(self, track: int) -> str:
        return f"person {track} of {self._session}"

    def _amend(self, amendments: Sequence[TrackAmendment]) -> Callable[[Connection], None]:
        values: dict[str, object] = {
            "tracks": [self._name(one.track) for one in amendments],
            "others": [self._name(one.other) for one in amendments],
            "kinds": [one.kind for one in amendments],
            "since": [to_datetime(one.since_us) for one in amendments],
            "found": [to_datetime(one.found_us) for one in amendments],
        }
        return self._adding(ADD_AMENDMENTS, self._persons, values)

    def _add_lines(self, found: Sequence[LinesAt]) -> Callable[[Connection], None]:
        ends = np.concatenate([each.lines.ends_m for each in found]).reshape(-1, 4)
        values = {
            "stamps": [to_datetime(each.lines.stamp_us) for each in found for _ in range(len(each.lines))],
            **{name: ends[:, column].tolist() for column, name in enumerate(("x1", "y1", "x2", "y2"))},
            "z": [each.z_m for each in found for _ in range(len(each.lines))],
            "angle": np.concatenate([each.lines.angle_std_rad for each in found]).tolist(),
            "offset": np.concatenate([each.lines.offset_std_m for each in found]).tolist(),
            "points": np.concatenate([each.lines.points for each in found]).tolist(),
        }
        return self._adding(ADD_LINES, self._lines, values)

    def _adding(
        self, statement: object, source: str, values: dict[str, object]
    ) -> Callable[[Connection], None]:
        def write(connection: Connection) -> None:
            connection.execute(statement, {"map": self._map_name, "source": source, **values})  # type: ignore[call-overload]

        return write


def open_tracks(connection: Connection, map_name: str, source: str) -> list[tuple[str, int]]:
    """Tracks of persons that a bridge before this one left open, and when each was seen last [us]."""
    rows = connection.execute(OPEN, {"map": map_name, "source": persons_source(source)})
    return [(name, stamp_us) for name, stamp_us in rows]
