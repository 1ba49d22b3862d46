"""Boxes of persons in a text file of MOTChallenge, a line each: frame, id, x, y, width, height, confidence.

Frames count from 1 at a constant rate. One that has no line is an image in which nobody was found; the file
tells nothing before its first and after its last. An id below 0 says that nobody followed the box.
"""

from __future__ import annotations

import configparser
import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from semap.errors import InvalidInput
from semap.formats.refusals import Refusals
from semap.timeline.stamp import to_datetime
from semap_ingest.sensing.boxes import Boxes

COLUMNS = "frame,id,x,y,w,h,conf"
LEAST_COLUMNS = 6
REMEDY = f"Give lines of {COLUMNS}, as of MOTChallenge."
MOST_FRAMES = 10_000_000
MOST_ID = 2**31
MOST_BEYOND = 1.5
"""Boxes may go on beyond the border of the image; so many times its size they do not."""
UNTOLD = -1.0
"""A confidence that says nothing."""
PERSON = "person"


@dataclass(frozen=True)
class BoxFile:
    """Where it is, and what its numbers mean.

    topic     by which its boxes are known
    start_us  when frame 1 was taken
    rate_hz   None: as its seqinfo.ini says
    scores    confidences that count as 0 and as 1
    size_px   of the image, where it is known
    """

    path: Path
    topic: str
    start_us: int
    rate_hz: float | None = None
    scores: tuple[float, float] = (0.0, 1.0)
    size_px: tuple[int, int] | None = None


@dataclass(frozen=True)
class _Row:
    frame: int
    id: int
    corners_px: tuple[float, float, float, float]
    score: float


@dataclass(frozen=True, eq=False)
class FileOfBoxes:
    """One that was read: rows by frame.

    has_ids  whether each box says who it is
    """

    topic: str
    start_us: int
    end_us: int
    has_ids: bool
    _first: int
    _last: int
    _told: BoxFile
    _rate_hz: float
    _rows: dict[int, list[_Row]]

    @property
    def count(self) -> int:
        return self._last - self._first + 1

    def boxes(self) -> Iterator[Boxes]:
        """Those of each frame from the first to the last."""
        for frame in range(self._first, self._last + 1):
            rows = self._rows.get(frame, ())
            yield Boxes(
                _stamp_us(self._told.start_us, frame, self._rate_hz),
                "",
                np.array([row.corners_px for row in rows], np.float64).reshape(-1, 4),
                np.array([row.score for row in rows], np.float64),
                (PERSON,) * len(rows),
                np.array([row.id for row in rows], np.int64),
            )


def read_boxes(told: BoxFile) -> FileOfBoxes:
    """raises InvalidInput, which names each line that is wrong and what to write there"""
    where = told.topic
    try:
        lines = told.path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise InvalidInput(f"cannot be read: {error.strerror}", "Check the path.", where) from error
    except UnicodeDecodeError as error:
        raise InvalidInput("no text of boxes", REMEDY, where) from error
    rate_hz = _rate_hz(told)
    by_frame: dict[int, list[_Row]] = defaultdict(list)
    refusals = Refusals()
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        with refusals.of_part(number):
            row = _row(line, told, f"{where}:{number}")
            if row.id >= 0 and any(row.id == other.id for other in by_frame[row.frame]):
                raise InvalidInput(
                    f"the id {row.id} is there twice in frame {row.frame}",
                    "Give each person an id of its own, or -1 to all boxes.",
                    f"{where}:{number}",
                )
            by_frame[row.frame].append(row)
    refusals.raise_if_any("lines", where)
    if not by_frame:
        raise InvalidInput("it has no boxes", REMEDY, where)
    _check_size(told, by_frame)
    first, last = min(by_frame), max(by_frame)
    return FileOfBoxes(
        where,
        _stamp_us(told.start_us, first, rate_hz),
        _stamp_us(told.start_us, last, rate_hz),
        all(row.id >= 0 for rows in by_frame.values() for row in rows),
        first,
        last,
        told,
        rate_hz,
        by_frame,
    )


def _stamp_us(start_us: int, frame: int, rate_hz: float) -> int:
    return start_us + round((frame - 1) / rate_hz * 1e6)


