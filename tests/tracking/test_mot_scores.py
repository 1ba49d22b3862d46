"""The scores of tracks whose scores can be told by hand."""

import numpy as np
import pytest
from semap_service.evaluation.mot_scores import Places, mot_scores, places_of
from walking_crowd import detections, tracked

from semap.errors import InvalidInput


def places(rows: list[tuple[int, int, float]]) -> Places:
    """stamp, identity, x"""
    table = np.array(rows, np.float64).reshape(-1, 3)
    return Places(
        table[:, 0].astype(np.int64),
        table[:, 1].astype(np.int64),
        np.column_stack([table[:, 2], np.zeros(len(table))]),
    )


TWO = places([(stamp, person, 3.0 * person) for stamp in range(10) for person in (1, 2)])


def test_tracks_at_the_persons_places_score_one() -> None:
    scores = mot_scores(TWO, Places(TWO.stamp_us, 10 - TWO.identity, TWO.position_m))
    assert (scores.mota, scores.idf1, scores.hota, scores.distance_m) == (1, 1, pytest.approx(1), 0)
    assert (scores.missed, scores.false_positives, scores.switches, scores.fragments) == (0, 0, 0, 0)
    assert (scores.persons, scores.tracks) == (2, 2)


def test_a_number_that_changes_halfway_costs_identity_and_one_switch() -> None:
    parted = Places(
        TWO.stamp_us, np.where((TWO.identity == 1) & (TWO.stamp_us >= 5), 9, TWO.identity), TWO.position_m
    )
    scores = mot_scores(TWO, parted)
    assert (scores.switches, scores.missed, scores.false_positives) == (1, 0, 0)
    assert scores.mota == pytest.approx(1 - 1 / 20)
    assert scores.idf1 == pytest.approx(2 * 15 / (20 + 20))
    assert scores.detection_accuracy == pytest.approx(1)
    assert scores.association_accuracy == pytest.approx((10 * 1 + 10 * 0.5) / 20)


def test_what_is_missed_and_what_is_nobody() -> None:
    half = places([(stamp, 1, 3.0) for stamp in range(10)] + [(stamp, 7, 50.0) for stamp in range(5)])
    scores = mot_scores(TWO, half)
    assert (scores.missed, scores.false_positives, scores.switches) == (10, 5, 0)
    assert scores.mota == pytest.approx(1 - 15 / 20)


def test_half_of_zero_distance_is_the_limit() -> None:
    near, far = (
        Places(TWO.stamp_us, TWO.identity, TWO.position_m + np.array([0, offset])) for offset in (0.49, 0.51)
    )
    assert (mot_scores(TWO, near).mota, mot_scores(TWO, near).distance_m) == (1, pytest.approx(0.49))
    assert mot_scores(TWO, far).mota == -1
    assert mot_scores(TWO, far, zero_m=1.1).mota == 1


def test_no_track_at_all() -> None:
    scores = mot_scores(TWO, places_of([]))
    assert (scores.mota, scores.idf1, scores.hota, scores.missed, scores.tracks) == (0, 0, 0, 20, 0)
    assert np.isnan(scores.distance_m)


def test_places_of_states() -> None:
    states = tracked([detections(stamp * 50_000, [[1, 2], [5, 5]]) for stamp in range(4)])
    found = places_of(states)
    assert found.stamp_us.tolist() == [50_000, 50_000, 100_000, 100_000, 150_000, 150_000]
    assert found.identity.tolist() == [1, 2] * 3
    np.testing.assert_allclose(found.position_m[:2], [[1, 2], [5, 5]])


def test_what_cannot_be_compared_is_refused() -> None:
    with pytest.raises(InvalidInput, match="nobody to compare"):
        mot_scores(places([]), TWO)
    with pytest.raises(InvalidInput, match="1 is in two places at 0 us"):
        mot_scores(TWO, places([(0, 1, 0.0), (0, 1, 5.0)]))
