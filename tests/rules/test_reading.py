"""Reading rules: what each clause becomes, and each mistake named with its place and a remedy."""

from __future__ import annotations

import json
import re
from pathlib import Path
from uuid import UUID

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from scene import S, rule

from semap.errors import InvalidInput
from semap.rules.condition import read_condition, read_measure
from semap.rules.declaration import (
    AfterMatch,
    Confidence,
    Edges,
    Input,
    IntervalPattern,
    RowPattern,
    TemporalFormula,
    Windows,
)
from semap.rules.engine.run_over import run_over
from semap.rules.formula import And, Atom, Eventually, Not
from semap.rules.language.reading import parse_declaration, read_declaration
from semap.rules.language.source_text import read_source
from semap.rules.language.template import TEMPLATES
from semap.rules.pattern import Element, Sequence, Variable
from semap.rules.row import PROPERTIES, Row

DOCS = Path(__file__).parents[2] / "docs" / "rules.md"

ENTERED = """\
name: opened_then_entered
input: [track_in_room, {object_state: door, actor_within_m: 1.5}]
where: concept <> 'Hallway'
partition_by: room
pattern: O followed by E
define:
  O: "input = 'door' and type = 'open'"
  E: >
    input = 'track_in_room' and type = 'began'
    and track = first(O.actor)
measures: {gap_s: "seconds_between(first(O.stamp), last(E.stamp))", who: last(E.track)}
within: {match: 6 s, step: 2.5, E: 500 ms}
after_match: skip to last E
emit: {match: entered, timeout: nobody_came}
confidence: {gap: [O, E], distribution: lognormal, median_s: 2, sigma: 0.6, at_least: 0.2}
"""
PATTERN = {
    "name": "r", "input": ["q", "door"], "pattern": "A followed by B", "define": {"A": "type = 'open'"},
    "within": "6 s", "emit": "ab",
}  # fmt: skip
FORMULA = {
    "name": "r", "input": "q", "formula": "eventually[0 s, 6 s] (E and not W)", "when": "W",
    "define": {"E": "type = 'began'", "W": "type = 'ended'"}, "emit": {"holds": "came", "fails": "did_not"},
}  # fmt: skip
INTERVALS = {
    "name": "r", "input": ["q", "door"], "pattern": "P during|starts D",
    "define": {"P": "input = 'q'", "D": "type = 'open'"}, "emit": "inside",
}  # fmt: skip
EDGES = {"name": "visits", "input": "q", "emit": {"began": "entered", "ended": "left"}}


def test_every_clause_of_a_pattern_of_rows() -> None:
    found = read_declaration(ENTERED)
    both = frozenset({"O", "E"})
    assert found.name == "opened_then_entered"
    assert found.inputs == (Input("track_in_room"), Input("door", "object_state", 1.5))
    assert found.where == read_condition("concept <> 'Hallway'", "", frozenset())
    assert found.partition_by == ("room",)
    assert found.body == RowPattern(
        Sequence((Element("next", Variable("O")), Element("relaxed", Variable("E"))))
    )
    assert found.define == {
        "O": read_condition("input = 'door' and type = 'open'", "", both),
        "E": read_condition(
            "input = 'track_in_room' and type = 'began' and track = first(O.actor)", "", both
        ),
    }
    assert found.measures == {
        "gap_s": read_measure("seconds_between(first(O.stamp), last(E.stamp))", "", both),
        "who": read_measure("last(E.track)", "", both),
    }
    assert found.within == Windows(6_000_000, 2_500_000, {"E": 500_000})
    assert found.after_match == AfterMatch("to last", frozenset({"E"}))
    assert found.emit == {"match": "entered", "timeout": "nobody_came"}
    assert found.confidence == Confidence("O", "E", "lognormal", {"median_s": 2, "sigma": 0.6}, 0.2)


