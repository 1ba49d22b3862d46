"""The documents of instances: as given out, to be made, and to be changed."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any
from uuid import UUID, uuid4

from pydantic import Field, model_validator

from semap.errors import InvalidInput
from semap.geometry.pose import transform_mesh
from semap.geometry.prism import extrude
from semap.model.building import Item, Mesh
from semap.model.pose import IDENTITY
from semap.store.frames import Keep
from semap.store.history import PastInstance
from semap.store.instance_edit import KEEP, Changes
from semap.store.instances import InstanceDetail
from semap.store.placement import inverse, normalised
from semap_service.documents.document import (
    AreaDocument,
    BandDocument,
    Document,
    Name,
    Next,
    PoseDocument,
    Request,
    Stamp,
    area_document,
    area_of,
    band_of,
    stored,
)

Attributes = Annotated[dict[str, Any], Field(description="Whatever else is known.", examples=[{"number": 7}])]
Elevation = Annotated[float | None, Field(description="Where the footprint's heights begin [m].")]
NEVER_NULL = (
    "name",
    "concept",
    "attributes",
    "frame",
    "pose",
    "local_pose",
    "joins",
    "footprint",
    "elevation_m",
)
Height = Annotated[float | None, Field(gt=0, description="How high they reach from there [m].")]


LocalPose = Annotated[
    PoseDocument, Field(description="Where it stands in the frame that carries it, instead of `pose`.")
]


class InstanceSummary(Document):
    """An instance as lists show it."""

    id: int = stored("instance_id")
    uid: UUID
    map: str = Field(examples=["office"])
    name: str = Field(examples=["Room07"])
    alias: str | None
    concept: str = Field(examples=["Room"])
    storey: str | None = Field(description="The storey that it is on.", examples=["first floor"])


class InstanceList(Document):
    instances: list[InstanceSummary] = Field(description="In the order of their ids.")
    next: Next


class Neighbour(Document):
    """The other side of a door: a room that it joins, or a door of the room."""

    id: int
    name: str


class FrameReference(Document):
    """The frame of an instance, and the one that carries it."""

    id: int
    name: str = Field(examples=["Table1"])
    parent: str | None = Field(description="null: it is a root.", examples=["map"])


class DescriptionReference(Document):
    """What an instance looks like."""

    id: int
    name: str | None = Field(
        description="The blueprint; null: it is this instance's own.", examples=["chair"]
    )


class InstanceDocument(InstanceSummary):
    """All that is known of an instance; everything in the map frame."""

    pose: PoseDocument | None = Field(
        description="In the map frame; null: its frame hangs under another root than `map`."
    )
    frame: FrameReference
    description: DescriptionReference | None = Field(description="null: it looks like nothing.")
    crs: str | None = Field(description="The system of the footprint; null: metres in the map frame.")
    footprint: AreaDocument | None = Field(description="GeoJSON; null where there is none.")
    band: BandDocument | None = Field(
        description="Heights that it answers for: a room of IFC up to the next storey. null: every height."
    )
    body_band: BandDocument | None = Field(
        description="Heights that its body has itself: of a room from the floor to the ceiling."
    )
    joins: list[Neighbour]
    has_body: bool = Field(description="Whether there is a mesh.")
    attributes: Attributes
    created_at: Stamp
    updated_at: Stamp


class PastInstanceDocument(InstanceSummary):
    """An instance as it was."""

    as_of: Stamp
    pose: PoseDocument | None = Field(description="In the map frame; null: it was nowhere.")
    footprint: AreaDocument | None = Field(description="GeoJSON in metres; null where there was none.")
    band: BandDocument | None
    attributes: Attributes


class NewInstance(Request):
    """An instance to be made. Its shape is a mesh, a footprint with or without a height, or a blueprint."""

    name: Name = Field(examples=["Room07"])
    concept: Name = Field(examples=["Room"])
    uid: UUID | None = Field(None, description="Made up if not given.")
    alias: Name | None = None
    storey: Name | None = Field(None, description="The name of the storey that it is on.")
    joins: list[Name] = Field([], max_length=100, description="Names of the rooms that a door joins.")
    attributes: Attributes = Field(default_factory=dict)
    description: Name | None = Field(
        None, description="The blueprint that it looks like.", examples=["chair"]
    )
    frame: Name | None = Field(
        None, description="The frame that carries it. [default: that of its storey, else `map`]"
    )
    pose: PoseDocument | None = Field(
        None,
        description="Where its own frame, and so a mesh, stands in the map frame. [default: the identity]",
    )
    local_pose: LocalPose | None = None
    footprint: AreaDocument | None = Field(None, description="Its outline, if not that of the mesh.")
    elevation_m: Elevation = None
    height_m: Height = None

    def item(self, body: Mesh | None) -> Item:
        """The item to be made; a footprint with a height and no mesh gets the prism over it as its body."""
        footprint = None if self.footprint is None else area_of(self.footprint)
        band = band_of(self.elevation_m, self.height_m)
        if self.description is not None and (body is not None or footprint is not None):
            raise InvalidInput("a blueprint and a shape of its own", "Give one of them.", "description")
        if self.local_pose is not None and (self.pose is not None or footprint is not None):
            raise InvalidInput(
                "a local pose beside a pose or a footprint, which are in the map frame",
                "Give one of them.",
                "local_pose",
            )
        if band is not None and footprint is None and body is None:
            raise InvalidInput("heights of nothing", "Give a footprint or a mesh.", "height_m")
        pose = IDENTITY if self.pose is None else normalised(self.pose.pose())
        if body is None and footprint is not None and band is not None:
            prism = extrude(footprint, band.z_min_m, band.z_max_m)
            body = prism if pose == IDENTITY else transform_mesh(inverse(pose.matrix()), prism)
        return Item(
            uid=self.uid or uuid4(),
            name=self.name,
            concept=self.concept,
            alias=self.alias,
            storey=self.storey,
            pose=pose,
            body=body,
            footprint=footprint,
            band=band,
            joins=tuple(self.joins),
            attributes=self.attributes,
        )


class InstanceChanges(Request):
    """The changes; omitted members stay unchanged."""

    name: Name | None = None
    alias: Name | None = Field(None, description="null removes it.")
    concept: Name | None = None
    attributes: Attributes | None = Field(None, description="Replaces all attributes.")
    description: Name | None = Field(
        None, description="The blueprint that it looks like from now on; null: like nothing."
    )
    frame: Name | None = Field(None, description="The frame that carries it from now on.")
    keep: Keep = Field(
        "world", description="Kept by a change of `frame`: its place in the world, or its local pose."
    )
    pose: PoseDocument | None = Field(None, description="Moves it in the map frame, with what stands on it.")
    local_pose: LocalPose | None = None
    storey: Name | None = Field(None, description="The storey that it is on; null: none. It does not move.")
    joins: list[Name] | None = Field(
        None, max_length=100, description="Names of all rooms that a door joins."
    )
    footprint: AreaDocument | None = None
    elevation_m: Elevation = None
    height_m: Annotated[
        float | None, Field(gt=0, description="null: the heights of the mesh, or every height without one.")
    ] = None

    @model_validator(mode="after")
    def _some_are_never_null(self) -> InstanceChanges:
        for name in NEVER_NULL:
            if name in self.model_fields_set and getattr(self, name) is None:
                raise ValueError(f"{name} cannot be null; leave it out to keep it")
        if self.pose is not None and self.local_pose is not None:
            raise ValueError("give pose or local_pose, not both")
        return self

    def changes(self) -> Changes:
        """raises InvalidInput for an elevation without a height"""
        is_banded = bool({"elevation_m", "height_m"} & self.model_fields_set)
        return Changes(
            name=self.name,
            alias=self.alias if "alias" in self.model_fields_set else KEEP,
            concept=self.concept,
            attributes=self.attributes,
            pose=None if self.pose is None else self.pose.pose(),
            footprint=None if self.footprint is None else area_of(self.footprint),
            band=band_of(self.elevation_m, self.height_m) if is_banded else KEEP,
        )


def detail(found: InstanceDetail, crs: str | None = None) -> InstanceDocument:
    """crs  the system in which the footprint is given; None: the map frame"""
    return InstanceDocument(
        **dict(InstanceSummary.model_validate(found.instance)),
        pose=None if found.pose is None else PoseDocument.model_validate(found.pose),
        frame=FrameReference(id=found.frame_id, name=found.frame, parent=found.parent),
        description=None
        if found.description_id is None
        else DescriptionReference(id=found.description_id, name=found.description),
        crs=crs,
        footprint=None if found.footprint is None else area_document(found.footprint),
        band=None if found.band is None else BandDocument.model_validate(found.band),
        body_band=None if found.body_band is None else BandDocument.model_validate(found.body_band),
        joins=[Neighbour(id=id_, name=name) for id_, name in found.joins.items()],
        has_body=found.has_body,
        attributes=dict(found.attributes),
        created_at=found.created_at,
        updated_at=found.updated_at,
    )


def past_summary(map_name: str, found: PastInstance) -> InstanceSummary:
    return InstanceSummary(**_past_fields(map_name, found))


def past_detail(map_name: str, found: PastInstance, as_of: datetime) -> PastInstanceDocument:
    return PastInstanceDocument(
        **_past_fields(map_name, found),
        as_of=as_of,
        pose=None if found.pose is None else PoseDocument.model_validate(found.pose),
        footprint=None if found.footprint is None else area_document(found.footprint),
        band=None if found.band is None else BandDocument.model_validate(found.band),
        attributes=dict(found.attributes),
    )


def _past_fields(map_name: str, found: PastInstance) -> dict[str, Any]:
    return {
        "id": found.instance_id,
        "uid": found.uid,
        "map": map_name,
        "name": found.name,
        "alias": found.alias,
        "concept": found.concept,
        "storey": found.storey,
    }
