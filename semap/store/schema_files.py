"""The files of the schema: `sql/` and `migrations/`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import semap
from semap.errors import DatabaseError


def schema_folder(name: str) -> Path:
    """Where `sql`, `migrations` or a folder of it lies: in the installed package or the checkout."""
    package = Path(semap.__file__).parent
    for folder in (package / "schema" / name, package.parent / name):
        if folder.is_dir():
            return folder
    raise DatabaseError(f"The folder {name}/ is missing.", "Install semap again.")


def migration_texts() -> Iterator[str]:
    """The SQL of all migrations in their order: of versions/0001_baseline.py that of the folder baseline/."""
    for version in sorted(schema_folder("migrations").glob("versions/[0-9]*.py")):
        for file in sorted(schema_folder(f"migrations/{version.stem[5:]}").glob("*.sql")):
            yield file.read_text()
