"""Confidence: the survival functions and what is learnt, against scipy."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from semap.errors import InvalidInput
from semap.rules.bound import Bound
from semap.rules.confidence import Distribution, confidence_of, gap_of, learn, survival
from semap.rules.declaration import Confidence
from semap.rules.row import Row

S = 1_000_000
SCALES = st.floats(0.01, 100)
GAPS = st.lists(st.floats(0.001, 1e4), min_size=2, max_size=30).filter(
    lambda gaps: max(gaps) > 1.01 * min(gaps)
)


def confidence(distribution: Distribution, **parameters: float) -> Confidence:
    return Confidence("O", "E", distribution, parameters)


@given(st.floats(-10, 1000), SCALES, SCALES)
def test_survival_is_that_of_the_distribution(gap_s: float, one: float, two: float) -> None:
    for given_, expected in [
        (confidence("lognormal", median_s=one, sigma=two), stats.lognorm(two, scale=one).sf(gap_s)),
        (confidence("normal", mean_s=one, std_s=two), stats.norm(one, two).sf(gap_s)),
        (confidence("exponential", mean_s=one), stats.expon(scale=one).sf(gap_s)),
    ]:
        assert survival(given_, gap_s) == pytest.approx(expected, rel=1e-9, abs=1e-300)


@given(GAPS)
def test_what_is_learnt_is_likeliest(gaps_s: list[float]) -> None:
    sigma, _, median_s = stats.lognorm.fit(gaps_s, floc=0)
    assert learn("lognormal", gaps_s) == pytest.approx({"median_s": median_s, "sigma": sigma}, rel=1e-6)
    mean_s, std_s = stats.norm.fit(gaps_s)
    assert learn("normal", gaps_s) == pytest.approx({"mean_s": mean_s, "std_s": std_s}, rel=1e-6)
    _, mean_s = stats.expon.fit(gaps_s, floc=0)
    assert learn("exponential", gaps_s) == pytest.approx({"mean_s": mean_s}, rel=1e-9)


@pytest.mark.parametrize(
    ("distribution", "gaps_s", "message"),
    [
        ("lognormal", [], "no gaps"),
        ("normal", [1.0, float("nan")], "no gaps"),
        ("lognormal", [1.0, 0.0], "lognormal distribution are positive"),
        ("exponential", [1.0, -0.5], "exponential distribution are positive"),
        ("exponential", [0.0, 0.0], "exponential distribution are positive"),
        ("lognormal", [2.0, 2.0], "alike"),
        ("normal", [2.0], "alike"),
    ],
)
def test_what_cannot_be_learnt_is_refused(
    distribution: Distribution, gaps_s: list[float], message: str
) -> None:
    with pytest.raises(InvalidInput, match=message) as wrong:
        learn(distribution, gaps_s)
    assert wrong.value.remedy


def bound(*rows: tuple[str, float]) -> Bound:
    chain = None
    for variable, stamp_s in rows:
        chain = Bound(variable, Row(round(stamp_s * S), 0, variable, "map", {}), chain)
    assert chain is not None
    return chain


def test_the_gap_is_from_the_first_row_of_one_to_the_last_row_of_the_other() -> None:
    given_ = confidence("exponential", mean_s=2.0)
    assert gap_of(given_, bound(("O", 1), ("O", 2), ("X", 3), ("E", 4), ("E", 6), ("X", 9))) == 5
    assert confidence_of(given_, bound(("O", 1), ("E", 3))) == pytest.approx(0.36787944)
    assert gap_of(given_, bound(("O", 1))) is None
    assert confidence_of(given_, bound(("E", 1))) is None
