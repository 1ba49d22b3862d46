"""Images of a simulated recording, drawn by several processes, each in any order the same."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Generator, Sequence
from concurrent.futures import ProcessPoolExecutor

import cv2
import numpy as np

from semap_ingest.simulation.camera_view import CameraView
from semap_ingest.simulation.floor import CAMERA
from semap_ingest.simulation.localisation import map_from_camera
from semap_ingest.simulation.noise import Stream, noise
from semap_ingest.simulation.schedule import Moments
from semap_ingest.simulation.settings import OfficeSettings

JPEG_QUALITY = 85
AT_ONCE = 30
"""Images that a process draws for one answer."""

PROCESSES = 2
FEW = 60
"""Images that are drawn faster here than processes start."""


class Photographer:
    """State: the camera's view, whose backdrop is drawn once."""

    def __init__(self, settings: OfficeSettings, course: Moments) -> None:
        self._settings, self._course = settings, course
        self._view = CameraView(
            CAMERA, map_from_camera(), course.floor.fixed, noise(settings, Stream.DECORATION)
        )

    def jpeg(self, number: int, time_s: float) -> bytes:
        """The image of a number and a time, a whole JPEG file."""
        moment = self._course.at(time_s)
        leaves = self._course.floor.leaves(moment.door_rad)
        view = self._view.render(moment, leaves, noise(self._settings, Stream.IMAGE, number))
        _, data = cv2.imencode(".jpg", view.pixels[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        return np.asarray(data).tobytes()


def jpegs(
    settings: OfficeSettings, course: Moments, times_s: Sequence[float]
) -> Generator[bytes, None, None]:
    """One image for each time, in their order; close it to stop the processes that draw."""
    numbered = list(enumerate(times_s))
    batches = [numbered[begin : begin + AT_ONCE] for begin in range(0, len(numbered), AT_ONCE)]
    if len(times_s) <= FEW:
        photographer = Photographer(settings, course)
        for batch in batches:
            yield from (photographer.jpeg(*each) for each in batch)
        return
    pool = ProcessPoolExecutor(
        min(PROCESSES, os.cpu_count() or 1),
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_begin,
        initargs=(settings, course),
    )
    try:
        for batch_of_jpegs in pool.map(_drawn, batches):
            yield from batch_of_jpegs
    finally:
        pool.shutdown(cancel_futures=True)


_photographer: list[Photographer] = []
"""Of this process, which draws for another one."""


def _begin(settings: OfficeSettings, course: Moments) -> None:
    # Ctrl-C goes to all of them; the one that asked ends the others.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)
    _photographer.append(Photographer(settings, course))


def _drawn(batch: Sequence[tuple[int, float]]) -> list[bytes]:
    return [_photographer[0].jpeg(number, time_s) for number, time_s in batch]
