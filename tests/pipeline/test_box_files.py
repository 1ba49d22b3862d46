"""Boxes of other programs in files: what they give is what the same boxes in messages give."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from semap_ingest.fusion.camera_model import project
from semap_ingest.pipeline.ingest_recording import Plan, ingest_recording, opened
from semap_ingest.pipeline.rig import read_rig
from semap_ingest.recording.reading import Recording
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.sensing.track_states import TrackStates
from semap_ingest.simulation.office import OfficePaths, write_office
from semap_ingest.simulation.settings import OfficeSettings
from semap_ingest.simulation.wall_sensors import CAMERAS, WallCamera
from semap_service.cli import commands
from semap_service.evaluation.tracking import perceive
from stored_results import stored
from typer.testing import CliRunner
from watched_hall import BODY_M

from semap.errors import InvalidInput
from semap.timeline.stamp import rfc3339, to_datetime

EYES = CAMERAS[:4]
BOXES = [f"/{each.name}/boxes" for each in EYES]


@pytest.fixture(scope="module")
def walls(tmp_path_factory: pytest.TempPathFactory) -> OfficePaths:
    settings = OfficeSettings(seed=1, people=4, duration_s=12.0, camera=False, wall_cameras=4)
    return write_office(tmp_path_factory.mktemp("walls") / "office", settings)


def seen_by(walls: OfficePaths, topic: str) -> list[Boxes]:
    with Recording(walls.recording) as recording:
        return [each.value for each in recording.records([topic]) if isinstance(each.value, Boxes)]


def entry(eye: WallCamera, every: Sequence[Boxes], known_as: dict[tuple[int, int], int] | None = None) -> str:
    """A sensor of a rig whose file has these boxes; known_as: ids by frame and row."""
    camera, (x, y, z, _, _) = eye.camera, eye.place
    roll, pitch, yaw = eye.turn.as_euler("xyz").tolist()
    return f"""
  {eye.name}:
    kind: camera
    file: {eye.name}.txt
    rate_hz: {round(1 / eye.period_s)}
    start: {rfc3339(to_datetime(every[0].stamp_us))}
    calibration: {{width_px: 640, height_px: 480, fx_px: 320, fy_px: 320, cx_px: {camera.matrix[0, 2]}, cy_px: {camera.matrix[1, 2]}}}
    mount: {{parent: map, xyz_m: [{x}, {y}, {z}], rpy_rad: [{roll!r}, {pitch!r}, {yaw!r}]}}
"""


def mot(every: Sequence[Boxes], ids: Sequence[Sequence[int]] | None = None) -> str:
    lines = []
    for frame, boxes in enumerate(every, start=1):
        for row, ((left, top, right, bottom), score) in enumerate(
            zip(boxes.corners_px.tolist(), boxes.score.tolist(), strict=True)
        ):
            known_as = -1 if ids is None else ids[frame - 1][row]
            lines.append(
                f"{frame},{known_as},{left!r},{top!r},{right - left!r},{bottom - top!r},{score!r},-1,-1,-1"
            )
    return "\n".join(lines) + "\n"


@pytest.fixture(scope="module")
def rig(walls: OfficePaths, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four cameras whose boxes are in files beside it."""
    folder, text = tmp_path_factory.mktemp("rig"), "sensors:"
    for eye, topic in zip(EYES, BOXES, strict=True):
        every = seen_by(walls, topic)
        (folder / f"{eye.name}.txt").write_text(mot(every))
        text += entry(eye, every)
    (folder / "rig.yaml").write_text(text)
    return folder / "rig.yaml"


def of_files(rig: Path, recording: Path | None = None) -> Plan:
    return Plan("office", "walls", recording, rig=read_rig(rig))


def told(states: Sequence[TrackStates]) -> list[tuple[int, list[int]]]:
    return [(each.stamp_us, each.track.tolist()) for each in states if len(each)]


def test_boxes_in_files_give_the_tracks_of_the_same_boxes_in_messages(walls: OfficePaths, rig: Path) -> None:
    topics = {"scan": (), "boxes": BOXES}
    expected = list(perceive(Plan("office", "walls", walls.recording, topics=topics)))
    found = list(perceive(of_files(rig)))
    assert told(found) == told(expected) != []
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one.position_m, other.position_m, atol=1e-6)
        np.testing.assert_allclose(one.covariance_m2, other.covariance_m2, atol=1e-6)


def test_files_beside_a_recording_are_merged_with_it_in_event_time(walls: OfficePaths, rig: Path) -> None:
    beside = rig.with_name("beside.yaml")
    first = rig.read_text().split("\n  wall_camera_")[1]
    beside.write_text(
        f"sensors:\n  wall_camera_{first}\n  robot: {{kind: laser, topic: /scan}}\n"
        f"  second: {{kind: camera, topic: {BOXES[1]}}}\n"
    )
    in_bag = rig.with_name("in_bag.yaml")
    in_bag.write_text(
        f"sensors:\n  first: {{kind: camera, topic: {BOXES[0]}}}\n  robot: {{kind: laser, topic: /scan}}\n"
        f"  second: {{kind: camera, topic: {BOXES[1]}}}\n"
    )
    found, expected = (list(perceive(of_files(each, walls.recording))) for each in (beside, in_bag))
    assert told(found) == told(expected) != []


