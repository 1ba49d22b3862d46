"""People before a laser alone: the classifier of legs bag by bag, and how well people are followed.

Bags are judged by a classifier that has not learnt from their place, made-up places by the one that comes
with semap, which has learnt from others.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path

from semap_ingest.laser.detector import LegDetector
from semap_service.evaluation.mot_scores import mot_scores

from bench.figure import Rows, once
from bench.people_scenes import Watched, of_bags, of_scenes, tracks_of
from ingest.training.leg_samples import BAGS, Samples
from ingest.training.legs import THRESHOLD, Judged, export, judged, read_all, train

DIGITS = 3
SHARES = ("recall", "precision", "mota", "idf1", "hota")
COUNTS = ("switches", "tracks", "persons")
PLACES = sorted({bag.place for bag in BAGS})


def measure(folder: Path | None) -> Rows:
    """A row for each bag, as far as there is a folder of them, then one for each made-up place.

    folder  `laser_people`
    """
    made_up = [_row(each, LegDetector.open()) for each in of_scenes()]
    if folder is None:
        return made_up
    with tempfile.TemporaryDirectory() as home:
        return [*_of_bags(of_bags(folder), read_all(folder), Path(home)), *made_up]


def _of_bags(bags: Iterable[Watched], samples: Mapping[str, Samples], home: Path) -> Rows:
    watched = {each.name: each for each in bags}
    rows = []
    for place in PLACES:
        left_out = [bag.name for bag in BAGS if bag.place == place]
        classifier = train({name: each for name, each in samples.items() if name not in left_out})
        export(classifier, home / f"{place}.onnx")
        legs = LegDetector.open(home / f"{place}.onnx")
        for name in left_out:
            clusters = _of_clusters(judged(classifier, samples[name]))
            rows.append(
                _row(watched[name], legs, clusters) if name in watched else {"where": name} | clusters
            )
    return rows


def measured(watched: Watched, legs: LegDetector) -> dict[str, float]:
    """Recall and precision of places, MOTA, IDF1, HOTA; switches, tracks and persons."""
    scores = mot_scores(watched.truth, tracks_of(watched, legs))
    found = len(watched.truth) - scores.missed
    told = {"recall": found / len(watched.truth), "precision": found / max(found + scores.false_positives, 1)}
    return told | {title: getattr(scores, title) for title in (*SHARES[2:], *COUNTS)}


def _row(
    watched: Watched, legs: LegDetector, clusters: Mapping[str, object] | None = None
) -> dict[str, object]:
    told = measured(watched, legs)
    shares = {title: once(told[title], DIGITS) for title in SHARES}
    return (
        {"where": watched.name} | shares | {title: once(told[title]) for title in COUNTS} | (clusters or {})
    )


def _of_clusters(told: Judged) -> dict[str, object]:
    """How often legs and other things are told right, of one bag."""
    is_right = (told.score >= THRESHOLD) == told.is_leg
    others_right = float(is_right[~told.is_leg].mean())
    if not told.is_leg.any():
        return {"others_right": once(others_right, DIGITS)}
    legs_right = float(is_right[told.is_leg].mean())
    return {
        "legs_right": once(legs_right, DIGITS),
        "others_right": once(others_right, DIGITS),
        "balanced": once((legs_right + others_right) / 2, DIGITS),
    }
