"""The corpus, by this engine and by trying everything (how a case is written: README.md)."""

from __future__ import annotations

import pytest
from conformance.case import Case, read_corpus
from conformance.finding import by_engine, by_enumerator, expected, matches_of, unmatched_by_enumerator

CASES = read_corpus()


def test_the_corpus_is_large_and_says_where_each_case_comes_from() -> None:
    assert len(CASES) >= 300
    definitions = [case for case in CASES if case.source.startswith(("SQL:2016", "Flink"))]
    assert len(definitions) > len(CASES) * 3 / 4
    distinct = {f"{case.declaration.document} {case.rows} {case.timeouts is None}" for case in CASES}
    assert len(distinct) == len(CASES)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_engine(case: Case) -> None:
    assert by_engine(case) == expected(case), f"{case.title} ({case.source})"


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_enumerator(case: Case) -> None:
    assert by_enumerator(case) == expected(case), f"{case.title} ({case.source})"


@pytest.mark.parametrize(
    "case", [case for case in CASES if case.values is not None], ids=lambda case: case.name
)
def test_measures(case: Case) -> None:
    """In the order of the first rows, then of the rows."""
    told = [match for match in matches_of(case) if match.type == "found"]
    told.sort(key=lambda match: match.stamp_us)
    assert tuple(tuple(match.measures.values()) for match in told) == case.values, case.title


@pytest.mark.parametrize(
    "case", [case for case in CASES if case.unmatched is not None], ids=lambda case: case.name
)
def test_unmatched(case: Case) -> None:
    told = sorted(int(match.rows[0][1].uid) for match in matches_of(case) if match.type == "unmatched")
    assert tuple(told) == case.unmatched == unmatched_by_enumerator(case), case.title
