"""The corpus, and patterns made at random, by Flink itself, where Flink can say them."""

from __future__ import annotations

from collections import Counter

import pytest
from conformance.case import Case, Pairs, read_corpus
from conformance.finding import by_engine
from conformance.flink_condition import Unsaid
from conformance.flink_question import FAMILIES, Family, ask_flink
from conformance.random_case import random_cases

from bench.flink.cases import Answer, Found, Item, Query, Question, ask
from bench.flink.environment import Flink, FlinkMissing, find

pytestmark = pytest.mark.flink

Said = dict[tuple[str, Family], Answer | Unsaid]
RANDOM_RULES = 120
STREAMS_OF_A_RULE = 8


@pytest.fixture(scope="module")
def flink() -> Flink:
    try:
        return find()
    except FlinkMissing as missing:
        pytest.skip(str(missing))


CORPUS = read_corpus()
RANDOM = random_cases(seed=1, rules=RANDOM_RULES, streams=STREAMS_OF_A_RULE)


@pytest.fixture(scope="module")
def said(flink: Flink) -> Said:
    """All answers, out of one JVM."""
    return ask_flink(flink, (*CORPUS, *RANDOM))


def _counted(found: tuple[Found, ...]) -> Counter[Pairs]:
    return Counter(
        tuple(sorted((number, variable) for variable, numbers in each.items() for number in numbers))
        for each in found
    )


def _differences(case: Case, family: Family, answer: Answer) -> str | None:
    """What Flink says otherwise than the case says that it does."""
    differing = case.flink.get(family)
    wanted = tuple(found.pairs for found in case.matches) if differing is None else differing.pairs
    found = None if answer.error else _counted(answer.matches)
    agrees = found == (None if wanted is None else Counter(wanted))
    if agrees and case.timeouts is not None and not answer.error:
        wanted = tuple(each.pairs for each in case.timeouts)
        found = _counted(answer.timeouts)
        agrees = found == Counter(wanted)
    if agrees:
        return None
    return f"{case.name} {family}: {case.title}: wanted {wanted}, found {answer.error or found}"


def test_corpus(said: Said) -> None:
    compared = Counter[Family]()
    differences = []
    for case in CORPUS:
        for family in FAMILIES:
            answer = said[case.name, family]
            if isinstance(answer, Answer):
                compared[family] += 1
                differences.append(_differences(case, family, answer))
            else:
                assert family not in case.flink, (
                    f"{case.name} cannot be asked, so nothing can differ: {answer}"
                )
    assert not [difference for difference in differences if difference]
    assert compared["sql"] >= 110
    assert compared["cep"] >= 300


def test_random_patterns(said: Said) -> None:
    """Over streams of rows that are each true of one variable at most, where Flink's definitions are ours."""
    differences = []
    compared = 0
    for case in RANDOM:
        matches, _ = by_engine(case)
        for family in FAMILIES:
            answer = said[case.name, family]
            if isinstance(answer, Answer):
                compared += len(matches)
                found = answer.error or _counted(answer.matches)
                if found != Counter(each.pairs for each in matches):
                    differences.append(f"{case.title}\n  {family} {found}\n  semap {matches}")
    assert not differences, "\n".join(differences)
    assert compared > len(RANDOM)


REFUSED = {
    "A B+": "Greedy quantifiers are not allowed as the last element",
    "A B?? C": "Reluctant optional variables are not supported",
    "(A | B) C": "branching patterns",
    "PERMUTE(A, B)": "PERMUTE patterns",
    "(A B)+ C": "Group patterns",
    "A B A": "Pattern variables must be unique",
}


def test_what_match_recognize_refuses(flink: Flink) -> None:
    """docs/decisions/0006 says that it does, so no case of the corpus asks it."""
    rows: tuple[Item, ...] = ((0, "a", None), (1000, "b", None))
    text = (
        "SELECT * FROM %s MATCH_RECOGNIZE (PARTITION BY `stream` ORDER BY stamp MEASURES"
        " LISTAGG(CAST(A.`number` AS STRING)) AS A_ ONE ROW PER MATCH PATTERN ({}) DEFINE A AS {})"
    )
    queries = {pattern: text.format(pattern, "A.`type` = 'a'") for pattern in REFUSED}
    queries["PREV"] = text.format("A B", "PREV(A.`occupants`) IS NULL")
    asked = {name: Question(Query(sql, ("A",)), (rows,)) for name, sql in queries.items()}
    errors = {name: answers[0].error or "" for name, answers in ask(flink, asked).items()}
    for name, reason in (REFUSED | {"PREV": "physical offsets"}).items():
        assert reason in errors[name], f"{name}: {errors[name]}"
