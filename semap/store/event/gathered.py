"""Events of a shard as its directory takes them: with their evidence, and with their places."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import Connection, text

from semap.store.database.connection import translated

MOST = 1000
GATHER_LOCK = 7378

HOLD = text("select pg_try_advisory_lock(:key, :shard_id)")
NEXT = text("""
    select e.seq,
           (to_jsonb(e) - array['seq', 'created_at'] || jsonb_build_object(
             'place', coalesce(semap.place_at(e.track_id, e.stamp), (
               select a.geometry from semap.abstraction a
               where a.instance_id = e.instance_id and a.type = 'Position2D'))::text,
             'evidence', (
               select coalesce(jsonb_agg(jsonb_build_object(
                        'uid', v.uid, 'variable', v.variable, 'source', v.source, 'stamp', v.stamp)
                        order by v.place), '[]')
               from semap.event_evidence v where v.event_id = e.event_id)))::text
    from semap.event e where e.seq > :after order by e.seq limit :most
""")
GONE = text("select name from semap.place where shard_id = :shard_id order by name")
KNOWN = text("select name from semap.place")


def topic_of(shard: str) -> str:
    """Under which name it is kept up to where the events of a shard were gathered."""
    return f"shard {shard}"


def hold_gathering(directory: Connection, shard_id: int) -> bool:
    """Be the only one who gathers from a shard, until the session ends; False where somebody else is."""
    with translated():
        return bool(directory.scalar(HOLD, {"key": GATHER_LOCK, "shard_id": shard_id}))


def read_events(shard: Connection, after: int) -> Sequence[tuple[int, str]]:
    """The next events of a shard with their numbers there, as JSON."""
    with translated():
        return [(seq, event) for seq, event in shard.execute(NEXT, {"after": after, "most": MOST})]


def unknown_maps(directory: Connection, shard: Connection, shard_id: int) -> Sequence[str]:
    """Maps that the directory has placed on a shard which does not know of them."""
    with translated():
        placed = directory.scalars(GONE, {"shard_id": shard_id}).all()
        known = set(shard.scalars(KNOWN))
    return [name for name in placed if name not in known]
