"""A large body is never held in memory by the service."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from lasting import answers, serving
from patience import until

LINES, LINE_BYTES = 250, 1_000_000
MOST_GROWTH_BYTES = 48 * 1024**2
BOUNDARY = "a-line-that-is-nowhere-else"


def body() -> Iterator[bytes]:
    """A form with a file of a quarter of a gigabyte, made while it is sent."""
    head = 'Content-Disposition: form-data; name="file"; filename="many.ndjson"'
    yield f"--{BOUNDARY}\r\n{head}\r\n\r\n".encode()
    for number in range(LINES):
        thing = {"name": f"thing {number}", "concept": "Thing", "attributes": {"text": "x" * LINE_BYTES}}
        yield json.dumps(thing).encode() + b"\n"
    yield f"\r\n--{BOUNDARY}--\r\n".encode()


def peak_bytes(pid: int) -> int:
    (line,) = (
        each for each in Path(f"/proc/{pid}/status").read_text().splitlines() if each.startswith("VmHWM")
    )
    return int(line.split()[1]) * 1024


@pytest.mark.slow
def test_a_quarter_of_a_gigabyte_passes_through(database: str, tmp_path: Path) -> None:
    with serving(database, "--spool", str(tmp_path)) as (process, url):
        until(lambda: answers(url))
        httpx.post(f"{url}/maps", json={"name": "office"}).raise_for_status()
        before = peak_bytes(process.pid)
        headers = {"Content-Type": f"multipart/form-data; boundary={BOUNDARY}", "Prefer": "respond-async"}
        sent = httpx.post(f"{url}/maps/office/instances/import", content=body(), headers=headers, timeout=300)
        assert sent.status_code == 202, sent.text
        where = url + sent.headers["location"]
        until(lambda: httpx.get(where).json()["progress"] > 0.1)
        assert peak_bytes(process.pid) - before < MOST_GROWTH_BYTES
        httpx.delete(where).raise_for_status()
        until(lambda: httpx.get(where).json()["state"] == "cancelled")
        until(lambda: not list(tmp_path.iterdir()))
        assert httpx.get(f"{url}/instances").json()["instances"] == []
