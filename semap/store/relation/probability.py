"""How probable relations are, of queries that ask for certainty."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from sqlalchemy import Connection, text

from semap.store.database.connection import translated
from semap.store.relation.relations import Place, Relation

PROBABLE = text("""
    select n.place, semap.relation_probability(n.track_id, r.region_id)
    from unnest(cast(:places as integer[]), cast(:tracks as bigint[]), cast(:queries as integer[]),
                cast(:instances as bigint[])) as n (place, track_id, query_id, instance_id)
    join semap.region r using (query_id, instance_id)
""")


def probabilities(connection: Connection, relations: Iterable[Relation]) -> Mapping[Place, float | None]:
    """How probable each of these is now, by its place; None, or nothing, of those that ask for none."""
    wanted = [each for each in relations if each.until is None]
    if not wanted:
        return {}
    asked = {
        "places": list(range(len(wanted))),
        "tracks": [each.track_id for each in wanted],
        "queries": [each.place[1] for each in wanted],
        "instances": [each.instance_id for each in wanted],
    }
    with translated():
        rows = connection.execute(PROBABLE, asked).all()
    return {wanted[place].place: probability for place, probability in rows}
