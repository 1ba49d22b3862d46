"""Reading a rule: each clause, and whether they fit together.

The clauses that a rule has tell its kind: with `formula` it is one, with `pattern` a pattern of rows or of
two intervals, with neither it names the events of both edges. What is read can be run.
"""

from __future__ import annotations

import difflib
from collections.abc import Collection, Mapping, Sequence

from semap.cql2 import Expression
from semap.errors import InvalidInput
from semap.rules.compilation import OUTCOMES, compile_rule
from semap.rules.condition import asks_of_pattern, read_condition, read_measure
from semap.rules.declaration import (
    Body,
    Declaration,
    Edges,
    Input,
    IntervalPattern,
    RowPattern,
    TemporalFormula,
    Windows,
)
from semap.rules.language import formula_text, pattern_text
from semap.rules.language.clauses import (
    read_about,
    read_after_match,
    read_confidence,
    read_inputs,
    read_mapping,
    read_partition,
    read_rows_per_match,
    read_subsets,
    read_windows,
)
from semap.rules.language.names import Names, names_of
from semap.rules.language.source_text import LONGEST, read_source
from semap.rules.language.sql_text import is_sql, read_sql
from semap.rules.language.stored_form import stored_form
from semap.rules.language.words import read_identifier, read_name, read_variable, unknown
from semap.rules.matching.follow import may_be_empty
from semap.rules.naming import Subsets
from semap.rules.needs import OF_ACTOR, properties_read
from semap.rules.temporal.quantifiers import scopes, variables_of

ALWAYS = ("name", "input", "where", "partition_by", "measures", "emit")
CLAUSES: Mapping[type[Body], tuple[str, ...]] = {
    Edges: ALWAYS,
    RowPattern: (
        *ALWAYS,
        "pattern",
        "subset",
        "define",
        "rows_per_match",
        "within",
        "after_match",
        "about",
        "confidence",
    ),
    IntervalPattern: (*ALWAYS, "pattern", "define", "within", "confidence"),
    TemporalFormula: (*ALWAYS, "formula", "when", "define", "confidence"),
}
ALL_CLAUSES = tuple(dict.fromkeys(name for names in CLAUSES.values() for name in names))
KINDS: Mapping[type[Body], str] = {
    Edges: "a rule without pattern and formula",
    RowPattern: "the pattern of rows",
    IntervalPattern: "the pattern of two intervals",
    TemporalFormula: "the formula",
}
EMITS: Mapping[type[Body], tuple[str, ...]] = {
    RowPattern: OUTCOMES,
    IntervalPattern: ("match",),
    TemporalFormula: ("holds", "fails"),
}
EDGES = ("began", "ended", "crossed")
EMIT_REMEDY: Mapping[type[Body], str] = {
    Edges: "For example: emit: {began: entered, ended: left}",
    RowPattern: "For example: emit: opened_then_entered, or emit: {match: a, timeout: b}",
    IntervalPattern: "For example: emit: was_there_while_open",
    TemporalFormula: "For example: emit: {holds: kept, fails: broken}",
}
VARIABLES_AT_MOST = 300
MEASURES_AT_MOST = 50
LONGEST_WORD = 100
"""Of what a message repeats."""


def read_declaration(text: str, name: str | None = None) -> Declaration:
    """Read a rule from YAML, JSON or SQL; `name` stands in for a missing clause `name`.

    raises InvalidInput naming the clause, the line and the column
    """
    if is_sql(text):
        return _from_sql(text, name)
    source = read_source(text)
    try:
        return parse_declaration(source.document, name)
    except InvalidInput as error:
        raise source.placed(error) from error


def _from_sql(text: str, name: str | None) -> Declaration:
    """Only a pattern that may bind no row has an event of that."""
    if len(text) > LONGEST:
        raise InvalidInput(f"more than {LONGEST} characters", "Make several rules of it.")
    clauses = read_sql(text)
    emit = clauses["emit"]
    assert isinstance(emit, dict)  # noqa: S101
    body = _body(clauses)
    if not isinstance(body, RowPattern) or not may_be_empty(body.node):
        emit.pop("empty", None)
    return parse_declaration(clauses, name)


