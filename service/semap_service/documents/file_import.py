"""What an import says of itself: of a map, a building, or many instances."""

from __future__ import annotations

from pydantic import Field

from semap.store.building import ImportReport
from semap_service.documents.document import Document
from semap_service.documents.geometry import FindingDocument


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


class InstanceImportDocument(Document):
    """What an import brought into a map."""

    map: str = Field(examples=["office"])
    concepts: dict[str, int] = Field(
        description="How many instances of each concept.", examples=[{"Desk": 120}]
    )
    findings: list[FindingDocument] = Field(description="What had to be changed or left out.")


def import_document(report: ImportReport) -> ImportDocument:
    return ImportDocument(
        map=report.map,
        concepts=dict(report.concepts),
        doors=[DoorCount(rooms=rooms, doors=doors) for rooms, doors in report.doors.items()],
        findings=[FindingDocument.model_validate(each) for each in report.findings],
    )
