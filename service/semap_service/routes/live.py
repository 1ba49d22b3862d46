"""The WebSocket /maps/{name}/live: the map as it is now, for pages that draw it."""

from __future__ import annotations

import asyncio
from functools import partial

from fastapi import APIRouter, WebSocket
from sqlalchemy import Engine

from semap.errors import NotFound, SemapError
from semap.store.map.maps import map_id_of
from semap_service.context.caller import current_caller
from semap_service.database.transaction import Database, transaction
from semap_service.documents.feed import Failure
from semap_service.feed.ring import Feed
from semap_service.http.connection import lent
from semap_service.http.outlet import NotTaken, Pace, SocketOutlet
from semap_service.http.websocket import TOO_SLOW, accept, close, refuse, text_frame, until_gone
from semap_service.live.watch import Watch, show

router = APIRouter()


@router.websocket("/maps/{name}/live")
async def live_map(socket: WebSocket, database: Database, name: str) -> None:
    """A snapshot, then what has changed, at most 20 times a second, and heartbeats in between."""
    await accept(socket)
    feed: Feed = socket.app.state.feed
    with feed.following("live"):
        try:
            map_id = await feed.ask(partial(_visible, database, name))
            connection = lent(socket)
            if connection is not None:
                connection.keep_newest()
            async with socket.app.state.watches.watching(database, map_id, name) as watch:
                showing = _show(watch, SocketOutlet(socket), socket.app.state.pace, feed)
                if await until_gone(socket, asyncio.create_task(showing)):
                    await close(socket, TOO_SLOW, "too slow")
        except SemapError as error:
            await refuse(socket, error)


async def _show(watch: Watch, outlet: SocketOutlet, pace: Pace, feed: Feed) -> None:
    """Show the map until the client takes nothing any more; it is told then."""
    try:
        await show(watch, outlet, pace, own=current_caller().maps is not None)
    except NotTaken:
        feed.too_slow += 1
        outlet.let_pass()
        failure = Failure(
            detail=f"What was sent was not taken within {pace.patience_s:g} s.",
            remedy="Connect again: a snapshot says all that is on the map now.",
        )
        await outlet.put(text_frame(failure.model_dump_json().encode()), pace.patience_s)


def _visible(engine: Engine, name: str) -> int:
    """The id of a map that the caller may see."""
    if not current_caller().may_see(name):
        raise NotFound("map", name, "List the maps to see their names.")
    with transaction(engine) as connection:
        return map_id_of(connection, name)
