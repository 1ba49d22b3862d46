"""Non-maximum suppression: of boxes of one class that overlap, the one with the best score stays."""

from __future__ import annotations

import cv2
import numpy as np

from semap_ingest.image.candidates import Candidates

MOST_CANDIDATES = 1000


def suppress(candidates: Candidates, max_overlap: float) -> Candidates:
    """Greedy, class by class, best score first: a box goes whose IoU with one that stays exceeds max_overlap.

    Only the best 1000 candidates are looked at. Of equal scores the earlier candidate is the better one.
    """
    best_first = candidates[np.argsort(-candidates.score, kind="stable")[:MOST_CANDIDATES]]
    if len(best_first) < 2:
        return best_first
    corners = best_first.corners_px
    # OpenCV holds classes apart by moving each away from the others, which needs coordinates of at least 0.
    low = corners[:, :2] - corners[:, :2].min(axis=0)
    size = corners[:, 2:] - corners[:, :2]
    kept = cv2.dnn.NMSBoxesBatched(
        np.hstack([low, size]).tolist(),
        best_first.score.tolist(),
        best_first.class_number.tolist(),
        0.0,
        max_overlap,
    )
    return best_first[np.sort(np.asarray(kept, dtype=np.int64))]