def parse_declaration(document: object, name: str | None = None) -> Declaration:
    """Read a rule from parsed YAML or JSON; `name` stands in for a missing clause `name`.

    raises InvalidInput naming the clause
    """
    clauses = stored_form(_clauses(document))
    body = _body(clauses)
    for clause in clauses:
        if clause not in CLAUSES[type(body)]:
            raise InvalidInput(
                f"{KINDS[type(body)]} has no such clause",
                f"Its clauses are {', '.join(CLAUSES[type(body)])}.",
                clause,
            )
    names = names_of(body)
    subsets = read_subsets(clauses.get("subset"), names.bound)
    declaration = Declaration(
        name=read_name(clauses.get("name", name), "name"),
        inputs=read_inputs(clauses.get("input")),
        body=body,
        emit=_emit(clauses.get("emit"), body),
        where=_where(clauses.get("where")),
        partition_by=read_partition(clauses.get("partition_by")),
        define=_define(clauses.get("define"), body, names, subsets),
        measures=_measures(clauses.get("measures"), body, names.bound, subsets),
        within=read_windows(clauses.get("within"), names.bound | names.absent),
        after_match=read_after_match(clauses.get("after_match"), names.bound, subsets),
        each_row=read_rows_per_match(clauses.get("rows_per_match")),
        subsets=subsets,
        about=read_about(clauses.get("about"), names.bound),
        confidence=read_confidence(clauses.get("confidence"), names.bound),
        document={clause: value for clause, value in clauses.items() if clause != "name"},
    )
    _require_sense(declaration)
    return declaration


def _clauses(document: object) -> Mapping[str, object]:
    """The clauses that say something, by name."""
    remedy = f"Its clauses are {', '.join(ALL_CLAUSES)}."
    if not isinstance(document, Mapping):
        raise InvalidInput("a rule is a mapping of clauses", remedy)
    for clause in document:
        if clause not in ALL_CLAUSES:
            word = str(clause)[:LONGEST_WORD]
            raise unknown("there is no such clause", word, ALL_CLAUSES, word)
    return {clause: value for clause, value in document.items() if value is not None}


def _body(clauses: Mapping[str, object]) -> Body:
    if "pattern" in clauses and "formula" in clauses:
        raise InvalidInput("a rule has a pattern or a formula", "Make two rules of it.", "formula")
    if "pattern" in clauses:
        return pattern_text.read(clauses["pattern"], "pattern")
    if "formula" not in clauses:
        return Edges()
    formula, when = formula_text.read(clauses["formula"], "formula"), clauses.get("when")
    scopes(formula)
    if when in variables_of(formula):
        raise InvalidInput(
            f"{when} is quantified in the formula", "Ask it at rows of another variable.", "when"
        )
    return TemporalFormula(formula, None if when is None else read_variable(when, "when"))


def _emit(value: object, body: Body) -> Mapping[str, str]:
    """Names of events: by the type of a row, or by what was found."""
    kind = type(body)
    if isinstance(value, str) and isinstance(body, RowPattern | IntervalPattern):
        return {"match": read_name(value, "emit")}
    if not isinstance(value, Mapping) or not value:
        raise InvalidInput("names of events are needed", EMIT_REMEDY[kind], "emit")
    given = read_mapping(value, "emit", EMIT_REMEDY[kind])
    for key in given:
        if kind in EMITS and key not in EMITS[kind]:
            raise unknown(f"{KINDS[kind]} has no such outcome", key, EMITS[kind], f"emit.{key}")
    return {key: read_name(each, f"emit.{key}") for key, each in given.items()}


def _where(value: object) -> Expression | None:
    if value is None:
        return None
    condition = read_condition(_text(value, "where"), "where", frozenset())
    _refuse_before(condition, "where")
    return condition


