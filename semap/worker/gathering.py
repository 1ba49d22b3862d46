"""Events of the shards come to their directory, which numbers them: one feed of all maps, with one cursor.

A thread for each shard is woken as feeds are, reads on, and writes events with how far it has come in one
transaction (`semap.collect_events`); an event that is there already is passed over. Maps that were deleted on
their shard by somebody who did not come to say so are forgotten here.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from functools import partial
from threading import Event as Signal

from semap.store.database.connection import listen, own_session, wait_for_notice
from semap.store.event.collected import collect, offsets
from semap.store.event.gathered import hold_gathering, read_events, topic_of, unknown_maps
from semap.store.map.places import Shard, list_shards
from semap.store.operate.shards import forget_map
from semap.worker.beside import again_and_again, beside

log = logging.getLogger(__name__)

ROLE = "semap_worker"
ADMIN = "semap_admin"
LOOK_S = 1.0
FORGET_S = 60.0
RETRY_S = 1.0


@contextmanager
def gathering(dsn: str) -> Iterator[None]:
    """Events are gathered as long as this lasts, from shards that are added meanwhile, too."""
    work = partial(
        again_and_again, partial(_follow, dsn), log=log, waits="Shards are looked for later", retry_s=RETRY_S
    )
    with beside("gathering", work):
        yield


def _follow(dsn: str, stop: Signal) -> None:
    """A thread for each shard, until there are others."""
    with closing(own_session(dsn, ADMIN, application="semap work: gathering")) as directory:
        while not stop.is_set():
            shards = [each for each in list_shards(directory) if each.dsn is not None]
            ways = _ways(shards)
            with ExitStack() as stack:
                for shard in shards:
                    stack.enter_context(beside(f"gathering {shard.name}", partial(_gather, dsn, shard)))
                while not stop.wait(LOOK_S) and _ways(list_shards(directory)) == ways:
                    pass


def _ways(shards: Sequence[Shard]) -> set[tuple[str, str]]:
    """What tells shards, and where they are, from others."""
    return {(each.name, each.dsn) for each in shards if each.dsn is not None}


def _gather(dsn: str, shard: Shard, stop: Signal) -> None:
    waits = f"Events of the shard {shard.name} are gathered later"
    again_and_again(partial(_read_on, dsn, shard), stop, log, waits, RETRY_S)


def _read_on(dsn: str, shard: Shard, stop: Signal) -> None:
    application = "semap work: gathering"
    where = shard.dsn or dsn
    with (
        closing(own_session(dsn, ROLE, application=application)) as directory,
        closing(own_session(where, ROLE, application=application)) as there,
        listen(where, "semap_event", ROLE, application=application) as told,
    ):
        if not hold_gathering(directory, shard.shard_id):
            return
        topic, forgotten_s = topic_of(shard.name), -FORGET_S
        after = offsets(directory, topic).get(0, 0)
        while not stop.is_set():
            found = read_events(there, after)
            if found:
                last = found[-1][0]
                collect(directory, topic, 0, (after, last), [event for _, event in found], [])
                after = last
                continue
            if time.monotonic() - forgotten_s >= FORGET_S:
                forgotten_s = time.monotonic()
                for name in unknown_maps(directory, there, shard.shard_id):
                    forget_map(dsn, name)
            wait_for_notice(told, LOOK_S)
