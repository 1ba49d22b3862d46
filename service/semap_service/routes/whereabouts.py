"""/instances/{id}/where and /instances/{id}/relations"""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Query
from pydantic import Field

from semap.store import whereabouts
from semap_service.database.transaction import Database, transaction
from semap_service.documents.document import Document, Id, InStamp, Limit, PoseDocument, Stamp
from semap_service.http.problem import problems

router = APIRouter(tags=["instances"])

Relation = Literal["in", "contains", "on", "carries", "joins", "intersects", "near"]


class NamedInstance(Document):
    """An instance."""

    id: int
    name: str = Field(examples=["Room07"])


class CarryingFrameDocument(Document):
    """A frame on the way to the root of the tree."""

    id: int
    name: str = Field(examples=["first floor"])
    pose: PoseDocument | None = Field(description="In the next one; null where it was nowhere then.")


class WhereDocument(Document):
    """Where an instance was."""

    instance: NamedInstance
    map: str = Field(examples=["office"])
    at: Stamp | None = Field(description="null: now.")
    pose: PoseDocument | None = Field(
        description="In the map frame; null: its frame hangs under another root, or was nowhere then."
    )
    rooms: list[NamedInstance] = Field(description="Those that contain it, the smallest first.")
    frames: list[CarryingFrameDocument] = Field(description="Its own, the one that carries it, and so on.")


class HeldRelationDocument(Document):
    """What holds from this instance to another one."""

    relation: Relation
    instance: NamedInstance
    distance_m: float | None = Field(description="Between footprints; null where one has none.")


class HeldTrackDocument(Document):
    """A track that is in this instance, as a continuous query sees it."""

    track_id: int
    name: str = Field(examples=["person 3"])
    query: str = Field(examples=["track_in_room"])
    since: Stamp


class HeldDocument(Document):
    """What holds between an instance, others, and tracks."""

    instance: NamedInstance
    relations: list[HeldRelationDocument] = Field(description="The nearest first, at most `limit`.")
    tracks: list[HeldTrackDocument] = Field(description="By their ids, at most `limit`.")
    more: bool = Field(description="Whether `limit` left something out.")


@router.get("/instances/{id}/where", operation_id="where_is_instance", responses=problems(404))
def where_is_instance(
    database: Database,
    id: Id,  # noqa: A002
    at: Annotated[InStamp | None, Query(description="At this time (RFC 3339). [default: now]")] = None,
) -> WhereDocument:
    """Where something is, or was: its pose, the rooms that it is in, and the frames that carry it.

    What moves is found by the stamped poses of its frames; the outlines of rooms are as they are now.
    """
    with transaction(database) as connection:
        found = whereabouts.whereabouts(connection, id, at)
    return WhereDocument(
        instance=NamedInstance(id=found.instance_id, name=found.name),
        map=found.map,
        at=at,
        pose=None if found.pose is None else PoseDocument.model_validate(found.pose),
        rooms=[NamedInstance(id=each.instance_id, name=each.name) for each in found.rooms],
        frames=[
            CarryingFrameDocument(
                id=each.frame_id,
                name=each.name,
                pose=None if each.pose is None else PoseDocument.model_validate(each.pose),
            )
            for each in found.frames
        ],
    )


@router.get("/instances/{id}/relations", operation_id="list_relations_of_instance", responses=problems(404))
def list_relations_of_instance(
    database: Database,
    id: Id,  # noqa: A002
    near_m: Annotated[
        float, Query(ge=0, le=100, allow_inf_nan=False, description="Up to which distance others are near.")
    ] = 1,
    limit: Limit = 100,
) -> HeldDocument:
    """Instances that it is in, on, near, that it contains, carries, joins or intersects, and tracks in it.

    Of the thousand instances that are nearest to it. Each operator by itself, over all: /operators.
    """
    with transaction(database) as connection:
        place = whereabouts.whereabouts(connection, id)
        held = whereabouts.relations_of(connection, id, near_m=near_m, limit=limit + 1)
        tracks = whereabouts.tracks_in(connection, id, limit + 1)
    return HeldDocument(
        instance=NamedInstance(id=place.instance_id, name=place.name),
        relations=[
            HeldRelationDocument(
                relation=each.relation,  # type: ignore[arg-type]  # the function knows no other
                instance=NamedInstance(id=each.instance_id, name=each.instance),
                distance_m=each.distance_m,
            )
            for each in held[:limit]
        ],
        tracks=[HeldTrackDocument.model_validate(each) for each in tracks[:limit]],
        more=max(len(held), len(tracks)) > limit,
    )