def test_the_other_kinds_are_told_by_their_clauses() -> None:
    edges = parse_declaration(EDGES)
    assert (edges.body, edges.inputs, edges.emit) == (
        Edges(), (Input("q"),), {"began": "entered", "ended": "left"},
    )  # fmt: skip
    formula = parse_declaration(FORMULA)
    inner = And((Atom("E"), Not(Atom("W"))))
    assert formula.body == TemporalFormula(Eventually(inner, 0, 6_000_000), "W")
    assert formula.emit == {"holds": "came", "fails": "did_not"}
    intervals = parse_declaration(INTERVALS)
    assert intervals.body == IntervalPattern("P", frozenset({"during", "starts"}), "D")
    assert intervals.emit == {"match": "inside"}


def test_inputs_say_what_they_are() -> None:
    inputs = [{"query": "a"}, {"rule": "b", "actor_within_m": 2}, {"object_state": "c"}, {"map": True}, "d"]
    assert parse_declaration({**PATTERN, "input": inputs}).inputs == (
        Input("a", "query"), Input("b", "rule", 2.0), Input("c", "object_state"), Input("map", "map"), Input("d"),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("no skip", AfterMatch("none")),
        ("SKIP  TO next row", AfterMatch("to next")),
        ("skip past last row", AfterMatch("past last")),
        ("skip to first A", AfterMatch("to first", frozenset({"A"}))),
        ("skip to last B", AfterMatch("to last", frozenset({"B"}))),
        ("skip to B", AfterMatch("to last", frozenset({"B"}))),
        ("skip to first A or fail", AfterMatch("to first", frozenset({"A"}), strict=True)),
        ("no skip, clear", AfterMatch("clear")),
        ("no skip, at most 5", AfterMatch("none", at_most=5)),
        ("No skip, clear, AT  MOST 12", AfterMatch("clear", at_most=12)),
        (None, AfterMatch("past last")),
    ],
)
def test_after_a_match(text: str | None, found: AfterMatch) -> None:
    assert parse_declaration({**PATTERN, "after_match": text}).after_match == found


@pytest.mark.parametrize("document", [PATTERN, FORMULA, INTERVALS, EDGES, yaml.safe_load(ENTERED)])
def test_what_is_stored_is_the_rule(document: dict[str, object]) -> None:
    found = parse_declaration(document)
    stored = json.loads(json.dumps(found.as_json()))
    assert stored == {clause: value for clause, value in document.items() if clause != "name"}
    assert parse_declaration(stored, found.name) == found
    assert read_declaration(json.dumps(stored), found.name) == found
    assert read_declaration(yaml.safe_dump(document)) == found


def test_a_clause_that_says_nothing_is_left_out() -> None:
    found = parse_declaration({**EDGES, "where": None, "within": None})
    assert found == parse_declaration(EDGES)


@pytest.mark.parametrize("state", ["open", "opened", "closed", "end", "on"])
def test_a_bare_name_may_be_the_state_of_an_object(state: str) -> None:
    assert parse_declaration({**EDGES, "emit": {state: "x"}}).emit == {state: "x"}


def test_yaml_takes_no_state_for_a_truth_value() -> None:
    found = read_declaration("{name: lamp, input: {object_state: lamp}, emit: {on: lit, off: dark, 1: one}}")
    assert found.emit == {"on": "lit", "off": "dark", "1": "one"}


