"""The documents of geometries, which a description consists of: as given out, to be made, and as uploaded."""

from __future__ import annotations

from pydantic import Field

from semap.errors import InvalidInput
from semap.model.building import HeightBand
from semap.model.source_geometry import GeometryType, SourceGeometry
from semap_service.documents.document import BandDocument, Document, PoseDocument, Request
from semap_service.documents.shape import ShapeDocument, shape_document, shape_of


class FindingDocument(Document):
    """What was done to what, and why."""

    action: str = Field(description="repaired, skipped or note", examples=["repaired"])
    subject: str
    reason: str


class GeometryDocument(Document):
    """A source geometry of a description."""

    name: str = Field(examples=["Body"])
    type: GeometryType
    pose: PoseDocument = Field(description="description_T_geometry")
    band: BandDocument | None = Field(
        description="Heights of a POLYGON2D in its own frame; null: every height."
    )
    shape: ShapeDocument = Field(description="In its own frame, before the pose.")


class BandRequest(Request):
    """Heights from z_min_m up to, but not including, z_max_m."""

    z_min_m: float
    z_max_m: float


class NewGeometry(Request):
    """A source geometry. The orientation of POSE2D and POSE3D is that of `pose`; their shape is a point."""

    type: GeometryType
    shape: ShapeDocument
    pose: PoseDocument = Field(PoseDocument(), description="description_T_geometry")
    band: BandRequest | None = Field(None, description="Heights over which a POLYGON2D holds.")

    def source(self, name: str) -> SourceGeometry:
        """raises InvalidInput if the shape is not of the type, or the heights do not rise"""
        if self.band is not None and self.type != "POLYGON2D":
            raise InvalidInput(f"heights of a {self.type}", "Only a POLYGON2D has heights.", "band")
        if self.band is not None and not self.band.z_min_m < self.band.z_max_m:
            raise InvalidInput("heights that do not rise", "Let z_min_m be below z_max_m.", "band")
        band = None if self.band is None else HeightBand(self.band.z_min_m, self.band.z_max_m)
        return SourceGeometry(name, self.type, shape_of(self.shape, self.type), self.pose.pose(), band)


class UploadedGeometry(Document):
    """What became of an upload, and what was repaired in it."""

    name: str = Field(examples=["Body"])
    faces: int = Field(description="How many triangles it has.")
    findings: list[FindingDocument]


def geometry_document(found: SourceGeometry) -> GeometryDocument:
    return GeometryDocument(
        name=found.name,
        type=found.type,
        pose=PoseDocument.model_validate(found.pose),
        band=None if found.band is None else BandDocument.model_validate(found.band),
        shape=shape_document(found.shape),
    )
