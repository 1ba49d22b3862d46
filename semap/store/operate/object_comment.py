"""The comments of what the files of sql/ create: of each object, the sentences right above its `create`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

NOTE = r"--[^\n]*+|/\*(?s:.*?)\*/"
QUOTED = (
    r"""[eE]'(?:[^'\\]|\\(?s:.)|'')*+'|'(?:[^']|'')*+'|"(?:[^"]|"")*+"|"""
    r"""\$(?P<tag>(?!\d)\w*)\$(?s:.*?)\$(?P=tag)\$"""
)
WORD = r"\w[\w$]*+"
STATEMENT = re.compile(rf"""(?:{NOTE}|{QUOTED}|{WORD}|[^;\w'"$/-]++|[^;])++;?""")
TOKEN = re.compile(rf"(?P<note>{NOTE})|{QUOTED}|{WORD}|\S")
SENTENCES = re.compile(r"(?:(?:\A|\n)--[^\n]*)+\n\Z")

NAME = r'(?:\w+|"(?:[^"]|"")*")(?:\.(?:\w+|"(?:[^"]|"")*"))?'
CREATE = re.compile(
    rf"(?:\s|{NOTE})*+(?P<create>create)\s+(?:or\s+replace\s+)?(?:constraint\s+)?"
    r"(?P<kind>aggregate|domain|function|procedure|schema|trigger|type|view)\s+(?:if\s+not\s+exists\s+)?"
    rf"(?P<name>{NAME})\s*\(?",
    re.I,
)
ON_TABLE = re.compile(rf".*?\bon\s+({NAME})", re.I | re.S)


@dataclass(frozen=True)
class ObjectComment:
    """What is said of an object."""

    kind: str
    name: str
    target: str
    """As `comment on` names it: with the types of its parameters, or with the table of a trigger."""
    text: str


def comments_in(sql: str) -> Iterator[ObjectComment]:
    """What is said of what these statements create, in their order.

    A blank line parts a remark from what follows, and one behind the end of a statement belongs to that.
    """
    ended = 0
    for statement in STATEMENT.finditer(sql):
        created = CREATE.match(sql, statement.start())
        if created is not None:
            sentences = SENTENCES.search(sql, ended, created.start("create"))
            if sentences is not None:
                lines = (line.removeprefix("--").strip() for line in sentences[0].split("\n"))
                yield ObjectComment(
                    created["kind"].lower(), created["name"], _target(sql, created), " ".join(lines).strip()
                )
        ended = statement.end() - 1


def comment_statements(sql: str) -> str:
    """The statements that say of all that these statements create what is said of it."""
    return "".join(
        "comment on {} is '{}';\n".format(each.target, each.text.replace("'", "''"))
        for each in comments_in(sql)
    )


def _target(sql: str, created: re.Match[str]) -> str:
    """What these statements create here, as `comment on` names it."""
    kind = created["kind"].lower()
    target = f"{kind} {created['name']}"
    if kind in ("aggregate", "function", "procedure"):
        return f"{target}({_parameters(sql, created.end())})"
    table = ON_TABLE.match(sql, created.end()) if kind == "trigger" else None
    return target if table is None else f"{target} on {table[1]}"


def _parameters(sql: str, begin: int) -> str:
    """The parameters of a routine from behind its parenthesis on, without their defaults."""
    kept: list[str] = []
    depth, in_default = 1, False
    for token in TOKEN.finditer(sql, begin):
        depth += (token[0] in "([") - (token[0] in ")]")
        if depth == 0:
            break
        if depth == 1 and token[0] == ",":
            in_default = False
        elif depth == 1 and token[0].lower() in ("default", "="):
            in_default = True
        if not in_default and token["note"] is None:
            kept.append(token[0])
    return " ".join(kept)
