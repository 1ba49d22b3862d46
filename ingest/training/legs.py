"""Train the leg classifier, cross-validate it, and write it as ONNX.

    python -m ingest.training.legs FOLDER    (from the repository's root, with scikit-learn and skl2onnx)

FOLDER holds the bags `positive_*_extracted.bag`, `positive_not_extracted/` and `negative_2.bag`. Folds leave
out whole bags, and, which is harder, whole places: bags of one place show the same furniture. The same bags
give the same file.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray
from semap_ingest.laser.features import FEATURES
from skl2onnx import to_onnx
from skl2onnx.common.data_types import FloatTensorType
from sklearn.ensemble import RandomForestClassifier
from sklearn.metrics import roc_auc_score

from ingest.training.leg_samples import (
    BAGS,
    EMPTY_BAG,
    LEG,
    OTHER,
    Samples,
    joined,
    read_empty,
    read_samples,
)

MODEL = Path(__file__).parents[1] / "semap_ingest" / "models" / "legs.onnx"
SEED = 0
THRESHOLD = 0.5
OPSET = {"": 15, "ai.onnx.ml": 3}

# a thing that stands still looks the same in every scan; more of them only teach it by heart
STILL_EVERY = 32
EMPTY_EVERY = 16


@dataclass(frozen=True)
class Forest:
    """Size of the random forest: small enough to ship, leaves large enough not to learn single things."""

    trees: int = 60
    depth: int = 12
    leaf: int = 20


SHIPPED = Forest()


@dataclass(frozen=True, eq=False)
class Judged:
    """Scores of clusters that a forest has not learnt from, and whether they are legs (each (n,))."""

    score: NDArray[np.float64]
    is_leg: NDArray[np.bool_]

    def row(self, name: str) -> str:
        """One row of the table: clusters, sensitivity, specificity, balanced accuracy, precision, AUC."""
        found = self.score >= THRESHOLD
        specificity = float((~found[~self.is_leg]).mean())
        if not self.is_leg.any():
            return f"| {name} | 0 | {len(found)} | | {specificity:.3f} | | | |"
        sensitivity = float(found[self.is_leg].mean())
        auc = roc_auc_score(self.is_leg, self.score)
        legs = int(self.is_leg.sum())
        return (
            f"| {name} | {legs} | {len(found) - legs} | {sensitivity:.3f} | {specificity:.3f} | "
            f"{(sensitivity + specificity) / 2:.3f} | {self.is_leg[found].mean():.3f} | {auc:.3f} |"
        )

    def balanced_accuracy(self) -> float:
        """At THRESHOLD."""
        found = self.score >= THRESHOLD
        return float(found[self.is_leg].mean() + (~found[~self.is_leg]).mean()) / 2


def thinned(samples: Samples, every: int) -> Samples:
    """What a forest learns from: all legs, and what is no leg from each `every`th scan."""
    is_leg = samples.label > OTHER
    return samples[is_leg | ((samples.label == OTHER) & (samples.scan % every == 0))]


def train(samples: Samples, forest: Forest = SHIPPED) -> RandomForestClassifier:
    """A forest for which legs and other things are as frequent, whatever the samples are."""
    classifier = RandomForestClassifier(
        forest.trees,
        max_depth=forest.depth,
        min_samples_leaf=forest.leaf,
        class_weight="balanced_subsample",
        random_state=SEED,
        n_jobs=1,
    )
    return classifier.fit(samples.features, samples.label > OTHER)


def cross_validate(
    samples: Mapping[str, Samples],
    folds: Sequence[Sequence[str]],
    forest: Forest = SHIPPED,
) -> Iterator[tuple[str, Judged]]:
    """Each bag of each fold, judged by a forest that has learnt from the bags of the other folds."""
    for fold in folds:
        others = [
            thinned(each, EMPTY_EVERY if name == EMPTY_BAG else STILL_EVERY)
            for name, each in samples.items()
            if name not in fold
        ]
        classifier = train(joined(others), forest)
        for name in fold:
            held_out = samples[name][samples[name].is_judged]
            held_out = held_out[(held_out.label == LEG) | (held_out.label == OTHER)]
            yield name, Judged(classifier.predict_proba(held_out.features)[:, 1], held_out.label == LEG)


def pooled(judged: Sequence[Judged]) -> Judged:
    """All clusters of all bags together."""
    return Judged(
        np.concatenate([each.score for each in judged]), np.concatenate([each.is_leg for each in judged])
    )


def table(judged: Sequence[tuple[str, Judged]]) -> str:
    """A row for each bag, for all their clusters together, and the mean over the bags with people."""
    with_people = [each for _, each in judged if each.is_leg.any()]
    mean = np.mean([each.balanced_accuracy() for each in with_people])
    return "\n".join(
        [
            "| left out | legs | others | sensitivity | specificity | balanced accuracy | precision | AUC |",
            "|---|---|---|---|---|---|---|---|",
            *(each.row(name) for name, each in judged),
            pooled(with_people).row("pooled, bags with people"),
            pooled([each for _, each in judged]).row("pooled, all"),
            f"| mean, bags with people | | | | | {mean:.3f} | | |",
        ]
    )


def export(classifier: RandomForestClassifier, path: Path) -> None:
    """Write a forest as ONNX with the names of its features; out come label (n,), probabilities (n, 2)."""
    model = to_onnx(
        classifier,
        name="legs",
        initial_types=[("features", FloatTensorType([None, len(FEATURES)]))],
        options={"zipmap": False},
        target_opset=OPSET,
    )
    onnx.helper.set_model_props(model, {"features": " ".join(FEATURES)})
    path.write_bytes(model.SerializeToString(deterministic=True))


def read_all(folder: Path) -> dict[str, Samples]:
    """Samples of all bags, by name."""
    return {bag.name: read_samples(folder, bag) for bag in BAGS} | {EMPTY_BAG: read_empty(folder)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("folder", type=Path, help="where the bags are")
    parser.add_argument("--model", type=Path, default=MODEL)
    parser.add_argument("--skip-validation", action="store_true")
    chosen = parser.parse_args()
    samples = read_all(chosen.folder)
    if not chosen.skip_validation:
        by_place = [[bag.name for bag in BAGS if bag.place == place] for place in ("A", "B", "C")]
        for title, folds in (
            ("Whole bags left out", [[name] for name in samples]),
            ("Whole places left out", by_place),
        ):
            print(f"\n{title}\n\n{table(list(cross_validate(samples, folds)))}", flush=True)  # noqa: T201
    learnt = [
        thinned(each, EMPTY_EVERY if name == EMPTY_BAG else STILL_EVERY) for name, each in samples.items()
    ]
    export(train(joined(learnt)), chosen.model)


if __name__ == "__main__":
    main()
