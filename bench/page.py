"""How the page runs in a browser: its weight, its first picture, its frames while people walk among meshes.

Chromium draws by software (SwiftShader), so that the figures are those of a machine without a graphics card.
Frame times are the intervals between calls of requestAnimationFrame while people move at ten states a second
each; the picture is drawn anew in each. The others stand where they were seen once.
"""

from __future__ import annotations

import json
import shutil
import time
from dataclasses import dataclass
from pathlib import PurePath
from threading import Event as Signal
from threading import Thread
from urllib.parse import urlencode

import httpx
import numpy as np
import trimesh
from numpy.typing import NDArray
from playwright.sync_api import Page, sync_playwright
from semap_service.processes.port import free_port
from semap_service.processes.supervisor import Supervisor

from bench.crowd import Floor, build_map, walk
from bench.figure import once
from bench.latency import await_service
from semap.store.database.connection import connect


@dataclass(frozen=True)
class Crowd:
    """How many are on the map, how many of them move, and from where it is looked at."""

    view: str
    people: int
    moving: int


CROWDS = (
    Crowd("plan", 50, 50),
    Crowd("space", 50, 50),
    Crowd("plan", 400, 50),
    Crowd("plan", 400, 200),
    Crowd("space", 400, 200),
)
TRIANGLES = 50_000
BODIES = 50
STATES_PER_S = 10
LENGTH_S = 15.0
PATIENCE_S = 60.0
FLOOR = Floor(8, 6)
ARGUMENTS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]

# Somebody has moved a moment ago.
FRESH = "#status.live"

FRAMES = """(length_ms) => new Promise((resolve) => {
    const times = [];
    let last = performance.now();
    const begin = last;
    const next = (now) => {
        times.push(now - last);
        last = now;
        if (now - begin < length_ms) requestAnimationFrame(next);
        else resolve(times.slice(1));
    };
    requestAnimationFrame(next);
})"""
FIRST_PICTURE = """() => new Promise((resolve) => {
    const told = (found) => resolve(found.getEntries().at(-1).startTime);
    new PerformanceObserver(told).observe({type: "largest-contentful-paint", buffered: true});
})"""


def measure(dsn: str) -> list[dict[str, object]]:
    """Frames [ms] of each crowd, with what the page weighs and how soon it showed something."""
    tracks: dict[int, NDArray[np.int64]] = {}
    with connect(dsn) as connection:
        connection.execute("select semap.ensure_partitions(array[current_date, current_date + 1])")
        for people in {crowd.people for crowd in CROWDS}:
            _, tracks[people] = build_map(connection, _map_of(people), FLOOR.rooms(), people)
    port = free_port()
    url = f"http://127.0.0.1:{port}"
    with Supervisor(dsn) as supervisor:
        supervisor.start("serve", "--port", str(port), "--without-tokens")
        await_service(port)
        for people in tracks:
            _furnish(url, _map_of(people))
        return [_while_they_move(dsn, url, crowd, tracks[crowd.people]) for crowd in CROWDS]


def _map_of(people: int) -> str:
    return f"page{people}"


def _while_they_move(dsn: str, url: str, crowd: Crowd, track_ids: NDArray[np.int64]) -> dict[str, object]:
    done = Signal()
    places = walk(FLOOR, len(track_ids), 2000, pause_s=1.0)
    walking = Thread(target=_move, args=(dsn, track_ids, places, crowd.moving, done))
    walking.start()
    try:
        return _in_browser(url, crowd)
    finally:
        done.set()
        walking.join()


def _in_browser(url: str, crowd: Crowd) -> dict[str, object]:
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=ARGUMENTS)
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        sizes = _sizes(page)
        page.goto(f"{url}/#{urlencode({'map': _map_of(crowd.people), 'view': crowd.view})}")
        page.wait_for_selector("#status[data-state=live]", timeout=PATIENCE_S * 1000)
        page.wait_for_load_state("networkidle")
        first_picture_ms = page.evaluate(FIRST_PICTURE)
        page.wait_for_selector(FRESH, timeout=PATIENCE_S * 1000)
        frames_ms = np.array(page.evaluate(FRAMES, LENGTH_S * 1000))
        browser.close()
    p50, p95 = np.percentile(frames_ms, (50, 95))
    return {
        "view": crowd.view,
        "people": crowd.people,
        "moving": crowd.moving,
        "page_kb": once(sum(sizes) / 1000),
        "first_picture_ms": once(first_picture_ms),
        "frames_per_s": once(len(frames_ms) / LENGTH_S, 1),
        "p50_ms": once(float(p50), 1),
        "p95_ms": once(float(p95), 1),
    }


def _sizes(page: Page) -> list[int]:
    """What comes over the wire for the page's own files [bytes], as it comes."""
    session = page.context.new_cdp_session(page)
    session.send("Network.enable")
    own: set[str] = set()
    sizes: list[int] = []

    def received(event: dict) -> None:
        path = PurePath(httpx.URL(event["response"]["url"]).path)
        if path == PurePath("/") or PurePath("/page") in path.parents:
            own.add(event["requestId"])

    def finished(event: dict) -> None:
        if event["requestId"] in own:
            sizes.append(event["encodedDataLength"])

    session.on("Network.responseReceived", received)
    session.on("Network.loadingFinished", finished)
    return sizes


def _furnish(url: str, name: str) -> None:
    """Things with meshes of so many triangles in all, on the floor."""
    width_m, depth_m = FLOOR.size_m()
    body = trimesh.creation.torus(0.5, 0.2, *_sections(TRIANGLES // BODIES))
    data = body.export(file_type="ply")
    rng = np.random.default_rng(1)
    with httpx.Client(base_url=url, timeout=PATIENCE_S) as client:
        for number in range(BODIES):
            x_m, y_m = rng.uniform(0, 1, 2) * (width_m, depth_m)
            pose = {"x_m": x_m, "y_m": y_m}
            document = json.dumps({"name": f"thing {number}", "concept": "Furniture", "pose": pose})
            files = {"document": (None, document), "mesh": ("thing.ply", data)}
            client.post(f"/maps/{name}/instances", files=files).raise_for_status()


def _sections(triangles: int) -> tuple[int, int]:
    """How finely a torus is cut so that it has about so many triangles."""
    around = round((triangles / 2) ** 0.5 * 1.4)
    return around, round(triangles / 2 / around)


def _move(
    dsn: str, track_ids: NDArray[np.int64], places: NDArray[np.float64], moving: int, done: Signal
) -> None:
    """All are seen once, and then those who move as long as it takes."""
    statement = (
        "insert into semap.track_state (track_id, stamp, x_m, y_m)"
        " select id, clock_timestamp(), x, y"
        " from unnest(%s::bigint[], %s::float8[], %s::float8[]) v (id, x, y)"
    )
    with connect(dsn) as connection:
        seen = len(track_ids)
        for frame in places:
            begun_s = time.monotonic()
            x_m, y_m = frame[:seen].T.tolist()
            connection.execute(statement, [track_ids[:seen].tolist(), x_m, y_m])
            seen = moving
            if done.wait(max(0.0, 1 / STATES_PER_S - (time.monotonic() - begun_s))):
                return
