"""The service: REST and WebSocket over HTTP."""

from __future__ import annotations

import asyncio
import base64
import re
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import replace
from functools import partial
from hashlib import sha256
from pathlib import Path

import fastapi_offline
from fastapi import FastAPI
from fastapi.openapi.docs import get_swagger_ui_html
from fastapi.responses import HTMLResponse
from fastapi.staticfiles import StaticFiles
from sqlalchemy import Engine

from semap import __version__
from semap.store.database.connection import open_engine
from semap_service.access.authorisation import Authorisation
from semap_service.access.cors import CrossOrigin
from semap_service.access.limits import LIMITS, Limits
from semap_service.access.token_cache import TokenCache
from semap_service.context.caller import SYSTEM, acting_as
from semap_service.database.shards import Shards
from semap_service.feed.channel import Channels
from semap_service.feed.ring import Feed
from semap_service.http.body_limit import LimitedBody
from semap_service.http.compression import Compressed
from semap_service.http.head_method import Headed
from semap_service.http.json_body import BoundedJson
from semap_service.http.outlet import Pace
from semap_service.http.own_origin import OwnOrigin, require_origin
from semap_service.http.page import add_page
from semap_service.http.problem import answer_problems, published_methods, unexpected
from semap_service.http.security_headers import PAGE_POLICY
from semap_service.jobs.runner import JOBS, JobRunner, JobSettings
from semap_service.jobs.upload_limit import body_limit
from semap_service.live.watch import Watches
from semap_service.operations.instruments import Instruments
from semap_service.operations.metrics import Metrics
from semap_service.operations.request_log import RequestLog, Routed
from semap_service.routes import (
    abstractions,
    anchor,
    concepts,
    descriptions,
    doors,
    event_feed,
    event_stream,
    events,
    exchange,
    frames,
    geometries,
    grids,
    health,
    history,
    instances,
    jobs,
    live,
    maps,
    metrics,
    moment,
    object_states,
    ogc_collections,
    ogc_items,
    ogc_landing,
    ogc_moving,
    operators,
    queries,
    relations,
    rooms,
    route,
    rule_runs,
    rule_templates,
    rule_texts,
    rules,
    sources,
    states,
    tokens,
    track_amendments,
    tracks,
    webhooks,
    whereabouts,
)
from semap_service.serving.merged import Merged
from semap_service.serving.openapi import add_description, describer
from semap_service.webhooks.delivery import WEBHOOKS, Deliverer, WebhookSettings

ROLE = "semap_api"
CONNECTIONS = 20
STATES_ROLE = "semap_ingest"
STATES_CONNECTIONS = 10
HEARTBEAT_S = 15.0
TICK_S = 1.0
SWAGGER = "/docs/files"
SCRIPT = re.compile(rb"<script>(.*?)</script>", re.DOTALL)

DESCRIPTION = """
A semantic map with continuous queries: instances, tracks, their relations, and events.

Lengths are metres in the map frame (right-handed, z up), angles are quaternions (x y z w), stamps are
RFC 3339 in UTC. Lists have at most `limit` entries; `next` is the cursor of the next page. Every error is
a problem document (RFC 9457) with a `remedy`.

Editable resources have an ETag: with If-None-Match an unchanged response is 304, and a change with
If-Match is refused (412) after another change. Semap-Author and Semap-Message sign a change in the
history of the map.
"""

RESOURCES = (
    ogc_landing,
    ogc_collections,
    ogc_items,
    ogc_moving,
    health,
    metrics,
    exchange,
    maps,
    moment,
    anchor,
    grids,
    frames,
    descriptions,
    geometries,
    instances,
    abstractions,
    whereabouts,
    route,
    rooms,
    doors,
    operators,
    tracks,
    track_amendments,
    sources,
    states,
    relations,
    object_states,
    events,
    event_stream,
    queries,
    rule_runs,
    rule_templates,
    rule_texts,
    rules,
    concepts,
    history,
    tokens,
    jobs,
    webhooks,
)


