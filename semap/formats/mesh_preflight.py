"""What can be told of a mesh file before it is parsed: whether it is what it says, and how large it gets.

A few bytes can announce an array of any size, name one array a million times, or be an archive that
expands without end. What is refused here never reaches a parser.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Any

from semap.errors import InvalidInput, TooLarge
from semap.formats.mesh_part import SMALLER

ARCHIVES: Mapping[bytes, str] = {
    b"PK\x03\x04": "zip",
    b"PK\x05\x06": "zip",
    b"\x1f\x8b": "gzip",
    b"7z\xbc\xaf\x27\x1c": "7z",
    b"\xfd7zXZ\x00": "xz",
    b"BZh": "bzip2",
    b"Rar!": "rar",
    b"\x28\xb5\x2f\xfd": "zstd",
}
TEXT_BYTES = 64 * 1024**2
"""Parsers of text take thirty times the bytes in memory."""

GLB_HEADER = struct.Struct("<4sII I4s")
MAX_NODES = 20_000
MAX_DEPTH = 128
SIZES = {"char": 1, "uchar": 1, "int8": 1, "uint8": 1, "short": 2, "ushort": 2, "int16": 2, "uint16": 2}
SIZES |= {"int": 4, "uint": 4, "int32": 4, "uint32": 4, "float": 4, "float32": 4, "float16": 2}
SIZES |= {"double": 8, "float64": 8, "int64": 8, "uint64": 8}
HEAD_BYTES = 65_536
AGAIN = "Export the mesh again, as one file with everything inside."


def refuse_archives(data: bytes, kind: str) -> None:
    """Only a 3MF file is an archive.

    raises  InvalidInput
    """
    found = next((name for magic, name in ARCHIVES.items() if data.startswith(magic)), None)
    if found is None and data[257:262] == b"ustar":
        found = "tar"
    if found is not None and not (kind == "3mf" and found == "zip"):
        raise InvalidInput(f"the {kind} file is a {found} archive", "Unpack it and upload the mesh itself.")
    if found is None and kind == "3mf":
        raise InvalidInput("the bytes are no 3mf file, which is a zip archive", "Export the mesh again.")


def preflight(data: bytes, kind: str, max_faces: int) -> None:
    """Refuse what announces more than it holds, or more than the limits.

    raises  TooLarge, InvalidInput
    """
    if kind in ("glb", "gltf"):
        _check_gltf(_gltf_tree(data, kind), kind, max_faces)
    elif kind == "ply":
        _check_ply(data)
    elif kind == "off":
        _check_off(data)
    is_text = kind in ("obj", "off") or (kind == "ply" and b"format ascii" in data[:200])
    if (is_text or (kind == "stl" and not is_binary_stl(data))) and len(data) > TEXT_BYTES:
        raise TooLarge(f"The {kind} file has {len(data)} bytes of text; the limit is {TEXT_BYTES}.", SMALLER)


def is_binary_stl(data: bytes) -> bool:
    """80 bytes of header, a count, and 50 bytes for each triangle."""
    return len(data) >= 84 and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little")


def _gltf_tree(data: bytes, kind: str) -> dict[str, Any]:
    try:
        text = data
        if kind == "glb":
            magic, _, _, length, _ = GLB_HEADER.unpack_from(data)
            if magic != b"glTF":
                raise ValueError("the bytes are no glb file")
            text = data[GLB_HEADER.size : GLB_HEADER.size + length]
        tree = json.loads(text)
        if not isinstance(tree, dict):
            raise ValueError("the JSON is no object")
    except (struct.error, ValueError, RecursionError) as error:
        raise InvalidInput(f"the bytes are no readable {kind} file: {error}", AGAIN) from error
    return tree


def _check_gltf(tree: dict[str, Any], kind: str, max_faces: int) -> None:
    try:
        counts = [int(accessor["count"]) for accessor in tree.get("accessors", [])]
        announced = sum(counts)
        for mesh in tree.get("meshes", []):
            for primitive in mesh["primitives"]:
                used = [*primitive.get("attributes", {}).values()]
                used += [primitive["indices"]] if "indices" in primitive else []
                announced += sum(counts[int(index)] for index in used) + 100
        outside = [
            str(each["uri"])[:60]
            for each in (*tree.get("buffers", []), *tree.get("images", []))
            if "uri" in each and not str(each["uri"]).startswith("data:")
        ]
        _check_tree(tree.get("nodes", []))
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        raise InvalidInput(
            f"the bytes are no readable {kind} file: {type(error).__name__}: {error}", AGAIN
        ) from error
    if any(count < 0 for count in counts) or announced > 16 * 3 * max_faces:
        raise TooLarge(f"The mesh announces {announced} values.", SMALLER)
    if kind == "gltf" and outside:
        raise InvalidInput(
            f"the gltf file refers to other files: {', '.join(outside[:3])}",
            "Export it as glb, or with embedded buffers (data: URIs).",
        )


def _check_tree(nodes: list[dict[str, Any]]) -> None:
    """glTF 2.0, 3.5.2: nodes form trees; a node with two parents would be repeated without end."""
    if len(nodes) > MAX_NODES:
        raise TooLarge(f"The mesh has {len(nodes)} nodes; the limit is {MAX_NODES}.", SMALLER)
    parent: dict[int, int] = {}
    for number, node in enumerate(nodes):
        for child in node.get("children", []):
            if int(child) in parent or not 0 <= int(child) < len(nodes):
                raise ValueError("the nodes are no tree")
            parent[int(child)] = number
    for number in range(len(nodes)):
        above, depth = parent.get(number), 0
        while above is not None:
            above, depth = parent.get(above), depth + 1
            if depth > MAX_DEPTH:
                raise TooLarge(f"The nodes of the mesh are nested more than {MAX_DEPTH} deep.", SMALLER)


def _check_ply(data: bytes) -> None:
    head, end, body = data.partition(b"end_header")
    lines = head.decode("latin-1").split("\n")
    if not end or lines[0].strip() != "ply":
        raise InvalidInput("the bytes are no readable ply file: its header does not end", AGAIN)
    is_ascii = any(line.split()[:2] == ["format", "ascii"] for line in lines)
    needed = 0
    count = width = 0
    try:
        for words in [*map(str.split, lines[1:]), ["element", "", "0"]]:
            if words[:1] == ["element"]:
                if count and not width:
                    raise ValueError("an element without properties")
                needed += count * width
                count, width = int(words[2]), 0
                if count < 0:
                    raise ValueError("a negative number of elements")
            elif words[:1] == ["property"]:
                size = SIZES[words[2] if words[1] == "list" else words[1]]
                width += 2 if is_ascii else size
    except (ValueError, LookupError) as error:
        raise InvalidInput(f"the bytes are no readable ply file: {error!r}", AGAIN) from error
    if needed > len(body) + 1:
        raise InvalidInput(
            f"the ply file announces at least {needed} bytes and holds {len(body)}",
            "Copy or export it again.",
        )


def _check_off(data: bytes) -> None:
    lines = (line.partition(b"#")[0].split() for line in data[:HEAD_BYTES].splitlines())
    words = [word for line in lines for word in line][:4]
    try:
        if words[0] not in (b"OFF", b"COFF"):
            raise ValueError(f"it begins with {words[0][:20]!r}")
        vertex_count, face_count = int(words[1]), int(words[2])
    except (ValueError, LookupError) as error:
        raise InvalidInput(f"the bytes are no readable off file: {error}", AGAIN) from error
    # A vertex takes six bytes at least, a triangle eight.
    if vertex_count < 0 or face_count < 0 or 6 * vertex_count + 8 * face_count > len(data):
        raise InvalidInput(
            f"the off file announces {vertex_count} vertices and {face_count} faces in {len(data)} bytes",
            "Copy or export it again.",
        )
