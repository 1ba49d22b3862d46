"""Systems of the earth in requests: EPSG codes."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

from fastapi import Query
from sqlalchemy import Connection

from semap.store.anchor import on_earth
from semap.store.instances import InstanceDetail

PREFIX = "EPSG:"

Crs = Annotated[
    str | None,
    Query(
        pattern=r"^EPSG:[1-9]\d{3,4}$",
        description="Give shapes in this system of the earth. [default: the map frame]",
        examples=["EPSG:25832"],
    ),
]


def epsg_of(crs: str | None) -> int | None:
    """The code of a system; None: the map frame."""
    return None if crs is None else int(crs.removeprefix(PREFIX))


def footprint_in(connection: Connection, found: InstanceDetail, crs: str | None) -> InstanceDetail:
    """The same instance with its footprint in a system of the earth; None: in the map frame.

    raises  Conflict if its map has no anchor, InvalidInput for an unknown system
    """
    epsg = epsg_of(crs)
    if epsg is None or found.footprint is None:
        return found
    (placed,) = on_earth(connection, found.instance.map, [found.footprint], epsg)
    return replace(found, footprint=placed)
