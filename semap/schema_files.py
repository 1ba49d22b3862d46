"""The files of the schema: `sql/` and `migrations/`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from semap.errors import DatabaseError


def schema_folder(name: str) -> Path:
    """Where `sql`, `migrations` or a folder of it lies: in the installed package or the checkout."""
    package = Path(__file__).parent
    for folder in (package / "schema" / name, package.parent / name):
        if folder.is_dir():
            return folder
    raise DatabaseError(f"The folder {name}/ is missing.", "Install semap again.")


def sql_files(folder: str) -> list[Path]:
    """The SQL of a folder and of those in it, in the order of their names, which is that in which it runs."""
    root = schema_folder(folder)
    return sorted(root.rglob("*.sql"), key=lambda file: file.relative_to(root).as_posix())


def migration_texts() -> Iterator[str]:
    """The SQL of all migrations in their order: of versions/0001_baseline.py that of the folder baseline/."""
    for version in sorted(schema_folder("migrations").glob("versions/[0-9]*.py")):
        for file in sql_files(f"migrations/{version.stem[5:]}"):
            yield file.read_text()