CONFIDENCE = {"gap": ["A", "B"], "distribution": "normal", "mean_s": -1, "std_s": 1}
WRONG = [
    ("text", "", "a rule is a mapping of clauses"),
    ({**EDGES, "wihtin": "6 s"}, "wihtin", "Did you mean within?"),
    ({**EDGES, "within": "6 s"}, "within", "a rule without pattern and formula has no such clause"),
    ({**FORMULA, "within": "6 s"}, "within", "the formula has no such clause"),
    ({**INTERVALS, "after_match": "no skip"}, "after_match", "no such clause"),
    ({**FORMULA, "pattern": "A"}, "formula", "a pattern or a formula"),
    ({**EDGES, "name": "2r"}, "name", "a name is needed"),
    ({"input": "q", "emit": {"began": "x"}}, "name", "a name is needed"),
    ({**EDGES, "input": None}, "input", "a name is needed"),
    ({**EDGES, "input": []}, "input", "0 inputs"),
    ({**EDGES, "input": ["q", "q"]}, "input[1]", "q is there twice"),
    ({**EDGES, "input": "map"}, "input", "{map: true}"),
    ({**EDGES, "input": {"qery": "q"}}, "input.qery", "Did you mean query?"),
    ({**EDGES, "input": {"query": "q", "rule": "r"}}, "input", "one of query"),
    ({**EDGES, "input": {"map": "yes"}}, "input.map", "map is true"),
    ({**EDGES, "input": {"object_state": "d", "actor_within_m": 0}}, "input.actor_within_m", "out of range"),
    ({**EDGES, "input": [{"object_state": 3}]}, "input[0].object_state", "a name is needed"),
    ({**EDGES, "emit": None}, "emit", "names of events"),
    ({**EDGES, "emit": {}}, "emit", "names of events"),
    ({**EDGES, "emit": "entered"}, "emit", "names of events"),
    ({**EDGES, "emit": {"begun": "x"}}, "emit.begun", "Write began;"),
    ({**EDGES, "input": {"query": "q"}, "emit": {"open": "x"}}, "emit.open", "no such edge"),
    ({**EDGES, "emit": {"began": ""}}, "emit.began", "a name is needed"),
    ({**EDGES, "emit": {True: "x"}}, "emit", "Put it in quotes."),
    ({**PATTERN, "emit": {"holds": "x"}}, "emit.holds", "no such outcome"),
    ({**FORMULA, "emit": {"hold": "x"}}, "emit.hold", "Did you mean holds?"),
    ({**PATTERN, "emit": {"timeout": "x"}, "within": None}, "emit.timeout", "without a window"),
    ({**EDGES, "where": "occupants >"}, "where", "line 1, character 12: it is no CQL2 text"),
    ({**EDGES, "where": True}, "where", "a text is needed"),
    ({**EDGES, "where": "prev(type) = 'began'"}, "where", "prev is of patterns of rows only"),
    ({**EDGES, "partition_by": "rom"}, "partition_by", "Did you mean room?"),
    ({**EDGES, "partition_by": ["room", "stamp"]}, "partition_by[1]", "cannot be partitioned by stamp"),
    ({**EDGES, "partition_by": ["room", "room"]}, "partition_by[1]", "room is there twice"),
    ({**EDGES, "partition_by": "attributes."}, "partition_by", "cannot be partitioned"),
    ({**EDGES, "partition_by": []}, "partition_by", "0 properties"),
    ({**PATTERN, "pattern": 3}, "pattern", "a text is needed"),
    ({**PATTERN, "pattern": "A followd by B"}, "pattern", "line 1, character 11"),
    ({**PATTERN, "rows_per_match": "some"}, "rows_per_match", "neither one nor all"),
    ({**PATTERN, "subset": {"S": ["A", "X"]}}, "subset.S", "no row is bound to X"),
    ({**PATTERN, "subset": {"A": ["A"]}}, "subset.A", "is a variable of the pattern"),
    ({**PATTERN, "subset": {"S": "A"}}, "subset.S", "a list of variables"),
    ({**PATTERN, "emit": {"none": "x"}}, "emit.none", "no such outcome"),
    ({**EDGES, "measures": {"n": "match_number()"}}, "measures.n", "of patterns of rows only"),
    ({**PATTERN, "pattern": "A? not next N B"}, "pattern", "begins with the absence of N"),
    ({**PATTERN, "pattern": "A not followed by N", "within": None}, "pattern", "absence of N"),
    ({**PATTERN, "pattern": "A not followed by N", "within": {"step": 3}}, "pattern", "absence of N"),
    ({**PATTERN, "define": {"Ab": "type = 'x'"}}, "define.Ab", "Did you mean A?"),
    ({**PATTERN, "define": "type = 'x'"}, "define", "a mapping is needed"),
    ({**PATTERN, "define": {"A": True}}, "define.A", "a text is needed"),
    ({**PATTERN, "define": {"A": "tpe = 'x'"}}, "define.A", "Did you mean type?"),
    ({**PATTERN, "define": {"A": "stamp"}}, "define.A", "neither true nor false"),
    ({**PATTERN, "define": {"A": "type = first(C.type)"}}, "define.A", "there is no variable C"),
    (
        {**PATTERN, "pattern": "A not next N B", "define": {"N": "type = last(N.type)"}},
        "define.N", "there is no variable N",
    ),
    ({**PATTERN, "pattern": "A+ until U B"}, "define.U", "the variable U has no condition"),
    ({**INTERVALS, "define": {"P": "input = 'q'"}}, "define.D", "the variable D has no condition"),
    ({**INTERVALS, "define": {"P": "track = last(D.track)", "D": "type='a'"}}, "define.P", "variable D"),
    ({**INTERVALS, "pattern": "P before D"}, "within", "before and after need a window"),
    ({**INTERVALS, "within": {"match": 9, "step": 3}}, "within", "one window"),
    ({**FORMULA, "when": "not"}, "when", "means something already"),
    ({**FORMULA, "when": "V"}, "define.V", "the variable V has no condition"),
    ({**FORMULA, "formula": "E and"}, "formula", "line 1, character 6: a variable is missing"),
    ({**FORMULA, "define": {"E": "prev(type) = 'a'", "W": "type = 'b'"}}, "define.E", "prev"),
    ({**PATTERN, "measures": {"g": "seconds_between(first(A))"}}, "measures.g", "seconds_between"),
    ({**PATTERN, "measures": {"g-s": "count(A)"}}, "measures.g-s", "no name"),
    ({**PATTERN, "measures": {"p": "last(A.position)"}}, "measures.p", "a measure that is a shape"),
    ({**PATTERN, "measures": {"p": "count(C)"}}, "measures.p", "there is no variable C"),
    ({**EDGES, "measures": {"p": "count(C)"}}, "measures.p", "there is no variable C"),
    ({**PATTERN, "within": "6 sec"}, "within", "no duration"),
    ({**PATTERN, "within": 0}, "within", "too short"),
    ({**PATTERN, "within": {"match": "6 s", "C": "3 s"}}, "within.C", "there is no variable C"),
    ({**PATTERN, "within": {}}, "within", "a mapping is needed"),
    ({**PATTERN, "after_match": "skip"}, "after_match", "where to continue"),
    ({**PATTERN, "after_match": "skip to first"}, "after_match", "where to continue"),
    ({**PATTERN, "after_match": "no skip A"}, "after_match", "where to continue"),
    ({**PATTERN, "after_match": "no skip, at most 0"}, "after_match", "above zero"),
    ({**PATTERN, "after_match": "skip to next row, at most 5"}, "after_match", "that end at one row"),
    ({**PATTERN, "after_match": "skip to first C"}, "after_match", "no row is bound to C"),
    ({**PATTERN, "confidence": {**CONFIDENCE, "sigma": 3}}, "confidence.sigma", "normal has no sigma"),
    ({**PATTERN, "confidence": {**CONFIDENCE, "distribution": "norml"}}, "confidence.distribution", "normal?"),
    ({**PATTERN, "confidence": {**CONFIDENCE, "std_s": 0}}, "confidence.std_s", "out of range"),
    ({**PATTERN, "confidence": {**CONFIDENCE, "std_s": None}}, "confidence.std_s", "a number is needed"),
    ({**PATTERN, "confidence": {**CONFIDENCE, "at_least": 1.5}}, "confidence.at_least", "out of range"),
    ({**PATTERN, "confidence": {**CONFIDENCE, "gap": ["A"]}}, "confidence.gap", "two variables"),
    ({**PATTERN, "confidence": {**CONFIDENCE, "gap": ["A", "C"]}}, "confidence.gap[1]", "bound to C"),
    ({**PATTERN, "define": {"B": "track = first(A.actor)"}}, "input", "no input has actor_within_m"),
]  # fmt: skip


