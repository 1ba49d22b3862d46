"""/maps/{name}/states, and the WebSocket /maps/{name}/states/live"""

from __future__ import annotations

import asyncio
from contextlib import suppress
from functools import partial
from typing import Annotated

from fastapi import APIRouter, Query, Request, WebSocket, WebSocketDisconnect
from semap_ingest.state_json import states_of_lines
from sqlalchemy import Engine

from semap.errors import InvalidInput, NotFound, SemapError
from semap.store.map.maps import map_id_of
from semap_service.context.caller import current_caller
from semap_service.database.shards import Shards
from semap_service.database.transaction import Database, Everywhere, transaction
from semap_service.documents.document import InStamp, Name
from semap_service.documents.json_values import require_few_values
from semap_service.documents.state import (
    SEQUENCE,
    WATERMARK,
    Sequence,
    StatesHello,
    Taken,
    TakenStates,
)
from semap_service.http.problem import problems
from semap_service.http.websocket import accept, close, refuse
from semap_service.states.taking import Message, StateTaking, read_message, watermark_us

router = APIRouter(tags=["tracks"])

NDJSON = "application/x-ndjson"
WINDOW = 16
NORMAL = 1000

BODY = {
    "requestBody": {
        "required": True,
        "content": {
            "application/json": {"schema": {"$ref": "#/components/schemas/NewStates"}},
            NDJSON: {
                "schema": {"type": "string", "description": "A state a line; `source` is a parameter."},
                "example": '{"track":"person 3","stamp":"2026-01-31T12:00:00Z","x_m":1.0,"y_m":1.5}\n',
            },
        },
    }
}


@router.post(
    "/maps/{name}/states",
    operation_id="add_states",
    responses=problems(404, 409, 413),
    openapi_extra=BODY,
)
async def add_states(
    request: Request,
    name: str,
    database: Database,
    shards: Everywhere,
    source: Annotated[Name | None, Query(description="Of lines of JSON: made where it is missing.")] = None,
    sequence: Annotated[Sequence | None, Query(description=f"Of lines of JSON. {SEQUENCE}")] = None,
    watermark: Annotated[InStamp | None, Query(description=f"Of lines of JSON. {WATERMARK}")] = None,
) -> TakenStates:
    """Tell where tracks were: JSON rows or columns, or lines of JSON. Tracks are made when they are new.

    What cannot be used is refused state by state, and keeps no other out. A state that is stored already is
    refused as `repeated`, so that a request may be sent again; with `sequence` it is passed over as a whole.
    """
    body = await request.body()
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()

    def take() -> TakenStates:
        require_visible(database, name)
        if kind == NDJSON:
            if source is None:
                raise InvalidInput("lines of JSON do not say their source", "Add ?source=NAME.", "source")
            require_few_values(body)
            states, refused = states_of_lines(body.splitlines())
            message = Message(source, states, refused, sequence, watermark_us(watermark))
        else:
            message = read_message(body)
        return StateTaking(shards.states_of(name), name).take(message)

    return await asyncio.to_thread(take)


@router.websocket("/maps/{name}/states/live")
async def stream_states(socket: WebSocket, name: str, database: Database, shards: Everywhere) -> None:
    """Hello, then an answer to each message, in their order.

    While the database is slow nothing is read, so that the client waits; at most WINDOW messages may be on
    their way unanswered.
    """
    await accept(socket)
    try:
        source = socket.query_params.get("source", "")
        if not source:
            raise InvalidInput("the source is not said", "Add ?source=NAME.", "source")
        taking = await asyncio.to_thread(partial(_taking, shards, database, name))
        last = await asyncio.to_thread(partial(taking.last, source))
        hello = StatesHello(source=source, sequence=last, window=WINDOW)
        await socket.send_text(hello.model_dump_json())
        with suppress(WebSocketDisconnect):
            while True:
                body = (await socket.receive_text()).encode()
                answer = await asyncio.to_thread(partial(_take, taking, body, source, last))
                last = answer.sequence or last
                await socket.send_text(answer.model_dump_json())
    except SemapError as error:
        await refuse(socket, error)
    except (KeyError, UnicodeError):  # bytes in place of text
        await close(socket, NORMAL, "send text")


def _taking(shards: Shards, database: Engine, name: str) -> StateTaking:
    require_visible(database, name)
    return StateTaking(shards.states_of(name), name)


def _take(taking: StateTaking, body: bytes, source: str, last: int) -> Taken:
    message = read_message(body, source)
    if message.sequence is None:
        raise InvalidInput("the message has no sequence number", "Count messages.", "sequence")
    return Taken(**taking.take(message, after=last).model_dump())


def require_visible(engine: Engine, name: str) -> None:
    """raises NotFound for a map that the caller does not see"""
    if not current_caller().may_see(name):
        raise NotFound("map", name, "List the maps to see their names.")
    with transaction(engine) as connection:
        map_id_of(connection, name)
