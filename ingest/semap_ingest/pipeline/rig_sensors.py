"""From what a rig says to sensors with their models; which topics they need."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from semap.errors import InvalidInput
from semap_ingest.image.detector import ImageDetector
from semap_ingest.laser.detector import LegDetector
from semap_ingest.pipeline.image_topics import is_rectified
from semap_ingest.pipeline.rig import CameraEntry, Finder, Laser, Rig
from semap_ingest.pipeline.sensor import Kind, Sensor
from semap_ingest.pipeline.survey import UNKNOWN, Timing
from semap_ingest.pipeline.topics import PARTS
from semap_ingest.recording.box_file import BoxFile
from semap_ingest.recording.gathered import BOX_FILE
from semap_ingest.recording.reading import Topic

LEAST_SCORE = 0.2
"""Of a box that is kept: weak ones go on with tracks, but begin none."""
PARTS_OF: Mapping[Kind, tuple[str, ...]] = {
    "laser": ("scan",), "camera": ("image", "boxes"), "finder": ("poses",),
}  # fmt: skip

CLOUD = "PointCloud2"
POSES = ("PoseWithCovarianceStamped", "PoseStamped")
SLICE = " Of a cloud, slice_m: [LOW, HIGH] makes scans."


def topics_of(rig: Rig, topics: Sequence[Topic]) -> Collection[str]:
    """The topics that a rig needs: of its sensors, their camera_info, tf or odometry.

    raises  InvalidInput for a sensor whose topic is not there or of another type, images without a detector,
            and a camera of which nothing says how it sees
    """
    known = {topic.name: topic for topic in topics if topic.count and topic.is_read}
    infos = {name for name, topic in known.items() if _kind(topic) in PARTS["camera_info"]}
    wanted = {name for name, topic in known.items() if _kind(topic) in PARTS["transforms"]}
    if rig.odometry is not None:
        _require(rig.odometry, known, ("odometry",), "odometry")
        wanted.add(rig.odometry)
    if rig.localisation is not None:
        _require_kind(rig.localisation.topic, known, POSES, "localisation.topic")
        wanted.add(rig.localisation.topic)
    for name, each in rig.sensors.items():
        _require_kind(each.topic, known, kinds_of(each), f"sensors.{name}.topic")
        wanted.add(each.topic)
        if isinstance(each, CameraEntry):
            wanted.update(_infos_of(name, each, known, infos))
            if _kind(known[each.topic]) in PARTS["image"] and each.detector is None:
                raise InvalidInput(
                    "its images need a detector of persons",
                    "Name one in the rig, detector: FILE.onnx, or for all: --camera-model FILE.",
                    f"sensors.{name}",
                )
    return wanted


def _infos_of(
    name: str, camera: CameraEntry, known: Mapping[str, Topic], infos: Collection[str]
) -> Collection[str]:
    if camera.mount is None and camera.frame is None and camera.file is not None:
        raise InvalidInput(
            "nothing says where the camera hangs",
            "Write a homography: four points of the floor and their pixels; or a calibration and a mount.",
            f"sensors.{name}",
        )
    if camera.calibration is not None:
        return ()
    if camera.camera_info is not None:
        _require(camera.camera_info, known, ("camera_info",), f"sensors.{name}.camera_info")
        return (camera.camera_info,)
    if not infos:
        raise InvalidInput(
            f"there is no calibration of the camera that took the images of {camera.topic}",
            "Record its camera_info, write a calibration into a rig, or leave the images out:"
            " --topic image= --topic boxes=",
        )
    return infos


def kinds_of(entry: Laser | CameraEntry | Finder) -> Sequence[str]:
    """The types of messages that a sensor may have."""
    if isinstance(entry, Laser) and entry.slice_m is not None:
        return (CLOUD,)
    if isinstance(entry, CameraEntry) and entry.file is not None:
        return (BOX_FILE,)
    return [kind for part in PARTS_OF[entry.kind] for kind in PARTS[part]]


def box_files_of(rig: Rig) -> list[BoxFile]:
    """The files of boxes that its cameras have."""
    told = [each.boxes() for each in rig.sensors.values() if isinstance(each, CameraEntry)]
    return [each for each in told if each is not None]


def _require(name: str, known: Mapping[str, Topic], parts: Sequence[str], where: str) -> None:
    _require_kind(name, known, [kind for part in parts for kind in PARTS[part]], where)


def _require_kind(name: str, known: Mapping[str, Topic], kinds: Sequence[str], where: str) -> None:
    if name not in known:
        fitting = sorted(each for each, topic in known.items() if _kind(topic) in kinds)
        raise InvalidInput(
            f"there are no messages of the topic {name!r} that semap reads",
            f"Of {' or '.join(kinds)} there are {', '.join(fitting) or 'none'}.",
            where,
        )
    if _kind(known[name]) not in kinds:
        raise InvalidInput(
            f"the topic {name!r} is of the type {known[name].type}",
            f"Name one of {', '.join(kinds)}.{SLICE if _kind(known[name]) == CLOUD else ''}",
            where,
        )


def _kind(topic: Topic) -> str:
    return topic.type.rpartition("/")[2]


def sensors_of(
    rig: Rig,
    timing: Mapping[str, Timing],
    providers: Sequence[str] = ("CPUExecutionProvider",),
    followed: Collection[str] = (),
) -> list[Sensor]:
    """The sensors with their detectors; each model is opened once.

    timing    of their topics, as `survey` tells it
    followed  topics of boxes that somebody else has followed from image to image
    raises  InvalidInput for a model that cannot be used, and sensors that do not fit together
    """
    opened: dict[tuple[Path | None, str | None, Path | None], ImageDetector] = {}
    legs: dict[Path | None, LegDetector] = {}
    sensors = []
    for name, each in rig.sensors.items():
        detector: ImageDetector | LegDetector | None = None
        gap_us = 0.0
        if isinstance(each, Laser):
            detector = legs[each.legs] = legs.get(each.legs) or LegDetector.open(each.legs)
        elif isinstance(each, CameraEntry) and each.detector is not None:
            key = (each.detector, each.layout, each.classes)
            if key not in opened:
                opened[key] = ImageDetector.open(
                    each.detector,
                    layout=each.layout,
                    class_names=each.classes,
                    providers=providers,
                    min_score=LEAST_SCORE,
                )
            detector = opened[key]
            gap_us = least_gap_us(each.images_hz) if each.images_hz else 0.0
        sensor = _sensor(name, each, rig, detector, timing.get(each.topic, UNKNOWN), gap_us)
        sensors.append(replace(sensor, is_followed=each.topic in followed))
    return sensors


def _sensor(
    name: str,
    entry: Laser | CameraEntry | Finder,
    rig: Rig,
    detector: ImageDetector | LegDetector | None,
    timing: Timing,
    gap_us: float,
) -> Sensor:
    camera = entry if isinstance(entry, CameraEntry) else CameraEntry(topic=entry.topic)
    patience_us = timing.patience_us if entry.patience_s is None else round(entry.patience_s * 1e6)
    return Sensor(
        name,
        entry.kind,
        entry.topic,
        detector,
        tells_persons=not isinstance(entry, Laser) or entry.persons,
        slice_m=entry.slice_m if isinstance(entry, Laser) else None,
        partner=camera.laser,
        calibration=None if camera.calibration is None else camera.calibration.camera(),
        info_topic=camera.camera_info,
        is_rectified=is_rectified(camera.topic) if camera.rectified is None else camera.rectified,
        frame=entry.own_frame(name),
        offset_us=round(entry.time_offset_s * 1e6),
        period_us=int(max(timing.period_us, gap_us)),
        patience_us=patience_us,
        least_gap_us=gap_us,
        person_classes=rig.person_classes,
        detected=entry.detection_probability,
    )


def timed(sensor: Sensor, timing: Timing) -> Sensor:
    """The sensor with what has become known of when its records come."""
    return replace(
        sensor,
        period_us=int(max(timing.period_us, sensor.least_gap_us)),
        patience_us=max(timing.patience_us, sensor.patience_us),
    )


def least_gap_us(images_hz: float) -> float:
    """Between two images at this rate, give or take a tenth."""
    return 0.9e6 / images_hz