@pytest.mark.parametrize(("document", "where", "said"), WRONG)
def test_a_mistake_is_named_with_its_clause_and_a_remedy(document: object, where: str, said: str) -> None:
    with pytest.raises(InvalidInput) as wrong:
        parse_declaration(document)
    assert re.match(rf"{re.escape(where)}(, line|\Z)", wrong.value.where)
    assert said in f"{wrong.value}\n{wrong.value.remedy}"
    assert wrong.value.remedy


def placed(text: str) -> str:
    with pytest.raises(InvalidInput) as wrong:
        read_declaration(text)
    assert wrong.value.remedy
    return wrong.value.where


@pytest.mark.parametrize(
    ("right", "wrong", "mistake"),
    [
        ("type = 'open'", "tpe = 'open'", "tpe"),
        ("'began'\n    and track =", "'began'\n    and trak =", "trak"),
        ("first(O.actor)", "first(Q.actor)", "Q.actor"),
        ("concept <>", "cncept <>", "cncept"),
        ("last(E.track)}", "last(E.trac)}", "E.trac"),
        ("step: 2.5", "step: 2.5 x", "2.5 x"),
        ("O followed by", "O follow by", "by E"),
        ("after_match: skip to last E", "after_match: skip to last F", "skip to last F"),
        ("actor_within_m: 1.5", "actor_within_m: none", "none"),
        ("sigma: 0.6", "sigma: -0.6", "-0.6"),
        ("define:\n", "dfine:\n", "dfine"),
        ("timeout: nobody_came", "timeout: 7", "7}"),
    ],
)
def test_a_mistake_is_found_at_its_line_and_column(right: str, wrong: str, mistake: str) -> None:
    text = ENTERED.replace(right, wrong)
    at = text.index(mistake, text.index(wrong))
    line, column = text.count("\n", 0, at) + 1, at - text.rfind("\n", 0, at)
    assert placed(text).endswith(f", line {line}, column {column}")


