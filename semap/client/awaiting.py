"""The client that awaits: it carries out plans with httpx.AsyncClient."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine
from functools import wraps
from types import TracebackType
from typing import TYPE_CHECKING, Any, Generic, Literal, ParamSpec, TypeVar, overload

import httpx
from httpx_sse import EventSource, SSEError

from semap.client.exchange import Pause, Plan, Told
from semap.client.following import Following, Gaps, Interrupted
from semap.client.plans import happenings, places, things, whole_maps
from semap.client.retrying import patiently
from semap.client.streaming import Streaming
from semap.client.table import Table
from semap.client.transport import answer_of, arguments, lost, settings, stream_arguments
from semap.client.values import Event

if TYPE_CHECKING:
    from semap.client.awaiting_stream import AsyncStateStream

P = ParamSpec("P")
T = TypeVar("T")


class _Awaiting(Generic[P, T]):
    """A method that carries out the plan of an operation, when it is awaited."""

    def __init__(self, plan: Callable[P, Plan[T]]) -> None:
        self.plan = plan
        self.__doc__ = plan.__doc__

    @overload
    def __get__(self, client: None, owner: type[AsyncClient]) -> _Awaiting[P, T]: ...
    @overload
    def __get__(
        self, client: AsyncClient, owner: type[AsyncClient]
    ) -> Callable[P, Coroutine[Any, Any, T]]: ...
    def __get__(
        self, client: AsyncClient | None, owner: type[AsyncClient]
    ) -> _Awaiting[P, T] | Callable[P, Coroutine[Any, Any, T]]:
        if client is None:
            return self

        @wraps(self.plan)
        async def carried_out(*arguments: P.args, **options: P.kwargs) -> T:
            return await client.carry_out(self.plan(*arguments, **options))

        return carried_out


class AsyncClient:
    """The same as Client, for asyncio: operations are awaited, and events are iterated with `async for`.

    Use it in `async with`, or await `close`.
    """

    health = _Awaiting(whole_maps.health)
    maps = _Awaiting(whole_maps.list_maps)
    map = _Awaiting(whole_maps.get_map)
    create_map = _Awaiting(whole_maps.create_map)
    delete_map = _Awaiting(whole_maps.delete_map)
    import_map = _Awaiting(whole_maps.import_map)
    export_map = _Awaiting(whole_maps.export_map)
    jobs = _Awaiting(whole_maps.list_jobs)
    job = _Awaiting(whole_maps.get_job)
    cancel_job = _Awaiting(whole_maps.cancel_job)

    rooms = _Awaiting(things.list_rooms)
    occupants = _Awaiting(things.list_occupants)
    features = _Awaiting(places.list_features)
    shapes = _Awaiting(places.list_shapes)
    where = _Awaiting(places.get_whereabouts)
    route = _Awaiting(places.find_route)
    instances = _Awaiting(things.list_instances)
    instance = _Awaiting(things.get_instance)
    add_instance = _Awaiting(things.add_instance)
    change_instance = _Awaiting(things.change_instance)
    put_mesh = _Awaiting(things.put_mesh)
    delete_instance = _Awaiting(things.delete_instance)
    operators = _Awaiting(things.list_operators)
    ask = _Awaiting(things.ask_operator)

    tracks = _Awaiting(happenings.list_tracks)
    track = _Awaiting(happenings.get_track)
    history = _Awaiting(places.get_history)
    extent = _Awaiting(places.get_extent)
    relations = _Awaiting(happenings.list_relations)
    object_states = _Awaiting(happenings.list_object_states)
    add_object_states = _Awaiting(happenings.add_object_states)

    rules = _Awaiting(happenings.list_rules)
    rule = _Awaiting(happenings.get_rule)
    add_rule = _Awaiting(happenings.add_rule)
    change_rule = _Awaiting(happenings.change_rule)
    delete_rule = _Awaiting(happenings.delete_rule)
    try_rule = _Awaiting(happenings.try_rule)
    explain_rule = _Awaiting(happenings.explain_rule)

    def __init__(
        self,
        url: str | None = None,
        *,
        token: str | None = None,
        timeout_s: float = 30.0,
        retries: int = 4,
        transport: httpx.AsyncBaseTransport | None = None,
    ) -> None:
        self.retries = retries
        self._http = httpx.AsyncClient(**settings(url, token, timeout_s), transport=transport)

    async def __aenter__(self) -> AsyncClient:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def close(self) -> None:
        await self._http.aclose()

    async def carry_out(self, plan: Plan[T]) -> T:
        """Do what an operation wants done, step by step."""
        steps = patiently(plan, self.retries)
        told: Told = None
        while True:
            try:
                step = steps.send(told)
            except StopIteration as end:
                value: T = end.value
                return value
            if isinstance(step, Pause):
                await asyncio.sleep(step.seconds)
                told = None
                continue
            with arguments(step) as call:
                try:
                    told = answer_of(await self._http.request(**call))
                except httpx.RequestError as error:
                    told = lost(error)

    def stream_states(self, map: str, source: str) -> AsyncStateStream:  # noqa: A002
        """As Client.stream_states, for `async with`."""
        from semap.client.awaiting_stream import AsyncStateStream  # noqa: PLC0415  (few stream)

        return AsyncStateStream(Streaming(map, source, self.retries), self._http)

    @overload
    def events(
        self,
        map: str | None = ...,
        *,
        follow: Literal[True],
        after: int | None = ...,
        type: str | None = ...,
        rule: str | None = ...,
        filter: str | None = ...,
        gaps: Gaps = ...,
    ) -> AsyncIterator[Event]: ...
    @overload
    def events(
        self,
        map: str | None = ...,
        *,
        follow: Literal[False] = ...,
        after: int | None = ...,
        type: str | None = ...,
        rule: str | None = ...,
        filter: str | None = ...,
        limit: int | None = ...,
    ) -> Awaitable[Table[Event]]: ...
    def events(
        self,
        map: str | None = None,  # noqa: A002
        *,
        follow: bool = False,
        after: int | None = None,
        type: str | None = None,  # noqa: A002
        rule: str | None = None,
        filter: str | None = None,  # noqa: A002
        limit: int | None = None,
        gaps: Gaps = "raise",
    ) -> Awaitable[Table[Event]] | AsyncIterator[Event]:
        """As Client.events: a list to be awaited, or with `follow` an iterator for `async for`."""
        if not follow:
            plan = happenings.list_events(
                map, after=after or 0, type=type, rule=rule, filter=filter, limit=limit
            )
            return self.carry_out(plan)
        wanted = {"map": map, "type": type, "rule": rule, "filter": filter}
        return self._follow(Following(wanted, after, gaps, self.retries))

    async def _follow(self, following: Following) -> AsyncIterator[Event]:
        while True:
            wait_s = 0.0
            try:
                async with self._http.stream(**stream_arguments(following.request())) as response:
                    if response.is_success:
                        async for message in EventSource(response).aiter_sse():
                            event = following.take(message.event, message.id, message.data)
                            if event is not None:
                                yield event
                        wait_s = following.lost("it ended")
                    else:
                        await response.aread()
                        wait_s = following.refused(answer_of(response))
            except (httpx.RequestError, SSEError, Interrupted) as error:
                wait_s = following.lost(str(error) or type(error).__name__)
            await asyncio.sleep(wait_s)
