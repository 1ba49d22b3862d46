"""Labelled clusters that `legs` learns from: of the bags of Leigh et al., and of made-up places.

Most bags are of static places, with one or a few persons who walk about before the laser; one is of a robot
that drives where nobody is. In six of them their author marked as legs, in some of the scans, all clusters in
a sector that is empty but for one person, up to 5 m. He cut clusters by single linkage at 0.13 m and kept
only their middles, so each mark is traced back to its beams by cutting the scan in the same way.

The laser stands still while a person walks. So two more things are known, for learning alone:
- what moves in the same sector beyond 5 m is the same person. Without it a classifier learns that there are
  no legs beyond 5 m, which only holds for the marks; in the bags without marks, what moves is a person;
- what does not move elsewhere is no leg. What moves elsewhere may be anybody, and is left out.

Each scan is learnt from as it is and in variations: with fewer beams, larger or smaller, noisier, mirrored,
and with made-up people before its furniture, standing and walking. Other places are wholly made up
(`leg_world`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from semap_ingest.laser.clusters import find_clusters
from semap_ingest.laser.features import column, describe
from semap_ingest.recording.reading import Recording
from semap_ingest.sensing.scan import Scan
from semap_ingest.sensing.transform import PersonPoses

from ingest.training.leg_laser import any_laser, before_background, seen
from ingest.training.leg_world import any_height_m, passer_by, scene, spot

LEG, OTHER, UNKNOWN = 1, 0, -1
LINKAGE_M = 0.13
MARK_TOLERANCE_M = 1e-3
MARKED_TO_M = 5.0
STILL_WITHIN_M = 0.1
STILL_SHARE = 0.5
MOVING_SHARE = 0.05
WIDEST_LEGS_M = 0.45
MOVES_TO_M = 4.5
"""In bags without marks: beyond, what moves may be noise."""

STILL_EVERY = 16
"""A thing that stands still looks the same in every scan: more of them only teach it by heart."""
MOVING_EVERY = 4
VARIATIONS = 3
SCANS_PER_PLACE = 8
PUT_PEOPLE = (0, 1, 2, 4, 6)
SKIP_BEAMS = (1.0, 1.42, 2.0, 2.84)
MADE_UP_PEOPLE = (0, 1, 1, 2, 3, 3, 5, 8, 12)

How = Literal["marks", "motion", "empty"]


@dataclass(frozen=True)
class Bag:
    """A bag, where it was recorded, how its labels are known, and the sector in which legs were marked."""

    path: str
    place: str
    how: How = "marks"
    sector_deg: tuple[float, float] = (-15.0, 15.0)

    @property
    def name(self) -> str:
        return Path(self.path).stem


_MARKED = "training_scans_res_0.33/positive_not_extracted"
BAGS = (
    Bag(f"{_MARKED}/positive_1.bag", "A"),
    Bag(f"{_MARKED}/positive_2.bag", "A"),
    Bag(f"{_MARKED}/positive_3.bag", "A"),
    Bag(f"{_MARKED}/positive_4.bag", "B", sector_deg=(-15.0, 10.0)),
    Bag(f"{_MARKED}/positive_6.bag", "C"),
    Bag(f"{_MARKED}/positive_7.bag", "C"),
    Bag("demo_stationary_simple_environment.bag", "D", "motion"),
    Bag(f"{_MARKED}/positive_5.bag", "E", "motion"),
    Bag("training_scans_res_0.33/negative_2.bag", "F", "empty"),
)


@dataclass(frozen=True, eq=False)
class Samples:
    """Clusters of one source.

    features    (n, len(FEATURES)) float32
    label       (n,) LEG, OTHER or UNKNOWN
    is_judged   (n,) whether it is of an unvaried scan, and a marked leg where there are marks
    """

    features: NDArray[np.float32]
    label: NDArray[np.int8]
    is_judged: NDArray[np.bool_]

    def __getitem__(self, chosen: NDArray[np.bool_]) -> Samples:
        return Samples(self.features[chosen], self.label[chosen], self.is_judged[chosen])


def read_samples(folder: Path, bag: Bag, every: int = 1) -> Samples:
    """Clusters of each `every`th scan of a bag, as it is and varied. The same bag gives the same."""
    random = np.random.default_rng([2, *bag.name.encode()])
    scans = _scans(folder / bag.path)
    marks = _marks((folder / bag.path).parents[1] / f"{bag.name}_extracted.bag") if bag.how == "marks" else {}
    still = np.ones((len(scans), 1)) if bag.how == "empty" else still_share(scans)
    parts = []
    for number in range(0, len(scans), every):
        scan = scans[number]
        middles = marks.get(scan.stamp_us)
        is_still = number % STILL_EVERY == 0
        if middles is None and not is_still and (bag.how == "empty" or number % MOVING_EVERY):
            continue
        is_marked = np.zeros(len(scan.ranges_m), bool) if middles is None else marked_beams(scan, middles)
        of_beams = _OfBeams(is_marked, np.broadcast_to(still[number], len(scan.ranges_m)))
        is_judged = middles is not None or bag.how != "marks"
        for variation in range(VARIATIONS + 1):
            part = _samples(scan, of_beams, bag, random, is_varied=variation > 0, is_judged=is_judged)
            parts.append(part if is_still or not variation else part[part.label != OTHER])
    return joined(parts)


def made_up(seeds: Sequence[int]) -> Samples:
    """Clusters of a made-up place for each seed, before lasers of all kinds."""
    parts = []
    for seed in seeds:
        random = np.random.default_rng([1, seed])
        people = int(random.choice(MADE_UP_PEOPLE))
        place = scene(random, people, 30.0, standing=random.uniform(0.2, 0.9))
        for _ in range(SCANS_PER_PLACE):
            x_m, y_m = spot(place.world, random)
            pose = (float(x_m), float(y_m), random.uniform(-math.pi, math.pi))
            scan, whom = seen(place, any_laser(random), pose, int(random.integers(place.rows)), random)
            clusters = find_clusters(scan)
            share = clusters.mean((whom[clusters.beam[clusters.member]] >= 0).astype(np.float64))
            label = np.select([share >= 0.5, share == 0], [LEG, OTHER], UNKNOWN).astype(np.int8)
            parts.append(Samples(describe(scan, clusters), label, np.ones(len(clusters), bool)))
    return joined(parts)


def joined(parts: Sequence[Samples]) -> Samples:
    """All samples of all parts."""
    return Samples(
        np.concatenate([part.features for part in parts]),
        np.concatenate([part.label for part in parts]),
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


@dataclass(frozen=True, eq=False)
class _OfBeams:
    """What is known of each beam (n,): whether it met a marked leg, how often it measured the same."""

    is_marked: NDArray[np.bool_]
    still: NDArray[np.float64]

    def __getitem__(self, chosen: NDArray[np.int64]) -> _OfBeams:
        return _OfBeams(self.is_marked[chosen], self.still[chosen])


def _samples(
    scan: Scan, of_beams: _OfBeams, bag: Bag, random: np.random.Generator, *, is_varied: bool, is_judged: bool
) -> Samples:
    scale, is_mirrored = 1.0, False
    is_put = np.zeros(len(scan.ranges_m), bool)
    if is_varied:
        scale, is_mirrored = float(random.uniform(0.82, 1.2)), bool(random.random() < 0.5)
        scan, of_beams = _resampled(scan, of_beams, scale, is_mirrored, random)
        scan, is_put = _with_people(scan, random)
    clusters = find_clusters(scan)
    described = describe(scan, clusters)
    beam = clusters.beam[clusters.member]
    marked = clusters.mean(of_beams.is_marked[beam].astype(np.float64))
    still, put = clusters.mean(of_beams.still[beam]), clusters.mean(is_put[beam].astype(np.float64))
    middle = clusters.mean(clusters.points_m[clusters.member])
    angle_deg = np.degrees(np.arctan2(middle[:, 1], middle[:, 0])) * (-1 if is_mirrored else 1)
    in_sector = (angle_deg > bag.sector_deg[0]) & (angle_deg < bag.sector_deg[1])
    range_m, width_m = np.hypot(*middle.T) / scale, column(described, "width_m") / scale
    moves = (still < MOVING_SHARE) & (width_m < WIDEST_LEGS_M)
    if bag.how == "marks":
        is_leg = (marked >= 0.5) | (in_sector & (range_m > MARKED_TO_M) & moves)
        is_other = ~(in_sector & (range_m <= MARKED_TO_M)) & (still > STILL_SHARE)
    else:
        is_leg = moves & (range_m < MOVES_TO_M)
        is_other = still > STILL_SHARE
    label = np.select([put >= 0.5, put > 0, is_leg, is_other], [LEG, UNKNOWN, LEG, OTHER], UNKNOWN).astype(
        np.int8
    )
    judged = np.full(len(clusters), is_judged and not is_varied)
    if bag.how == "marks":
        judged &= (marked >= 0.5) | (label == OTHER)
    return Samples(described, label, judged)


def _resampled(
    scan: Scan, of_beams: _OfBeams, scale: float, is_mirrored: bool, random: np.random.Generator
) -> tuple[Scan, _OfBeams]:
    """The scan with fewer beams, of a place of another size, with more noise."""
    skip = float(random.choice(SKIP_BEAMS))
    last = len(scan.ranges_m) - 1
    beam = np.unique(np.minimum(np.round(np.arange(random.uniform(0, skip), last, skip)), last).astype(int))
    ranges = scan.ranges_m[beam] * scale + random.normal(0, random.uniform(0, 0.012), len(beam))
    fewer = replace(
        scan,
        ranges_m=ranges.astype(np.float32),
        angle_min_rad=scan.angle_min_rad + scan.angle_step_rad * float(beam[0]),
        angle_step_rad=scan.angle_step_rad * skip,
        range_max_m=scan.range_max_m * scale,
    )
    if is_mirrored:
        return mirrored(fewer), of_beams[beam[::-1]]
    return fewer, of_beams[beam]


def _with_people(scan: Scan, random: np.random.Generator) -> tuple[Scan, NDArray[np.bool_]]:
    """The scan with made-up people before what it met, and which beams met them."""
    is_put = np.zeros(len(scan.ranges_m), bool)
    height_m = any_height_m(random)
    noise_m = float(random.uniform(0.003, 0.015))
    for _ in range(int(random.choice(PUT_PEOPLE))):
        beam = int(random.integers(len(scan.ranges_m)))
        farthest = float(scan.ranges_m[beam]) if scan.is_return[beam] else 8.0
        if not farthest > 0.9:
            continue
        away_m = random.uniform(0.5, min(farthest, 8.0) - 0.3)
        angle_rad = scan.angles_rad[beam]
        at_m = away_m * np.array([math.cos(angle_rad), math.sin(angle_rad)])
        person, row = passer_by(at_m, height_m, random)
        scan, is_met = before_background(scan, person, row, noise_m, random)
        is_put |= is_met
    return scan, is_put


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