@pytest.mark.parametrize(
    "written",
    [
        "O: 'input = ''door'' and HERE = 1'",
        "O: \"input = 'door' and HERE = 1\"",
        'O: "\\"input\\" = \'door\'\n    and HERE = 1"',
        "O: input = 'door' and HERE = 1",
        "O: input = 'door'\n    and\n    HERE = 1",
        "O: |-\n    input = 'door'\n      and HERE = 1",
        "O: >-  # why\n\n    input = 'door'\n\n    and HERE = 1",
        "O:\n    input = 'door' and HERE = 1",
        "? O\n  : input = 'dööör' and HERE = 1",
    ],
)
def test_a_mistake_is_found_however_the_text_is_written(written: str) -> None:
    text = f"name: r\ninput: q\npattern: O\ndefine:\n  {written}\nemit: x\n"
    at = text.index("HERE")
    line, column = text.count("\n", 0, at) + 1, at - text.rfind("\n", 0, at)
    assert placed(text) == f"define.O, line {line}, column {column}"


def test_where_escapes_hide_a_column_the_character_of_the_text_is_given() -> None:
    text = "name: r\ninput: q\npattern: O\ndefine: {O: \"input = '\\u0064oor' and HERE = 1\"}\nemit: x\n"
    assert placed(text) == "define.O, line 4, column 13: line 1, character 20 of the text"


@pytest.mark.parametrize(
    ("text", "where", "said"),
    [
        ("name: r\nname: s", "name, line 2, column 1", "name is there twice"),
        ("define: {A: x, A: y}", "define.A, line 1, column 16", "A is there twice"),
        ("name: &a r\ninput: *a", "line 1, column 7", "an anchor, alias or tag"),
        ("name: *a", "line 1, column 7", "an anchor, alias or tag"),
        ("name: !!python/object:os.system x", "line 1, column 7", "an anchor, alias or tag"),
        ("name: [" + "[" * 5000, "line 1, column 19", "nested too deeply"),
        ("name: r\n input: q", "line 2, column 7", "not YAML"),
        ("name: 'r", "line 1, column 9", "not YAML"),
        ("? [a]\n: b", "line 1, column 3", "a key that is no word"),
        ("name: r\n---\nname: s", "line 2, column 1", "more than one document"),
        ("", "", "the text is empty"),
        ("name: \0", "", "not YAML"),
        ("x" * 200_001, "", "more than 200000 characters"),
        ("[name, r]", "line 1, column 1", "a rule is a mapping of clauses"),
        ('{\n\t"name": "r",\n\t"inptu": "q"\n}', "inptu, line 3, column 11", "there is no such clause"),
    ],
)  # fmt: skip
def test_what_is_no_text_of_a_rule_is_refused_at_its_place(text: str, where: str, said: str) -> None:
    with pytest.raises(InvalidInput) as wrong:
        read_declaration(text)
    assert (wrong.value.where, said in str(wrong.value)) == (where, True), str(wrong.value)
    assert wrong.value.remedy


