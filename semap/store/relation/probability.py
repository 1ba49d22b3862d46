"""How probable relations are, of queries that ask for certainty."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from sqlalchemy import Connection, text

from semap.store.database.connection import translated

PROBABLE = text("""
    select n.track_id, n.region_id, semap.relation_probability(n.track_id, n.region_id)
    from unnest(cast(:tracks as bigint[]), cast(:regions as integer[])) as n (track_id, region_id)
""")


def probabilities(
    connection: Connection, relations: Iterable[tuple[int, int]]
) -> Mapping[tuple[int, int], float | None]:
    """Of relations as (track_id, region_id): how probable each is now; None of those that ask for none."""
    wanted = list(relations)
    if not wanted:
        return {}
    asked = {"tracks": [track for track, _ in wanted], "regions": [region for _, region in wanted]}
    with translated():
        rows = connection.execute(PROBABLE, asked).all()
    return {(track, region): probability for track, region, probability in rows}