def create_app(
    dsn: str,
    *,
    heartbeat_s: float = HEARTBEAT_S,
    without_tokens: bool = False,
    allowed_origins: Sequence[str] = (),
    limits: Limits = LIMITS,
    job_settings: JobSettings = JOBS,
    webhook_settings: WebhookSettings = WEBHOOKS,
) -> FastAPI:
    """The service over a database; it connects when it starts, and again whenever that is lost.

    heartbeat_s      silence on the feed after which it says that it is alive
    without_tokens   whoever reaches it may do everything; for programs on the same machine only
    allowed_origins  the sites whose pages may call it from a browser, such as https://maps.example
    """

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        engine = open_engine(dsn, ROLE, application="semap serve", size=CONNECTIONS)
        app.state.engine = token_cache.engine = engine
        app.state.token_cache = token_cache
        app.state.shards = _shards(dsn, engine)
        app.state.watch = open_engine(dsn, ROLE, application="semap watch", size=1)
        app.state.metrics = Metrics(instruments, app.state.watch, engine)
        app.state.pace = Pace(heartbeat_s)
        app.state.feed = Feed(engine, dsn, tick_s=min(TICK_S, heartbeat_s / 3))
        app.state.channels = Channels(app.state.feed)
        app.state.watches = Watches()
        app.state.feed.on_taken = instruments.feed_took
        app.state.jobs = JobRunner(dsn, engine, job_settings)
        app.state.webhooks = Deliverer(
            dsn,
            replace(webhook_settings, allow_private=webhook_settings.allow_private or without_tokens),
            app.state.feed.wait,
        )
        with acting_as(SYSTEM):
            following = asyncio.create_task(app.state.feed.run())
            delivering = asyncio.create_task(app.state.webhooks.run())
        app.state.jobs.start()
        try:
            yield
        finally:
            await asyncio.to_thread(app.state.jobs.stop)
            for task in (delivering, following):
                task.cancel()
                with suppress(asyncio.CancelledError):
                    await task
            for each in (app.state.shards, app.state.watch, engine):
                each.dispose()

    instruments = Instruments()
    token_cache = TokenCache()
    app = FastAPI(
        title="semap",
        version=__version__,
        summary="A semantic map service with continuous queries",
        description=DESCRIPTION,
        license_info={"name": "Apache-2.0", "identifier": "Apache-2.0"},
        lifespan=lifespan,
        openapi_url=None,
        docs_url=None,
        redoc_url=None,
    )
    answer_problems(app)
    for resource in RESOURCES:
        app.include_router(resource.router)
    app.include_router(event_feed.router)
    app.include_router(live.router)
    app.state.methods = published_methods(each.router for each in RESOURCES)
    _add_documents(app)
    app.add_middleware(Merged)
    app.add_middleware(Routed)
    app.add_middleware(Compressed)
    app.add_middleware(Headed)
    app.add_middleware(BoundedJson)
    app.add_middleware(
        LimitedBody,
        limit_of=lambda scope: body_limit(scope, job_settings.most_bytes),
        stall_s=limits.stall_s,
    )
    app.add_middleware(Authorisation, limits=limits, token_cache=None if without_tokens else token_cache)
    origins = [require_origin(each) for each in allowed_origins]
    app.add_middleware(OwnOrigin, allowed=origins)
    if origins:
        app.add_middleware(CrossOrigin, origins=origins)
    app.add_middleware(RequestLog, instruments=instruments, failed=unexpected)
    app.openapi = describer(app)  # type: ignore[method-assign]
    return app


def _shards(dsn: str, engine: Engine) -> Shards:
    """With as many connections to each shard as to the directory."""
    open_requests = partial(open_engine, role=ROLE, application="semap serve", size=CONNECTIONS)
    open_states = partial(open_engine, role=STATES_ROLE, application="semap states", size=STATES_CONNECTIONS)
    return Shards(dsn, engine, open_requests, open_states)


def _add_documents(app: FastAPI) -> None:
    """The page, /openapi.json, and interactive documentation, which loads nothing from other hosts."""
    add_description(app)
    add_page(app)

    page = get_swagger_ui_html(
        openapi_url="/openapi.json",
        title="semap",
        swagger_js_url=f"{SWAGGER}/swagger-ui-bundle.js",
        swagger_css_url=f"{SWAGGER}/swagger-ui.css",
        swagger_favicon_url=f"{SWAGGER}/favicon.png",
    )
    page.headers["Content-Security-Policy"] = f"{PAGE_POLICY}; {_own_scripts(bytes(page.body))}"

    @app.get("/docs", include_in_schema=False)
    def docs() -> HTMLResponse:
        return page

    files = Path(fastapi_offline.__file__).parent / "static"
    app.mount(SWAGGER, StaticFiles(directory=files), name="swagger")


def _own_scripts(page: bytes) -> str:
    """The directives by which a page may run the scripts that are written in it, and no others."""
    digests = (base64.b64encode(sha256(each).digest()).decode() for each in SCRIPT.findall(page))
    allowed = " ".join(f"'sha256-{each}'" for each in digests)
    return f"script-src 'self' {allowed}; style-src 'self' 'unsafe-inline'"