def test_ids_of_a_tracker_tell_who_is_who(walls: OfficePaths, tmp_path: Path) -> None:
    """Who comes back after two seconds is the same one, if the id says so."""
    eye = EYES[0]
    stamps = [each.stamp_us for each in seen_by(walls, BOXES[0])[:70]]
    every = []
    for number, stamp_us in enumerate(stamps):
        body_m = BODY_M + np.array([4.0 + 0.03 * number, 5.1, 0.0])
        pixels = project((body_m - eye.place[:3]) @ eye.turn.as_matrix(), eye.camera)
        box = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])[None]
        seen = box[: not 25 <= number < 47]
        many = len(seen)
        every.append(Boxes(stamp_us, "", seen, np.full(many, 0.9), ("person",) * many, np.full(many, -1)))
    path = tmp_path / "rig.yaml"
    path.write_text("sensors:" + entry(eye, every))

    def tracks() -> set[int]:
        return {track for each in perceive(of_files(path)) for track in each.track.tolist()}

    (tmp_path / f"{eye.name}.txt").write_text(mot(every))
    assert tracks() == {1, 2}
    (tmp_path / f"{eye.name}.txt").write_text(mot(every, [[7] * len(each) for each in every]))
    assert tracks() == {1}


def test_files_alone_are_brought_in_once(office_map: str, rig: Path) -> None:
    first = ingest_recording(office_map, of_files(rig))
    assert first.states > 100
    assert first.fruitless == ()
    before = stored(office_map)
    assert ingest_recording(office_map, of_files(rig)).records == 0
    assert stored(office_map) == before


