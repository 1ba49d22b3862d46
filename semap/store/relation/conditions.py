"""Conditions of continuous queries, compiled once to SQL that triggers ask (sql/104_condition.sql).

What a condition says is passed beside the SQL, which is made of this compiler's words alone. Who keeps it has
the role semap_compile for that moment: triggers run it with the rights of the schema's owner.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass

from sqlalchemy import Connection, Text, cast, false, func, literal_column, select, text
from sqlalchemy.dialects.postgresql import ARRAY, JSONB
from sqlalchemy.dialects.postgresql.base import PGDialect

from semap.cql2 import Call, Expression, Kinds, Shape, check, parse, parts
from semap.cql2.check import SPATIAL
from semap.errors import InvalidInput, NotPermitted
from semap.model.predicate import Kind
from semap.store.database.connection import translated
from semap.store.database.cql2_sql import Sql, Thing, condition

LONGEST = 100_000
ASKED_OF: Mapping[Kind, Kinds] = {
    "track": {"name": "text", "source": "text", "attributes": "any"},
    "instance": {"name": "text", "alias": "text", "attributes": "any"},
}
"""What a condition may ask."""
COLUMNS: Mapping[str, Sql] = {
    "name": literal_column("p_name", Text),
    "alias": literal_column("p_also", Text),
    "source": literal_column("p_also", Text),
    "attributes": literal_column("p_attributes", JSONB),
}
DIALECT = PGDialect(paramstyle="named")  # type: ignore[no-untyped-call]


@dataclass(frozen=True)
class Compiled:
    """A condition as SQL over p_name, p_also, p_attributes and, by their numbers, the texts `p_said`."""

    sql: str
    said: tuple[str, ...]


def compiled(where: Mapping[str, object], kind: Kind, place: str = "where") -> Compiled:
    """raises InvalidInput with the place of what cannot be asked of tracks, or of instances"""
    if len(json.dumps(where, ensure_ascii=False)) > LONGEST:
        raise InvalidInput(f"more than {LONGEST} characters", "Ask for less.", place)
    expression = parse(where, place)
    check(expression, ASKED_OF[kind])
    for part in parts(expression):
        _require_askable(part)
    said: list[str] = []

    def value(each: str) -> Sql:
        said.append(each)
        return literal_column(f"p_said[{len(said)}]", Text)

    made = condition(expression, Thing(ASKED_OF[kind], COLUMNS, lambda _: false(), value))
    return Compiled(str(made.compile(dialect=DIALECT, compile_kwargs={"literal_binds": True})), tuple(said))


def keep_condition(
    connection: Connection, map_id: int, kind: Kind, where: Mapping[str, object], place: str = "where"
) -> None:
    """Compile a condition that queries of a map may then have.

    raises  InvalidInput as `compiled`, NotPermitted where the login is no member of semap_compile
    """
    made = compiled(where, kind, place)
    keep = func.semap.keep_condition(
        map_id, kind, cast(dict(where), JSONB), made.sql, cast(list(made.said), ARRAY(Text))
    )
    with translated():
        role = connection.scalar(text("select current_setting('role')"))
    try:
        with translated():
            connection.execute(text("set local role semap_compile"))
    except NotPermitted as error:
        raise NotPermitted(
            "This login may not say what SQL a condition is.",
            "Ask for the query by the service, or by semap.create_continuous_query(name, sql). Whoever may do"
            " all that the schema's owner may can have it: grant semap_compile to LOGIN;",
        ) from error
    with translated():
        connection.execute(select(keep))
        connection.execute(select(func.set_config("role", role, True)))


def compile_again(connection: Connection) -> None:
    """Compile all conditions that are kept, as this version does."""
    kept = text("select map_id, kind, condition, condition_id from semap.condition order by condition_id")
    for map_id, kind, where, condition_id in connection.execute(kept).all():
        keep_condition(connection, map_id, kind, where, f"condition {condition_id}")


def _require_askable(part: Expression) -> None:
    match part:
        case Call(op=op, place=place) if op == "isA" or op in SPATIAL:
            found = op
        case Shape(place=place):
            found = "a shape"
        case _:
            return
    raise InvalidInput(
        f"a condition cannot ask for {found}",
        "Say shapes by the predicate of the query, and a concept by its side.",
        place,
    )
