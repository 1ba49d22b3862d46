"""The tables of the schema, for statements of Python: `from semap.store.database.tables import map_, track`.

They are read from `create table` and `alter table` in the SQL of the migrations, which is laid out for it: a
column on a line, two spaces in. A test compares them with a migrated database. Statements need names and
types; keys, checks and defaults are the database's.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from geoalchemy2 import Geometry
from sqlalchemy import (
    ARRAY,
    REAL,
    BigInteger,
    Boolean,
    Column,
    ColumnElement,
    Double,
    Integer,
    LargeBinary,
    MetaData,
    SmallInteger,
    Table,
    Text,
    Uuid,
    any_,
    literal,
)
from sqlalchemy.dialects.postgresql import ENUM, INTERVAL, JSONB, TIMESTAMP
from sqlalchemy.types import NULLTYPE, TypeEngine

from semap.schema_files import migration_texts

STAMP = TIMESTAMP(timezone=True)
POSE = ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")

_TYPES: dict[str, TypeEngine[Any]] = {
    "bigint": BigInteger(),
    "boolean": Boolean(),
    "bytea": LargeBinary(),
    "double precision": Double(),
    "integer": Integer(),
    "interval": INTERVAL(),
    "jsonb": JSONB(none_as_null=True),
    "public.geometry": Geometry("GEOMETRY", srid=-1, spatial_index=False),
    "real": REAL(),
    "smallint": SmallInteger(),
    "text": Text(),
    "timestamptz": STAMP,
    "uuid": Uuid(),
}
_ENUM = re.compile(r"^create type semap\.(\w+) as enum \(([^)]*)\)", re.MULTILINE)
_STATEMENT = re.compile(r"^(create|alter|drop) table semap\.(\w+)(.*?);$", re.MULTILINE | re.DOTALL)
_TYPE = r"(double precision|[\w.]+)(\[\])?"
_COLUMN = re.compile(rf"^  (?!(?:constraint|check|unique|primary)\b)(\w+) +{_TYPE}", re.MULTILINE)
_ADDED = re.compile(rf"\badd column (\w+) +{_TYPE}")
_DROPPED = re.compile(r"\bdrop column (\w+)")


def read_tables(sql: str) -> dict[str, Table]:
    """The tables that migrations leave, by name, without the schema's."""
    types = _TYPES | {
        f"semap.{name}": ENUM(*re.findall(r"'(\w+)'", labels), name=name, schema="semap", create_type=False)
        for name, labels in _ENUM.findall(sql)
    }
    columns: dict[str, dict[str, TypeEngine[Any]]] = {}
    for verb, table, body in _STATEMENT.findall(sql):
        if verb == "drop":
            del columns[table]
            continue
        known = columns.setdefault(table, {})
        for name in _DROPPED.findall(body):
            del known[name]
        for name, type_, is_array in (_COLUMN if verb == "create" else _ADDED).findall(body):
            of = types.get(type_, NULLTYPE)
            known[name] = ARRAY(of) if is_array else of
    metadata = MetaData(schema="semap")
    return {
        table: Table(table, metadata, *(Column(name, type_) for name, type_ in known.items()))
        for table, known in columns.items()
        if known  # a partition has those of its table
    }


TABLES = read_tables("\n".join(migration_texts()))

track_place = Table(
    "track_place",
    MetaData(schema="semap"),
    *(
        Column(each.name, each.type)
        for each in TABLES["track_now"].c
        if each.name != "cell_m" and not each.name.startswith(("safe_", "outlier_"))
    ),
)

rule_given_up = Table(
    "rule_given_up",
    MetaData(schema="semap"),
    Column("rule_id", Integer),
    Column("map_id", Integer),
    Column("attempts", BigInteger),
    Column("first", STAMP),
    Column("key", JSONB),
    Column("matches", BigInteger),
)

VIEWS = (track_place, rule_given_up)


def __getattr__(name: str) -> Table:
    """The table of a name; `map_` is `semap.map`."""
    try:
        return TABLES[name.removesuffix("_")]
    except KeyError:
        raise AttributeError(f"The schema has no table {name}.") from None


def one_of(column: Column[Any], values: Iterable[object]) -> ColumnElement[bool]:
    """`column = any (values)`: one parameter, however many values there are."""
    return column == any_(literal(list(values), ARRAY(column.type)))
