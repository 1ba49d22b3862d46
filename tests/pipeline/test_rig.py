"""A rig says which sensors there are: read with errors that name the line, proposed, and followed."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from semap_ingest.pipeline.ingest_recording import Plan, ingest_recording
from semap_ingest.pipeline.rig import fixed_transforms, read_rig
from semap_ingest.pipeline.rig_check import propose, rig_text, sights
from semap_ingest.recording.reading import Recording
from semap_ingest.simulation.office import OfficePaths
from semap_service.cli import commands
from stored_results import stored
from typer.testing import CliRunner

from semap.errors import InvalidInput

WHOLE = """
frame: map
floor_z_m: 0.1
person_classes: [person, dummy]
transform_patience_s: 2
confirmation: {probability: 0.95}
sensors:
  front: {kind: laser, topic: /front/scan, patience_s: 0.4, time_offset_s: -0.02}
  rear: {kind: laser, topic: /rear/scan, persons: false}
  entrance:
    kind: camera
    topic: /entrance/image/compressed
    calibration: {width_px: 640, height_px: 480, fx_px: 500, fy_px: 501, cx_px: 320, cy_px: 240}
    mount: {parent: map, xyz_m: [4, 2, 2.4], rpy_rad: [-2.0, 0, 1.57]}
    detector: models/yolo.onnx
    laser: front
    detection_probability: 0.7
  robot_eyes: {kind: finder, topic: /people}
transforms:
  - {parent: base_link, child: front_laser, xyz_m: [0.2, 0, 0.3]}
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "rig.yaml"
    path.write_text(text)
    return path


def test_a_rig_is_read_as_it_is_written(tmp_path: Path) -> None:
    rig = read_rig(written(tmp_path, WHOLE))
    assert list(rig.sensors) == ["front", "rear", "entrance", "robot_eyes"]
    assert rig.sensors["entrance"].detector == tmp_path / "models" / "yolo.onnx"
    assert rig.sensors["entrance"].calibration.camera().matrix[1].tolist() == [0, 501, 240]
    assert [(each.parent, each.child) for each in rig.fixed()] == [
        ("base_link", "front_laser"),
        ("map", "entrance (rig)"),
    ]
    assert rig.confirmation.existence().believed == 0.95


@pytest.mark.parametrize(
    ("old", "new", "line", "says", "remedy"),
    [
        ("topic: /people", "topics: /people", 18, "topics", "Write it"),
        ("kind: finder", "kind: radar", 18, "'radar' is not known here", "laser, camera, finder"),
        ("kind: finder, ", "", 18, "robot_eyes has no kind", "laser, camera, finder"),
        ("fy_px: 501", "fy_px: -1", 13, "calibration.fy_px", "Correct it"),
        ("xyz_m: [4, 2, 2.4]", "xyz_m: [4, 2]", 14, "mount.xyz_m.2", "Write it"),
        ("patience_s: 0.4", "patience_s: soon", 8, "patience_s", "How far behind"),
        ("detection_probability: 0.7", "detection_probability: 1", 17, "detection_probability", "Correct it"),
        ("floor_z_m: 0.1", "floor_m: 0.1", 3, "there is no key 'floor_m'", "floor_z_m"),
        ("parent: base_link, ", "", 20, "transforms.0.parent", "Write it"),
        ("probability: 0.95", "probability: 1.5", 6, "confirmation.probability", "Correct it"),
    ],
)
def test_an_error_names_its_line_and_what_to_write(
    tmp_path: Path, old: str, new: str, line: int, says: str, remedy: str
) -> None:
    assert old in WHOLE
    with pytest.raises(InvalidInput) as caught:
        read_rig(written(tmp_path, WHOLE.replace(old, new)))
    assert f"rig.yaml:{line}:" in str(caught.value)
    assert says in str(caught.value)
    assert remedy in caught.value.remedy


@pytest.mark.parametrize("text", ["sensors:", "frame: map", "sensors: {}"])
def test_a_rig_without_sensors_is_none(tmp_path: Path, text: str) -> None:
    with pytest.raises(InvalidInput, match="there are no sensors"):
        read_rig(written(tmp_path, text))


def test_a_rig_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="cannot be read") as caught:
        read_rig(tmp_path / "none.yaml")
    assert "semap rig check" in caught.value.remedy


