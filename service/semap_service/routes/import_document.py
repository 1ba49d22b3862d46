"""What an import of a map or a building says of itself."""

from __future__ import annotations

from pydantic import Field

from semap.store.building import ImportReport
from semap_service.document import Document
from semap_service.mesh_upload import FindingDocument


class DoorCount(Document):
    rooms: int = Field(description="How many rooms they join.")
    doors: int


class ImportDocument(Document):
    """The result of an import, with repairs and omissions."""

    map: str = Field(examples=["office"])
    concepts: dict[str, int] = Field(
        description="How many instances of each concept.", examples=[{"Room": 6}]
    )
    doors: list[DoorCount]
    findings: list[FindingDocument]


def import_document(report: ImportReport) -> ImportDocument:
    return ImportDocument(
        map=report.map,
        concepts=dict(report.concepts),
        doors=[DoorCount(rooms=rooms, doors=doors) for rooms, doors in report.doors.items()],
        findings=[FindingDocument.model_validate(each) for each in report.findings],
    )
