"""The client that blocks: it carries out plans with httpx.Client."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import wraps
from types import TracebackType
from typing import TYPE_CHECKING, Generic, Literal, ParamSpec, TypeVar, overload

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
    from semap.client.blocking_stream import StateStream

P = ParamSpec("P")
T = TypeVar("T")


class _Blocking(Generic[P, T]):
    """A method that carries out the plan of an operation."""

    def __init__(self, plan: Callable[P, Plan[T]]) -> None:
        self.plan = plan
        self.__doc__ = plan.__doc__

    @overload
    def __get__(self, client: None, owner: type[Client]) -> _Blocking[P, T]: ...
    @overload
    def __get__(self, client: Client, owner: type[Client]) -> Callable[P, T]: ...
    def __get__(self, client: Client | None, owner: type[Client]) -> _Blocking[P, T] | Callable[P, T]:
        if client is None:
            return self

        @wraps(self.plan)
        def carried_out(*arguments: P.args, **options: P.kwargs) -> T:
            return client.carry_out(self.plan(*arguments, **options))

        return carried_out


class Client:
    """A client of the service. Use it in `with`, or close it.

    url        of the service [default: SEMAP_URL, else http://127.0.0.1:8000]
    token      as `semap token add` says it [default: SEMAP_TOKEN, else none]
    timeout_s  without any sign from the service for so long, it counts as lost
    retries    so often a request is sent again that was not carried out, or may be sent twice
    """

    health = _Blocking(whole_maps.health)
    maps = _Blocking(whole_maps.list_maps)
    map = _Blocking(whole_maps.get_map)
    create_map = _Blocking(whole_maps.create_map)
    delete_map = _Blocking(whole_maps.delete_map)
    import_map = _Blocking(whole_maps.import_map)
    export_map = _Blocking(whole_maps.export_map)
    jobs = _Blocking(whole_maps.list_jobs)
    job = _Blocking(whole_maps.get_job)
    cancel_job = _Blocking(whole_maps.cancel_job)

    rooms = _Blocking(things.list_rooms)
    occupants = _Blocking(things.list_occupants)
    features = _Blocking(places.list_features)
    shapes = _Blocking(places.list_shapes)
    where = _Blocking(places.get_whereabouts)
    route = _Blocking(places.find_route)
    instances = _Blocking(things.list_instances)
    instance = _Blocking(things.get_instance)
    add_instance = _Blocking(things.add_instance)
    change_instance = _Blocking(things.change_instance)
    put_mesh = _Blocking(things.put_mesh)
    delete_instance = _Blocking(things.delete_instance)
    operators = _Blocking(things.list_operators)
    ask = _Blocking(things.ask_operator)

    tracks = _Blocking(happenings.list_tracks)
    track = _Blocking(happenings.get_track)
    history = _Blocking(places.get_history)
    extent = _Blocking(places.get_extent)
    relations = _Blocking(happenings.list_relations)
    object_states = _Blocking(happenings.list_object_states)
    add_object_states = _Blocking(happenings.add_object_states)

    rules = _Blocking(happenings.list_rules)
    rule = _Blocking(happenings.get_rule)
    add_rule = _Blocking(happenings.add_rule)
    change_rule = _Blocking(happenings.change_rule)
    delete_rule = _Blocking(happenings.delete_rule)
    try_rule = _Blocking(happenings.try_rule)
    explain_rule = _Blocking(happenings.explain_rule)

    def __init__(
        self,
        url: str | None = None,
        *,
        token: str | None = None,
        timeout_s: float = 30.0,
        retries: int = 4,
        transport: httpx.BaseTransport | None = None,
    ) -> None:
        self.retries = retries
        self._http = httpx.Client(**settings(url, token, timeout_s), transport=transport)

    def __enter__(self) -> Client:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        self._http.close()

    def carry_out(self, plan: Plan[T]) -> T:
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
                time.sleep(step.seconds)
                told = None
                continue
            with arguments(step) as call:
                try:
                    told = answer_of(self._http.request(**call))
                except httpx.RequestError as error:
                    told = lost(error)

    def stream_states(self, map: str, source: str) -> StateStream:  # noqa: A002
        """Send where tracks are, many times a second, over one connection; to be used in `with`.

        A lost connection is made again, and what was not answered is sent again: nothing is lost or taken
        twice. The source and its tracks are made when they are new.

        raises  AccessRefused; SemapError with what else the service says against it; ServiceUnreachable
                where it never answered
        """
        from semap.client.blocking_stream import StateStream  # noqa: PLC0415  (few stream)

        return StateStream(Streaming(map, source, self.retries), self._http)

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
    ) -> Iterator[Event]: ...
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
    ) -> Table[Event]: ...
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
    ) -> Table[Event] | Iterator[Event]:
        """Events, oldest first; with `follow` one by one as they happen, for ever.

        A lost connection is made again, and nothing is missed or repeated: to go on in another process, keep
        the `seq` of the last event and give it as `after`.

        after   only events after this number; without it all that are stored, or with `follow` what comes
        filter  CQL2 over the properties of events, such as "track = 'ann' AND type = 'entered'"
        gaps    with `follow`: whether events that are no longer kept raise NoLongerKept, or are skipped
        """
        if not follow:
            plan = happenings.list_events(
                map, after=after or 0, type=type, rule=rule, filter=filter, limit=limit
            )
            return self.carry_out(plan)
        wanted = {"map": map, "type": type, "rule": rule, "filter": filter}
        return self._follow(Following(wanted, after, gaps, self.retries))

    def _follow(self, following: Following) -> Iterator[Event]:
        while True:
            wait_s = 0.0
            try:
                with self._http.stream(**stream_arguments(following.request())) as response:
                    if response.is_success:
                        for message in EventSource(response).iter_sse():
                            event = following.take(message.event, message.id, message.data)
                            if event is not None:
                                yield event
                        wait_s = following.lost("it ended")
                    else:
                        response.read()
                        wait_s = following.refused(answer_of(response))
            except (httpx.RequestError, SSEError, Interrupted) as error:
                wait_s = following.lost(str(error) or type(error).__name__)
            time.sleep(wait_s)
