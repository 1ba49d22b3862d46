"""A rig: which sensors there are, where they are fixed, and how they are looked at. A YAML file says it:

    frame: map                       # the records' frame that is the map's
    floor_z_m: 0.0
    sensors:
      front: {kind: laser, topic: /front/scan}
      entrance:
        kind: camera
        topic: /entrance/image/compressed
        calibration: {width_px: 640, height_px: 480, fx_px: 500, fy_px: 500, cx_px: 320, cy_px: 240}
        mount: {parent: map, xyz_m: [4, 2, 2.4], rpy_rad: [-2.1, 0, 1.57]}
        detector: yolov8n.onnx
      robot_eyes: {kind: finder, topic: /people, patience_s: 1}
    transforms:
      - {parent: base_link, child: laser, xyz_m: [0.2, 0, 0.3]}

Paths in it are meant from the folder of the file. What it fixes holds whatever the records say.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import (
    AfterValidator,
    AwareDatetime,
    BaseModel,
    ConfigDict,
    Field,
    ValidationInfo,
    model_validator,
)
from scipy.spatial.transform import Rotation

from semap.errors import InvalidInput
from semap.formats.checked_node import checked
from semap.formats.refusals import Refusals
from semap.formats.yaml_node import parse_yaml
from semap.timeline.stamp import to_us
from semap_ingest.fusion.floor_homography import SeenFloor, camera_over
from semap_ingest.image.added import added_as
from semap_ingest.recording.box_file import BoxFile
from semap_ingest.recording.reading import PERSON_CLASSES
from semap_ingest.sensing.detections import DETECTED
from semap_ingest.sensing.image import Camera
from semap_ingest.sensing.transform import Transform
from semap_ingest.tracking.existence import Existence

Frame = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(lambda name: name.lstrip("/"))]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Pair = tuple[Finite, Finite]
Triple = tuple[Finite, Finite, Finite]
Share = Annotated[float, Field(gt=0, le=1)]
USUAL = Existence()


def _from_folder(path: Path, info: ValidationInfo) -> Path:
    folder: Path = (info.context or {}).get("folder", Path())
    return folder / path


def _ascending(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] >= pair[1]:
        raise ValueError("the lower one comes first")
    return pair


RigPath = Annotated[Path, AfterValidator(_from_folder)]
Ascending = Annotated[Pair, AfterValidator(_ascending)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Mount(_Part):
    """Where something is fixed in its parent's frame."""

    parent: Frame = Field(description="The frame that it is fixed in, such as base_link or map.")
    xyz_m: Triple = Field(default=(0.0, 0.0, 0.0), description="Its origin in the parent [m].")
    rpy_rad: Triple = Field(
        default=(0.0, 0.0, 0.0),
        description="Roll, pitch and yaw [rad], turned about the parent's x, then y, then z, as in URDF.",
    )

    def transform(self, child: str) -> Transform:
        """The static transform of a child that is fixed so."""
        turn = Rotation.from_euler("xyz", self.rpy_rad).as_quat()
        return Transform(0, self.parent, child, np.array(self.xyz_m), turn, is_static=True)


class Fixed(Mount):
    """A transform that holds at all times."""

    child: Frame = Field(description="The frame whose place is told.")


def fixed_transforms(said: Sequence[str]) -> tuple[Fixed, ...]:
    """Transforms as an option gives them: parent, child, x y z [m], roll pitch yaw [rad].

    raises  InvalidInput for what is not that, a frame in itself, and one that is told twice
    """
    found: dict[str, Fixed] = {}
    for each in said:
        try:
            parent, child, *numbers = each.split()
            x, y, z, roll, pitch, yaw = map(float, numbers)
            fixed = Fixed(parent=parent, child=child, xyz_m=(x, y, z), rpy_rad=(roll, pitch, yaw))
        except ValueError as error:
            raise InvalidInput(
                f"{each!r} is no transform",
                "Write PARENT CHILD x y z roll pitch yaw, in metres and radians, such as"
                " base_link laser 0.2 0 0.3 0 0 0.",
                "--transform",
            ) from error
        if fixed.parent == fixed.child or fixed.child in found:
            raise InvalidInput(
                f"{fixed.child} is in itself, or named twice", "Give each frame one parent.", "--transform"
            )
        found[fixed.child] = fixed
    return tuple(found.values())


