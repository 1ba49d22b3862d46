"""The reference pages, made of the code whenever the documentation is built (a hook of MkDocs).

Nothing of it is in the repository: what semap does and what its reference says cannot differ.
"""

from __future__ import annotations

import html
import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import typer
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from semap_service.cli import commands
from semap_service.http.problem import STATUS, TYPE
from semap_service.serving.app import create_app

from semap import Client
from semap.rules.language.clauses import SKIPS
from semap.rules.language.reading import ALL_CLAUSES
from semap.rules.language.template import TEMPLATES
from semap.rules.language.words import OF_FORMULAS, OF_PATTERNS
from semap.rules.row import PROPERTIES
from semap.schema_files import sql_files
from semap.store.operate.object_comment import comments_in

CHECKOUT = Path(__file__).parents[2]
MODELS = "ingest/semap_ingest/models"
SIGNATURE = (
    r"create (?:or replace )?(?:function|procedure|aggregate) {name}\s*\((?P<takes>.*?)\)\s*"
    r"(?:returns\s+(?P<gives>.*?))?\s*(?:language|as|strict|\(\s*sfunc)"
)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages to those that were found, and the cards of the models that are shipped."""
    for name, page in PAGES.items():
        files.append(File.generated(config, f"reference/{name}.md", content=page()))
    for card in sorted((CHECKOUT / MODELS).glob("*.md")):
        files.append(File.generated(config, f"models/{card.name}", content=card.read_text()))
    return files


def on_page_markdown(markdown: str, **_: object) -> str:
    """Let links to the cards, which lie outside of the documentation, lead to where they are in the site."""
    markdown = markdown.replace("(../../../docs/", "(../")
    return re.sub(rf"\(\.\./((?:\.\./)*){MODELS}/", r"(\1models/", markdown)


def command_line() -> str:
    """Each command with its arguments and options, as `--help` says it."""
    parts = ["# Command line\n", "Each command says the same with `--help`.\n"]
    root = typer.main.get_command(commands())
    for path, command in _commands("semap", root):
        parts.append(f"{'##' if path.count(' ') < 2 else '###'} {path}\n")
        context = command.context_class(command, info_name=path)
        takes = " ".join(command.collect_usage_pieces(context))
        parts.append(f"    {path} {takes}\n")
        parts.append(f"{_plain(inspect.cleandoc(command.help or ''))}\n")
        rows = [row for row in (_parameter(each, context) for each in command.get_params(context)) if row]
        if rows:
            parts.append("| argument or option | meaning |\n|---|---|\n" + "".join(rows))
    return "\n".join(parts)


def rest() -> str:
    """Each operation of the service by what it is about, and the kinds of problems."""
    described = create_app("").openapi()
    parts = [
        "# REST\n",
        f"{inspect.cleandoc(described['info']['description'])}\n",
        "A running service shows the same at `/docs`, to be tried, and as OpenAPI at `/openapi.json`.\n",
    ]
    by_tag: dict[str, list[str]] = {}
    for path, methods in described["paths"].items():
        for method, operation in methods.items():
            for tag in operation.get("tags", ["other"]):
                by_tag.setdefault(tag, []).append(_operation(method, path, operation))
    for tag, operations in by_tag.items():
        parts.append(f"## {tag.capitalize()}\n")
        parts += operations
    parts.append("## Problems\n")
    parts.append("Errors are problem documents (RFC 9457); `remedy` says what can be done.\n")
    parts.append("| status | type | meaning |\n|---|---|---|\n")
    parts[-1] += "".join(
        f"| {int(status)} | `{TYPE}{kind}` | {_plain((error.__doc__ or '').splitlines()[0])} |\n"
        for error, status, kind in STATUS
    )
    return "\n".join(parts)


def sql() -> str:
    """Each function of the schema by the file in which it stands, with what its comment says."""
    parts = [
        "# SQL functions\n",
        "All are in the schema `semap`, but for the predicates of continuous queries, which are in"
        " `semap_query`. Spatial operators are explained in"
        " [Spatial operators](../operators.md).\n",
    ]
    for file in sql_files("sql"):
        text = file.read_text()
        found = [each for each in comments_in(text) if each.kind in ("function", "procedure", "aggregate")]
        if not found:
            continue
        parts.append(f"## {file.stem.partition('_')[2].replace('_', ' ').capitalize()}\n")
        for each in found:
            parts.append(f"### {each.name.partition('.')[2]}\n")
            signature = _signature(each.name, text)
            if signature:
                parts.append(f"```sql\n{signature}\n```\n")
            parts.append(f"{_plain(each.text)}\n")
    return "\n".join(parts)


def rule_language() -> str:
    """Clauses, words and properties of the rule language, and the ready templates."""
    return "\n".join(
        [
            "# Rule language\n",
            "[Rules](../rules.md) teaches the language; this page lists all its words.\n",
            "## Clauses\n",
            "".join(f"- `{each}`\n" for each in ALL_CLAUSES),
            "## Properties of a row\n",
            "| property | kind |\n|---|---|\n"
            + "".join(f"| `{name}` | {kind} |\n" for name, kind in PROPERTIES.items()),
            "## Words of patterns\n",
            ", ".join(f"`{each}`" for each in sorted(OF_PATTERNS)) + ".\n",
            "## Words of formulas\n",
            ", ".join(f"`{each}`" for each in sorted(OF_FORMULAS)) + ".\n",
            "## After a match\n",
            ", ".join(f"`{each}`" for each in SKIPS) + ".\n",
            "## Templates\n",
            *(_template(name) for name in TEMPLATES),
        ]
    )


def python() -> str:
    """Each operation of the Python client."""
    parts = [
        "# Python client\n",
        "`AsyncClient` has the same operations, to be awaited. How they are used:"
        " [The Python client](../client.md).\n",
        f"## Client\n\n```python\nClient{_call(Client.__init__)}\n```\n\n{_doc(Client)}\n",
    ]
    for name, member in inspect.getmembers_static(Client):
        if name.startswith("_") or name in ("close", "carry_out"):
            continue
        plan: Callable[..., Any] = getattr(member, "plan", member)
        parts.append(f"## {name}\n\n```python\nclient.{name}{_call(plan)}\n```\n\n{_doc(plan)}\n")
    return "\n".join(parts)


PAGES: Mapping[str, Callable[[], str]] = {
    "command-line": command_line,
    "rest": rest,
    "sql": sql,
    "rule-language": rule_language,
    "python": python,
}


def _commands(path: str, command: Any) -> Iterator[tuple[str, Any]]:
    inner = getattr(command, "commands", None)
    if inner is None:
        yield path, command
        return
    for name, each in inner.items():
        yield from _commands(f"{path} {name}", each)


def _parameter(parameter: Any, context: Any) -> str | None:
    record = parameter.get_help_record(context)
    if record is None or "--help" in record[0]:
        return None
    return f"| `{record[0]}` | {_plain(' '.join(record[1].split()))} |\n"


def _operation(method: str, path: str, operation: Mapping[str, Any]) -> str:
    lines = [f"### {method.upper()} {path}\n", f"`{operation['operationId']}`\n"]
    lines.append(f"{_plain(inspect.cleandoc(operation.get('description', '')))}\n")
    rows = [
        f"| `{each['name']}` | {each['in']} | {_plain(' '.join(each.get('description', '').split()))} |\n"
        for each in operation.get("parameters", ())
        if each["in"] != "header"
    ]
    if rows:
        lines.append("| parameter | in | meaning |\n|---|---|---|\n" + "".join(rows))
    answers = ", ".join(str(status) for status in operation["responses"])
    lines.append(f"Answers: {answers}.\n")
    return "\n".join(lines)


def _template(name: str) -> str:
    template = TEMPLATES[name]
    parameters = "".join(f"- `{each.name}`: {each.default}\n" for each in template.parameters)
    return f"### {name}\n\n{template.sentence}\n\n```yaml\n{template.text.strip()}\n```\n\n{parameters}\n"


def _signature(name: str, text: str) -> str | None:
    found = re.search(SIGNATURE.format(name=re.escape(name)), text, re.S)
    if found is None:
        return None
    takes = " ".join(found["takes"].split())
    gives = " ".join((found["gives"] or "").split())
    return f"{name}({takes}){f' returns {gives}' if gives else ''}"


def _call(function: Callable[..., Any]) -> str:
    signature = inspect.signature(function)
    kept = [each for each in signature.parameters.values() if each.name not in ("self", "transport")]
    text = str(signature.replace(parameters=kept))
    return re.sub(r"Plan\[(.*)\]$", r"\1", text.replace("'", "")).replace(") -> None", ")")


def _doc(thing: object) -> str:
    """Paragraphs as they are; what is aligned like a table, too."""
    paragraphs = (inspect.getdoc(thing) or "").split("\n\n")
    return "\n\n".join(
        f"```text\n{each}\n```" if re.search(r"^\w[\w, ]*  +\S", each, re.M) else _plain(each)
        for each in paragraphs
    )


def _plain(text: str) -> str:
    """Text that Markdown does not take for anything else, but for code: in backticks, or indented."""
    return "\n".join(line if line.startswith("    ") else _escaped(line) for line in text.split("\n"))


def _escaped(line: str) -> str:
    pieces = re.split(r"(`[^`]*`)", line)
    return "".join(
        piece if piece.startswith("`") else re.sub(r"([*\[\]|])", r"\\\1", html.escape(piece, quote=False))
        for piece in pieces
    )
