"""Boxes and persons that the robot has found itself: vision_msgs, geometry_msgs, those of person trackers.

vision_msgs changed: a hypothesis had an `id` (a number in ROS 1, a text in ROS 2's first releases) and has a
`hypothesis.class_id` since Galactic; the centre of a box had x and y and has a `position` since Humble.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semap_ingest.recording.header import frame_name, stamp_us
from semap_ingest.recording.passed_over import Flaw, Unusable, Why
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.sensing.transform import PersonPoses

UNKNOWN_COVARIANCE = np.full((2, 2), np.nan)


def decode_boxes(message: Any, log_us: int) -> Boxes:
    """A Detection2DArray: the upright box around each, turned, box; its likeliest class.

    A box without a class has the label "" and the score 1. One that is not finite is left out.
    """
    header = _header(message)
    corners = np.array([_corners_px(each.bbox) for each in message.detections], np.float64).reshape(-1, 4)
    kept = np.flatnonzero(np.isfinite(corners).all(axis=1))
    told = [_class_and_score(message.detections[index].results) for index in kept]
    return Boxes(
        stamp_us(header.stamp, log_us),
        frame_name(header.frame_id),
        corners[kept],
        np.array([score for _, score in told], np.float64),
        tuple(label for label, _ in told),
        np.full(len(told), -1, np.int64),
    )


def decode_persons(message: Any, log_us: int, classes: frozenset[str]) -> Iterator[PersonPoses | Flaw]:
    """A Detection3DArray: the middle of the box of each person, or its pose where the box has no size.

    classes  lower-case names that say person; a detection without a class is one, too
    """
    header = _header(message)
    positions, covariances, scores, ids = [], [], [], []
    for each in message.detections:
        label, score = _class_and_score(each.results)
        if label and label.lower() not in classes:
            yield Flaw(Why.OTHER_CLASS, f"the class {label!r} is not one of {', '.join(sorted(classes))}")
            continue
        best = max(each.results, key=_score, default=None)
        size, place = each.bbox.size, each.bbox.center.position
        if best is not None and not (size.x or size.y or size.z):
            place = best.pose.pose.position
        positions.append(_point(place))
        covariances.append(UNKNOWN_COVARIANCE if best is None else _covariance_m2(best.pose.covariance))
        scores.append(score)
        ids.append(str(getattr(each, "id", "") or getattr(each, "tracking_id", "")))
    yield _persons(header, log_us, positions, covariances, scores, ids)


def decode_people(message: Any, log_us: int) -> PersonPoses:
    """A People of people_msgs; how reliable each is, is its score."""
    return _persons(
        message.header,
        log_us,
        [_point(each.position) for each in message.people],
        scores=[_share(each.reliability) for each in message.people],
        ids=[each.name for each in message.people],
    )


def decode_tracked_persons(message: Any, log_us: int) -> Iterator[PersonPoses | Flaw]:
    """A TrackedPersons of spencer_tracking_msgs; whom its tracker does not see now, is left out."""
    seen = [each for each in message.tracks if not each.is_occluded]
    for _ in range(len(message.tracks) - len(seen)):
        yield Flaw(Why.NOT_SEEN, "is_occluded is set: where the person is, is a guess")
    yield _persons(
        message.header,
        log_us,
        [_point(each.pose.pose.position) for each in seen],
        [_covariance_m2(each.pose.covariance) for each in seen],
        ids=[each.track_id for each in seen],
    )


def decode_detected_persons(message: Any, log_us: int) -> PersonPoses:
    """A DetectedPersons of spencer_tracking_msgs; its ids are of detections, and say nothing of who it is."""
    return _persons(
        message.header,
        log_us,
        [_point(each.pose.pose.position) for each in message.detections],
        [_covariance_m2(each.pose.covariance) for each in message.detections],
        [_share(each.confidence) for each in message.detections],
    )


def decode_person_array(message: Any, log_us: int) -> PersonPoses:
    """A PersonArray of leg_tracker."""
    return _persons(
        message.header,
        log_us,
        [_point(each.pose.position) for each in message.people],
        ids=[each.id for each in message.people],
    )


def decode_pose(message: Any, log_us: int) -> PersonPoses:
    """A PoseStamped: one person."""
    return _persons(message.header, log_us, [_point(message.pose.position)])


def decode_pose_array(message: Any, log_us: int) -> PersonPoses:
    """A PoseArray: one person each."""
    return _persons(message.header, log_us, [_point(pose.position) for pose in message.poses])


def decode_uncertain_pose(message: Any, log_us: int) -> PersonPoses:
    """A PoseWithCovarianceStamped: one person."""
    told = message.pose
    return _persons(
        message.header, log_us, [_point(told.pose.position)], [_covariance_m2(told.covariance)], [1.0]
    )


def _persons(
    header: Any,
    log_us: int,
    positions: Iterable[tuple[float, float, float]],
    covariances: Iterable[NDArray[np.float64]] | None = None,
    scores: Iterable[float] | None = None,
    ids: Iterable[str | int] | None = None,
) -> PersonPoses:
    """Those with a position that is finite."""
    position_m = np.array(list(positions), np.float64).reshape(-1, 3)
    many = len(position_m)
    covariance_m2 = np.array(
        [UNKNOWN_COVARIANCE] * many if covariances is None else list(covariances), np.float64
    ).reshape(-1, 2, 2)
    score = np.ones(many) if scores is None else np.array(list(scores), np.float64)
    names = [""] * many if ids is None else [str(each) for each in ids]
    times = Counter(names)
    is_told = np.isfinite(position_m).all(axis=1)
    return PersonPoses(
        stamp_us(header.stamp, log_us),
        frame_name(header.frame_id),
        position_m[is_told],
        covariance_m2[is_told],
        score[is_told],
        tuple(names[row] if times[names[row]] == 1 else "" for row in np.flatnonzero(is_told)),
    )


def _header(message: Any) -> Any:
    """Of the array; of its first detection where the array has no frame."""
    if message.header.frame_id or not message.detections:
        return message.header
    return message.detections[0].header


def _score(hypothesis: Any) -> float:
    return _share(getattr(hypothesis, "hypothesis", hypothesis).score)


def _share(told: Any) -> float:
    """From 0 to 1."""
    value = float(told)
    return min(max(value, 0.0), 1.0) if math.isfinite(value) else 0.0


def _class_and_score(results: list[Any]) -> tuple[str, float]:
    """Of the likeliest hypothesis; "" and 1 where there is none."""
    if not results:
        return "", 1.0
    best = max(results, key=_score)
    label = best.hypothesis.class_id if hasattr(best, "hypothesis") else best.id
    return str(label), _score(best)


def _corners_px(box: Any) -> tuple[float, float, float, float]:
    middle = getattr(box.center, "position", box.center)
    if box.size_x < 0 or box.size_y < 0:
        raise Unusable(f"a box of {box.size_x} by {box.size_y} px")
    cosine, sine = abs(math.cos(box.center.theta)), abs(math.sin(box.center.theta))
    half_x = (box.size_x * cosine + box.size_y * sine) / 2
    half_y = (box.size_x * sine + box.size_y * cosine) / 2
    return middle.x - half_x, middle.y - half_y, middle.x + half_x, middle.y + half_y


def _point(point: Any) -> tuple[float, float, float]:
    return point.x, point.y, point.z


def _covariance_m2(told: Any) -> NDArray[np.float64]:
    """Of x and y out of the 6x6 of a pose; NaN where that is no covariance, such as all zero: not told."""
    of_xy = np.array(told, np.float64).reshape(6, 6)[:2, :2]
    if np.isfinite(of_xy).all() and of_xy[0, 0] > 0 and np.linalg.det(of_xy) > 0:
        return of_xy
    return UNKNOWN_COVARIANCE
