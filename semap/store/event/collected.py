"""Events that rules made elsewhere, as a topic brings them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sqlalchemy import Connection, text

from semap.store.database.connection import translated

OFFSETS = text("select partition, next_offset from semap.collected where topic = :topic")
COLLECT = text("""
    select semap.collect_events('rules', :topic, :partition, :from, :next, cast(:events as jsonb),
                                cast(:late as jsonb))
""")


def offsets(connection: Connection, topic: str) -> Mapping[int, int]:
    """Of each partition that was read, the offset of what is to be read next."""
    with translated():
        return {row.partition: row.next_offset for row in connection.execute(OFFSETS, {"topic": topic})}


def collect(
    connection: Connection,
    topic: str,
    partition: int,
    from_to: tuple[int, int],
    events: Sequence[str],
    late: Sequence[str],
) -> int:
    """Write what offsets from the first to before the second brought; gives how many events are new.

    events, late  JSON of each, as the rules write it
    raises        ServerUnavailable where another process has collected it
    """
    said = {
        "topic": topic,
        "partition": partition,
        "from": from_to[0],
        "next": from_to[1],
        "events": f"[{','.join(events)}]",
        "late": f"[{','.join(late)}]",
    }
    with translated():
        return int(connection.execute(COLLECT, said).scalar_one())
