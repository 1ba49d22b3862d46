"""/maps/{name}/rules/check, /rules/{id}/text: rules as the texts that people write"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated

from fastapi import APIRouter, Query, Response
from pydantic import Field
from sqlalchemy import Connection

from semap.errors import Conflict, InvalidInput, NotFound
from semap.rules.declaration import Declaration as Declared
from semap.rules.language.described import describe
from semap.rules.language.drawn import draw
from semap.rules.language.reading import parse_declaration
from semap.rules.language.recognised import recognise
from semap.rules.language.source_text import LONGEST, SourceText, line_and_column, read_source
from semap.rules.language.written import write_rule
from semap.store.event import rules
from semap.store.event.rules import Rule, RuleVersion
from semap.store.map.maps import get_map
from semap_service.database import rule_edit as rule_editing
from semap_service.database.transaction import Database, transaction
from semap_service.documents.document import LARGEST_SMALL_ID, Document, Request, SmallId
from semap_service.documents.rule import Declaration, RuleLikeness, RulePart
from semap_service.http.problem import problems

router = APIRouter(tags=["rules"])

YAML = "application/yaml"
"""RFC 9512."""


class RuleText(Request):
    """A rule as its author has written it so far."""

    text: str = Field(
        max_length=LONGEST,
        description="YAML or JSON.",
        examples=["name: visits\ninput: track_in_room\nemit: {began: entered}\n"],
    )
    replaces: int | None = Field(
        None,
        ge=1,
        le=LARGEST_SMALL_ID,
        description="The id of the rule that it would replace, whose name it may have.",
    )


class Fault(Document):
    """An error in a text."""

    message: str
    remedy: str
    where: str = Field(description="The clause, and where it stands.", examples=["emit, line 3, column 7"])
    line: int | None = Field(description="From 1; null: it is about the whole.")
    column: int | None = Field(description="From 1.")


class RuleCheck(Document):
    """The declaration of a text, or its first error."""

    name: str | None = Field(description="The name that it gives the rule.", examples=["visits"])
    declaration: Declaration | None = Field(
        description="As POST /rules takes it; null where it is wrong. Where only its name is taken, it can"
        " still be run dry."
    )
    sentence: str | None = Field(description="What it does, in plain words; null where it is wrong.")
    diagram: RulePart | None = Field(description="The same as a drawing; null where it is wrong.")
    like: RuleLikeness | None = Field(description="Which template says it; null where it is wrong.")
    fault: Fault | None = Field(description="null: it could be added as it is.")


@router.post("/maps/{name}/rules/check", operation_id="check_rule", responses=problems(404))
def check_rule(database: Database, name: str, written: RuleText) -> RuleCheck:
    """Check whether a text is a rule that could be added to a map, or return its error with the position.
    Nothing is written. A wrong text is not an error of this request.
    """
    source: SourceText | None = None
    declared: Declared | None = None
    with transaction(database) as connection:
        get_map(connection, name)
        replaced = None if written.replaces is None else _rule_of(connection, name, written.replaces)
        try:
            source = read_source(written.text)
            declared = parse_declaration(source.document, None if replaced is None else replaced.name)
            rule_editing.require_fits(connection, name, declared, replaced)
        except InvalidInput as error:
            return _faulty(error if source is None else source.placed(error), declared)
        except Conflict as error:
            faulty = _faulty(InvalidInput(str(error), error.remedy), declared)
            return faulty if declared is None else _said(declared, faulty.fault)
    return _said(declared, None)


@router.get(
    "/rules/{id}/text",
    operation_id="get_rule_text",
    response_class=Response,
    responses={**problems(404), 200: {"description": "YAML.", "content": {YAML: {}}}},
)
def get_rule_text(
    database: Database,
    id: SmallId,  # noqa: A002
    version: Annotated[
        int | None, Query(ge=1, le=LARGEST_SMALL_ID, description="Of the rule. [default: the last]")
    ] = None,
) -> Response:
    """A rule, or what it once declared, as text to read and edit. Its comments are not kept."""
    with transaction(database) as connection:
        rule = rules.get_rule(connection, id)
        if version is None or version == rule.version:
            name, declaration = rule.name, rule.declaration
        else:
            name, declaration = _declared_once(rules.list_versions(connection, id), version)
    return Response(write_rule(name, declaration), media_type=YAML)


def _rule_of(connection: Connection, map_name: str, rule_id: int) -> Rule:
    rule = rules.get_rule(connection, rule_id)
    if rule.map != map_name:
        raise NotFound("rule", f"{rule_id} on the map {map_name}", "List the rules of the map.")
    return rule


def _said(declared: Declared, fault: Fault | None) -> RuleCheck:
    """What a rule that can be read says, whatever other rules say against it."""
    return RuleCheck(
        name=declared.name,
        declaration=dict(declared.document),
        sentence=describe(declared),
        diagram=RulePart.model_validate(draw(declared)),
        like=RuleLikeness.model_validate(recognise(declared)),
        fault=fault,
    )


def _faulty(error: InvalidInput, declared: Declared | None) -> RuleCheck:
    line, column = line_and_column(error) or (None, None)
    message = str(error).removeprefix(f"{error.where}: ")
    fault = Fault(message=message, remedy=error.remedy, where=error.where, line=line, column=column)
    return RuleCheck(
        name=None if declared is None else declared.name,
        declaration=None,
        sentence=None,
        diagram=None,
        like=None,
        fault=fault,
    )


def _declared_once(versions: Sequence[RuleVersion], version: int) -> tuple[str, Mapping[str, object]]:
    for each in versions:
        if each.version == version:
            return each.name, each.declaration
    raise NotFound("version", version, "List the versions of the rule.")
