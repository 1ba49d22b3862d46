"""Lists over all maps where these are on several shards: each shard is asked, and the answers become one.

What has a number is listed in the order of numbers, of which each shard has a range: the list of the second
shard begins where that of the first ends, and a cursor says both. What goes by name is merged.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any
from urllib.parse import parse_qs, urlencode

from anyio import to_thread
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from semap.errors import SemapError
from semap.store.map.places import Shard
from semap_service.access.authorisation import route_path
from semap_service.database.shards import Shards
from semap_service.documents.ogc_features import Link
from semap_service.http.etag import etag_of, names
from semap_service.ogc.links import link_header

BY_NUMBER: Mapping[str, str] = {
    "/instances": "instances",
    "/rooms": "rooms",
    "/doors": "doors",
    "/tracks": "tracks",
    "/track-amendments": "track_amendments",
    "/sources": "sources",
    "/queries": "queries",
    "/rules": "rules",
    "/relations": "relations",
    "/object-states": "object_states",
}
BY_NAME: Mapping[str, str] = {"/maps": "maps", "/concepts": "concepts"}
COLLECTIONS = "/collections"
MOST_COLLECTIONS = 10_000
DEFAULT_LIMITS = {"/concepts": 1000, COLLECTIONS: 1000}
DEFAULT_LIMIT = 100


@dataclass
class Answer:
    """Mutable: what was answered, as it comes."""

    status: int = 0
    headers: Sequence[tuple[bytes, bytes]] = ()
    body: bytes = b""

    async def take(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            self.status, self.headers = message["status"], message["headers"]
        else:
            self.body += message.get("body", b"")


class Merged:
    """ASGI middleware; a request that is about one map, or a service without shards, is left as it is."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        path = route_path(scope) if scope["type"] == "http" and scope["method"] == "GET" else ""
        query = parse_qs(scope["query_string"].decode("latin-1"), keep_blank_values=True) if path else {}
        if (path not in BY_NUMBER and path not in BY_NAME and path != COLLECTIONS) or "map" in query:
            await self.app(scope, receive, send)
            return
        shards: Shards = scope["app"].state.shards
        try:
            known = await to_thread.run_sync(shards.all)
        except SemapError:  # which whoever answers says better
            known = ()
        if len(known) < 2:
            await self.app(scope, receive, send)
            return
        answer = await _Asking(self.app, scope, path, query).merged(known)
        await _send(answer, Headers(scope=scope).get("if-none-match"), send)


@dataclass(frozen=True)
class _Asking:
    app: ASGIApp
    scope: Scope
    path: str
    query: Mapping[str, list[str]]

    async def merged(self, shards: Sequence[Shard]) -> Answer:
        """The answer of all, or the first that is none."""
        if self.path == COLLECTIONS:
            return await self._collections(shards)
        return await (self._by_number if self.path in BY_NUMBER else self._by_name)(shards)

    async def _by_number(self, shards: Sequence[Shard]) -> Answer:
        key = BY_NUMBER[self.path]
        answer = await self._ask(shards[0])
        found = _document(answer)
        for shard in shards[1:]:
            limit = self._number("limit", DEFAULT_LIMIT)
            if found is None or len(found[key]) >= limit:
                break
            answer_of_next = await self._ask(shard, limit=limit - len(found[key]))
            more = _document(answer_of_next)
            if more is None:
                return answer_of_next
            found = {**more, key: found[key] + more[key]}
        return _written(answer, found)

    async def _by_name(self, shards: Sequence[Shard]) -> Answer:
        key = BY_NAME[self.path]
        by_name: dict[str, Any] = {}
        for shard in shards:
            answer = await self._ask(shard)
            found = _document(answer)
            if found is None:
                return answer
            by_name = {each["name"]: each for each in found[key]} | by_name
        limit = self._number("limit", DEFAULT_LIMITS.get(self.path, DEFAULT_LIMIT))
        shown = [by_name[name] for name in sorted(by_name)[:limit]]
        following = shown[-1]["name"] if len(shown) == limit else None
        return _written(answer, {key: shown, "next": following})

    async def _collections(self, shards: Sequence[Shard]) -> Answer:
        """By the names of maps; a map has all of its collections on one shard, in their order."""
        offset, limit = self._number("offset", 0), self._number("limit", DEFAULT_LIMITS[COLLECTIONS])
        every: list[dict[str, Any]] = []
        links: list[dict[str, Any]] = []
        for shard in shards:
            answer = await self._ask(shard, offset=0, limit=min(offset + limit + 1, MOST_COLLECTIONS))
            found = _document(answer)
            if found is None:
                return answer
            every += found["collections"]
            links = [each for each in found["links"] if each["rel"] == "root"]
        every.sort(key=lambda each: str(each["id"]).rpartition(".")[0])
        shown = every[offset : offset + limit]
        for rel, begin in (("self", offset), ("next", offset + limit), ("prev", max(0, offset - limit))):
            if rel == "self" or (rel == "next" and len(every) > begin) or (rel == "prev" and offset):
                asked = self._query(offset=begin or None)
                where = links[0]["href"].rstrip("/") + COLLECTIONS + (f"?{asked}" if asked else "")
                links.append({"href": where, "rel": rel, "type": "application/json", "title": rel})
        return _written(answer, {"collections": shown, "links": links, "numberReturned": len(shown)})

    def _number(self, name: str, default: int) -> int:
        """Of a parameter that whoever answered has found to be a number."""
        given = self.query.get(name, [""])[-1]
        return int(given) if given.isdigit() else default

    def _query(self, **changed: object) -> str:
        said = {
            **self.query,
            **{name: [] if value is None else [str(value)] for name, value in changed.items()},
        }
        return urlencode(said, doseq=True)

    async def _ask(self, shard: Shard, **changed: object) -> Answer:
        """Let a shard answer for itself."""
        headers = [each for each in self.scope["headers"] if each[0] != b"if-none-match"]
        scope = {
            **self.scope,
            "state": {**self.scope.get("state", {}), "shard": shard},
            "query_string": self._query(**changed).encode(),
            "headers": headers,
        }
        answer = Answer()
        await self.app(scope, _nothing_more, answer.take)
        return answer


async def _nothing_more() -> Message:
    return {"type": "http.request", "body": b"", "more_body": False}


def _document(answer: Answer) -> dict[str, Any] | None:
    """What a list says; None where the answer is a problem."""
    if answer.status != HTTPStatus.OK:
        return None
    document: dict[str, Any] = json.loads(answer.body)
    return document


def _written(answer: Answer, document: dict[str, Any] | None) -> Answer:
    """The answer with another document in it."""
    if document is not None:
        answer.body = json.dumps(document, ensure_ascii=False, separators=(",", ":")).encode()
    return answer


async def _send(answer: Answer, known: str | None, send: Send) -> None:
    headers = MutableHeaders(raw=list(answer.headers))
    if "etag" in headers:
        headers["etag"] = etag_of(answer.body)
        if known is not None and names(known, headers["etag"], weakly=True):
            answer.status, answer.body = HTTPStatus.NOT_MODIFIED, b""
    if "content-length" in headers:
        headers["content-length"] = str(len(answer.body))
    if "link" in headers and answer.status == HTTPStatus.OK and b'"collections"' in answer.body[:20]:
        headers["link"] = link_header([Link(**each) for each in json.loads(answer.body)["links"]])
    await send({"type": "http.response.start", "status": int(answer.status), "headers": headers.raw})
    await send({"type": "http.response.body", "body": answer.body})