def _row(line: str, told: BoxFile, where: str) -> _Row:
    texts = line.split(",")
    if len(texts) < LEAST_COLUMNS:
        raise InvalidInput(f"{len(texts)} values in a line", f"Write {COLUMNS}, with commas between.", where)
    values = []
    for name, text in zip(COLUMNS.split(","), texts, strict=False):
        try:
            values.append(float(text))
        except ValueError:
            values.append(math.nan)
        if not math.isfinite(values[-1]):
            raise InvalidInput(
                f"{name} is no finite number: {text.strip()[:20]!r}",
                f"Write {COLUMNS} as numbers, with a point for decimals, and no line of headings.",
                where,
            )
    frame, known_as, x, y, width, height, *more = values
    if frame != int(frame) or not 0 <= frame <= MOST_FRAMES:
        raise InvalidInput(
            f"there is no frame {texts[0].strip()}",
            "Number the frames of the video from 1, not stamps.",
            where,
        )
    if known_as != int(known_as) or known_as >= MOST_ID:
        raise InvalidInput(
            f"an id of {texts[1].strip()}",
            "Give whole numbers from 0 on, or -1 where nobody followed.",
            where,
        )
    if width <= 0 or height <= 0:
        raise InvalidInput(
            f"a box of {width:g} x {height:g} px",
            "Write the upper left corner, then width and height.",
            where,
        )
    return _Row(
        int(frame), max(int(known_as), -1), (x, y, x + width, y + height), _score(more, told.scores, where)
    )


def _score(told: list[float], scores: tuple[float, float], where: str) -> float:
    low, high = scores
    if not told or (told[0] == UNTOLD and low > UNTOLD):
        return 1.0
    if scores == (0.0, 1.0) and not 0 <= told[0] <= 1:
        raise InvalidInput(
            f"a confidence of {told[0]:g} is no probability",
            "Say which confidences count as 0 and as 1: scores: [LOW, HIGH].",
            where,
        )
    return min(max((told[0] - low) / (high - low), 0.0), 1.0)


def _check_size(told: BoxFile, by_frame: dict[int, list[_Row]]) -> None:
    if told.size_px is None:
        return
    corners = np.array([row.corners_px for rows in by_frame.values() for row in rows])
    (width, height), reach = told.size_px, np.percentile(corners[:, 2:], 99, axis=0)
    if (reach > MOST_BEYOND * np.array(told.size_px)).any():
        raise InvalidInput(
            f"its boxes reach to {reach[0]:.0f}, {reach[1]:.0f} px in images of {width} x {height} px",
            "Give the calibration or the homography of images as large as those in which they were found.",
            told.topic,
        )


def _rate_hz(told: BoxFile) -> float:
    """raises InvalidInput where nothing tells it, or two things differ"""
    info = next((folder / "seqinfo.ini" for folder in list(told.path.resolve().parents)[:2]
                 if (folder / "seqinfo.ini").is_file()), None)  # fmt: skip
    said: float | None = None
    if info is not None:
        parser = configparser.ConfigParser(interpolation=None)
        try:
            parser.read(info, encoding="utf-8")
            said = parser.getfloat("Sequence", "frameRate", fallback=None)
        except (configparser.Error, ValueError, OSError) as error:
            if told.rate_hz is None:
                raise InvalidInput(
                    f"{info.name} beside it cannot be read: {error}",
                    "Correct it, or give rate_hz.",
                    told.topic,
                ) from error
    if told.rate_hz is None and not (said is not None and math.isfinite(said) and said > 0):
        raise InvalidInput("nothing says its frame rate", "Give rate_hz: frames a second.", told.topic)
    if told.rate_hz is not None and said and abs(told.rate_hz / said - 1) > 0.01:
        raise InvalidInput(
            f"a rate of {told.rate_hz:g} Hz, and seqinfo.ini beside it says {said:g}",
            "Correct rate_hz, or leave it out.",
            told.topic,
        )
    return told.rate_hz or said or 0.0


def span(start_us: int, end_us: int) -> str:
    """For people."""
    return f"{to_datetime(start_us):%Y-%m-%d %H:%M:%S} to {to_datetime(end_us):%Y-%m-%d %H:%M:%S} UTC"
