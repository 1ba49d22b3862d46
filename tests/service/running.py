"""A running service, and a client that holds every answer against the published description."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import cache
from uuid import NAMESPACE_URL, uuid5

import httpx
import numpy as np
import psycopg
import shapely
import trimesh
import uvicorn
from fastapi import FastAPI
from jsonschema import Draft202012Validator
from patience import PATIENCE_S, until
from semap_service.feed.ring import Feed
from semap_service.serving.app import create_app
from shapely.geometry import mapping

START = datetime(2026, 1, 31, 12, tzinfo=UTC)
PROBLEM = "application/problem+json"
STREAM = "text/event-stream"


@cache
def published() -> dict:
    """What every service publishes as /openapi.json; it takes longer to make than most tests."""
    return json.loads(json.dumps(create_app("").openapi()))


class Service:
    """`client` fails the test when an answer is not what /openapi.json says; `raw` does not look."""

    def __init__(self, port: int, plain: psycopg.Connection, app: FastAPI, server: uvicorn.Server) -> None:
        self.url = f"http://127.0.0.1:{port}"
        self.feed_url = f"ws://127.0.0.1:{port}/events/feed"
        self.plain = plain
        self.app = app
        self.server = server
        self.raw = httpx.Client(base_url=self.url, timeout=PATIENCE_S)
        self.described = published()
        self.seen: set[tuple[str, int]] = set()
        self.client = httpx.Client(
            base_url=self.url, timeout=PATIENCE_S, event_hooks={"response": [self._check]}
        )

    @property
    def server_feed(self) -> Feed:
        """The feed of the service itself."""
        return self.app.state.feed

    def pace(self, **limits: float) -> None:
        """Give clients of the feeds other limits."""
        self.app.state.pace = replace(self.app.state.pace, **limits)

    def close(self) -> None:
        self.raw.close()
        self.client.close()

    def _check(self, response: httpx.Response) -> None:
        media_type = response.headers.get("content-type")
        goes_on = media_type is not None and media_type.startswith(STREAM)
        if not goes_on:  # else its reader looks at it, message by message
            response.read()
        operation = self._operation(response.request)
        self.seen.add((operation["operationId"], response.status_code))
        published = operation["responses"].get(str(response.status_code))
        said = f"{response.request.method} {response.request.url} gave {response.status_code}"
        assert published is not None, f"{said}, which is not published: {'' if goes_on else response.text}"
        if "content" not in published:
            assert response.content == b"", said
            return
        assert media_type in published["content"], f"{said} as {media_type}"
        if goes_on or "schema" not in published["content"][media_type]:
            return
        components = {"components": self.described["components"]}
        checker = Draft202012Validator.FORMAT_CHECKER
        schema = {**published["content"][media_type]["schema"], **components}
        Draft202012Validator(schema, format_checker=checker).validate(response.json())
        if media_type == PROBLEM:
            assert response.json()["status"] == response.status_code, said
            assert response.json()["instance"] == response.request.url.path, said

    def _operation(self, request: httpx.Request) -> dict:
        for template, methods in self.described["paths"].items():
            pattern = re.sub(r"\{[^}]*\}", "[^/]+", template)
            path = request.url.raw_path.decode().split("?")[0]
            if re.fullmatch(pattern, path) and request.method.lower() in methods:
                return methods[request.method.lower()]
        raise AssertionError(f"{request.url} is not published")

    def until(self, happens: Callable[[], bool]) -> None:
        until(happens)

    def get(self, path: str, **parameters: object) -> dict:
        response = self.client.get(path, params=parameters)
        assert response.status_code == 200, response.text
        return response.json()

    def make_map(self, name: str = "office") -> dict:
        response = self.client.post("/maps", json={"name": name})
        assert response.status_code == 201, response.text
        return response.json()

    def post_instance(
        self, document: dict, mesh: tuple[str, bytes] | None = None, map_name: str = "office"
    ) -> httpx.Response:
        files = {"document": (None, json.dumps(document))}
        if mesh is not None:
            files["mesh"] = mesh
        return self.client.post(f"/maps/{map_name}/instances", files=files)

    def make_thing(self, name: str, map_name: str = "office", **document: object) -> dict:
        response = self.post_instance({"name": name, "concept": "Thing", **document}, map_name=map_name)
        assert response.status_code == 201, response.text
        return response.json()

    def make_room(self, name: str, area: shapely.Geometry, **more: object) -> dict:
        document = {"name": name, "concept": "Room", "footprint": json.loads(json.dumps(mapping(area)))}
        response = self.post_instance({**document, **more})
        assert response.status_code == 201, response.text
        return response.json()

    def walk(
        self, places: Sequence[tuple[float, float]], track: str = "person", map_name: str = "office"
    ) -> int:
        """A track that is seen at these places, second by second."""
        uid = uuid5(NAMESPACE_URL, f"{map_name}/{track}")
        self.plain.execute(
            "insert into semap.source (map_id, name, watermark)"
            " select map_id, 'lidar', '-infinity' from semap.map where name = %s"
            " on conflict do nothing",
            [map_name],
        )
        track_id = self.plain.execute(
            "insert into semap.track (uid, source_id, map_id, name) select %s, source_id, map_id, %s"
            " from semap.source join semap.map m using (map_id) where m.name = %s returning track_id",
            [uid, track, map_name],
        ).fetchone()[0]
        for second, (x_m, y_m) in enumerate(places):
            self.plain.execute(
                "insert into semap.track_state (track_id, stamp, x_m, y_m) values (%s, %s, %s, %s)",
                [track_id, START + timedelta(seconds=second), x_m, y_m],
            )
        self.plain.execute(
            "update semap.source s set watermark = greatest(s.watermark, %s) from semap.track t"
            " where t.track_id = %s and s.source_id = t.source_id",
            [START + timedelta(seconds=len(places) - 1), track_id],
        )
        return track_id

    def happen(
        self, first: int, count: int = 1, map_name: str = "office", kind: str = "entered", track_id: int = 3
    ) -> None:
        """Events with these numbers, committed at once as the rule worker does."""
        self.plain.execute(
            "with made as (insert into semap.event (seq, event_id, map_id, rule_name, rule_version, type,"
            " stamp, cause, track_id, track_name, instance_id, instance_name, since)"
            " select seq, gen_random_uuid(), map_id, 'room_visits', 1, %(kind)s, %(stamp)s, 'moved',"
            " %(track)s, 'person', 7, 'Room07', %(stamp)s"
            " from semap.map, generate_series(%(first)s::int, %(last)s::int) seq where name = %(map)s"
            " returning 1), known as (update semap.progress set event_seq = greatest(event_seq, %(last)s::int))"
            " select pg_notify('semap_event', '') from (select count(*) from made) done",
            {"kind": kind, "stamp": START, "first": first, "last": first + count - 1}
            | {"map": map_name, "track": track_id},
        )


def box_mesh(x_m: float, y_m: float, z_m: float, file_type: str) -> bytes:
    """A box with one corner at the origin of a z-up frame."""
    box = trimesh.creation.box(extents=[x_m, y_m, z_m])
    box.apply_translation([x_m / 2, y_m / 2, z_m / 2])
    if file_type == "glb":
        box.apply_transform(np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]]))
    data = box.export(file_type=file_type)
    return data.encode() if isinstance(data, str) else data
