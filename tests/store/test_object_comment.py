"""What the database says of an object is what stands above it in its file."""

from __future__ import annotations

from itertools import takewhile
from pathlib import Path

import pytest

from semap.schema_files import sql_files
from semap.store.database.connection import connect
from semap.store.operate.object_comment import comment_statements, comments_in

HOSTILE = r"""-- The file's own remark; it says nothing of a type.

create type semap.pair_of as (a integer, b text);
-- A "range"; it's 100 % {safe} \ and :x.
create domain semap.share as double precision check (value between 0 and 1);

-- Not this one: a blank line follows.

-- create function semap.never() -- is not a statement
-- The first of two lines,
--   the second one.
Create  OR REPLACE
function semap.first(
  -- what it takes; and why
  p_a integer default 3, p_b text = ')(,;''', p_c numeric(10, 2)[] default array[1, 2]::numeric[], /* ; ( */
  p_d double precision default (1 + (2)), inout p_e text default $x$a);$x$, variadic p_f integer[] default '{}'
) language plpgsql as $body$
-- Not this one either.
-- create function semap.inner();
begin
  p_e := E'\';' || $$ ; -- $$ || "p_e"; -- Nor this one.
end $body$; -- A remark behind the end says nothing of the next.
create function semap.second() returns text language sql as 'select ''-- ;''::text';
-- The other one of its name.
create function semap.second(a$b text) returns text
language sql as $$ select $1 $$;
-- All of them.
create aggregate semap.all_of(integer) (sfunc = int4pl, stype = integer);
-- Waits.
create procedure semap.waits(p_s double precision) language sql as '';
-- Looks at "both".
create view semap."Two; words" with (security_invoker = true) as select ';' as "a;";
-- Refuses.
create constraint trigger refuses after insert or update of name on semap.map
  deferrable for each row execute function semap.frame_checked();
-- A room.
create schema if not exists room"""

SAID = {
    ("share", 'A "range"; it\'s 100 % {safe} \\ and :x.'),
    ("first", "create function semap.never() -- is not a statement The first of two lines, the second one."),
    ("second", None),
    ("second", "The other one of its name."),
    ("pair_of", None),
    ("all_of", "All of them."),
    ("waits", "Waits."),
    ("Two; words", 'Looks at "both".'),
    ("refuses", "Refuses."),
    ("room", "A room."),
}


@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_only_sentences_right_above_an_object_are_its_comment(database: str, ends: str) -> None:
    sql = HOSTILE.replace("\n", ends)
    with connect(database) as connection:
        connection.execute(f"{sql};{comment_statements(sql)}".encode())
        said = connection.execute(
            "select proname::text, obj_description(oid, 'pg_proc') from pg_proc"
            " where proname in ('first', 'second', 'all_of', 'waits') and pronamespace = 'semap'::regnamespace"
            " union all select typname::text, obj_description(oid, 'pg_type') from pg_type"
            " where typname in ('pair_of', 'share')"
            " union all select relname::text, obj_description(oid, 'pg_class') from pg_class"
            " where relname = 'Two; words'"
            " union all select tgname::text, obj_description(oid, 'pg_trigger') from pg_trigger"
            " where tgname = 'refuses'"
            " union all select nspname::text, obj_description(oid, 'pg_namespace') from pg_namespace"
            " where nspname = 'room'"
        ).fetchall()
    assert len(said) == len(SAID)
    assert set(said) == SAID


CREATED = {
    "CreateFunctionStmt": lambda made: made.funcname[-1].sval,
    "CreateSchemaStmt": lambda made: made.schemaname,
    "CreateTrigStmt": lambda made: made.trigname,
    "DefineStmt": lambda made: made.defnames[-1].sval,
    "ViewStmt": lambda made: made.view.relname,
}


@pytest.mark.parametrize("file", sql_files("sql"), ids=lambda file: file.stem)
def test_files_are_read_as_postgresql_reads_them(file: Path) -> None:
    pglast = pytest.importorskip("pglast")
    sql = file.read_text()
    expected = []
    for each in pglast.parse_sql(sql):
        name = CREATED.get(type(each.stmt).__name__)
        before = sql.encode()[: each.stmt_location].decode().count("\n")
        lines = sql.split("\n")
        if name is not None:
            begin = next(n for n in range(before, len(lines)) if lines[n].startswith("create "))
            above = list(takewhile(lambda line: line.startswith("--"), reversed(lines[:begin])))
            if above:
                expected.append((name(each.stmt), " ".join(line[2:].strip() for line in reversed(above))))
    assert [(each.name.rpartition(".")[2], each.text) for each in comments_in(sql)] == expected
