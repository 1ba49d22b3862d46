"""A recording and files of boxes, played as one; either may be missing."""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterator, Sequence
from types import TracebackType
from typing import Self

from semap.errors import InvalidInput
from semap_ingest.recording.box_file import BoxFile, FileOfBoxes, read_boxes, span
from semap_ingest.recording.passed_over import PassedOver
from semap_ingest.recording.reading import Received, Recording, Topic

BOX_FILE = "MOT"
"""As the type of a topic."""


class Gathered:
    """A context manager, as a Recording is: it closes the recording that it was given.

    topics  of the recording, and the files as topics of their own
    """

    def __init__(self, recording: Recording | None, files: Sequence[BoxFile] = ()) -> None:
        """raises InvalidInput for files that cannot be used, and for one of another time"""
        self._recording = recording
        self._files = {told.topic: read_boxes(told) for told in files}
        if recording is not None:
            for each in self._files.values():
                _require_overlap(each, recording)
        topics = [Topic(each.topic, BOX_FILE, each.count) for each in self._files.values()]
        self.topics = (*(recording.topics if recording else ()), *topics)
        spans = [each for each in (recording, *self._files.values()) if each is not None]
        if not spans:
            raise InvalidInput(
                "there is no recording, and no sensor of the rig has a file",
                "Name the recording, or write file: into the rig.",
            )
        self.start_us, self.end_us = min(e.start_us for e in spans), max(e.end_us for e in spans)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._recording is not None:
            self._recording.close()

    @property
    def passed_over(self) -> tuple[PassedOver, ...]:
        return () if self._recording is None else self._recording.passed_over

    @property
    def followed(self) -> Collection[str]:
        """Topics of boxes that each say who it is."""
        return {topic for topic, each in self._files.items() if each.has_ids}

    def records(self, topics: Collection[str]) -> Iterator[Received]:
        """Those of these topics in the order in which they were sent; boxes of files, when they were seen."""
        streams = [_played(each) for topic, each in self._files.items() if topic in topics]
        others = [each for each in topics if each not in self._files]
        if self._recording is not None and others:
            streams.insert(0, self._recording.records(others))
        return heapq.merge(*streams, key=lambda each: each.sent_us)


def _played(file: FileOfBoxes) -> Iterator[Received]:
    return (Received(boxes.stamp_us, file.topic, boxes) for boxes in file.boxes())


def _require_overlap(file: FileOfBoxes, recording: Recording) -> None:
    if file.end_us < recording.start_us or file.start_us > recording.end_us:
        raise InvalidInput(
            f"its boxes are of {span(file.start_us, file.end_us)}, and the recording is of"
            f" {span(recording.start_us, recording.end_us)}",
            "Correct start, or rate_hz.",
            file.topic,
        )
