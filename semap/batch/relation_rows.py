"""Visits as the changes of relations that rules read."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from uuid import UUID, uuid5

from semap.batch.crossing import Visit
from semap.batch.stored_tracks import StoredRegion, StoredTrack
from semap.intake.input_row import relation_row
from semap.intake.map_facts import MapFacts
from semap.rules.row import Row
from semap.timeline.stamp import to_datetime

NAMESPACE = UUID("0c5e2e43-63ee-5f3b-8c5e-2b0b1f3d9a44")


def relation_rows(
    visits: Iterable[Visit],
    tracks: Mapping[int, StoredTrack],
    regions: Mapping[int, StoredRegion],
    facts: MapFacts,
    before_us: int,
) -> Iterator[Row]:
    """A row for each beginning and each end of a visit, with an identity made of what happened.

    before_us  where a visit is said to have begun that had begun before anything was read
    """
    for visit in visits:
        track, region = tracks[visit.track], regions[visit.region_id]
        since_us = before_us if visit.began_by is None else visit.began_us
        yield _row(track, region, "began", visit.began_by or "moved", since_us, since_us, facts)
        if visit.ended_us is not None and visit.ended_by is not None:
            yield _row(track, region, "ended", visit.ended_by, visit.ended_us, since_us, facts)


def _row(
    track: StoredTrack,
    region: StoredRegion,
    kind: str,
    cause: str,
    stamp_us: int,
    since_us: int,
    facts: MapFacts,
) -> Row:
    said = f"{region.query_name}|{track.uid}|{region.instance_uid}|{kind}|{cause}|{stamp_us}"
    return relation_row(
        {
            "uid": str(uuid5(NAMESPACE, said)),
            "query_name": region.query_name,
            "track_id": str(track.track_id),
            "track_name": track.name,
            "instance_id": str(region.instance_id),
            "instance_name": region.instance_name,
            "kind": kind,
            "cause": cause,
            "stamp": to_datetime(stamp_us).isoformat(),
            "since": to_datetime(since_us).isoformat(),
        },
        facts,
    )
