"""The tables that Python knows are those of a migrated database, also after a later migration."""

import shutil
from collections.abc import Iterable
from pathlib import Path

import pytest
from sqlalchemy import Engine, Table, inspect, text
from sqlalchemy.dialects.postgresql import dialect
from sqlalchemy.types import NullType, TypeEngine

from semap import schema_files
from semap.schema_files import migration_texts, schema_folder
from semap.store.database.tables import TABLES, VIEWS, read_tables
from semap.store.operate import schema
from semap.store.operate.schema import FORGET, migrate

SECOND = """
    from alembic import op
    from semap.store.operate.schema import run_files
    revision, down_revision = "0002", "0001"
    def upgrade(): run_files(op.get_bind(), "migrations/floor_colour")
"""
STATEMENTS = """
create table semap.paint (
  paint_id  bigint generated always as identity primary key,
  -- as it was mixed
  parts     real[] not null default '{}' check (
    cardinality(parts) < 5),
  shape     public.geometry,
  check (paint_id > 0)
);
create index paint_parts on semap.paint using gin (parts);
alter table semap.map
  add column paint_id bigint references semap.paint on delete set null,
  add column seen_at timestamptz not null default '-infinity',
  add constraint paint_is_new check (paint_id > 0),
  alter column cell_m drop default;
alter table semap.instance drop column alias;
alter table semap.track add column weight_kg real;
drop table semap.event_amendment;
"""


def described(columns: Iterable[tuple[str, TypeEngine]]) -> dict[str, str]:
    """Each column's type as DDL says it; that of an enumeration with its labels."""
    return {
        name: "not asked about"
        if isinstance(type_, NullType)
        else f"{type_.compile(dialect())} {getattr(type_, 'enums', '')}"
        for name, type_ in columns
    }


def read_from(tables: Iterable[Table]) -> dict[str, dict[str, str]]:
    return {table.name: described((column.name, column.type) for column in table.c) for table in tables}


def held_by(engine: Engine, kind: str) -> dict[str, dict[str, str]]:
    found = text("""
        select relname from pg_class
        where relnamespace = 'semap'::regnamespace and relkind = any (cast(:kind as text)::"char"[])
          and not relispartition and relname <> 'schema_version'
    """)
    with engine.connect() as connection:
        inspector = inspect(connection)
        return {
            name: described(
                (column["name"], column["type"]) for column in inspector.get_columns(name, "semap")
            )
            for name in connection.scalars(found, {"kind": kind})
        }


@pytest.mark.filterwarnings("ignore:Did not recognize type '(pg_lsn|regrole|semap.track_state)'")
def test_tables_and_views_are_those_of_the_database(engine: Engine) -> None:
    assert read_from(TABLES.values()) == held_by(engine, "{r,p}")
    views = held_by(engine, "{v}")
    assert read_from(VIEWS) == {view.name: views[view.name] for view in VIEWS}


@pytest.mark.filterwarnings("ignore:Did not recognize type '(pg_lsn|regrole|semap.track_state)'")
def test_a_later_migration_changes_what_the_first_made(
    database: str, engine: Engine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sql").mkdir()
    shutil.copy(schema_folder("sql") / FORGET, tmp_path / "sql")
    shutil.copytree(schema_folder("migrations"), tmp_path / "migrations")
    (tmp_path / "migrations" / "versions" / "0002_floor_colour.py").write_text(
        "\n".join(line[4:] for line in SECOND.splitlines())
    )
    (tmp_path / "migrations" / "floor_colour").mkdir()
    (tmp_path / "migrations" / "floor_colour" / "010_paint.sql").write_text(STATEMENTS)
    for each in (schema, schema_files):
        monkeypatch.setattr(each, "schema_folder", lambda name: tmp_path / name)
    with engine.begin() as connection:
        connection.execute(text("insert into semap.map (name) values ('office')"))
    migrated = migrate(database, slot=False)
    assert (migrated.version_before, migrated.version) == ("0001", "0002")
    with engine.connect() as connection:
        assert connection.execute(text("select name, paint_id from semap.map")).all() == [("office", None)]
    assert read_from(read_tables("\n".join(migration_texts())).values()) == held_by(engine, "{r,p}")
