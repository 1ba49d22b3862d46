"""Files that are no recordings, or no longer: what was found is told, and what to do."""

import contextlib
import functools
import zlib
from pathlib import Path

import pytest
from bags import FORMATS, Ros, Said, the_file, write
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from semap_ingest.recording.reading import Recording

from semap.errors import InvalidInput

START_NS = 1_700_000_000_000_000_000
SCAN, TF = "sensor_msgs/msg/LaserScan", "tf2_msgs/msg/TFMessage"


@functools.cache
def healthy(kind: str, folder: Path) -> Path:
    ros = Ros(is_ros1=kind == "ros1")
    said = [
        said
        for index in range(5)
        for said in (
            Said("/scan", SCAN, ros.scan(START_NS + index, [1.0] * 3), START_NS + index),
            Said("/tf", TF, ros.tf(ros.transform(START_NS + index, "odom", "base")), START_NS + index),
        )
    ]
    return write(folder, kind, said, ros)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("healthy")


def count(path: Path) -> int:
    with Recording(path) as recording:
        return sum(1 for _ in recording.records())


def refusal(path: Path) -> InvalidInput:
    with pytest.raises(InvalidInput) as error:
        count(path)
    assert error.value.remedy
    assert path.name in str(error.value)
    return error.value


@pytest.mark.parametrize("kind", FORMATS)
def test_a_file_that_was_cut_off_anywhere(kind: str, folder: Path, tmp_path: Path) -> None:
    whole = the_file(healthy(kind, folder))
    data = whole.read_bytes()
    assert count(whole) == 10
    cut = tmp_path / whole.name
    ends = range(1, len(data) - (0 if kind != "sqlite3" else 4096), max(len(data) // 40, 1))
    for end in ends:
        cut.write_bytes(data[:end])
        error = refusal(cut)
    assert any(tool in error.remedy for tool in ("rosbag reindex", "mcap recover", ".recover"))


@pytest.mark.parametrize("kind", FORMATS)
@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_bytes_that_flipped_are_refused_or_counted(
    kind: str, folder: Path, tmp_path: Path, data: st.DataObject
) -> None:
    whole = the_file(healthy(kind, folder))
    rotten = bytearray(whole.read_bytes())
    for place in data.draw(st.lists(st.integers(0, len(rotten) - 1), min_size=1, max_size=8)):
        rotten[place] ^= data.draw(st.integers(1, 255))
    path = tmp_path / whole.name
    path.write_bytes(rotten)
    with contextlib.suppress(InvalidInput):
        assert 0 <= count(path) <= 20


@pytest.mark.parametrize("name", ["nothing.bag", "nothing.mcap", "nothing.db3", "nothing"])
def test_an_empty_file(tmp_path: Path, name: str) -> None:
    (tmp_path / name).touch()
    assert "empty" in str(refusal(tmp_path / name))


@pytest.mark.parametrize("name", ["text.bag", "text.mcap", "text.db3", "text.txt"])
def test_a_file_that_is_no_recording(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("x,y\n1,2\n")
    error = refusal(tmp_path / name)
    assert "x,y" in str(error)
    assert "metadata.yaml" in error.remedy


def test_a_path_that_is_not_there(tmp_path: Path) -> None:
    assert "no such recording" in str(refusal(tmp_path / "gone.mcap"))


@pytest.mark.parametrize("kind", FORMATS)
def test_a_recording_without_messages(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path, kind, [], Ros(is_ros1=kind == "ros1"))
    assert "holds no messages" in str(refusal(path))


def test_a_folder_without_metadata(tmp_path: Path, folder: Path) -> None:
    assert "without a recording" in str(refusal(tmp_path))
    whole = the_file(healthy("mcap", folder))
    (tmp_path / whole.name).write_bytes(whole.read_bytes())
    error = refusal(tmp_path)
    assert whole.name in str(error)
    assert "ros2 bag reindex" in error.remedy


@pytest.mark.parametrize(
    ("old", "new", "found", "remedy"),
    [
        ("storage_identifier: mcap", "storage_identifier: rocksdb", "storage plugin", "ros2 bag convert"),
        ("made_mcap.mcap", "other.mcap", "not there", "ros2 bag reindex"),
        ("version: 9", "version: 99", "version 99", "ros2 bag reindex"),
        ("rosbag2_bagfile_information", "something", "metadata key", "ros2 bag reindex"),
        ("rosbag2_bagfile_information:", "a: [", "YAML", "ros2 bag reindex"),
    ],
)
def test_metadata_that_does_not_fit(
    tmp_path: Path, folder: Path, old: str, new: str, found: str, remedy: str
) -> None:
    whole = healthy("mcap", folder)
    for each in whole.iterdir():
        data = each.read_bytes()
        (tmp_path / each.name).write_bytes(
            data.replace(old.encode(), new.encode()) if each.suffix == ".yaml" else data
        )
    error = refusal(tmp_path)
    assert found in str(error)
    assert remedy in error.remedy


def test_a_bag_without_an_index(tmp_path: Path, folder: Path) -> None:
    data = healthy("ros1", folder).read_bytes()
    place = data.index(b"index_pos=") + len(b"index_pos=")
    (tmp_path / "crashed.bag.active").write_bytes(data[:place] + bytes(8) + data[place + 8 :])
    error = refusal(tmp_path / "crashed.bag.active")
    assert "no index" in str(error)
    assert error.remedy == "rosbag reindex crashed.bag.active"


def test_a_bag_of_an_old_version(tmp_path: Path, folder: Path) -> None:
    data = healthy("ros1", folder).read_bytes()
    old = tmp_path / "old.bag"
    old.write_bytes(data.replace(b"#ROSBAG V2.0", b"#ROSBAG V1.2"))
    assert "rosbag fix" in refusal(old).remedy


def test_an_mcap_file_of_something_else(tmp_path: Path, folder: Path) -> None:
    data = the_file(healthy("mcap", folder)).read_bytes()
    other = tmp_path / "other.mcap"
    other.write_bytes(data.replace(b"\x04\x00\x00\x00ros2", b"\x04\x00\x00\x00ros1", 1))
    assert "not of ROS 2" in str(refusal(other))


def test_names_that_do_not_fit(tmp_path: Path, folder: Path) -> None:
    mcap = the_file(healthy("mcap", folder)).read_bytes()
    (tmp_path / "some.bag").write_bytes(mcap)
    assert refusal(tmp_path / "some.bag").remedy == "Rename it to end in .mcap."
    (tmp_path / "some.mcap.zstd").write_bytes(b"\x28\xb5\x2f\xfd" + zlib.compress(mcap))
    assert refusal(tmp_path / "some.mcap.zstd").remedy == "zstd -d some.mcap.zstd"
    bag = tmp_path / "bag of 2015"
    bag.write_bytes(healthy("ros1", folder).read_bytes())
    assert count(bag) == 10


def test_a_folder_with_a_dot_or_a_hash_in_its_name(tmp_path: Path) -> None:
    ros = Ros(is_ros1=False)
    said = [Said("/scan", SCAN, ros.scan(START_NS, [1.0]), START_NS)]
    assert count(write(tmp_path, "mcap", said, ros, name="v1.2#")) == 1
    (tmp_path / "v1.2#").mkdir()
    path = write(tmp_path / "v1.2#", "mcap", said, ros)
    the_file(path).write_bytes(the_file(path).read_bytes()[:-9])
    assert "damaged" in str(refusal(path))
    whole = the_file(write(tmp_path, "sqlite3", said, ros))
    (tmp_path / "a#b.db3").write_bytes(whole.read_bytes())
    assert "Rename" in refusal(tmp_path / "a#b.db3").remedy