@pytest.mark.parametrize(
    ("topics", "says", "remedy"),
    [
        ("/skan", "there are no messages of the topic '/skan'", "Of LaserScan there are /scan"),
        ("/tf", "the topic '/tf' is of the type tf2_msgs/msg/TFMessage", "Name one of LaserScan"),
    ],
)
def test_a_topic_that_does_not_fit_is_told(
    office_map: str, office: OfficePaths, tmp_path: Path, topics: str, says: str, remedy: str
) -> None:
    rig = read_rig(written(tmp_path, f"sensors: {{front: {{kind: laser, topic: {topics}}}}}"))
    with pytest.raises(InvalidInput, match=says) as caught:
        ingest_recording(office_map, Plan("office", "robot", office.recording, rig=rig))
    assert remedy in caught.value.remedy


def test_what_a_recording_tells_by_itself_a_rig_tells_too(
    office_map: str, office: OfficePaths, at_once: dict[str, list[str]], tmp_path: Path
) -> None:
    with Recording(office.recording) as recording:
        rig, notes = propose(recording)
        seen = sights(recording, rig)
    assert notes == []
    assert [(each.name, each.kind, each.topic, each.frame, each.trouble) for each in seen] == [
        ("scan", "laser", "/scan", "laser", "")
    ]
    assert seen[0].rate_hz == pytest.approx(15, abs=0.2)
    read = read_rig(written(tmp_path, rig_text(rig, seen, notes)))
    ingest_recording(office_map, Plan("office", "robot", office.recording, rig=read))
    assert stored(office_map) == at_once


def done(*arguments: str | Path, code: int = 0) -> str:
    ran = CliRunner().invoke(commands(), [str(each) for each in arguments])
    assert ran.exit_code == code, (ran.output, ran.exception)
    return ran.stdout


def test_a_rig_is_proposed_and_tried_on_the_command_line(office: OfficePaths, tmp_path: Path) -> None:
    path = written(tmp_path, done("rig", "check", office.recording))
    tried = json.loads(done("rig", "check", office.recording, "--rig", path, "--json"))
    assert [(each["name"], each["trouble"]) for each in tried] == [("scan", "")]
    lost = written(tmp_path, "sensors: {eye: {kind: laser, topic: /scan, frame: lost}}")
    assert "no transform names its frame 'lost'" in done(
        "rig", "check", office.recording, "--rig", lost, code=1
    )


def test_options_that_a_rig_says_are_refused_beside_it(office: OfficePaths, tmp_path: Path) -> None:
    path = written(tmp_path, "sensors: {eye: {kind: laser, topic: /scan}}")
    ran = CliRunner().invoke(
        commands(),
        ["ingest", "recording", str(office.recording), "--map", "m", "--rig", str(path), "--frame", "odom"],
    )
    assert isinstance(ran.exception, InvalidInput)
    assert "--frame beside --rig" in str(ran.exception)


@pytest.mark.parametrize(
    "said", [["a b 0 0 0 0 0"], ["a b 0 0 0 0 0 x"], ["a b 0 0 0 0 0 nan"], ["a a 0 0 0 0 0 0"], ["", ""],
             ["a b 0 0 0 0 0 0", "c b 0 0 0 0 0 0"]]
)  # fmt: skip
def test_a_transform_that_is_none_is_refused(said: Sequence[str]) -> None:
    with pytest.raises(InvalidInput) as caught:
        fixed_transforms(said)
    assert caught.value.remedy


def test_roll_pitch_and_yaw_turn_as_in_urdf() -> None:
    (fixed,) = fixed_transforms(["base_link laser 1 2 3 3.141592653589793 0 1.5707963267948966"])
    transform = fixed.transform(fixed.child)
    x, y, z, w = transform.quaternion
    # upside down, then turned left: what was ahead is to the left, what was left is ahead
    ahead = np.array([1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)])
    left = np.array([2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)])
    np.testing.assert_allclose([ahead, left], [[0, 1, 0], [1, 0, 0]], atol=1e-12)
    assert transform.translation_m.tolist() == [1, 2, 3]


def test_the_rig_of_the_documentation_is_one(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "recordings.md").read_text()
    (text,) = (each for each in page.split("```yaml\n")[1:] if each.startswith("frame:"))
    rig = read_rig(written(tmp_path, text.partition("```")[0]))
    assert [each.kind for each in rig.sensors.values()] == ["laser", "laser", "camera", "camera", "finder"]
