"""A short recording, written and read back by rosbags alone."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation
from semap_ingest.simulation import images
from semap_ingest.simulation.floor import BASE_FROM_CAMERA_M, CAMERA, ROBOT
from semap_ingest.simulation.labels import read_labels, stamp_us
from semap_ingest.simulation.localisation import map_from_camera
from semap_ingest.simulation.office import OfficePaths, office_recording, write_office
from semap_ingest.simulation.recording_stream import image_times
from semap_ingest.simulation.schedule import moments
from semap_ingest.simulation.settings import START_US, Gap, OfficeSettings

from semap.errors import Conflict

SHORT = OfficeSettings(seed=8, people=3, duration_s=2.0, cloud=True)
BARE = OfficeSettings(seed=8, people=2, duration_s=2.0, camera=False)


def messages(path: Path, *topics: str) -> list:
    """Topic, log time [ns] and message, in the order of the log."""
    with AnyReader([path]) as reader:
        wanted = [each for each in reader.connections if not topics or each.topic in topics]
        return [
            (connection.topic, log_ns, reader.deserialize(data, connection.msgtype))
            for connection, log_ns, data in reader.messages(wanted)
        ]


def seconds(message: object) -> float:
    stamp = message.header.stamp
    return stamp.sec + stamp.nanosec * 1e-9 - START_US / 1e6


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> OfficePaths:
    return write_office(tmp_path_factory.mktemp("short") / "office", SHORT)


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> OfficePaths:
    return write_office(tmp_path_factory.mktemp("bare") / "office", BARE)


def test_rates_and_order(short: OfficePaths) -> None:
    found = messages(short.recording)
    logged = [log_ns for _, log_ns, _ in found]
    assert logged == sorted(logged)
    count = {topic: sum(each == topic for each, _, _ in found) for topic in {each for each, _, _ in found}}
    assert count == {
        "/scan": 30, "/camera/image/compressed": 60, "/camera/camera_info": 60, "/velodyne_points": 20,
        "/tf_static": 1, "/tf": 111 + 23,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("topic", "least_s", "most_s"),
    [("/scan", 0.05, 0.06), ("/camera/image/compressed", 0.008, 0.022), ("/velodyne_points", 0.1, 0.11)],
)
def test_records_arrive_after_they_were_taken(
    short: OfficePaths, topic: str, least_s: float, most_s: float
) -> None:
    for _, log_ns, message in messages(short.recording, topic):
        assert least_s < log_ns * 1e-9 - START_US / 1e6 - seconds(message) < most_s
    stamps = [seconds(message) for _, _, message in messages(short.recording, topic)]
    assert np.diff(stamps).min() > 0.03


def test_scan_says_what_the_sensor_is(short: OfficePaths) -> None:
    for _, _, scan in messages(short.recording, "/scan"):
        assert scan.header.frame_id == "laser"
        assert scan.ranges.dtype == np.float32
        assert len(scan.ranges) == 811
        assert np.degrees([scan.angle_min, scan.angle_max]) == pytest.approx([-135, 135], abs=1e-4)
        assert scan.angle_min + 810 * scan.angle_increment == pytest.approx(scan.angle_max, abs=1e-5)
        assert scan.time_increment * 810 == pytest.approx(0.05, abs=1e-6)
        assert (scan.range_min, scan.range_max) == pytest.approx((0.05, 25.0))


def test_images_are_jpegs_with_their_camera(short: OfficePaths) -> None:
    taken = messages(short.recording, "/camera/image/compressed")
    infos = messages(short.recording, "/camera/camera_info")
    for (_, _, image), (_, _, info) in zip(taken, infos, strict=True):
        assert seconds(image) == seconds(info)
        assert image.header.frame_id == info.header.frame_id == "camera_optical"
        assert info.k.tolist() == CAMERA.matrix.ravel().tolist()
        assert info.d.tolist() == CAMERA.distortion.tolist()
    pixels = cv2.imdecode(taken[0][2].data, cv2.IMREAD_COLOR)
    assert pixels.shape == (480, 640, 3)
    assert pixels.std() > 20


def test_frames_lead_from_map_to_every_sensor(short: OfficePaths) -> None:
    """The chain gives where the camera truly is, but for the localisation's centimetre."""
    matrices = {}
    for _, _, message in messages(short.recording, "/tf", "/tf_static"):
        for each in message.transforms:
            matrix = np.eye(4)
            turned, moved = each.transform.rotation, each.transform.translation
            matrix[:3, :3] = Rotation.from_quat([turned.x, turned.y, turned.z, turned.w]).as_matrix()
            matrix[:3, 3] = moved.x, moved.y, moved.z
            matrices[each.header.frame_id, each.child_frame_id] = matrix
    base = matrices["map", "odom"] @ matrices["odom", "base_link"]
    optical = base @ matrices["base_link", "camera_link"] @ matrices["camera_link", "camera_optical"]
    assert base[:2, 3] == pytest.approx(ROBOT[:2], abs=0.05)
    assert optical == pytest.approx(map_from_camera(), abs=0.05)
    assert map_from_camera()[:3, 2] == pytest.approx([0, 1, 0])
    assert map_from_camera()[:3, 1] == pytest.approx([0, 0, -1])
    assert map_from_camera()[:3, 3] == pytest.approx([10.0, 5.0 + BASE_FROM_CAMERA_M[0], 1.2])
    assert ("base_link", "laser") in matrices
    assert ("base_link", "velodyne") in matrices


