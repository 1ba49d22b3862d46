"""The files themselves, through rosbags: opened, listed, read in order; what is wrong with them in our words.

rosbags meets damaged bytes with whatever they make it trip over (its own errors, AssertionError, TypeError, a
decompressor's, SQLite's), so that this module translates every Exception that comes out of it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2

from semap.errors import InvalidInput
from semap_ingest.recording.definitions import Deserialiser, deserialiser

MAGIC = {
    b"#ROSBAG V": ".bag",
    b"\x89MCAP0\r\n": ".mcap",
    b"SQLite format 3\0": ".db3",
    b"\x28\xb5\x2f\xfd": ".zstd",
}
"""How a file begins, by the ending that it should have."""

KNOWN = "Give a ROS 1 .bag, a ROS 2 folder with metadata.yaml, or one .mcap or .db3 file."

REPAIRS = {
    ".bag": "If it was cut off or not closed: rosbag reindex {name}",
    ".mcap": "If it was cut off or not closed: mcap recover {name} -o repaired.mcap",
    ".db3": "If it was cut off: sqlite3 {name} .recover | sqlite3 repaired.db3",
    "": "Write its metadata anew: ros2 bag reindex {name}",
}

CAUSES = (
    ("not indexed", "the bag has no index, as when recording was interrupted", "rosbag reindex {name}"),
    ("Bag version", "a bag of an old version of ROS", "Bring it up to date: rosbag fix {name} fixed.bag"),
    ("Bag encryption", "an encrypted bag", "Decrypt it: rosbag decrypt {name}"),
    (
        "Profile is not",
        "an MCAP file, but not of ROS 2",
        "Give a recording of ROS 2, or the bag it was made of.",
    ),
    (
        "Storage plugin",
        "the recording is kept by a storage plugin that cannot be read",
        "Convert it: ros2 bag convert, with storage_id mcap or sqlite3.",
    ),
    (
        "unable to open database",
        "SQLite cannot open the file",
        "Rename files and folders whose names have #, ? or % in them.",
    ),
    (
        "database files are missing",
        "files that metadata.yaml names are not there",
        "Put them beside metadata.yaml, or write that anew: ros2 bag reindex {name}",
    ),
)
"""What rosbags says, what that means, and what to do; for all else there are REPAIRS."""


class RosbagFile:
    """An open recording; times are the log's, in nanoseconds."""

    def __init__(self, path: Path) -> None:
        """raises InvalidInput for what is no recording, is damaged, or holds no messages"""
        self._path, self._kind = path, _kind(path)
        try:
            self._reader = Reader1(path) if self.is_ros1 else Reader2(path)
            self._reader.open()
        except Exception as error:
            raise self._translated(error) from error
        try:
            self._list()
        except BaseException:
            self._reader.close()
            raise

    @property
    def is_ros1(self) -> bool:
        return self._kind == ".bag"

    def close(self) -> None:
        self._reader.close()

    def messages(self, connections: Collection[Connection]) -> Iterator[tuple[int, int, bytes]]:
        """The connection's id, the time of the log and the bytes of each message, in the log's order.

        raises  InvalidInput where the file is damaged; what came before stands
        """
        if not connections:
            return
        try:
            for connection, log_ns, raw in self._reader.messages(connections):
                yield connection.id, int(log_ns), raw  # SQLite keeps anything anywhere
        except Exception as error:
            raise self._translated(error) from error

    def deserialiser(self, connection: Connection) -> Deserialiser:
        return deserialiser(connection.msgtype, connection.msgdef, self.is_ros1)

    def _list(self) -> None:
        self.connections = tuple(self._reader.connections)
        if not all(isinstance(text, str) for each in self.connections for text in (each.topic, each.msgtype)):
            raise self._translated(ValueError("a topic without a name"))
        self.count = self._reader.message_count
        if not self.count:
            raise InvalidInput("the recording holds no messages", "Record it again.", self._path.name)
        try:
            self.first_ns, self.last_ns = int(self._reader.start_time), int(self._reader.end_time) - 1
        except ValueError as error:
            raise self._translated(error) from error

    def _translated(self, error: Exception) -> InvalidInput:
        name, said = self._path.name, str(error) or type(error).__name__
        if isinstance(error, PermissionError):
            return InvalidInput(f"cannot be read: {said}", "Check its permissions.", name)
        for words, found, remedy in CAUSES:
            if words in said:
                return InvalidInput(f"{found} ({said})", remedy.format(name=name), name)
        return InvalidInput(f"the recording is damaged: {said}", REPAIRS[self._kind].format(name=name), name)


def _kind(path: Path) -> str:
    """The ending that its contents ask for; "" for a folder. Raises InvalidInput for what is no recording."""
    if not path.exists():
        raise InvalidInput("there is no such recording", "Check the path.", str(path))
    if path.is_dir():
        if not (path / "metadata.yaml").exists():
            raise _without_metadata(path)
        return ""
    try:
        with path.open("rb") as file:
            begin = file.read(16)
    except OSError as error:
        raise InvalidInput(
            f"cannot be read: {error.strerror}", "Check its permissions.", path.name
        ) from error
    if not begin:
        raise InvalidInput("the file is empty", "Record it again.", path.name)
    kind = next((kind for magic, kind in MAGIC.items() if begin.startswith(magic)), None)
    if kind is None:
        raise InvalidInput(f"no recording: it begins with {begin!r}", KNOWN, path.name)
    if kind == ".zstd":
        raise InvalidInput("the file is compressed as a whole", f"zstd -d {path.name}", path.name)
    if kind not in {".bag", path.suffix}:
        raise InvalidInput(f"a {kind} file by another name", f"Rename it to end in {kind}.", path.name)
    return kind


def _without_metadata(folder: Path) -> InvalidInput:
    files = sorted(each.name for each in folder.iterdir() if each.suffix in {".bag", ".mcap", ".db3"})
    if not files:
        return InvalidInput("a folder without a recording", KNOWN, folder.name)
    return InvalidInput(
        f"a folder without metadata.yaml, with {', '.join(files[:5])}",
        "Give one of the files; of a recording of ROS 2, metadata.yaml is written anew by: "
        f"ros2 bag reindex {folder.name}",
        folder.name,
    )
