"""A service that asks for tokens, with two maps, and a token of each kind."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import httpx
import psycopg
import shapely
import uvicorn
from fastapi import FastAPI
from patience import PATIENCE_S, until
from semap_service.access.limits import LIMITS, Limits
from semap_service.serving.app import create_app
from semap_service.serving.uvicorn_server import OPTIONS
from world import World

from semap.store.database.connection import one_transaction
from semap.store.operate.tokens import add_token, revoke_token

KINDS = ("read", "write", "ingest", "admin")
NEVER = "semap_" + "x" * 43


@dataclass
class Guarded:
    """A running service with the tokens that were made for it."""

    dsn: str
    port: int
    app: FastAPI
    tokens: dict[str, str]

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def socket_url(self, path: str) -> str:
        return f"ws://127.0.0.1:{self.port}{path}"

    def client(self, token: str | None = None, **headers: str) -> httpx.Client:
        """Asks with the token of a kind, or with another one."""
        if token is not None:
            headers["Authorization"] = f"Bearer {self.tokens.get(token, token)}"
        return httpx.Client(base_url=self.url, headers=headers, timeout=PATIENCE_S)

    def add_token(self, name: str, *scopes: str, maps: list[str] | None = None) -> str:
        with one_transaction(self.dsn, "semap_admin") as connection:
            self.tokens[name] = add_token(connection, name, scopes, maps=maps, created_by="test")[1]
        return self.tokens[name]


@dataclass
class Building:
    """A guarded service over two maps, and the ids of what is in the office."""

    service: Guarded
    ids: dict[str, int]


@contextmanager
def guarded(dsn: str, limits: Limits = LIMITS, **options: object) -> Iterator[Guarded]:
    """The service as it runs for users, on a port of its own."""
    app = create_app(dsn, heartbeat_s=0.3, limits=limits, **options)  # type: ignore[arg-type]
    config = uvicorn.Config(app, "127.0.0.1", 0, log_level="error", timeout_graceful_shutdown=1, **OPTIONS)
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        until(lambda: server.started or not thread.is_alive())
        port = server.servers[0].sockets[0].getsockname()[1]
        yield Guarded(dsn, port, app, {})
    finally:
        server.should_exit = True
        thread.join()


def give_tokens(service: Guarded) -> None:
    """One for each scope, some that are of no use, and one for the map `annex` alone."""
    for kind in KINDS:
        service.add_token(kind, kind)
    service.add_token("annex", "write", "ingest", maps=["annex"])
    service.add_token("revoked", "admin")
    service.add_token("expired", "admin")
    service.tokens["wrong"] = NEVER
    with one_transaction(service.dsn, "semap_admin") as connection:
        ids = {
            name: id_ for id_, name in connection.exec_driver_sql("select token_id, name from semap.token")
        }
        revoke_token(connection, ids["revoked"])
    with psycopg.connect(service.dsn) as owner:
        owner.execute(
            "update semap.token set expires_at = %s where name = 'expired'",
            [datetime.now(UTC) - timedelta(seconds=1)],
        )


def furnish(dsn: str, *names: str) -> dict[str, int]:
    """The maps `office` and `annex`, or others: a room, a track in it, an event, a state; the ids of what is in the last."""
    ids = {}
    for name in names or ("annex", "office"):
        world = World(dsn, name)
        room = world.add_room(f"{name} room", shapely.box(0, 0, 4, 4))
        track = world.add_track(f"{name} person")
        world.run(
            "insert into semap.track_state (track_id, stamp, x_m, y_m)"
            " select %s, to_timestamp(t), t, 2 from generate_series(1, 6) t",
            track,
        )
        seq = 1 + world.one("select count(*) from semap.event")
        event = world.one(
            "insert into semap.event (seq, event_id, map_id, rule_name, rule_version, type, stamp, since,"
            " track_id, track_name, instance_id, instance_name) values (%s, gen_random_uuid(), %s,"
            " 'room_visits', 1, 'entered', to_timestamp(1), to_timestamp(1), %s, %s, %s, %s) returning event_id",
            seq, world.map_id, track, f"{name} person", room, f"{name} room",
        )  # fmt: skip
        world.run(
            "insert into semap.event_evidence (event_id, uid, place, variable, source, stamp) values (%s, gen_random_uuid(), 0, 'a', 'relation', now())",
            event,
        )
        description = world.one(
            "insert into semap.description (map_id, name) values (%s, %s) returning description_id",
            world.map_id,
            f"{name} lamp",
        )
        change = world.one("select max(change_set_id) from semap.row_version where map_id = %s", world.map_id)
        ids = {
            "map": world.map_id, "instance": room, "track": track, "query": world.query_id, "rule": world.rule_id,
            "frame": world.frame_id, "description": description, "change": change, "source": world.source_id,
        }  # fmt: skip
        world.close()
    return ids
