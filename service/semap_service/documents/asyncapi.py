"""What the feeds send, as an AsyncAPI 3.0 document, made from the models that the code itself writes."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from semap import __version__
from semap_service.documents.feed import CloudEvents, Events, Failure, Heartbeat, Hello, TooSlow
from semap_service.documents.live_map import Delta, LiveHeartbeat, Snapshot
from semap_service.documents.state import SentStates, StatesHello, Taken

JSON = "application/json"
SCHEMAS = "#/components/schemas/{model}"

MESSAGES: dict[str, type[BaseModel]] = {
    "hello": Hello,
    "events": Events,
    "cloudEvents": CloudEvents,
    "heartbeat": Heartbeat,
    "tooSlow": TooSlow,
    "error": Failure,
    "snapshot": Snapshot,
    "delta": Delta,
    "liveHeartbeat": LiveHeartbeat,
    "statesHello": StatesHello,
    "sentStates": SentStates,
    "taken": Taken,
}
FEED = ("hello", "events", "cloudEvents", "heartbeat", "tooSlow", "error")
LIVE = ("snapshot", "delta", "liveHeartbeat", "error")
TOLD_OF_STATES = ("statesHello", "taken", "error")

QUERY: dict[str, dict[str, Any]] = {
    "after": {"type": "integer", "minimum": 0, "description": "Begin after this number of an event."},
    "map": {"type": "string", "description": "Only what is on the map of this name."},
    "type": {"type": "string", "description": "Only events of this type."},
    "rule": {"type": "string", "description": "Only events of this rule."},
    "filter": {"type": "string", "description": "Only events that this CQL2 text takes."},
    "envelope": {"type": "string", "enum": ["cloudevents"], "description": "Events as CloudEvents 1.0."},
}


def asyncapi(host: str, *, secure: bool) -> dict[str, Any]:
    """The document, for a service that is reached at a host with its port."""
    _, schemas = models_json_schema(
        [(model, "serialization") for model in MESSAGES.values()], ref_template=SCHEMAS
    )
    return {
        "asyncapi": "3.0.0",
        "info": {
            "title": "semap",
            "version": __version__,
            "description": "Feeds of a semantic map. The same events come as server-sent events at"
            " /events/stream and by polling /events: see /openapi.json.",
            "license": {"name": "Apache-2.0"},
        },
        "defaultContentType": JSON,
        "servers": {
            "here": {
                "host": host,
                "protocol": "wss" if secure else "ws",
                "security": [{"$ref": "#/components/securitySchemes/token"}],
            }
        },
        "channels": {
            "events": _channel(
                "/events/feed",
                "Every event after a cursor in the order of numbers, then new ones once committed.",
                FEED,
                query=QUERY,
            ),
            "live": {
                **_channel("/maps/{name}/live", "A map as it is now: a snapshot, then changes.", LIVE),
                "parameters": {"name": {"description": "The name of the map."}},
            },
            "states": {
                **_channel(
                    "/maps/{name}/states/live",
                    "States of tracks from a client, each message answered with what was late or refused.",
                    ("sentStates", *TOLD_OF_STATES),
                    query={"source": {"type": "string", "description": "The source of the states."}},
                ),
                "parameters": {"name": {"description": "The name of the map."}},
            },
        },
        "operations": {
            "followEvents": _receives("events", "Follow events.", FEED),
            "watchMap": _receives("live", "Draw a map as it is now.", LIVE),
            "answerStates": _receives("states", "Say what came of each message.", TOLD_OF_STATES),
            "takeStates": {
                **_receives("states", "Take where tracks are.", ("sentStates",)),
                "action": "receive",
            },
        },
        "components": {
            "messages": {name: _message(model) for name, model in MESSAGES.items()},
            "schemas": schemas["$defs"],
            "securitySchemes": {
                "token": {
                    "type": "http",
                    "scheme": "bearer",
                    "description": "Or, from a browser, the subprotocols `semap` and `bearer.TOKEN`.",
                }
            },
        },
    }


def _channel(
    address: str, description: str, messages: tuple[str, ...], query: dict[str, Any] | None = None
) -> dict[str, Any]:
    binding: dict[str, Any] = {"method": "GET", "bindingVersion": "0.1.0"}
    if query is not None:
        binding["query"] = {"type": "object", "properties": query}
    return {
        "address": address,
        "description": description,
        "messages": {name: {"$ref": f"#/components/messages/{name}"} for name in messages},
        "bindings": {"ws": binding},
    }


def _receives(channel: str, summary: str, messages: tuple[str, ...]) -> dict[str, Any]:
    """What the service sends, whose action in AsyncAPI is `send`."""
    return {
        "action": "send",
        "channel": {"$ref": f"#/channels/{channel}"},
        "summary": summary,
        "messages": [{"$ref": f"#/channels/{channel}/messages/{name}"} for name in messages],
    }


def _message(model: type[BaseModel]) -> dict[str, Any]:
    summary = (model.__doc__ or "").strip().split("\n")[0]
    return {
        "name": model.__name__,
        "summary": summary,
        "contentType": JSON,
        "payload": {"$ref": f"#/components/schemas/{model.__name__}"},
    }
