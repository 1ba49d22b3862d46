"""Events are numbered within their maps: without gaps, in the order of the log, also of what is deleted."""

from __future__ import annotations

from uuid import UUID, uuid4, uuid5

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from semap.store.database.connection import connect, one_transaction
from semap.store.event.events import kept_events, list_events, read_stretch

ADD = """
    select semap.add_events('rules', (
      select jsonb_agg(jsonb_build_object('event_id', id, 'map_id', m.map_id, 'rule_name', 'r', 'rule_version', 1,
                                          'type', 'entered', 'stamp', now(), 'since', now()) order by place)
      from unnest(%s::text[], %s::uuid[]) with ordinality as e (map, id, place) join semap.map m on m.name = e.map))
"""
MAPS = st.sampled_from(["a", "b", "c"])


@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    commits=st.lists(st.lists(st.tuples(MAPS, st.integers(1, 40)), max_size=12), max_size=5),
    dropped=st.integers(1, 40),
)
def test_numbers_have_no_gaps_and_follow_the_log(
    database: str, commits: list[list[tuple[str, int]]], dropped: int
) -> None:
    run = uuid4()  # maps and events of each example are others
    expected: dict[str, list[UUID]] = {f"{run} {name}": [] for name in "abc"}
    with connect(database) as owner, one_transaction(database) as connection:
        owner.execute(
            "insert into semap.map (name, uid) select n, gen_random_uuid() from unnest(%s::text[]) n",
            [list(expected)],
        )
        known: set[UUID] = set()
        for commit in commits:
            events = [(f"{run} {name}", uuid5(run, str(id_))) for name, id_ in commit]
            owner.execute(ADD, [[name for name, _ in events], [id_ for _, id_ in events]])
            for name, id_ in events:
                if id_ not in known:
                    known.add(id_)
                    expected[name].append(id_)
        gone = uuid5(run, str(dropped))
        owner.execute("delete from semap.event where event_id = %s", [gone])
        for name, ids in expected.items():
            left = [(number, id_) for number, id_ in enumerate(ids, 1) if id_ != gone]
            found = list_events(connection, map_name=name, own=True)
            assert [(each.seq, each.event_id) for each in found] == left
            kept = kept_events(connection, name)
            assert (kept.oldest, kept.newest) == (left[0][0] if left else None, len(ids))
            for after in range(len(ids)):
                page = read_stretch(connection, after=after, limit=2, map_name=name, own=True)
                wanted = [each for each in left if each[0] > after][:2]
                assert [(each.seq, each.event_id) for each in page.events] == wanted
