"""Zip archives of a map's folder: made for an export, unpacked from bytes that nobody vouches for."""

from __future__ import annotations

import stat
import zipfile
import zlib
from pathlib import Path, PurePosixPath

from semap.errors import InvalidInput, TooLarge

MAX_MEMBERS = 10_000
MAX_EXPANDED_BYTES = 512 * 1024**2
PIECE_BYTES = 1024**2
PLAIN = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
ENCRYPTED = 0x1
REMEDY = "Zip the folder of the map as it is: map.yaml, meshes and grids."


def pack(folder: Path, archive: Path) -> None:
    """Zip all files of a folder, in the order of their names."""
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as made:
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                made.write(path, path.relative_to(folder).as_posix())


def unpack(archive: Path, folder: Path, max_bytes: int = MAX_EXPANDED_BYTES) -> None:
    """Write the files of an archive into a folder, and nothing outside it.

    raises  TooLarge if it has too many files or expands beyond the limit, whatever it announces;
            InvalidInput if it is none, is encrypted, or names a link or a place outside the folder
    """
    left = max_bytes
    try:
        with zipfile.ZipFile(archive) as opened:
            members = opened.infolist()
            if len(members) > MAX_MEMBERS:
                raise TooLarge(f"The archive has {len(members)} files; the limit is {MAX_MEMBERS}.", REMEDY)
            for member in members:
                if not member.is_dir():
                    left -= _unpack_one(opened, member, _target(folder, member), left)
    except (
        zipfile.BadZipFile,
        zipfile.LargeZipFile,
        NotImplementedError,
        OSError,
        EOFError,
        RuntimeError,
        ValueError,
        zlib.error,
    ) as error:
        raise InvalidInput(f"no readable zip archive: {type(error).__name__}", REMEDY) from error


def _target(folder: Path, member: zipfile.ZipInfo) -> Path:
    name = PurePosixPath(member.filename)
    is_link = stat.S_ISLNK(member.external_attr >> 16)
    is_outside = name.is_absolute() or ".." in name.parts or "\\" in member.filename or ":" in member.filename
    if is_link or is_outside or not name.parts:
        raise InvalidInput(f"{member.filename!r} lies outside the archive, or is a link", REMEDY)
    if member.flag_bits & ENCRYPTED or member.compress_type not in PLAIN:
        raise InvalidInput(f"{member.filename!r} is encrypted or packed in a rare way", REMEDY)
    return folder / name


def _unpack_one(opened: zipfile.ZipFile, member: zipfile.ZipInfo, target: Path, left: int) -> int:
    """How many bytes it had; the announced size is not trusted."""
    target.parent.mkdir(parents=True, exist_ok=True)
    done = 0
    with opened.open(member) as packed, target.open("xb") as plain:
        while piece := packed.read(PIECE_BYTES):
            done += len(piece)
            if done > left:
                raise TooLarge(
                    "The archive expands beyond the limit.", "Leave out what is not part of the map."
                )
            plain.write(piece)
    return done
