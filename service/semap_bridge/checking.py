"""What a bridge would see: its peer, what comes in, and what is wrong. Nothing is written."""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import Awaitable, Sequence
from contextlib import aclosing, suppress
from datetime import UTC, datetime

from semap_ingest.named_states import sifted, without_repeats
from semap_ingest.state_intake import StateIntake

from semap.errors import SemapError
from semap.store.motion.bridges import Place, read_position
from semap.timeline.stamp import to_us
from semap_bridge.adapter import Batch, Sight, Source
from semap_bridge.config import Entry
from semap_bridge.running import close_context, open_context

EXAMPLES = 3


def check_bridge(dsn: str, entry: Entry, seconds: float) -> list[Sight]:
    """Connect, and look for so many seconds."""
    return asyncio.run(_check(dsn, entry, seconds))


async def _check(dsn: str, entry: Entry, seconds: float) -> list[Sight]:
    context = open_context(dsn, entry)
    context.only_looks = True
    quiet = logging.getLogger("semap_bridge.context")
    was, quiet.disabled = quiet.disabled, True  # what is refused is told as a sight
    adapter = entry.adapter(context)
    try:
        states = await context.ask(lambda c: StateIntake(c, entry.map_name, entry.settings.concept))
        place = Place(states.map_id, entry.settings.name, "in")
        position = await context.ask(lambda c: read_position(c, place))
        try:
            await adapter.open()
            source = adapter.source()
            seen, came = await asyncio.gather(
                _or_trouble(adapter.look(seconds), entry),
                _or_trouble(_came(source, position, entry, seconds), entry),
            )
            troubles = [
                Sight("refused", each, trouble=f"{each}: {n} records", remedy="Correct the sender.")
                for each, n in context.figures.refusals.items()
            ]
            return [*seen, *came, *troubles]
        finally:
            await adapter.close()
    except SemapError as error:
        return [_trouble(error, entry)]
    finally:
        quiet.disabled = was
        close_context(context)


async def _or_trouble(looking: Awaitable[Sequence[Sight]], entry: Entry) -> Sequence[Sight]:
    try:
        return await looking
    except SemapError as error:
        return [_trouble(error, entry)]


def _trouble(error: SemapError, entry: Entry) -> Sight:
    return Sight(entry.settings.name, entry.settings.kind, trouble=str(error), remedy=error.remedy)


async def _came(source: Source | None, position: object, entry: Entry, seconds: float) -> list[Sight]:
    """What a source yields within the time."""
    if source is None:
        return []
    tracks: Counter[str] = Counter()
    objects: Counter[str] = Counter()
    refused: Counter[str] = Counter()
    with suppress(TimeoutError):
        async with asyncio.timeout(seconds), aclosing(source.batches(position)) as batches:  # type: ignore[arg-type,type-var]
            async for batch in batches:
                _count(batch, entry, tracks, objects, refused)
    sights = [
        Sight("states", f"of {len(tracks)} tracks", tracks.total() / seconds),
        *([Sight("states of objects", f"of {len(objects)}", objects.total() / seconds)] if objects else []),
    ]
    if not tracks and not objects:
        sights = [
            Sight(
                "states",
                trouble=f"Nothing came within {seconds:g} s.",
                remedy="See that the peer sends, or look longer: --seconds 30.",
            )
        ]
    return sights + [
        Sight(
            "refused",
            reason,
            count / seconds,
            trouble=f"{count} records: {reason}.",
            remedy="Correct what is sent; run semap bridge to see the first ones in its log.",
        )
        for reason, count in refused.most_common()
    ]


def _count(
    batch: Batch, entry: Entry, tracks: Counter[str], objects: Counter[str], refused: Counter[str]
) -> None:
    good, flawed = sifted(
        batch.states,
        to_us(datetime.now(UTC)),
        ahead_s=entry.settings.ahead_s,
        behind_s=entry.settings.behind_s,
    )
    states, repeated = without_repeats(good)
    tracks.update(states.names)
    objects.update(f"{each.instance} {each.property}" for each in batch.objects)
    refused.update(each.reason for each in [*batch.refused, *flawed, *repeated])
