"""Files of many instances for a map that exists.

`.ndjson` (or `.jsonl`) has on each line what `POST /maps/{name}/instances` takes as its `document`; it is
read as it is written, so that it may be as large as it likes. What a line names (a storey, the rooms of a
door) stands on a line before, or is on the map already. `.geojson` is a floor plan, as for a building.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError
from sqlalchemy import Connection

from semap.errors import Conflict, InvalidInput, SemapError, TooLarge
from semap.formats import read_building
from semap.formats.source import refuse_utf16
from semap.store.building import import_building
from semap.store.instance_batch import NewInstance, create_instances
from semap.store.maps import map_id_of
from semap_service.documents.file_import import InstanceImportDocument
from semap_service.documents.geometry import FindingDocument
from semap_service.documents.instance import NewInstance as NewInstanceDocument
from semap_service.documents.json_values import require_few_values

LINES = (".ndjson", ".jsonl")
FLOOR_PLANS = (".geojson", ".json")
LONGEST_LINE = 4 * 1024**2
BATCH = 1000
BATCH_BYTES = 4 * 1024**2

Progress = Callable[[float, str], None]


@dataclass(frozen=True, eq=False)
class Line:
    """A line of a file, counted from 1; `end` is where the next begins [bytes]."""

    number: int
    end: int
    new: NewInstance


def write_instances(
    connection: Connection, map_name: str, path: Path, file: str, say: Progress
) -> InstanceImportDocument:
    """Bring all instances of a file into a map.

    file    names it in errors
    raises  NotFound if there is no such map; Conflict, InvalidInput with the line
    """
    map_id = map_id_of(connection, map_name)
    suffix = path.suffix.lower()
    if suffix in FLOOR_PLANS:
        return _floor_plan(connection, map_name, path, file, say)
    if suffix not in LINES:
        raise InvalidInput(
            f"{suffix or 'a file without suffix'} is no format of instances",
            "Give .ndjson, one instance on each line, or .geojson.",
            file,
        )
    concepts: Counter[str] = Counter()
    size = max(path.stat().st_size, 1)
    for batch in _batches(_lines(path, file)):
        try:
            create_instances(connection, map_id, [each.new for each in batch])
        except (Conflict, InvalidInput) as error:
            raise _placed(error, f"{file}, lines {batch[0].number} to {batch[-1].number}") from error
        concepts.update(each.new.item.concept for each in batch)
        say(0.95 * batch[-1].end / size, f"{concepts.total()} instances written")
    if not concepts:
        raise InvalidInput("there is no instance in it", "Give one on each line.", file)
    return InstanceImportDocument(map=map_name, concepts=dict(sorted(concepts.items())), findings=[])


def _floor_plan(
    connection: Connection, map_name: str, path: Path, file: str, say: Progress
) -> InstanceImportDocument:
    say(0, "reading the file")
    try:
        building = read_building(path)
    except InvalidInput as error:
        raise InvalidInput(str(error).replace(str(path), file), error.remedy) from error
    report = import_building(
        connection,
        map_name,
        building,
        lambda done, total: say(0.4 + 0.4 * done / total, f"{done} of {total} objects shaped"),
    )
    return InstanceImportDocument(
        map=map_name,
        concepts=dict(report.concepts),
        findings=[FindingDocument.model_validate(each) for each in report.findings],
    )


def _batches(lines: Iterable[Line]) -> Iterator[list[Line]]:
    """As many lines as one statement takes well."""
    batch: list[Line] = []
    begin = 0
    for line in lines:
        batch.append(line)
        if len(batch) == BATCH or line.end - begin > BATCH_BYTES:
            yield batch
            batch, begin = [], line.end
    if batch:
        yield batch


def _lines(path: Path, file: str) -> Iterator[Line]:
    """Those that say something."""
    end = 0
    with path.open("rb") as opened:
        number = 0
        while line := opened.readline(LONGEST_LINE + 1):
            number += 1
            end += len(line)
            where = f"{file}, line {number}"
            if number == 1:
                refuse_utf16(line, file)
            if len(line) > LONGEST_LINE:
                raise InvalidInput(
                    f"it is longer than {LONGEST_LINE} bytes",
                    "Put each instance on a line of its own.",
                    where,
                )
            if line.strip():
                yield Line(number, end, _instance(line, where))


def _instance(line: bytes, where: str) -> NewInstance:
    try:
        require_few_values(line)
        document = NewInstanceDocument.model_validate_json(line)
        item = document.item(None)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(str(part) for part in first["loc"])
        raise InvalidInput(
            f"{place}: {first['msg']}" if place else first["msg"], "Correct this line.", where
        ) from error
    except (InvalidInput, TooLarge) as error:
        raise InvalidInput(str(error), error.remedy, where) from error
    local = document.local_pose
    return NewInstance(item, document.description, document.frame, None if local is None else local.pose())


def _placed(error: SemapError, where: str) -> SemapError:
    """The same error, with the place in the file."""
    if isinstance(error, InvalidInput):
        return InvalidInput(str(error), error.remedy, where)
    return Conflict(f"{where}: {error}", error.remedy)