json_values = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**17), 10**17) | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(st.characters(codec="utf-8", max_codepoint=0xFFFF, categories=["L", "N", "P", "S", "Zs"])),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text("abc", min_size=1), inner, max_size=3),
    max_leaves=10,
)  # fmt: skip


@given(json_values)
def test_any_json_is_read_as_it_is(document: object) -> None:
    assert read_source(json.dumps(document)).document == document
    assert read_source(json.dumps(document, indent=1, ensure_ascii=False)).document == document


clauses = st.sampled_from([ENTERED, *(json.dumps(each) for each in (PATTERN, FORMULA, INTERVALS, EDGES))])


@given(clauses, st.data())
def test_a_text_with_something_left_out_is_a_rule_or_refused_with_a_remedy(
    text: str, data: st.DataObject
) -> None:
    start = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(start, min(len(text), start + 12)))
    wrong = None
    try:
        found = read_declaration(text[:start] + text[end:])
    except InvalidInput as error:
        wrong = error
    assert wrong.remedy if wrong else parse_declaration(found.as_json(), found.name) == found


def test_every_rule_in_the_documentation_is_one() -> None:
    blocks = re.findall(r"^```yaml\n(.*?)^```", DOCS.read_text(), re.DOTALL | re.MULTILINE)
    assert len(blocks) >= 13
    for block in blocks:
        read_declaration(block)


def table(heading: str) -> list[list[str]]:
    """The rows of the first table below a heading of the documentation."""
    lines = DOCS.read_text().split(f"# {heading}\n", 1)[1].split("\n| ", 1)[1].split("\n\n")[0].split("\n")
    return [[cell.strip(" `") for cell in re.split(r"(?<!\\)\|", line.strip("| "))] for line in lines[2:]]


def test_every_form_of_a_pattern_in_the_documentation_is_one() -> None:
    forms = [form.replace("\\", "") for form, _ in table("The text of a pattern")]
    assert len(forms) == 26
    for form in forms:
        parse_declaration(
            {**PATTERN, "pattern": f"Z {form}", "define": {"U": "type = 'u'"} if "U" in form else None}
        )


def test_the_matches_in_the_documentation_are_those() -> None:
    rows = table("Which rows match")
    assert len(rows) == 19
    for pattern, after_match, types, expected in rows:
        text = pattern.replace("\\", "")
        document = {
            "name": "r", "input": {"object_state": "letter"}, "pattern": text, "after_match": after_match,
            "define": {name: f"type = '{name.lower()}'" for name in re.findall(r"\b[A-Z]\b", text)},
            "within": "1 min", "emit": "found",
        }  # fmt: skip
        letters = [
            Row(
                n * S, 1, str(UUID(int=n)), "object_state", {"input": "letter", "type": type_, "stamp": n * S}
            )
            for n, type_ in enumerate(types.split(), start=1)
        ]
        events = run_over([rule(1, document)], letters, 1000 * S)
        found = [" ".join(f"{e.variable.lower()}{e.uid.int}" for e in event.evidence) for event in events]
        assert sorted(found) == sorted(expected.split(", ")), (pattern, after_match, types)


def test_the_properties_in_the_documentation_are_all() -> None:
    rows = [row for row in re.findall(r"^\| (`.*?) \| (.*?) \|", DOCS.read_text(), re.MULTILINE) if row[1]]
    said = {
        name.strip(" `"): kind
        for names, kinds in rows
        if set(kinds.split(", ")) <= {*PROPERTIES.values()}
        for name, kind in zip(names.split(","), kinds.split(", "), strict=True)
    }
    assert said == PROPERTIES


def test_the_templates_in_the_documentation_are_all() -> None:
    assert table("Templates") == [[name, template.sentence] for name, template in TEMPLATES.items()]
