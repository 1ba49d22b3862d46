"""Which two legs are one person's.

Two legs that are each other's nearest, with every other leg clearly further away, are a pair at once.
Where it is not so clear, as in a crowd, the pairs are chosen together: each leg in one pair at most, the
sum of what the pairs are worth as large as can be (an integer program, solved exactly). A pair is worth
more the closer its legs stand, and nothing at the length of a stride. A leg that finds no partner stands
for a person whose other leg is hidden; a cluster too wide for one leg holds both.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array
from scipy.spatial import cKDTree

from semap_ingest.sensing.clusters import LegClusters

Indices = NDArray[np.int64]

NONE = -1
CLEARLY = 1.5


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
    near = cKDTree(places_m).query_pairs(stride_m, output_type="ndarray") if len(places_m) > 1 else []
    edges = np.asarray(near, np.int64).reshape(-1, 2)
    edges = edges[np.lexsort(edges.T[::-1])]
    distance = np.hypot(*(places_m[edges[:, 0]] - places_m[edges[:, 1]]).T)
    is_clear = _is_clear(edges, distance, len(places_m))
    taken = np.zeros(len(places_m), bool)
    taken[edges[is_clear]] = True
    is_open = ~taken[edges].any(axis=1)
    return np.vstack([edges[is_clear], _best(edges[is_open], stride_m - distance[is_open])])


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


def _best(edges: Indices, worth: NDArray[np.float64]) -> Indices:
    """Of the edges (k, 2) those of the matching that is worth most."""
    if len(edges) < 2:
        return edges
    places, ends = np.unique(edges, return_inverse=True)
    which = np.repeat(np.arange(len(edges)), 2)
    meets = coo_array((np.ones(2 * len(edges)), (ends.ravel(), which)), shape=(len(places), len(edges)))
    found = milp(
        -worth,
        integrality=np.ones(len(edges)),
        bounds=Bounds(0, 1),
        constraints=LinearConstraint(meets.tocsr(), ub=1),
    )
    chosen: Indices = edges[found.x > 0.5]
    return chosen