def test_without_a_recording_all_sensors_need_files(tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text("sensors:\n  front: {kind: laser, topic: /scan}\n")
    with pytest.raises(InvalidInput, match="there is no recording"):
        ingest_recording("", of_files(tmp_path / "rig.yaml"))


def test_a_rig_of_files_is_checked_without_a_recording(rig: Path) -> None:
    ran = CliRunner().invoke(commands(), ["rig", "check", "--rig", str(rig), "--json"])
    assert ran.exit_code == 0, ran.output
    rates = {each["name"]: round(each["rate_hz"]) for each in json.loads(ran.stdout)}
    assert rates == {"wall_camera_1": 10, "wall_camera_2": 10, "wall_camera_3": 5, "wall_camera_4": 10}


GOOD = "1,-1,10,20,30,60,0.9,-1,-1,-1\n2,-1,11,20,30,60,0.9\n"
SENSOR = """sensors:
  door:
    kind: camera
    file: det.txt
    rate_hz: 25
    start: 2026-01-05T09:15:00Z
    calibration: {width_px: 640, height_px: 480, fx_px: 320, fy_px: 320, cx_px: 320, cy_px: 240}
    mount: {parent: map, xyz_m: [1, 1, 2.4], rpy_rad: [-2, 0, 0]}
"""
HANGS = SENSOR[SENSOR.index("    mount") :]


def opening(folder: Path, lines: str, sensor: str = SENSOR, recording: Path | None = None) -> None:
    (folder / "det.txt").write_text(lines)
    (folder / "rig.yaml").write_text(sensor)
    plan = of_files(folder / "rig.yaml", recording)
    ingest_recording("", plan)


@pytest.mark.parametrize(
    ("lines", "says", "remedy"),
    [
        (GOOD + "3,-1,1,2\n", r"det\.txt: det\.txt:3: 4 values|det\.txt:3: 4 values in a line", "commas"),
        (GOOD + "\n# more\n3;-1;1;2;3;4;1\n", r"det\.txt:5: 1 values", "commas"),
        ("frame,id,x,y,w,h,conf\n" + GOOD, r"det\.txt:1: frame is no finite number: 'frame'", "headings"),
        (GOOD + "3,-1,nan,2,3,4,1\n", r"det\.txt:3: x is no finite number", "numbers"),
        (GOOD + "1607123961837,-1,1,2,3,4,1\n", r"det\.txt:3: there is no frame 1607123961837", "from 1"),
        (GOOD + "2.5,-1,1,2,3,4,1\n", r"det\.txt:3: there is no frame 2\.5", "from 1"),
        (GOOD + "3,-1,10,2,-3,4,1\n", r"det\.txt:3: a box of -3 x 4 px", "width"),
        (GOOD + "3,1.5,1,2,3,4,1\n", r"det\.txt:3: an id of 1\.5", "-1"),
        (GOOD + "3,7,1,2,3,4,1\n3,7,5,6,7,8,1\n", r"det\.txt:4: the id 7 is there twice in frame 3", "own"),
        (GOOD + "3,-1,1,2,3,4,71.3\n", r"det\.txt:3: a confidence of 71\.3 is no probability", "scores"),
        ("1,-1,1900,20,30,60,0.9\n" * 9, "its boxes reach to 1930, 80 px in images of 640 x 480", "calibr"),
        ("1,-1,1\n2,-1\n", r"2 lines are wrong:\n +det\.txt:1.*\n +det\.txt:2", "commas"),
        ("\n", "it has no boxes", "frame,id,x,y,w,h"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_by_its_lines(
    lines: str, says: str, remedy: str, tmp_path: Path
) -> None:
    with pytest.raises(InvalidInput, match=says) as caught:
        opening(tmp_path, lines)
    assert remedy in caught.value.remedy


@pytest.mark.parametrize(
    ("sensor", "says", "remedy"),
    [
        (SENSOR.replace(HANGS, ""), "sensors.door: nothing says where the camera hangs", "homography"),
        (SENSOR.replace("    rate_hz: 25\n", ""), "nothing says its frame rate", "rate_hz"),
        (SENSOR.replace("25", "0"), "rate_hz: Input should be greater than 0", "rate_hz"),
        (SENSOR.replace("    start: 2026-01-05T09:15:00Z\n", ""), "write start", ""),
        (SENSOR.replace("09:15:00Z", "09:15:00"), "start: Input should have timezone info", "start"),
        (SENSOR + "    topic: /boxes\n", "leave out topic", ""),
        (SENSOR + "    scores: [1, 0]\n", "the lower one comes first", "scores"),
        (SENSOR.replace("    file: det.txt\n", "    topic: /x\n"), "rate_hz, start without a file", ""),
    ],
)
def test_a_sensor_with_a_file_that_lacks_something_is_refused(
    sensor: str, says: str, remedy: str, tmp_path: Path
) -> None:
    with pytest.raises(InvalidInput, match=says) as caught:
        opening(tmp_path, GOOD, sensor)
    assert remedy in caught.value.remedy


def test_what_motchallenge_puts_beside_tells_the_rate_or_contradicts_it(tmp_path: Path) -> None:
    (tmp_path / "seqinfo.ini").write_text("[Sequence]\nname=MOT17-02\nframeRate=30\nimWidth=1920\n")
    (tmp_path / "det.txt").write_text("1,-1,1,2,3,4\n4,-1,1,2,3,4\n")
    rig = tmp_path / "rig.yaml"
    rig.write_text(SENSOR.replace("    rate_hz: 25\n", ""))
    with opened(of_files(rig))[2] as gathered:
        seen = [(each.sent_us - gathered.start_us, len(each.value)) for each in gathered.records(["det.txt"])]
    assert seen == [(0, 1), (33333, 0), (66667, 0), (100000, 1)]
    rig.write_text(SENSOR)
    with pytest.raises(InvalidInput, match=r"a rate of 25 Hz, and seqinfo\.ini beside it says 30"):
        opened(of_files(rig))


def test_boxes_of_another_day_than_the_recording_are_refused(walls: OfficePaths, tmp_path: Path) -> None:
    with pytest.raises(
        InvalidInput, match=r"its boxes are of 2020-01-05 .* the recording is of 2026"
    ) as caught:
        opening(tmp_path, GOOD, SENSOR.replace("2026", "2020"), walls.recording)
    assert "start" in caught.value.remedy


def test_confidences_of_any_range_are_scaled(tmp_path: Path) -> None:
    (tmp_path / "det.txt").write_text("1,-1,1,2,3,4,60\n1,-1,10,2,3,4,120\n1,-1,20,2,3,4\n")
    (tmp_path / "rig.yaml").write_text(SENSOR + "    scores: [20, 100]\n")
    with opened(of_files(tmp_path / "rig.yaml"))[2] as gathered:
        (record,) = gathered.records(["det.txt"])
    assert isinstance(record.value, Boxes)
    assert record.value.score.tolist() == [0.5, 1.0, 1.0]


@pytest.mark.parametrize(("page", "height_m"), [("recordings.md", 2.6), ("bridges/mqtt.md", 2.4)])
def test_the_cameras_of_the_documentation_hang_where_cameras_do(
    page: str, height_m: float, tmp_path: Path
) -> None:
    told = (Path(__file__).parents[2] / "docs" / page).read_text(encoding="utf-8").split("```yaml\n")[1:]
    (text,) = (each.partition("```")[0] for each in told if each.startswith("sensors:"))
    (tmp_path / "rig.yaml").write_text(text)
    (camera,) = read_rig(tmp_path / "rig.yaml").sensors.values()
    assert camera.mount.xyz_m[2] == pytest.approx(height_m, abs=0.05)