class Calibration(_Part):
    """How a camera sees, as CameraInfo says it."""

    width_px: int = Field(gt=0)
    height_px: int = Field(gt=0)
    fx_px: float = Field(gt=0, allow_inf_nan=False)
    fy_px: float = Field(gt=0, allow_inf_nan=False)
    cx_px: Finite
    cy_px: Finite
    distortion: tuple[Finite, ...] = Field(default=(), description="D of CameraInfo: k1 k2 p1 p2 k3 ...")
    model: Literal["plumb_bob", "rational_polynomial", "equidistant"] = "plumb_bob"

    def camera(self) -> Camera:
        matrix = np.array([[self.fx_px, 0, self.cx_px], [0, self.fy_px, self.cy_px], [0, 0, 1]])
        return Camera("", self.width_px, self.height_px, matrix, np.array(self.distortion), self.model)


class FloorPoints(_Part):
    """Points of the floor and where they are in the image of a camera: its calibration and its mount."""

    width_px: int = Field(gt=0)
    height_px: int = Field(gt=0)
    pixels: tuple[Pair, ...] = Field(min_length=4, description="x and y from the upper left corner.")
    floor_m: tuple[Pair, ...] = Field(min_length=4, description="The same points in the map, in this order.")
    focal_px: float | None = Field(
        default=None, gt=0, allow_inf_nan=False, description="Of the lens. [default: as the points tell]"
    )

    @model_validator(mode="after")
    def _as_many(self) -> Self:
        if len(self.pixels) != len(self.floor_m):
            raise ValueError("give as many points as pixels")
        return self

    def seen(self, floor_z_m: float) -> SeenFloor:
        """The camera that sees them so; raises InvalidInput where none does."""
        size, floor = (self.width_px, self.height_px), np.array(self.floor_m)
        return camera_over(floor, np.array(self.pixels), size, floor_z_m, self.focal_px)


class Entry(_Part):
    """What may be said of every sensor."""

    topic: str = Field(min_length=1, description="Of its records.")
    frame: Frame | None = Field(default=None, description="In which it sees. [default: as its records say]")
    mount: Mount | None = Field(
        default=None, description="Where its frame is fixed; then `frame` may be left out."
    )
    time_offset_s: Finite = Field(
        default=0.0, description="Added to its stamps [s], for a clock that is off."
    )
    patience_s: float | None = Field(
        default=None, ge=0, le=60,
        description="How far behind the newest of all records it is waited for [s]. [default: measured]",
    )  # fmt: skip
    detection_probability: Share = Field(
        default=DETECTED, lt=1, description="That it detects a person in its sight."
    )

    def own_frame(self, name: str) -> str | None:
        """The frame in which it sees, if not that of its records; a mount makes one."""
        return self.frame or (None if self.mount is None else f"{name} (rig)")


class Laser(Entry):
    """Scans: legs of persons, and lines."""

    kind: Literal["laser"] = "laser"
    persons: bool = Field(default=True, description="false: it tells of doors only.")
    legs: RigPath | None = Field(default=None, description="Classifier of legs. [default: semap's own]")
    slice_m: Ascending | None = Field(
        default=None,
        description="Of a PointCloud2: two heights in its frame [m], between which its points make a scan.",
    )