def _define(value: object, body: Body, names: Names, subsets: Subsets) -> Mapping[str, Expression]:
    """The conditions, each of a variable that the pattern or formula uses."""
    if value is None:
        given: Mapping[str, object] = {}
    else:
        given = read_mapping(value, "define", "For example: define: {O: \"type = 'open'\"}")
    if len(given) > VARIABLES_AT_MOST:
        raise InvalidInput(f"more than {VARIABLES_AT_MOST} variables", "Make several rules of it.", "define")
    for name in given:
        if name not in names.all:
            raise unknown(
                f"{KINDS[type(body)]} has no variable {name}",
                name,
                sorted(names.all),
                f"define.{name}",
            )
    is_rows = isinstance(body, RowPattern)
    for name in sorted(names.all if not is_rows else names.ending):
        if name not in given:
            raise unknown(f"the variable {name} has no condition", name, [*given], f"define.{name}")
    found = {}
    for name, text in given.items():
        where = f"define.{name}"
        variables = names.bound if is_rows else _asked_of(body, name)
        found[name] = read_condition(_text(text, where), where, variables, subsets)
        if not is_rows:
            _refuse_before(found[name], where)
    return found


def _asked_of(body: Body, name: str) -> frozenset[str]:
    """Of what an atom may ask: of the row at which its formula is asked, and of quantifiers around it."""
    if not isinstance(body, TemporalFormula) or body.when == name:
        return frozenset()
    asked = frozenset({body.when} if body.when is not None else ())
    return asked | scopes(body.formula).get(name, frozenset())


def _measures(
    value: object, body: Body, variables: frozenset[str], subsets: Subsets
) -> Mapping[str, Expression]:
    if value is None:
        return {}
    given = read_mapping(value, "measures", "For example: measures: {who: last(E.track)}")
    if len(given) > MEASURES_AT_MOST:
        raise InvalidInput(f"more than {MEASURES_AT_MOST} measures", "Leave some out.", "measures")
    found = {}
    for name, text in given.items():
        where = f"measures.{name}"
        measure = read_measure(_text(text, where), where, variables, subsets)
        if not isinstance(body, RowPattern):
            _refuse_before(measure, where)
        found[read_identifier(name, where)] = measure
    return found


def _text(value: object, where: str) -> str:
    if not isinstance(value, str):
        raise InvalidInput("a text is needed", "Write CQL2 in quotes: \"type = 'open'\".", where)
    return value


def _refuse_before(condition: Expression, where: str) -> None:
    asked = asks_of_pattern(condition)
    if asked:
        raise InvalidInput(f"{asked} is of patterns of rows only", "Ask of the row itself.", where)


def _require_sense(declaration: Declaration) -> None:
    """raises InvalidInput for clauses that are each right and mean nothing together"""
    body, within = declaration.body, declaration.within
    if isinstance(body, Edges):
        _require_edges(declaration.emit, declaration.inputs)
    if "timeout" in declaration.emit and not isinstance(body, Edges) and within == Windows():
        raise InvalidInput("without a window nothing times out", "Add one: within: 6 s.", "emit.timeout")
    actors = properties_read(declaration) & OF_ACTOR
    if actors and all(item.actor_within_m is None for item in declaration.inputs):
        raise InvalidInput(
            f"{min(actors)} is read, and no input has actor_within_m",
            "Write the input as {object_state: door, actor_within_m: 1.5}.",
            "input",
        )
    try:
        compile_rule(declaration)
    except InvalidInput as error:
        if error.where:
            raise
        clause = next((name for name in ("pattern", "formula") if name in declaration.document), "define")
        raise InvalidInput(str(error), error.remedy, clause) from error


def _require_edges(emit: Collection[str], inputs: Sequence[Input]) -> None:
    """A row of a query is `began`, `ended` or `crossed`; a word very close to these is misspelt."""
    may_be_query = all(item.kind in (None, "query") for item in inputs)
    only_queries = all(item.kind == "query" for item in inputs)
    for key in emit:
        close = difflib.get_close_matches(key, EDGES, n=1, cutoff=0.8)
        if key not in EDGES and (only_queries or (may_be_query and close)):
            raise InvalidInput(
                "there is no such edge",
                f"Write {' or '.join(close or EDGES)}; of an object's state, input: {{object_state: NAME}}.",
                f"emit.{key}",
            )
