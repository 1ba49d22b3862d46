"""Rules in SQL: the clause that is read, and the query that is given back."""

from __future__ import annotations

from dataclasses import replace

import pytest
from conformance.case import read_corpus

from semap.errors import InvalidInput
from semap.rules.language.reading import parse_declaration, read_declaration
from semap.rules.language.sql_written import write_sql

pytest.importorskip("sqlglot")

QUERY = """
-- somebody opens a door, and more than one enters
SELECT * FROM (SELECT * FROM track_in_room WHERE concept = 'Room' AND type <> 'within interval ''1'' day') MATCH_RECOGNIZE (
  PARTITION BY room ORDER BY stamp
  MEASURES MATCH_NUMBER() AS n, FINAL LAST(e.track) AS who, RUNNING COUNT(*) AS running, COUNT(E.*) AS entered,
    ARRAY_AGG(DISTINCT E.track) AS tracks, CLASSIFIER(S) AS label, PREV(FIRST(O.stamp, 1), 2) AS before,
    COUNT(DISTINCT S.track) AS people, SUM(E.duration_s * 2) AS twice
  ALL ROWS PER MATCH WITH UNMATCHED ROWS
  AFTER MATCH SKIP TO LAST E
  PATTERN (^ O {- X*? -} E{1,3} | PERMUTE(O, E) $)
  WITHIN INTERVAL '90' SECOND
  SUBSET S = (O, E)
  DEFINE
    o AS TYPE = 'began',
    E AS type IN ('began', 'ended') AND E.track = FIRST(O.track) AND NOT (LOWER(track) || 'x' LIKE 'a%')
      AND NEXT(duration_s) IS NOT NULL AND ABS(duration_s - PREV(duration_s)) BETWEEN -1 AND 2.5
) AS crowd
"""

RULE = {
    "name": "crowd",
    "input": "track_in_room",
    "where": "concept = 'Room' and type <> 'within interval ''1'' day'",
    "partition_by": "room",
    "pattern": "^ O {- X*? -} E{1,3} | permute(O, E) $",
    "subset": {"S": ["O", "E"]},
    "define": {
        "O": "type = 'began'",
        "E": "type in ('began', 'ended') and E.track = first(O.track) and not (lower(track) || 'x' like 'a%')"
        " and next(duration_s) is not null and abs(duration_s - prev(duration_s)) between -1 and 2.5",
    },
    "measures": {
        "n": "match_number()",
        "who": "final(last(E.track))",
        "running": "count()",
        "entered": "count(E)",
        "tracks": "distinct(E.track)",
        "label": "classifier(S)",
        "before": "prev(first(O.stamp, 1), 2)",
        "people": "count_distinct(S.track)",
        "twice": "sum(E.duration_s * 2)",
    },
    "rows_per_match": "all",
    "within": "90 s",
    "after_match": "skip to last E or fail",
    "emit": {"match": "crowd", "unmatched": "crowd_unmatched"},
}


def test_a_query_is_the_rule_that_says_the_same() -> None:
    found = read_declaration(QUERY)
    wanted = parse_declaration(RULE)
    for name in ("E", "O"):
        assert found.define[name] == wanted.define[name]
    assert replace(found, document={}) == replace(wanted, document={})


def test_what_is_written_is_read_as_the_same_rule() -> None:
    wanted = parse_declaration(RULE)
    assert replace(read_declaration(write_sql(wanted)), document={}) == replace(wanted, document={})


def test_rules_of_the_corpus_come_back_as_they_were() -> None:
    written = set()
    for case in read_corpus():
        # a time-out and a lone row beside one row for each match are not SQL's; the event is the name of the rule
        emit = {key: "case" for key in case.declaration.emit if key in ("match", "empty")}
        wanted = replace(case.declaration, emit=emit)
        try:
            text = write_sql(wanted)
        except InvalidInput as unsaid:
            assert "SQL has no clause for" in str(unsaid)  # noqa: PT017
            continue
        found = read_declaration(text)
        left_out = {"document": {}, "emit": {}}
        assert replace(found, **left_out) == replace(wanted, **left_out), text
        written.add(text)
    assert len(written) > 100


@pytest.mark.parametrize(
    ("query", "match", "remedy"),
    [
        ("SELECT * FROM x", "one MATCH_RECOGNIZE", "PATTERN"),
        ("SELECT * FROM x MATCH_RECOGNIZE (PATTERN (A)", "no SQL", "PATTERN"),
        ("SELECT a FROM x MATCH_RECOGNIZE (PATTERN (A) DEFINE A AS type = 'a') AS m", "columns that are", "MEASURES"),
        ("SELECT * FROM x MATCH_RECOGNIZE (ORDER BY track PATTERN (A) DEFINE A AS type = 'a') AS m", "order of", "stamp"),
        ("SELECT * FROM x MATCH_RECOGNIZE (PATTERN (A) DEFINE A AS typ = 'a') AS m", "no property typ", "type"),
        (
            "SELECT * FROM x MATCH_RECOGNIZE (PATTERN (A) DEFINE A AS EXISTS (SELECT 1)) AS m",
            "no words for",
            "YAML",
        ),
        ("SELECT * FROM x MATCH_RECOGNIZE (PATTERN (A) WITHIN INTERVAL '1' YEAR DEFINE A AS type = 'a') AS m", "YEAR", "hour"),
    ],
)  # fmt: skip
def test_what_no_rule_says_is_refused(query: str, match: str, remedy: str) -> None:
    with pytest.raises(InvalidInput, match=match) as refused:
        read_declaration(query)
    assert remedy in refused.value.remedy


def test_only_a_pattern_that_may_be_empty_tells_of_it() -> None:
    query = "SELECT * FROM x MATCH_RECOGNIZE ({rows} PATTERN (A{quantifier}) DEFINE A AS type = 'a') AS m"
    for quantifier, rows, wanted in (
        ("*", "", {"match": "m", "empty": "m"}),
        ("+", "", {"match": "m"}),
        ("*", "ALL ROWS PER MATCH OMIT EMPTY MATCHES", {"match": "m"}),
    ):
        assert read_declaration(query.format(rows=rows, quantifier=quantifier)).emit == wanted