class CameraEntry(Entry):
    """Images, or boxes of persons that were found in them, in messages or in a file."""

    kind: Literal["camera"] = "camera"
    file: RigPath | None = Field(
        default=None, description="In place of a topic: boxes in MOT format, frame,id,x,y,w,h,conf,..."
    )
    start: AwareDatetime | None = Field(
        default=None, description="When frame 1 of the file was taken, such as 2026-01-05T09:15:00Z."
    )
    rate_hz: float | None = Field(
        default=None, gt=0, le=1000, description="Frames of the file a second. [default: as seqinfo.ini says]"
    )
    scores: Ascending = Field(
        default=(0.0, 1.0), description="Which confidences of the file count as 0 and as 1."
    )
    camera_info: str | None = Field(
        default=None, description="Topic of its CameraInfo. [default: the one of its images' frame]"
    )
    calibration: Calibration | None = Field(default=None, description="In place of a CameraInfo.")
    homography: FloorPoints | None = Field(
        default=None, description="In place of calibration and mount: four points of the floor."
    )
    rectified: bool | None = Field(
        default=None,
        description="Its images are without distortion: P of CameraInfo holds. [default: as its topic is"
        " called]",
    )
    detector: RigPath | None = Field(
        default=None, description="ONNX file, or name of one that was added. [default: --camera-model]"
    )
    layout: str | None = Field(default=None, description="Of its outputs, where the file is ambiguous.")
    classes: RigPath | None = Field(default=None, description="File of its classes, where it has none.")
    images_hz: float | None = Field(default=None, gt=0, description="So many images a second, at most.")
    laser: str | None = Field(
        default=None, description="The laser with whose legs its boxes are fused, where both see the same."
    )

    @model_validator(mode="before")
    @classmethod
    def _known_by(cls, said: object) -> object:
        """What has a file in place of a topic is known by that."""
        if not isinstance(said, dict) or "file" not in said:
            return said
        others = {"topic", "detector", "layout", "classes", "images_hz"} & said.keys()
        if others:
            raise ValueError(f"file says where its boxes are: leave out {', '.join(sorted(others))}")
        return {**said, "topic": str(said["file"])}

    @model_validator(mode="after")
    def _of_a_file(self) -> Self:
        of_files = {"start", "rate_hz", "scores"} & self.model_fields_set
        if self.file is None and of_files:
            raise ValueError(f"{', '.join(sorted(of_files))} without a file")
        if self.file is not None and self.start is None:
            raise ValueError("its file has no stamps: write start, when frame 1 was taken")
        return self

    def boxes(self) -> BoxFile | None:
        """Its file, where it has one."""
        if self.file is None or self.start is None:
            return None
        seen = self.calibration
        size = None if seen is None else (seen.width_px, seen.height_px)
        return BoxFile(self.file, self.topic, to_us(self.start), self.rate_hz, self.scores, size)

    def hung(self, map_frame: str, floor_z_m: float) -> CameraEntry:
        """With the calibration and the mount that its homography tells."""
        told = self.homography
        if told is None:
            return self
        seen = told.seen(floor_z_m)
        turn = Rotation.from_matrix(seen.map_T_camera[:3, :3]).as_euler("xyz")
        calibration = Calibration(
            width_px=told.width_px, height_px=told.height_px, fx_px=seen.focal_px, fy_px=seen.focal_px,
            cx_px=told.width_px / 2, cy_px=told.height_px / 2,
        )  # fmt: skip
        x, y, z = seen.map_T_camera[:3, 3].tolist()
        roll, pitch, yaw = turn.tolist()
        mount = Mount(parent=map_frame, xyz_m=(x, y, z), rpy_rad=(roll, pitch, yaw))
        return self.model_copy(update={"calibration": calibration, "mount": mount})

    def detecting(self, model: Path | None) -> CameraEntry:
        """The same, and this is its detector if it names none; one that was added by name is looked up."""
        if self.file is not None:
            return self
        model = self.detector or model
        known = None if model is None else added_as(model)
        if known is None:
            return self.model_copy(update={"detector": model})
        layout, classes = self.layout or known.layout, self.classes or known.classes
        return self.model_copy(update={"detector": known.model, "layout": layout, "classes": classes})


class Finder(Entry):
    """Persons whom somebody else has found."""

    kind: Literal["finder"] = "finder"


Sensors = Mapping[str, Laser | CameraEntry | Finder]
KINDS: Mapping[str, type[Laser | CameraEntry | Finder]] = {
    "laser": Laser, "camera": CameraEntry, "finder": Finder,
}  # fmt: skip


class Confirmation(_Part):
    """When a track is believed; as `Existence` says it."""

    probability: Share = Field(
        default=USUAL.believed, lt=1, description="A track is told that is a person so probably."
    )
    leg_score: Share = Field(
        default=USUAL.neutral_laser,
        lt=1,
        description="What a laser alone sees speaks for a person from this score on.",
    )

    def existence(self) -> Existence:
        return replace(USUAL, believed=self.probability, neutral_laser=self.leg_score)


