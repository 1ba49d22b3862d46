"""A detector tried on a picture: whom it finds, whether that can be, and the boxes drawn."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from time import perf_counter

import cv2
import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput
from semap_ingest.image.decoding import BrokenImage, decode
from semap_ingest.image.detector import ImageDetector
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.sensing.image import CompressedImage, Image

OWN = files("semap_ingest") / "models" / "person.jpg"
OWN_PERSON_PX = (5.0, 30.0, 512.0, 600.0)
"""Where the one person in semap's own picture is."""
LEAST_OVERLAP = 0.5
MOST_PERSONS = 300
"""In one picture; more are no persons."""
GREEN = (60, 220, 60)


@dataclass(frozen=True, eq=False)
class Picture:
    """known_px  where a person is in it, for certain; None: somewhere, as its giver says"""

    name: str
    image: Image
    known_px: tuple[float, ...] | None = None


@dataclass(frozen=True, eq=False)
class Trial:
    """suspicion  why it can hardly be a detector of persons that is used rightly; empty: it may be"""

    boxes: Boxes
    duration_s: float
    suspicion: str


def own_picture() -> Picture:
    """One person, whose place is known."""
    return Picture("semap's own picture", _decoded(OWN.read_bytes(), str(OWN)), OWN_PERSON_PX)


def picture_of(path: Path) -> Picture:
    """raises InvalidInput for what is no whole JPEG or PNG"""
    try:
        return Picture(path.name, _decoded(path.read_bytes(), path.name))
    except OSError as error:
        raise InvalidInput(f"cannot be read: {error.strerror}", "Check the path.", str(path)) from error


def try_on(detector: ImageDetector, picture: Picture) -> Trial:
    """raises InvalidInput where its boxes cannot be"""
    began = perf_counter()
    boxes = detector.detect(picture.image)
    return Trial(boxes, perf_counter() - began, _suspicion(boxes, picture))


def drawn(boxes: Boxes, image: Image) -> NDArray[np.uint8]:
    """The image as a JPEG, with the boxes and their scores in it: (n,) bytes."""
    canvas = np.ascontiguousarray(image.pixels[..., ::-1])
    for corners, score in zip(boxes.corners_px.round().astype(int).tolist(), boxes.score, strict=True):
        left, top, right, bottom = corners
        cv2.rectangle(canvas, (left, top), (right - 1, bottom - 1), GREEN, 2)
        place = (left + 3, max(top + 18, 18))
        cv2.putText(canvas, f"{score:.2f}", place, cv2.FONT_HERSHEY_SIMPLEX, 0.6, GREEN, 2)
    return np.asarray(cv2.imencode(".jpg", canvas)[1], np.uint8)


def _suspicion(boxes: Boxes, picture: Picture) -> str:
    if not len(boxes):
        return f"it finds nobody in {picture.name}, which shows persons"
    if len(boxes) > MOST_PERSONS:
        return f"it finds {len(boxes)} persons in {picture.name}"
    if picture.known_px is not None and not _overlaps(boxes, picture.known_px).max() >= LEAST_OVERLAP:
        return f"it finds persons in {picture.name}, but not where one is"
    return ""


def _overlaps(boxes: Boxes, known_px: tuple[float, ...]) -> NDArray[np.float64]:
    """(n,) intersection over union"""
    known = np.array(known_px)
    common = np.minimum(boxes.corners_px[:, 2:], known[2:]) - np.maximum(boxes.corners_px[:, :2], known[:2])
    shared = np.prod(np.clip(common, 0, None), axis=1)
    area = np.prod(boxes.corners_px[:, 2:] - boxes.corners_px[:, :2], axis=1)
    return np.asarray(shared / (area + np.prod(known[2:] - known[:2]) - shared), np.float64)


def _decoded(data: bytes, where: str) -> Image:
    image = decode(CompressedImage(0, "picture", data))
    if isinstance(image, BrokenImage):
        raise InvalidInput(image.reason, "Give a whole JPEG or PNG.", where)
    return image
