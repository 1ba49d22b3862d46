"""Which collections there are: of each map one for each concept, and its tracks, relations and events."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

from sqlalchemy import Connection, text

from semap.errors import NotFound
from semap.store.database.connection import translated

Kind: TypeAlias = Literal["instances", "tracks", "relations", "events"]

OTHERS: tuple[Kind, ...] = ("tracks", "relations", "events")
ALWAYS = ("Room", "Door")
"""Concepts whose collections are there while they are empty."""

LIST = text("""
    with used as materialized (
      select distinct map_id, concept_id from semap.instance
    ), named as (
      select u.map_id, c.name
      from used u cross join lateral semap.concepts_above(u.concept_id) a (concept_id)
      join semap.concept c on c.concept_id = a.concept_id
      union
      select m.map_id, c.name
      from semap.map m cross join semap.concept c where c.name = any (cast(:always as text[]))
      union
      select m.map_id, 'tracks' from semap.map m
      union
      select m.map_id, 'relations' from semap.map m
      union
      select m.map_id, 'events' from semap.map m
    )
    select m.map_id, m.name, n.name
    from named n join semap.map m using (map_id)
    where strpos(m.name || n.name, '/') = 0
    order by m.name collate "C", n.name = any (cast(:others as text[])), n.name collate "C"
    limit :limit offset :offset
""")
FIND = text("""
    select m.map_id, m.name, k.rest,
           case when k.rest <> all (cast(:others as text[])) then
             array(select semap.concepts_below(c.concept_id) order by 1) end
    from unnest(cast(:maps as text[]), cast(:rests as text[])) k (map, rest)
    join semap.map m on m.name = k.map
    left join semap.concept c on c.name = k.rest
    where c.concept_id is not null or k.rest = any (cast(:others as text[]))
    order by length(m.name) desc limit 1
""")


@dataclass(frozen=True)
class Collection:
    """What is of one kind on one map.

    concept      of instances: they are of this one, or of one below it
    concept_ids  of these, where they are known
    """

    map_id: int
    map: str
    kind: Kind
    concept: str | None = None
    concept_ids: tuple[int, ...] = ()

    @property
    def id(self) -> str:
        return f"{self.map}.{self.concept or self.kind}"


def list_collections(connection: Connection, *, limit: int, offset: int = 0) -> tuple[Collection, ...]:
    """At most `limit` collections, by map: first those of concepts, by name.

    A concept is there with the first instance of it, or of one below it.
    """
    asked = {"always": list(ALWAYS), "others": list(OTHERS), "limit": limit, "offset": offset}
    with translated():
        rows = connection.execute(LIST, asked).all()
    return tuple(_collection(map_id, map_name, name, ()) for map_id, map_name, name in rows)


def get_collection(connection: Connection, id_: str) -> Collection:
    """The collection `map.Concept`, `map.tracks`, `map.relations` or `map.events`.

    raises  NotFound
    """
    splits = list(_splits(id_))
    asked = {
        "maps": [map_name for map_name, _ in splits],
        "rests": [rest for _, rest in splits],
        "others": list(OTHERS),
    }
    with translated():
        found = connection.execute(FIND, asked).one_or_none()
    if found is None:
        raise NotFound("collection", id_, "List /collections to see their ids.")
    return _collection(found[0], found[1], found[2], tuple(found[3] or ()))


def _splits(id_: str) -> Iterator[tuple[str, str]]:
    """Names may have dots: every way to read an id."""
    at = id_.find(".")
    while at != -1:
        yield id_[:at], id_[at + 1 :]
        at = id_.find(".", at + 1)


def _collection(map_id: int, map_name: str, name: str, concept_ids: tuple[int, ...]) -> Collection:
    kind: Kind
    for kind in OTHERS:
        if name == kind:
            return Collection(map_id, map_name, kind)
    return Collection(map_id, map_name, "instances", name, concept_ids)
