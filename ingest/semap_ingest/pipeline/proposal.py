"""From parts to a rig: what semap takes for the sensors where nobody writes a rig."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path

from semap_ingest.pipeline.rig import CameraEntry, Entry, Finder, Fixed, Laser, Rig
from semap_ingest.pipeline.topics import Parts
from semap_ingest.recording.reading import PERSON_CLASSES


@dataclass(frozen=True)
class Wishes:
    """What options say of all sensors together, instead of a rig.

    image_model  ONNX file of the image detector; None: images are not looked at
    image_layout, class_names  of its outputs, and a file of its classes, where the model does not tell
    images_hz    at most so many images a second are looked at; None: all
    person_classes  what the robot calls persons, where it has found them by itself
    fixed        transforms that hold whatever the records say
    transform_patience_s  how long records wait for their transform; None: until it comes
    """

    map_frame: str = "map"
    floor_z_m: float = 0.0
    image_model: Path | None = None
    image_layout: str | None = None
    class_names: Path | None = None
    images_hz: float | None = None
    person_classes: Sequence[str] = PERSON_CLASSES
    fixed: Sequence[Fixed] = field(default=())
    transform_patience_s: float | None = None


def rig_of(parts: Parts, wishes: Wishes) -> Rig:
    """A sensor for each topic, called as the topic; cameras and lasers paired by what their names share.

    Where poses are given, lasers tell of lines only, and there are no cameras.
    """
    finds = parts.has("poses")
    sensors: dict[str, Entry] = {
        name: Laser(topic=name, persons=not finds) for name in parts.topics.get("scan", ())
    }
    cameras = () if finds else (*parts.topics.get("image", ()), *parts.topics.get("boxes", ()))
    partner_of = _partners(cameras, list(sensors) if not finds else [])
    for name in cameras:
        sensors[name] = CameraEntry(
            topic=name,
            camera_info=parts.infos.get(name),
            layout=wishes.image_layout,
            classes=wishes.class_names,
            images_hz=wishes.images_hz,
            laser=partner_of.get(name),
        ).detecting(wishes.image_model if name in parts.topics.get("image", ()) else None)
    for name in parts.topics.get("poses", ()):
        sensors[name] = Finder(topic=name)
    odometry = parts.topics.get("odometry", ())
    return Rig(
        frame=wishes.map_frame,
        floor_z_m=wishes.floor_z_m,
        transforms=tuple(wishes.fixed),
        transform_patience_s=wishes.transform_patience_s,
        odometry=odometry[0] if odometry else None,
        person_classes=tuple(wishes.person_classes),
    ).model_copy(update={"sensors": sensors})


def _shared(one: str, other: str) -> int:
    """So many of the folders that topics lie in are the same."""
    pairs = zip(one.split("/"), other.split("/"), strict=False)
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))


def _partners(cameras: Sequence[str], lasers: Sequence[str]) -> Mapping[str, str]:
    """Each camera's laser, each laser for one camera at most: those whose names share most first."""
    ranked = sorted(
        ((camera, laser) for camera in cameras for laser in lasers),
        key=lambda pair: (-_shared(*pair), pair),
    )
    found: dict[str, str] = {}
    for camera, laser in ranked:
        if camera not in found and laser not in found.values():
            found[camera] = laser
    return found
