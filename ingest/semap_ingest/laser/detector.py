"""Legs in a scan: clusters, their features, and a random forest that tells legs from other things."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path

import numpy as np

from semap.errors import InvalidInput
from semap_ingest.image.model_file import ModelFile
from semap_ingest.laser.axis import LegShape, locate_axes
from semap_ingest.laser.clusters import ClusterSettings, find_clusters
from semap_ingest.laser.features import FEATURES, column, describe
from semap_ingest.sensing.clusters import LegClusters
from semap_ingest.sensing.scan import Scan

PACKAGED = files("semap_ingest") / "models" / "legs.onnx"
FEATURES_KEY = "features"
PROBABILITIES = "probabilities"
USUAL_CUTTING = ClusterSettings()
USUAL_LEG = LegShape()


@dataclass(frozen=True, eq=False)
class LegDetector:
    """A classifier and how clusters are cut for it; made by `open`."""

    model: ModelFile
    cutting: ClusterSettings
    shape: LegShape

    @classmethod
    def open(
        cls,
        path: str | Path | None = None,
        *,
        threads: int = 1,
        cutting: ClusterSettings = USUAL_CUTTING,
        shape: LegShape = USUAL_LEG,
    ) -> LegDetector:
        """Load a classifier; None: the one that comes with semap.

        raises  InvalidInput where the file is no classifier of these features
        """
        if path is None:
            with as_file(PACKAGED) as packaged:
                model = ModelFile.open(packaged, threads=threads)
        else:
            model = ModelFile.open(Path(path), threads=threads)
        _require_fit(model)
        return cls(model, cutting, shape)

    def detect(self, scan: Scan) -> LegClusters:
        """All clusters of the scan, each with the probability that it is a leg."""
        clusters = find_clusters(scan, self.cutting)
        described = describe(scan, clusters)
        is_hidden = (column(described, "occluded_before") + column(described, "occluded_after")) > 0
        centre, covariance = locate_axes(clusters, scan.angle_step_rad, is_hidden, self.shape)
        score = np.zeros(0)
        if len(clusters):
            (probabilities,) = self.model.session.run([PROBABILITIES], {self.model.inputs[0].name: described})
            score = probabilities[:, 1].astype(np.float64)
        return LegClusters(
            scan.stamp_us,
            scan.frame,
            centre,
            covariance,
            score,
            column(described, "width_m").astype(np.float64),
            clusters.count,
        )


def _require_fit(model: ModelFile) -> None:
    names = tuple(model.metadata.get(FEATURES_KEY, "").split())
    if names != FEATURES or PROBABILITIES not in {each.name for each in model.outputs}:
        raise InvalidInput(
            f"it is not a classifier of the {len(FEATURES)} features that clusters are described by; "
            f"it has {model.described()}",
            "Train it again with ingest/training/legs.py, or leave the path out for semap's own.",
            model.where,
        )
