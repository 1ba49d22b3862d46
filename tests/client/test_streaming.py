"""States are sent once each, however often the service is killed meanwhile."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta

import numpy as np
import psycopg
import pytest
from killable import Serving

from semap import AsyncClient, Client
from semap.errors import Conflict, InvalidInput, SemapError, ServiceUnreachable
from semap.store.database.connection import connect

START = datetime(2026, 1, 31, 12, tzinfo=UTC)
STORED = "select t.name, s.stamp, s.x_m from semap.stored_state s join semap.track t using (track_id) order by s.stamp, 1"
MESSAGES = 60
KILLS = (5, 58)


@pytest.fixture
def plain(serving: Serving) -> Iterator[psycopg.Connection]:
    with connect(serving.dsn) as connection:
        with Client(serving.url) as client:
            client.create_map("office")
        yield connection


def frame(number: int) -> dict:
    return {
        "track": ["a", "b", "c"], "stamp": START + timedelta(seconds=number / 15),
        "x_m": np.arange(3) + number / 100, "y_m": [0.0, 0.0, 0.0],
    }  # fmt: skip


def expected() -> list[tuple]:
    return [
        (name, START + timedelta(seconds=number / 15), i + number / 100)
        for number in range(MESSAGES)
        for i, name in enumerate("abc")
    ]


def test_nothing_is_lost_or_taken_twice_by_kills(serving: Serving, plain: psycopg.Connection) -> None:
    answers = []
    with Client(serving.url) as client, client.stream_states("office", "lidar") as stream:
        for number in range(MESSAGES):
            if number in KILLS:
                serving.kill()
                serving.start()
            answers += stream.send(frame(number))
        answers += stream.flush()
    assert plain.execute(STORED).fetchall() == expected()
    assert [each.sequence for each in answers] == sorted({each.sequence for each in answers})
    assert answers[-1].sequence == MESSAGES


def test_the_same_with_a_client_that_awaits(serving: Serving, plain: psycopg.Connection) -> None:
    async def run() -> None:
        async with AsyncClient(serving.url) as client, client.stream_states("office", "lidar") as stream:
            for number in range(MESSAGES):
                if number in KILLS:
                    await asyncio.to_thread(serving.kill)
                    await asyncio.to_thread(serving.start)
                await stream.send(frame(number))
            await stream.flush()

    asyncio.run(run())
    assert plain.execute(STORED).fetchall() == expected()


def test_another_process_goes_on_after_it(serving: Serving, plain: psycopg.Connection) -> None:
    for number in range(3):
        with Client(serving.url) as client, client.stream_states("office", "lidar") as stream:
            stream.send(frame(number))
    assert len(plain.execute(STORED).fetchall()) == 9
    assert plain.execute("select position from semap.bridge_position").fetchall() == [({"sequence": 3},)]


def test_what_is_wrong_is_told(serving: Serving, plain: psycopg.Connection) -> None:
    with Client(serving.url) as client:
        with client.stream_states("office", "lidar") as stream:
            stream.send([{"track": "a", "stamp": START, "x_m": 0.0, "y_m": 0.0}, {"track": "b"}])
            (answer,) = stream.flush()
            assert (answer.accepted, answer.refused, answer.refusals[0].index) == (1, 1, 1)
            with pytest.raises(InvalidInput, match="no zone"):
                stream.send([{"track": "a", "stamp": datetime(2026, 1, 1)}])  # noqa: DTZ001
        with pytest.raises(SemapError, match="no map nowhere"), client.stream_states("nowhere", "lidar"):
            pass
        one, other = (client.stream_states("office", "lidar") for _ in range(2))
        with pytest.raises((Conflict, SemapError), match="Another client"), one, other:  # noqa: PT012
            one.send(frame(0))
            one.flush()
            other.send(frame(1))
            other.flush()


def test_a_service_that_never_answers_is_told() -> None:
    with (
        Client("http://127.0.0.1:9", retries=1) as client,
        pytest.raises(ServiceUnreachable, match="States cannot be sent"),
        client.stream_states("office", "lidar"),
    ):
        pass
