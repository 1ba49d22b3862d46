"""Labelled clusters from the bags of Leigh et al.: what `legs` learns from.

The bags are of three static places, each with one person who walks to and fro before the laser, and of a
robot that drives where nobody is. Their author marked as legs, in some of the scans, all clusters in a
sector that is empty but for that person, up to 5 m. He cut clusters by single linkage at 0.13 m and kept
only their middles, so each mark is traced back to its beams by cutting the scan in the same way.

The laser stands still while a person walks. So two more things are known, for learning alone:
- what moves in the same sector beyond 5 m is the same person. Without it a forest learns that there are no
  legs beyond 5 m, which only holds for the marks;
- what does not move elsewhere is no leg. What moves elsewhere may be anybody, and is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from semap_ingest.laser.clusters import ScanClusters, find_clusters
from semap_ingest.laser.features import describe
from semap_ingest.recording.reading import Recording
from semap_ingest.sensing.scan import Scan
from semap_ingest.sensing.transform import PersonPoses

LEG, FAR_LEG, OTHER, UNKNOWN = 1, 2, 0, -1
EMPTY_BAG = "negative_2"
LINKAGE_M = 0.13
MARK_TOLERANCE_M = 1e-3
MARKED_TO_M = 5.0
STILL_WITHIN_M = 0.1
STILL_SHARE = 0.5
MOVING_SHARE = 0.05
WIDEST_LEGS_M = 0.45


@dataclass(frozen=True)
class Bag:
    """A bag with a walking person, where it was recorded, and the sector in which its author marked legs."""

    name: str
    place: str
    sector_deg: tuple[float, float] = (-15.0, 15.0)


BAGS = (
    Bag("positive_1", "A"),
    Bag("positive_2", "A"),
    Bag("positive_3", "A"),
    Bag("positive_4", "B", (-15.0, 10.0)),
    Bag("positive_6", "C"),
    Bag("positive_7", "C"),
)


@dataclass(frozen=True, eq=False)
class Samples:
    """Clusters of one bag.

    features    (n, len(FEATURES)) float32
    label       (n,) LEG (marked by hand), FAR_LEG (by motion), OTHER or UNKNOWN
    scan        (n,) which scan
    is_judged   (n,) whether it is of a scan with marks, or of the empty bag, and not mirrored
    """

    features: NDArray[np.float32]
    label: NDArray[np.int8]
    scan: NDArray[np.int64]
    is_judged: NDArray[np.bool_]

    def __getitem__(self, chosen: NDArray[np.bool_]) -> Samples:
        return Samples(self.features[chosen], self.label[chosen], self.scan[chosen], self.is_judged[chosen])


def read_samples(folder: Path, bag: Bag, every: int = 1) -> Samples:
    """Clusters of a bag with a person, plain and mirrored; of each `every`th scan."""
    scans = _scans(folder / "positive_not_extracted" / f"{bag.name}.bag")
    marks = _marks(folder / f"{bag.name}_extracted.bag")
    still = still_share(scans)
    parts = []
    for k in range(0, len(scans), every):
        scan = scans[k]
        middles = marks.get(scan.stamp_us)
        is_marked = np.zeros(len(scan.ranges_m), bool) if middles is None else marked_beams(scan, middles)
        for is_mirrored in (False, True):
            turn = slice(None, None, -1 if is_mirrored else 1)
            seen = mirrored(scan) if is_mirrored else scan
            clusters = find_clusters(seen)
            sector = sorted((-d if is_mirrored else d) for d in bag.sector_deg)
            label = _labels(clusters, is_marked[turn], still[k][turn], (sector[0], sector[1]))
            parts.append(_samples(seen, clusters, label, k, middles is not None and not is_mirrored))
    return joined(parts)


def read_empty(folder: Path, every: int = 1) -> Samples:
    """Clusters of the bag without people, plain and mirrored; of each `every`th scan."""
    parts = []
    for k, scan in enumerate(_scans(folder / f"{EMPTY_BAG}.bag")[::every]):
        for seen in (scan, mirrored(scan)):
            clusters = find_clusters(seen)
            label = np.full(len(clusters), OTHER, np.int8)
            parts.append(_samples(seen, clusters, label, k * every, seen is scan))
    return joined(parts)


def joined(parts: Sequence[Samples]) -> Samples:
    """All samples of all parts."""
    return Samples(
        np.concatenate([part.features for part in parts]),
        np.concatenate([part.label for part in parts]),
        np.concatenate([part.scan for part in parts]),
        np.concatenate([part.is_judged for part in parts]),
    )


def marked_beams(scan: Scan, middles_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(beams,), whether a beam hit a cluster whose middle is marked (k, 2)."""
    is_point = scan.is_return & (scan.ranges_m > scan.range_min_m) & (scan.ranges_m < scan.range_max_m)
    beam = np.flatnonzero(is_point)
    points = scan.points_m[beam]
    links = cKDTree(points).query_pairs(LINKAGE_M, output_type="ndarray")
    graph = coo_array((np.ones(len(links)), links.T), shape=(len(points), len(points)))
    count, cluster = connected_components(graph, directed=False)
    size = np.bincount(cluster, minlength=count)
    middle = np.column_stack([np.bincount(cluster, axis, count) for axis in points.T]) / size[:, None]
    distance, nearest = cKDTree(middle).query(middles_m)
    marked = np.zeros(len(scan.ranges_m), bool)
    marked[beam[np.isin(cluster, nearest[distance < MARK_TOLERANCE_M])]] = True
    return marked


