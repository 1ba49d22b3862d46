"""The WebSocket /events/feed: events as they happen.

What the client sends is not looked at.
"""

from __future__ import annotations

import asyncio
from functools import partial

from fastapi import APIRouter, WebSocket

from semap.errors import SemapError
from semap_service.database.transaction import Database
from semap_service.feed.encoding import SocketEncoding
from semap_service.feed.request import cursor_of, selection_of, socket_envelope
from semap_service.feed.ring import Feed
from semap_service.feed.start_position import begin
from semap_service.feed.subscription import follow
from semap_service.http.outlet import Pace, SocketOutlet
from semap_service.http.websocket import TOO_SLOW, accept, close, refuse, until_gone

router = APIRouter()


@router.websocket("/events/feed")
async def event_feed(socket: WebSocket, database: Database) -> None:
    """Hello, then every selected event after the cursor in order, and heartbeats in between."""
    await accept(socket)
    feed: Feed = socket.app.state.feed
    with feed.following("websocket"):
        try:
            parameters = socket.query_params
            selection = selection_of(parameters)
            after = cursor_of(parameters.get("after"), "after")
            envelope = socket_envelope(parameters.get("envelope"), socket)
            beginning = await feed.ask(partial(begin, database, after, selection))
            with socket.app.state.channels.following(selection, SocketEncoding(envelope)) as channel:
                pace: Pace = socket.app.state.pace
                following = follow(feed, channel, SocketOutlet(socket), beginning, pace)
                if await until_gone(socket, asyncio.create_task(following)):
                    await close(socket, TOO_SLOW, "too slow")
        except SemapError as error:
            await refuse(socket, error)
