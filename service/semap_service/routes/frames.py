"""/frames, /maps/{name}/frames and /maps/{name}/transform"""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Response
from pydantic import Field, model_validator
from sqlalchemy import Connection

from semap.store import frames
from semap.store.placement import ROOT_FRAME
from semap_service.database.transaction import Database, Edit, Write, transaction
from semap_service.documents.document import (
    After,
    Document,
    Id,
    InStamp,
    Limit,
    Name,
    Next,
    PoseDocument,
    Request,
    Stamp,
    next_after,
    stored,
)
from semap_service.http.etag import TaggedRoute, edits, reads
from semap_service.http.problem import problems

router = APIRouter(tags=["frames"], route_class=TaggedRoute)

ParentPose = Annotated[PoseDocument, Field(description="parent_T_frame: maps points of it to its parent.")]
At = Annotated[InStamp | None, Query(description="At this time (RFC 3339). [default: now]")]


class FrameDocument(Document):
    """A frame and where it stands now."""

    id: int = stored("frame_id")
    map: str = Field(examples=["office"])
    name: str = Field(examples=["Table1"])
    parent: str | None = Field(description="null: it is a root.", examples=["map"])
    pose: ParentPose | None = Field(description="parent_T_frame; null: it had no pose yet.")
    is_static: bool = Field(description="Whether it has no stamped poses.")


class FrameList(Document):
    frames: list[FrameDocument] = Field(description="In the order of their ids.")
    next: Next


class NewFrame(Request):
    """A frame to be made."""

    name: Name = Field(examples=["dock"])
    parent: Name | None = Field(ROOT_FRAME, description="null: a root of its own.")
    pose: ParentPose = PoseDocument()


class FrameChanges(Request):
    """The changes; omitted members stay unchanged."""

    name: Name | None = None
    parent: Name | None = Field(None, description="The frame to put it below; null makes it a root.")
    keep: frames.Keep = Field(
        "world", description="Kept by a change of parent: its place in the world, or its local pose."
    )
    pose: ParentPose | None = Field(None, description="Its static pose in its parent, after all else.")

    @model_validator(mode="after")
    def _some_are_never_null(self) -> FrameChanges:
        for name in ("name", "pose"):
            if name in self.model_fields_set and getattr(self, name) is None:
                raise ValueError(f"{name} cannot be null; leave it out to keep it")
        return self


class StampedPoseDocument(Request):
    """Where a frame stood in its parent from a time on."""

    stamp: InStamp | None = Field(
        None, description="From then on; null: from the beginning of time, as a static pose."
    )
    pose: ParentPose


class StampedPoseList(Document):
    poses: list[StampedPoseDocument] = Field(description="By stamp; between two it is interpolated.")
    next: Stamp | None = Field(description="`after` of the next page; null where this is the last one.")


class TransformDocument(Document):
    """target_T_source: maps points of the source frame to the target frame."""

    target: str = Field(examples=["map"])
    source: str = Field(examples=["Table1"])
    at: Stamp | None = Field(description="null: now.")
    pose: PoseDocument


@router.get("/maps/{name}/frames", operation_id="list_frames", responses=reads(404))
def list_frames(database: Database, name: str, limit: Limit = 100, after: After = 0) -> FrameList:
    """The frames of a map: its root `map`, those of storeys and instances, and others."""
    with transaction(database) as connection:
        found = frames.list_frames(connection, name, after=after, limit=limit)
    return FrameList(
        frames=[FrameDocument.model_validate(each) for each in found],
        next=next_after([each.frame_id for each in found], limit),
    )


@router.post(
    "/maps/{name}/frames", operation_id="create_frame", status_code=201, responses=problems(404, 409)
)
def create_frame(write: Write, name: str, new: NewFrame, response: Response) -> FrameDocument:
    """Make a frame below another one, or a root of its own."""
    with write.begin() as connection:
        made = frames.create_frame(connection, name, new.name, new.parent, new.pose.pose())
    response.headers["Location"] = f"/frames/{made.frame_id}"
    return FrameDocument.model_validate(made)


@router.get("/maps/{name}/transform", operation_id="get_transform", responses=reads(404))
def get_transform(
    database: Database,
    name: str,
    target: Annotated[Name, Query(description="Name of the frame of the result.")],
    source: Annotated[Name, Query(description="Name of the frame in which they are given.")],
    at: At = None,
) -> TransformDocument:
    """Where one frame stands in another, now or at a past time; never extrapolated before the first pose."""
    with transaction(database) as connection:
        target_id = frames.frame_named(connection, name, target).frame_id
        source_id = frames.frame_named(connection, name, source).frame_id
        pose = frames.transform(connection, target_id, source_id, at)
    return TransformDocument(target=target, source=source, at=at, pose=PoseDocument.model_validate(pose))


@router.get("/frames/{id}", operation_id="get_frame", responses=reads(404))
def get_frame(database: Database, id: Id) -> FrameDocument:  # noqa: A002
    """A frame and where it stands now."""
    with transaction(database) as connection:
        return _read(connection, id)


@router.patch("/frames/{id}", operation_id="change_frame", responses=edits(404, 409))
def change_frame(edit: Edit, id: Id, changes: FrameChanges) -> FrameDocument:  # noqa: A002
    """Rename a frame, put it below another one, or move it. Its child frames and instances move with it."""
    with edit.begin(lambda connection: _read(connection, id)) as connection:
        if changes.name is not None:
            frames.rename_frame(connection, id, changes.name)
        if "parent" in changes.model_fields_set:
            frames.change_frame(connection, id, changes.parent, changes.keep)
        if changes.pose is not None:
            frames.set_pose(connection, id, changes.pose.pose())
        return _read(connection, id)


@router.delete("/frames/{id}", operation_id="delete_frame", status_code=204, responses=edits(404, 409))
def delete_frame(edit: Edit, id: Id) -> None:  # noqa: A002
    """Delete a frame on which nothing stands."""
    with edit.begin(lambda connection: _read(connection, id)) as connection:
        frames.delete_frame(connection, id)


@router.get("/frames/{id}/poses", operation_id="list_poses", responses=reads(404))
def list_poses(
    database: Database,
    id: Id,  # noqa: A002
    limit: Limit = 100,
    after: Annotated[InStamp | None, Query(description="Go on after this stamp.")] = None,
) -> StampedPoseList:
    """Where a frame was when, and its static pose if it has one."""
    with transaction(database) as connection:
        found = frames.list_poses(connection, id, after=after, limit=limit)
    return StampedPoseList(
        poses=[
            StampedPoseDocument(stamp=stamp, pose=PoseDocument.model_validate(pose)) for stamp, pose in found
        ],
        next=found[-1][0] if len(found) == limit else None,
    )


@router.post("/frames/{id}/poses", operation_id="set_pose", status_code=201, responses=problems(404, 409))
def set_pose(write: Write, id: Id, new: StampedPoseDocument) -> StampedPoseDocument:  # noqa: A002
    """Say where a frame stands in its parent from a time on; a pose of the same stamp is replaced."""
    with write.begin() as connection:
        frames.set_pose(connection, id, new.pose.pose(), new.stamp)
    return new


def _read(connection: Connection, frame_id: int) -> FrameDocument:
    return FrameDocument.model_validate(frames.get_frame(connection, frame_id))