def test_transforms_are_there_before_what_needs_them(short: OfficePaths) -> None:
    """At each scan and image both moving edges are known up to its stamp already (or 20 ms later at most)."""
    known = {}
    for topic, _, message in messages(short.recording):
        if topic in ("/tf", "/tf_static"):
            for each in message.transforms:
                stamp = each.header.stamp
                known[each.child_frame_id] = stamp.sec + stamp.nanosec * 1e-9 - START_US / 1e6
        elif topic == "/scan":
            assert known["odom"] >= seconds(message)
            assert known["base_link"] >= seconds(message)
        elif topic == "/camera/image/compressed":
            assert known["odom"] >= seconds(message)
            assert known["base_link"] >= seconds(message) - 0.02


def test_clouds_lie_inside_the_floor(short: OfficePaths) -> None:
    _, _, cloud = messages(short.recording, "/velodyne_points")[-1]
    points = cloud.data.view("<f4").reshape(-1, 3)
    assert len(points) == cloud.width
    assert points[:, 2].min() > -0.9 - 0.1
    assert points[:, 2].max() < 2.6 - 0.9 + 0.1
    assert 1 < np.linalg.norm(points[:, :2], axis=1).max() < 12


def test_labels_and_map_lie_beside_it(short: OfficePaths) -> None:
    labels = read_labels(short.labels)
    stamps = [round(seconds(each) * 1e6) + START_US for _, _, each in messages(short.recording, "/scan")]
    assert labels.tracks.stamp_us.tolist() == stamps
    assert len(labels.tracks.people) == 3
    assert short.map.name == "map.yaml"
    assert short.map.exists()
    assert sorted(each.name for each in short.recording.parent.iterdir()) == [
        "labels.json",
        "map",
        "recording.mcap",
    ]


def test_same_settings_same_messages(short: OfficePaths, tmp_path: Path) -> None:
    again = write_office(tmp_path / "office", SHORT)
    assert again.labels.read_bytes() == short.labels.read_bytes()
    assert again.recording.read_bytes() == short.recording.read_bytes()


def test_without_camera_the_scans_are_the_same(bare: OfficePaths, tmp_path: Path) -> None:
    other = write_office(tmp_path / "office", OfficeSettings(seed=9, people=2, duration_s=2.0, camera=False))
    assert {topic for topic, _, _ in messages(bare.recording)} == {"/scan", "/tf", "/tf_static"}
    first, second = (messages(paths.recording, "/scan")[0][2].ranges for paths in (bare, other))
    assert not np.array_equal(first, second)


def test_gaps_are_silent(bare: OfficePaths, tmp_path: Path) -> None:
    settings = OfficeSettings(seed=8, people=2, duration_s=2.0, camera=False, gaps=(Gap("laser", 0.5, 1.0),))
    gapped = messages(write_office(tmp_path / "office", settings).recording, "/scan")
    stamps = [seconds(message) for _, _, message in gapped]
    assert len(stamps) == 15
    assert not any(0.5 <= stamp < 1.5 for stamp in stamps)
    assert stamps[:7] == [seconds(message) for _, _, message in messages(bare.recording, "/scan")][:7]


def test_progress_goes_up_to_all(tmp_path: Path) -> None:
    calls: list[tuple[int, int]] = []
    write_office(tmp_path / "office", BARE, lambda done, total: calls.append((done, total)))
    assert calls[-1] == (20, 20)
    assert [done for done, _ in calls] == sorted(done for done, _ in calls)


def test_nothing_is_overwritten_and_nothing_half_done_is_left(tmp_path: Path) -> None:
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "letter.txt").write_text("dear")
    with pytest.raises(Conflict, match="is there already"):
        write_office(tmp_path / "taken", BARE)

    class Stopped(Exception):
        pass

    def stop(done: int, total: int) -> None:
        raise Stopped

    with pytest.raises(Stopped):
        write_office(tmp_path / "new", BARE, stop)
    assert [each.name for each in tmp_path.iterdir()] == ["taken"]


def test_an_empty_folder_is_filled(tmp_path: Path) -> None:
    (tmp_path / "office").mkdir()
    assert write_office(tmp_path / "office", BARE).recording.exists()


def test_cache_is_filled_once_even_by_two(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with ThreadPoolExecutor(2) as pool:
        first, second = pool.map(lambda _: office_recording(BARE), range(2))
    assert first == second
    assert first.recording.is_relative_to(tmp_path / "semap")
    written = first.recording.stat().st_mtime_ns
    assert office_recording(BARE).recording.stat().st_mtime_ns == written
    assert len(list((tmp_path / "semap").iterdir())) == 1
    assert office_recording(OfficeSettings(seed=9, people=1, duration_s=1, camera=False)) != first


def test_stamps() -> None:
    assert stamp_us(0.0) == START_US
    assert stamp_us(1.2345678) == START_US + 1_234_568


@pytest.mark.slow
def test_several_processes_draw_what_one_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = OfficeSettings(seed=8, people=3, duration_s=2.0)
    happening, times_s = moments(settings), image_times(settings)[:45]
    alone = list(images.jpegs(settings, happening, times_s))
    monkeypatch.setattr(images, "FEW", 0)
    assert list(images.jpegs(settings, happening, times_s)) == alone
