"""The service: REST and WebSocket over HTTP."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import fastapi_offline
from fastapi import FastAPI
from fastapi.openapi.docs import get_swagger_ui_html
from fastapi.responses import HTMLResponse
from fastapi.staticfiles import StaticFiles

from semap import __version__
from semap.store.database import open_engine
from semap_service.feed import Feed
from semap_service.openapi import describer
from semap_service.origin import OwnOrigin
from semap_service.problem import answer_problems
from semap_service.routes import (
    abstractions,
    anchor,
    concepts,
    descriptions,
    doors,
    event_feed,
    events,
    exchange,
    frames,
    geometries,
    grids,
    health,
    history,
    instances,
    maps,
    object_states,
    operators,
    queries,
    relations,
    rooms,
    rule_runs,
    rules,
    track_amendments,
    tracks,
)
from semap_service.upload import LimitedBody

ROLE = "semap_api"
CONNECTIONS = 20
HEARTBEAT_S = 15.0
SWAGGER = "/docs/files"

DESCRIPTION = """
A semantic map with continuous queries: what is where, who is in which room, and what happened.

Lengths are metres in the map frame (right-handed, z up), angles are quaternions (x y z w), stamps are
RFC 3339 in UTC. Lists give at most `limit` entries and go on at `next`. Every error is a problem document
(RFC 9457) with a `remedy`.

What can be changed is read with an ETag: with If-None-Match an unchanged answer is 304, and a change with
If-Match is refused (412) where another was faster. Semap-Author and Semap-Message sign a change in the
history of the map.
"""

RESOURCES = (
    health,
    exchange,
    maps,
    anchor,
    grids,
    frames,
    descriptions,
    geometries,
    instances,
    abstractions,
    rooms,
    doors,
    operators,
    tracks,
    track_amendments,
    relations,
    object_states,
    events,
    queries,
    rule_runs,
    rules,
    concepts,
    history,
)
LINKS = (
    "/docs",
    "/openapi.json",
    "/health",
    "/maps",
    "/instances",
    "/rooms",
    "/doors",
    "/tracks",
    "/track-amendments",
    "/operators",
    "/relations",
    "/object-states",
    "/events",
    "/queries",
    "/rules",
    "/concepts",
)


def create_app(dsn: str, *, heartbeat_s: float = HEARTBEAT_S) -> FastAPI:
    """The service over a database; it connects when it starts, and again whenever that is lost.

    heartbeat_s  silence on the feed after which it says that it is alive
    """

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        engine = open_engine(dsn, ROLE, application="semap serve", size=CONNECTIONS)
        app.state.engine = engine
        app.state.heartbeat_s = heartbeat_s
        app.state.feed = Feed(engine, dsn)
        following = asyncio.create_task(app.state.feed.run())
        try:
            yield
        finally:
            following.cancel()
            with suppress(asyncio.CancelledError):
                await following
            engine.dispose()

    app = FastAPI(
        title="semap",
        version=__version__,
        summary="A semantic map service with continuous queries",
        description=DESCRIPTION,
        license_info={"name": "Apache-2.0", "identifier": "Apache-2.0"},
        lifespan=lifespan,
        docs_url=None,
        redoc_url=None,
    )
    answer_problems(app)
    for resource in RESOURCES:
        app.include_router(resource.router)
    app.include_router(event_feed.router)
    _add_index(app)
    app.add_middleware(LimitedBody)
    app.add_middleware(OwnOrigin)
    app.openapi = describer(app)  # type: ignore[method-assign]
    return app


def _add_index(app: FastAPI) -> None:
    """The list of links, and interactive documentation that loads nothing from other hosts."""

    @app.get("/", include_in_schema=False)
    def index() -> dict[str, object]:
        return {"name": "semap", "version": __version__, "links": list(LINKS)}

    @app.get("/docs", include_in_schema=False)
    def docs() -> HTMLResponse:
        return get_swagger_ui_html(
            openapi_url="/openapi.json",
            title="semap",
            swagger_js_url=f"{SWAGGER}/swagger-ui-bundle.js",
            swagger_css_url=f"{SWAGGER}/swagger-ui.css",
            swagger_favicon_url=f"{SWAGGER}/favicon.png",
        )

    files = Path(fastapi_offline.__file__).parent / "static"
    app.mount(SWAGGER, StaticFiles(directory=files), name="swagger")
