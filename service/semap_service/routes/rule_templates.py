"""/rule-templates, /maps/{name}/rule-words: what helps to write rules"""

from __future__ import annotations

from typing import Literal

from fastapi import APIRouter
from pydantic import Field

from semap.rules.language.reading import ALL_CLAUSES
from semap.rules.language.template import TEMPLATES, fill
from semap.rules.language.words import OF_FORMULAS, OF_PATTERNS
from semap.rules.naming import FUNCTIONS
from semap.rules.row import PROPERTIES
from semap.store.event.rule_words import words_of_map
from semap_service.database.transaction import Database, transaction
from semap_service.documents.document import Document, Name, Request
from semap_service.http.problem import problems

router = APIRouter(tags=["rules"])


class TemplateParameter(Document):
    """A value of a ready rule."""

    name: str = Field(examples=["room"])
    kind: Literal["query", "state", "name", "room", "person", "door", "duration", "count", "distance_m"]
    default: str
    meaning: str


class RuleTemplate(Document):
    """A ready rule, to be used as it is or to be edited."""

    name: str = Field(examples=["visits"])
    title: str = Field(description="What it is about, in a few words.")
    phrase: str = Field(
        description="What it asks for, with its parameters in braces.",
        examples=["{person} has been in {room} for {duration}"],
    )
    sentence: str = Field(description="The meaning of its events.")
    text: str = Field(description="YAML, with the default values of the parameters.")
    parameters: list[TemplateParameter]


class RuleTemplateList(Document):
    templates: list[RuleTemplate] = Field(description="All there are.")


class TemplateValues(Request):
    """What a template is to be filled with."""

    values: dict[str, str] = Field(
        default={},
        max_length=20,
        description="By parameter; others have their default.",
        examples=[{"room": "Lab"}],
    )


class FilledTemplate(Document):
    text: str = Field(description="A rule in YAML.")


class RuleWords(Document):
    """The words that a rule of a map may use, for completion: those of the language, and names on the map."""

    clauses: list[str]
    properties: list[str] = Field(description="Of rows.")
    functions: list[str]
    pattern_words: list[str]
    formula_words: list[str]
    room: list[str]
    door: list[str]
    instance: list[str] = Field(description="Others than rooms and doors, at most 1,000.")
    person: list[str] = Field(description="Tracks, at most the last 1,000.")
    concept: list[str]
    query: list[str]
    rule: list[str]
    state: list[str] = Field(description="Properties of objects that have states.", examples=[["door"]])
    value: list[str] = Field(description="What these came to lately.", examples=[["closed", "open"]])


@router.get("/rule-templates", operation_id="list_rule_templates", responses=problems())
def list_rule_templates() -> RuleTemplateList:
    """Ready rules for what is often asked."""
    templates = [{**vars(each), "text": fill(each.name)} for each in TEMPLATES.values()]
    return RuleTemplateList.model_validate({"templates": templates})


@router.post("/rule-templates/{name}/text", operation_id="fill_rule_template", responses=problems(404))
def fill_rule_template(name: Name, wanted: TemplateValues) -> FilledTemplate:
    """The text of a ready rule with these values. Nothing is written."""
    return FilledTemplate(text=fill(name, **wanted.values))


@router.get("/maps/{name}/rule-words", operation_id="list_rule_words", responses=problems(404))
def list_rule_words(database: Database, name: str) -> RuleWords:
    """The words that a rule of a map may use, for completion as one types."""
    with transaction(database) as connection:
        named = words_of_map(connection, name)
    return RuleWords.model_validate(
        {
            "clauses": ALL_CLAUSES,
            "properties": tuple(PROPERTIES),
            "functions": (*(each for each in FUNCTIONS if each != "classifier_near"), "isA"),
            "pattern_words": sorted(OF_PATTERNS),
            "formula_words": sorted(OF_FORMULAS),
            **named,
        }
    )
