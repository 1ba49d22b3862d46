"""A recording through the whole of perception, without a database."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from semap_ingest.pipeline.found import Found
from semap_ingest.pipeline.ingest_recording import Plan, learn_static, perception_of, rig_for
from semap_ingest.pipeline.perception import Perception
from semap_ingest.pipeline.rig_sensors import sensors_of, topics_of
from semap_ingest.pipeline.survey import survey
from semap_ingest.recording.reading import Recording


def perceived(path: Path, **plan: Any) -> tuple[list[Found], Perception]:
    """What follows from each record of it, and what was left out."""
    with Recording(path) as recording:
        rig, _ = rig_for(recording, Plan("map", "robot", path, **plan))
        topics = topics_of(rig, recording.topics)
        recording.frame_at = rig.frame_at()
        timing = survey(recording, [each.topic for each in rig.sensors.values()])
        perception = perception_of(rig, sensors_of(rig, timing))
        learn_static(recording, perception)
        found = [perception.take(each) for each in recording.records(topics)]
        return [*found, perception.flush()], perception
