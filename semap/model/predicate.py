"""The predicates of continuous queries: each is one file of `sql/117_predicate`, and all that is known of it.

A file begins with a comment in TOML, the fields of `Predicate`. After it come the function that compares two
things, `semap.NAME_stands`, and the one by which a query in SQL names the predicate, in the schema
`semap_query`. The table `semap.predicate` has what the database asks of it.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Literal, get_args

from semap.schema_files import sql_files

Kind = Literal["track", "instance"]
FollowsFrom = Literal["moment", "trend", "rank", "way"]
Compared = Literal["position", "pose", "ground", "front", "back", "left", "right", "line", "body", "top"]
Reach = Literal["contact", "distance", "any"]
RegionTest = Literal["contains", "covers", "dwithin"]

FOLDER = "sql/117_predicate"
ANY = tuple(f"{subject} {object_}" for subject in get_args(Kind) for object_ in get_args(Kind))


@dataclass(frozen=True)
class RowFunction:
    """How a query in SQL names a predicate, of two rows.

    numbers       the parameters that follow the rows
    of_instance   the object is an instance
    by_track      the subject is a track
    always        parameters that it does not ask for
    of_instances  the abstraction that is compared of instances
    """

    name: str
    usage: str
    numbers: tuple[str, ...] = ()
    of_instance: bool = False
    by_track: bool = False
    always: Mapping[str, Any] = field(default_factory=dict)
    of_instances: str | None = None


@dataclass(frozen=True)
class Predicate:
    """A relation that can be kept true between a subject and an object.

    holds             while which it does, as the documentation says it
    holds_in_regions  the same of a track and an instance, where regions answer it
    needs, takes      parameters that it must be told, and that it may be told
    relates           the kinds of subject and object, as "track instance"
    why_not           why not every kind
    follows_from      where the two are at one moment; how their distance changed; where others are, too; the
                      way of the subject
    region_test       how PostGIS compares the area of an instance with the position of a track, where that is
                      all there is to it; None: only pair by pair
    subject, object   what is compared of each. Of a track: its position, also with the heading ("pose"), the
                      ground that it covers, or the area to a side of that. Of an instance: its abstraction,
                      the area to a side of that, the line on which it is crossed, or, of what need not
                      have an outline, its body or its top
    reach             how far apart what is compared of the two may be: not at all, up to the distance of the
                      query, or any distance
    has_boundary      whether there is one in metres, beside which a margin can be
    rows              its function of two rows
    areas             functions of PostGIS that mean it of an area and what is in it, and which argument is
                      the area
    """

    name: str
    holds: str
    holds_in_regions: str | None = None
    needs: tuple[str, ...] = ()
    takes: tuple[str, ...] = ()
    relates: tuple[str, ...] = ANY
    why_not: str = ""
    follows_from: FollowsFrom = "moment"
    region_test: RegionTest | None = None
    subject: Compared = "position"
    object: Compared = "position"
    reach: Reach = "contact"
    has_boundary: bool = False
    rows: RowFunction | None = None
    areas: Mapping[str, Literal[0, 1]] = field(default_factory=dict)

    def in_pairs(self, subject: Kind, object_: Kind) -> bool:
        """Whether it is kept pair by pair: regions answer only where a track is to an instance."""
        return (subject, object_) != ("track", "instance") or self.region_test is None


def read_predicate(name: str, sql: str) -> Predicate:
    """What a file says of its predicate.

    raises  ValueError where it does not begin with a comment, or that is no TOML; TypeError where it has a
            field that there is not
    """
    head, closed, _ = sql.removeprefix("/*").partition("*/")
    if not sql.startswith("/*") or not closed:
        raise ValueError(f"the predicate {name} does not begin with what it is, in a comment")
    said = _frozen(tomllib.loads(head))
    if "rows" in said:
        said["rows"] = RowFunction(**_frozen(said["rows"]))
    return Predicate(name=name, **said)


def _frozen(said: Mapping[str, Any]) -> Any:
    return {key: tuple(value) if isinstance(value, list) else value for key, value in said.items()}


@cache
def predicates() -> Mapping[str, Predicate]:
    """All of them, by their names."""
    return {file.stem: read_predicate(file.stem, file.read_text()) for file in sql_files(FOLDER)}


def needed_for(parameter: str) -> str:
    """Which predicates need or take a parameter, in words."""
    needing = [each.name for each in predicates().values() if parameter in each.needs]
    taking = [each.name for each in predicates().values() if parameter in each.takes]
    wanted = [f"of {', '.join(taking)} if wanted"] if taking else []
    said = "; ".join([f"of {', '.join(needing)}"] * bool(needing) + wanted)
    return said[0].upper() + said[1:]
