"""Events without a rule worker."""

from __future__ import annotations

from world import World


def make_events(world: World, count: int) -> list[str]:
    """Events of nobody, as the rule worker would write them; their ids."""
    return [
        str(event_id)
        for (event_id,) in world.rows(
            "insert into semap.event (seq, event_id, map_id, type, stamp, rule_version, rule_name, since)"
            " select coalesce((select max(seq) from semap.event), 0) + i, gen_random_uuid(), %s, 'told', now(), 1,"
            " 'room_visits', now() from generate_series(1, %s) i returning event_id", world.map_id, count,
        )
    ]  # fmt: skip
