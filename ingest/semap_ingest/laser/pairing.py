"""Which two legs are one person's.

Two legs that are each other's nearest, with every other leg clearly further away, are a pair at once.
Where it is not so clear, as in a crowd, the pairs are chosen together: each leg in one pair at most, the
sum of what the pairs are worth as large as can be (`matching`). A pair is worth more the closer its legs
stand, and nothing at the length of a stride. A leg that finds no partner stands for a person whose other leg
is hidden; a cluster too wide for one leg holds both.

Only the NEAREST legs of each are looked at, so that the work grows with the number of legs and no faster.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from semap_ingest.laser.matching import worthiest_matching
from semap_ingest.sensing.clusters import LegClusters

Indices = NDArray[np.int64]

NONE = -1
CLEARLY = 1.5
NEAREST = 12


def pair_legs(
    clusters: LegClusters,
    is_free: NDArray[np.bool_],
    min_score: float = 0.5,
    stride_m: float = 0.75,
    both_m: float = 0.25,
) -> Indices:
    """Persons (n, 2) as indices of clusters, the lower first; the second is -1 for one leg, or both in one.

    is_free    (len(clusters),) whether a cluster may be used
    min_score  a cluster below is no leg
    stride_m   between two legs of one person, at most
    both_m     a cluster at least so wide holds both legs

    In the order of the first index; the same clusters give the same persons.
    """
    is_leg = is_free & (clusters.score >= min_score) & np.isfinite(clusters.centre_m).all(axis=1)
    legs = np.flatnonzero(is_leg & (clusters.width_m < both_m))
    pairs = legs[_pairs(clusters.centre_m[legs], stride_m)]
    singles = np.setdiff1d(np.flatnonzero(is_leg), pairs)
    persons = np.vstack([pairs, np.column_stack([singles, np.full_like(singles, NONE)])])
    return persons[np.argsort(persons[:, 0])]


def _pairs(places_m: NDArray[np.float64], stride_m: float) -> Indices:
    """Which of the places (n, 2) belong together: (k, 2), each row ascending."""
    edges = _near(places_m, stride_m)
    distance = np.hypot(*(places_m[edges[:, 0]] - places_m[edges[:, 1]]).T)
    is_clear = _is_clear(edges, distance, len(places_m))
    taken = np.zeros(len(places_m), bool)
    taken[edges[is_clear]] = True
    is_open = ~taken[edges].any(axis=1)
    doubtful = edges[is_open]
    chosen = worthiest_matching(doubtful, stride_m - distance[is_open])
    return np.vstack([edges[is_clear], doubtful[chosen]])


def _near(places_m: NDArray[np.float64], stride_m: float) -> Indices:
    """Who may belong together (k, 2): each row ascending, all rows in order."""
    count = len(places_m)
    if count < 2:
        return np.empty((0, 2), np.int64)
    _, others = cKDTree(places_m).query(
        places_m, min(NEAREST + 1, count), distance_upper_bound=np.nextafter(stride_m, np.inf)
    )
    here, place = np.nonzero((others < count) & (others != np.arange(count)[:, None]))
    there = others[here, place]
    lower, upper = np.divmod(np.unique(np.minimum(here, there) * count + np.maximum(here, there)), count)
    return np.column_stack([lower, upper])


def _is_clear(edges: Indices, distance: NDArray[np.float64], count: int) -> NDArray[np.bool_]:
    """(k,) whether both ends have no other within CLEARLY times this distance."""
    ends = np.concatenate([edges[:, 0], edges[:, 1]])
    of_end = np.concatenate([distance, distance])
    order = np.lexsort((of_end, ends))
    starts = np.searchsorted(ends[order], np.arange(count))
    ordered = np.append(of_end[order], [np.inf, np.inf])
    nearest = ordered[starts]
    has_second = np.bincount(ends, minlength=count) > 1
    second = np.where(has_second, ordered[np.minimum(starts + 1, len(ordered) - 1)], np.inf)
    is_mutual = (distance <= nearest[edges].T).all(axis=0)
    is_clear: NDArray[np.bool_] = is_mutual & (CLEARLY * distance < second[edges].min(axis=1, initial=np.inf))
    return is_clear