class Localised(_Part):
    """Where the robot is in the map, where tf tells only where it is in its odometry."""

    topic: str = Field(min_length=1, description="Of its PoseWithCovarianceStamped or PoseStamped.")
    frame: Frame = Field(default="base_link", description="The robot's own frame.")


class Rig(_Part):
    """All sensors of a recording or a robot."""

    frame: Frame = Field(default="map", description="The records' frame that is the map's.")
    floor_z_m: Finite = Field(default=0.0, description="Height of the floor in it [m].")
    sensors: Sensors = Field(default_factory=dict)
    transforms: tuple[Fixed, ...] = Field(default=(), description="That hold whatever the records say.")
    odometry: str | None = Field(default=None, description="Topic of an Odometry that stands in for tf.")
    localisation: Localised | None = Field(
        default=None, description="Topic of the robot's pose in the map, where tf ends at odom."
    )
    transform_patience_s: float | None = Field(
        default=None,
        ge=0,
        description="How long records wait for their transform, in event time [s]. [default: until it comes]",
    )
    person_classes: tuple[str, ...] = Field(
        default=PERSON_CLASSES, description="What boxes and detections call a person."
    )
    confirmation: Confirmation = Confirmation()

    def fixed(self) -> list[Transform]:
        """The transforms that hold at all times."""
        mounts = [
            each.mount.transform(each.own_frame(name) or "")
            for name, each in self.sensors.items()
            if each.mount is not None
        ]
        return [*(each.transform(each.child) for each in self.transforms), *mounts]

    def frame_at(self) -> Mapping[str, str]:
        """Topics of poses that say where a frame is, and which."""
        told = self.localisation
        return {} if told is None else {told.topic: told.frame}

    def detecting(self, model: Path | None) -> Rig:
        """The same, and this is the detector of every camera that names none."""
        sensors = {
            name: each.detecting(model) if isinstance(each, CameraEntry) else each
            for name, each in self.sensors.items()
        }
        return self.model_copy(update={"sensors": sensors})

    def said(self) -> str:
        """All that it says but where its models lie."""
        files = {"detector", "classes", "legs", "file"}
        sensors = {name: each.model_dump(exclude=files) for name, each in self.sensors.items()}
        return repr((self.model_dump(exclude={"sensors"}), sorted(sensors.items())))

    def files(self) -> list[Path]:
        """The models, and the boxes, that it names."""
        found = []
        for each in self.sensors.values():
            if isinstance(each, CameraEntry):
                found += [file for file in (each.detector, each.classes, each.file) if file is not None]
            elif isinstance(each, Laser) and each.legs is not None:
                found.append(each.legs)
        return found


def read_rig(path: Path) -> Rig:
    """raises InvalidInput, which names each line that is wrong and what to write there"""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InvalidInput(
            f"cannot be read: {error.strerror}",
            "Name a rig's file; `semap rig check RECORDING` proposes one.",
            str(path),
        ) from error
    document = parse_yaml(data, str(path))
    document.fields(Rig.model_fields)
    folder = {"folder": path.resolve().parent}
    refusals = Refusals()
    sensors: dict[str, Laser | CameraEntry | Finder] = {}
    rest = None
    nodes = document.mapping().get("sensors")
    if nodes is None or not nodes.mapping():
        raise document.wrong("there are no sensors", "Write sensors: and a name for each.")
    for name, node in nodes.mapping().items():
        with refusals.of_part(node.mark.line):
            kind = node.mapping().get("kind")
            if kind is None:
                raise node.wrong(f"{name} has no kind", f"Write kind: and one of {', '.join(KINDS)}.")
            sensors[name] = checked(node, KINDS[kind.one_of(KINDS)], folder)
    with refusals.of_part(-1):
        others = {key: node for key, node in document.mapping().items() if key != "sensors"}
        rest = checked(type(document)(others, "", document.file, document.mark, document.keys), Rig, folder)
    refusals.raise_if_any("settings", str(path))
    assert rest is not None  # noqa: S101  (else it was refused)
    hung = {
        name: each.hung(rest.frame, rest.floor_z_m) if isinstance(each, CameraEntry) else each
        for name, each in sensors.items()
    }
    return rest.model_copy(update={"sensors": hung})