def still_share(scans: Sequence[Scan]) -> NDArray[np.float64]:
    """(scans, beams): in what share of all scans the beam of a standing laser measured about the same."""
    ranges = np.nan_to_num(np.array([scan.ranges_m for scan in scans], np.float64), posinf=0.0, neginf=0.0)
    share = np.empty(ranges.shape)
    for beam, measured in enumerate(ranges.T):
        ordered = np.sort(measured)
        above = np.searchsorted(ordered, measured + STILL_WITHIN_M, side="right")
        share[:, beam] = (above - np.searchsorted(ordered, measured - STILL_WITHIN_M)) / len(ordered)
    return share


def mirrored(scan: Scan) -> Scan:
    """As seen in a mirror that stands on the laser's x axis."""
    last = scan.angle_min_rad + scan.angle_step_rad * (len(scan.ranges_m) - 1)
    return replace(scan, angle_min_rad=-last, ranges_m=scan.ranges_m[::-1].copy())


def _labels(
    clusters: ScanClusters,
    is_marked: NDArray[np.bool_],
    still: NDArray[np.float64],
    sector_deg: tuple[float, float],
) -> NDArray[np.int8]:
    middle = clusters.mean(clusters.points_m[clusters.member])
    marked = clusters.mean(is_marked[clusters.beam[clusters.member]].astype(np.float64))
    stillness = clusters.mean(still[clusters.beam[clusters.member]])
    width = np.hypot(*(clusters.points_m[clusters.stop - 1] - clusters.points_m[clusters.first]).T)
    angle = np.degrees(np.arctan2(middle[:, 1], middle[:, 0]))
    in_sector = (angle > sector_deg[0]) & (angle < sector_deg[1])
    is_far = np.hypot(*middle.T) > MARKED_TO_M
    return np.select(
        [
            marked >= 0.5,
            in_sector & ~is_far,
            in_sector & (stillness < MOVING_SHARE) & (width < WIDEST_LEGS_M),
            stillness > STILL_SHARE,
        ],
        [LEG, UNKNOWN, FAR_LEG, OTHER],
        UNKNOWN,
    ).astype(np.int8)


def _samples(
    scan: Scan, clusters: ScanClusters, label: NDArray[np.int8], number: int, is_judged: bool
) -> Samples:
    count = len(clusters)
    return Samples(describe(scan, clusters), label, np.full(count, number), np.full(count, is_judged))


def _scans(path: Path) -> list[Scan]:
    with Recording(path) as recording:
        return [each.value for each in recording.records() if isinstance(each.value, Scan)]


def _marks(path: Path) -> dict[int, NDArray[np.float64]]:
    """Middles of the marked clusters (k, 2) by the stamp of their scan, which comes right after them."""
    marks: dict[int, NDArray[np.float64]] = {}
    middles = np.zeros((0, 2))
    with Recording(path) as recording:
        for each in recording.records():
            if isinstance(each.value, PersonPoses):
                middles = each.value.position_m[:, :2]
            elif isinstance(each.value, Scan):
                marks[each.value.stamp_us] = middles
    return marks
