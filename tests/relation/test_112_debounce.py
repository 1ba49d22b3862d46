"""Debounce against its table of transitions, told in plain Python."""

from __future__ import annotations

from dataclasses import dataclass

import psycopg
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from world import World


@dataclass(frozen=True)
class Seen:
    """Of a boundary with margins: how deep inside something is, 0 to 3; 1 and 2 lie between its margins."""

    at_s: int
    depth: int | None
    is_fresh: bool

    def row(self) -> tuple[object, ...]:
        if self.depth is None:
            return (self.at_s, None, None, None, False)
        return (self.at_s, self.depth >= 2, self.depth == 3, self.depth == 0, self.is_fresh)


def seen() -> st.SearchStrategy[list[Seen]]:
    each = st.tuples(st.integers(0, 3), st.none() | st.integers(0, 3), st.booleans())

    def in_order(steps: list[tuple[int, int | None, bool]]) -> list[Seen]:
        at_s, found = 0, []
        for gap_s, depth, is_fresh in steps:
            at_s += gap_s
            found.append(Seen(at_s, depth, is_fresh and depth is not None))
        return found

    return st.lists(each, min_size=1, max_size=12).map(in_order)


def expected(
    observations: list[Seen], enter_s: int, leave_s: int
) -> list[tuple[bool, bool, bool, int | None]]:
    """Raw, pending, confirmed and since after each observation."""
    raw = pending = confirmed = False
    raw_at = pending_at = since = None
    states = []
    for each in observations:
        inside = each.depth is not None and each.depth >= 2
        if each.is_fresh:
            since = None if not inside else since if confirmed else each.at_s
            raw = pending = confirmed = inside
            raw_at = pending_at = each.at_s
        else:
            if each.depth is not None and inside != raw:
                raw, raw_at = inside, each.at_s
            if (each.depth == 3 and not pending) or (each.depth == 0 and pending):
                pending, pending_at = each.depth == 3, each.at_s
            if pending != confirmed and each.at_s - pending_at >= (enter_s if pending else leave_s):
                confirmed = pending
                edge = raw_at if raw == confirmed and raw_at is not None else pending_at
                since = edge if confirmed else None
        states.append((raw, pending, confirmed, since))
    return states


STEP = """
    select semap.debounce(
      %s::text::semap.relation_state,
      row(to_timestamp(%s), null, null, %s::boolean, %s::boolean, %s::boolean, %s::boolean, null)::semap.observation,
      make_interval(secs => %s), make_interval(secs => %s))::text
"""
READ = """
    select (s).raw, (s).pending, (s).confirmed, extract(epoch from (s).since)::integer
    from (select %s::text::semap.relation_state as s) t
"""


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(observations=seen(), enter_s=st.integers(0, 3), leave_s=st.integers(0, 3))
def test_debounce_is_its_table(world: World, observations: list[Seen], enter_s: int, leave_s: int) -> None:
    connection: psycopg.Connection = world.connection
    row = connection.execute("select semap.relation_since(1, 2, 3, false, null)::text").fetchone()
    states = []
    for each in observations:
        row = connection.execute(STEP, [row and row[0], *each.row(), enter_s, leave_s]).fetchone()
        states.append(connection.execute(READ, [row and row[0]]).fetchone())
    assert states == expected(observations, enter_s, leave_s)
