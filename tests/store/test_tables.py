"""The tables that Python knows are those of a migrated database."""

from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import Engine
from sqlalchemy.dialects.postgresql.base import ischema_names

from semap.store.tables import METADATA, PgLsn, RegRole

NOT_DECLARED = ("schema_version", "line_observation_", "track_state_inbox", "state_chunk_default")


def test_tables_are_those_of_the_migrations(engine: Engine, monkeypatch) -> None:
    monkeypatch.setitem(ischema_names, "pg_lsn", PgLsn)
    monkeypatch.setitem(ischema_names, "regrole", RegRole)

    def include_name(name: str | None, kind: str, parents: dict) -> bool:
        if kind == "schema":
            return name == "semap"
        return not (kind == "table" and name is not None and name.startswith(NOT_DECLARED))

    def include_object(item: object, name: str | None, kind: str, *_: object) -> bool:
        return kind != "index"

    with engine.connect() as connection:
        context = MigrationContext.configure(
            connection,
            opts={"include_schemas": True, "include_name": include_name, "include_object": include_object},
        )
        differences = compare_metadata(context, METADATA)
    assert [each for each in differences if not _is_comment(each)] == []


def _is_comment(difference: object) -> bool:
    if isinstance(difference, tuple):
        return difference[0] == "remove_table_comment"
    return isinstance(difference, list) and all(each[0] == "modify_comment" for each in difference)
