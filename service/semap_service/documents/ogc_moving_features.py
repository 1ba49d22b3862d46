"""The documents of OGC API Moving Features (OGC 22-003r3) and MF-JSON (OGC 19-045r3)."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from semap_service.documents.document import Document
from semap_service.documents.ogc_features import Link


class NamedSystem(Document):
    """A system of coordinates or of time, by name."""

    type: Literal["Name"]
    properties: dict[str, str]


class MovingPoint(Document):
    """Where something was at each of the times."""

    id: str
    type: Literal["MovingPoint"]
    datetimes: list[str]
    coordinates: list[list[float]]
    interpolation: Literal["Linear", "Discrete"]


class TemporalGeometrySequence(Document):
    """The way of a track, in pieces."""

    type: Literal["TemporalGeometrySequence"]
    geometrySequence: list[MovingPoint]
    crs: NamedSystem
    trs: NamedSystem
    links: list[Link]
    numberReturned: int


class ValueSequence(Document):
    """A value at each of the times."""

    datetimes: list[str]
    values: list[float]
    interpolation: Literal["Linear", "Step", "Discrete"]


class TemporalProperty(Document):
    """A property over time."""

    name: str = Field(examples=["speed_mps"])
    type: Literal["TReal"]
    form: str = Field(description="Its unit, by UN/CEFACT's recommendation 20.", examples=["MTS"])
    description: str
    valueSequence: list[ValueSequence]
    links: list[Link]


class TemporalPropertySummary(Document):
    """A property that changes over time."""

    name: str
    type: Literal["TReal"]
    form: str
    description: str


class TemporalProperties(Document):
    """Which properties of a track change over time."""

    temporalProperties: list[TemporalPropertySummary]
    links: list[Link]
    numberMatched: int
    numberReturned: int
