"""Train the leg classifier, cross-validate it, and write it as ONNX.

    python -m ingest.training.legs FOLDER    (from the repository's root, with scikit-learn)

FOLDER is `laser_people`, with the bags of `leg_samples`. A fold leaves out a whole place, all of its bags:
bags of one place show the same furniture. Made-up places are learnt from in all folds; what is shipped has
learnt from all, and is judged in other made-up places. The same bags give the same file.
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
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.metrics import roc_auc_score

from ingest.training.leg_samples import (
    BAGS,
    LEG,
    UNKNOWN,
    Samples,
    joined,
    made_up,
    read_samples,
)

MODEL = Path(__file__).parents[1] / "semap_ingest" / "models" / "legs.onnx"
SEED = 0
THRESHOLD = 0.5
OPSET = {"": 15, "ai.onnx.ml": 3}
MADE_UP = "made up"
MADE_UP_SEEDS = range(800)
HELD_OUT_SEEDS = range(10_000, 10_100)
MADE_UP_WEIGHT = 3.0
"""As much as so many places."""


@dataclass(frozen=True)
class Boosting:
    """Size of the gradient boosting: small enough to ship."""

    trees: int = 150
    rate: float = 0.1
    leaves: int = 20
    least_leaf: int = 60
    shrinkage: float = 5.0


SHIPPED = Boosting()


@dataclass(frozen=True, eq=False)
class Judged:
    """Scores of clusters that a classifier has not learnt from, and whether they are legs (each (n,))."""

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


def train(sources: Mapping[str, Samples], boosting: Boosting = SHIPPED) -> HistGradientBoostingClassifier:
    """A classifier for which legs and other things are as frequent, and each place counts as much."""
    known = {name: each[each.label != UNKNOWN] for name, each in sources.items()}
    every = joined(list(known.values()))
    place_of = {bag.name: bag.place for bag in BAGS}
    bags_at = {place: [name for name in known if place_of.get(name) == place] for place in place_of.values()}
    weights = []
    for name, each in known.items():
        is_leg = each.label == LEG
        of_one = np.where(is_leg, 1 / max(is_leg.sum(), 1), 1 / max((~is_leg).sum(), 1))
        weights.append(of_one * (MADE_UP_WEIGHT if name == MADE_UP else 1 / len(bags_at[place_of[name]])))
    weight, is_leg = np.concatenate(weights), every.label == LEG
    weight = np.where(is_leg, weight / weight[is_leg].sum(), weight / weight[~is_leg].sum())
    classifier = HistGradientBoostingClassifier(
        max_iter=boosting.trees,
        learning_rate=boosting.rate,
        max_leaf_nodes=boosting.leaves,
        min_samples_leaf=boosting.least_leaf,
        l2_regularization=boosting.shrinkage,
        early_stopping=False,
        random_state=SEED,
    )
    return classifier.fit(every.features, is_leg, sample_weight=weight * len(weight) / 2)


def judged(classifier: HistGradientBoostingClassifier, samples: Samples) -> Judged:
    """What a classifier says of the unvaried clusters of a source."""
    held_out = samples[samples.is_judged & (samples.label != UNKNOWN)]
    return Judged(classifier.predict_proba(held_out.features)[:, 1], held_out.label == LEG)


def cross_validate(
    sources: Mapping[str, Samples], folds: Sequence[Sequence[str]], boosting: Boosting = SHIPPED
) -> Iterator[tuple[str, Judged]]:
    """Each bag of each fold, judged by a classifier that has learnt from the other folds."""
    for fold in folds:
        others = {name: each for name, each in sources.items() if name not in fold}
        classifier = train(others, boosting)
        for name in fold:
            yield name, judged(classifier, sources[name])


def table(rows: Sequence[tuple[str, Judged]]) -> str:
    """A row for each."""
    return "\n".join(
        [
            "| left out | legs | others | sensitivity | specificity | balanced accuracy | precision | AUC |",
            "|---|---|---|---|---|---|---|---|",
            *(each.row(name) for name, each in rows),
        ]
    )


def export(classifier: HistGradientBoostingClassifier, path: Path) -> None:
    """Write a classifier as ONNX with the names of its features; out come probabilities (n, 2).

    By hand, since skl2onnx refuses this scikit-learn's integers.
    """
    make, kind = onnx.helper, onnx.TensorProto
    one = make.make_tensor("one", kind.FLOAT, [1], [1.0])
    nodes = [
        make.make_node(
            "TreeEnsembleRegressor", ["features"], ["odds"], domain="ai.onnx.ml", **_trees(classifier)
        ),
        make.make_node("Sigmoid", ["odds"], ["leg"]),
        make.make_node("Sub", ["one", "leg"], ["other"]),
        make.make_node("Concat", ["other", "leg"], ["probabilities"], axis=1),
    ]
    features = make.make_tensor_value_info("features", kind.FLOAT, [None, len(FEATURES)])
    probabilities = make.make_tensor_value_info("probabilities", kind.FLOAT, [None, 2])
    graph = make.make_graph(nodes, "legs", [features], [probabilities], [one])
    opsets = [make.make_opsetid(domain, version) for domain, version in OPSET.items()]
    model = make.make_model(graph, opset_imports=opsets, ir_version=8, producer_name="semap")
    make.set_model_props(model, {"features": " ".join(FEATURES)})
    onnx.checker.check_model(model)
    path.write_bytes(model.SerializeToString(deterministic=True))


def _trees(classifier: HistGradientBoostingClassifier) -> dict[str, object]:
    """Attributes of a TreeEnsembleRegressor whose sum is the log odds of a leg."""
    trees = [predictors[0].nodes for predictors in classifier._predictors]
    count = [len(nodes) for nodes in trees]
    every = np.concatenate(trees)
    tree = np.repeat(np.arange(len(trees)), count)
    node = np.concatenate([np.arange(each) for each in count])
    is_leaf = every["is_leaf"].astype(bool)
    return {
        "n_targets": 1,
        "base_values": [float(classifier._baseline_prediction.item())],
        "nodes_treeids": tree.tolist(),
        "nodes_nodeids": node.tolist(),
        "nodes_featureids": np.where(is_leaf, 0, every["feature_idx"]).tolist(),
        "nodes_values": np.where(is_leaf, 0, _rounded_down(every["num_threshold"])).tolist(),
        "nodes_modes": np.where(is_leaf, "LEAF", "BRANCH_LEQ").tolist(),
        "nodes_truenodeids": np.where(is_leaf, 0, every["left"]).tolist(),
        "nodes_falsenodeids": np.where(is_leaf, 0, every["right"]).tolist(),
        "target_treeids": tree[is_leaf].tolist(),
        "target_nodeids": node[is_leaf].tolist(),
        "target_ids": [0] * int(is_leaf.sum()),
        "target_weights": every["value"][is_leaf].tolist(),
    }


def _rounded_down(thresholds: NDArray[np.float64]) -> NDArray[np.float32]:
    """The greatest float32 that is no greater: features compare with it as with the threshold."""
    nearest = thresholds.astype(np.float32)
    return np.where(nearest > thresholds, np.nextafter(nearest, np.float32(-np.inf)), nearest)


def read_all(folder: Path) -> dict[str, Samples]:
    """Samples of all bags and made-up places, by name."""
    return {bag.name: read_samples(folder, bag) for bag in BAGS} | {MADE_UP: made_up(MADE_UP_SEEDS)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("folder", type=Path, help="where the bags are")
    parser.add_argument("--model", type=Path, default=MODEL)
    parser.add_argument("--skip-validation", action="store_true")
    chosen = parser.parse_args()
    sources = read_all(chosen.folder)
    if not chosen.skip_validation:
        places = sorted({bag.place for bag in BAGS})
        folds = [[bag.name for bag in BAGS if bag.place == place] for place in places]
        print(table(list(cross_validate(sources, folds))), flush=True)  # noqa: T201
    classifier = train(sources)
    print(judged(classifier, made_up(HELD_OUT_SEEDS)).row(f"other places {MADE_UP}"))  # noqa: T201
    export(classifier, chosen.model)


if __name__ == "__main__":
    main()
