"""What an older semap knew of rules and events is there after the migration, in the new form."""

from __future__ import annotations

import json
from uuid import UUID

from server import migrate_to

from semap.store.database import connect
from semap.store.schema import migrate

VISITS = {"input": "track_in_room", "emit": {"began": "entered", "ended": "left"}}
UIDS = [UUID(int=number) for number in range(5)]
OLD = """
    insert into semap.map (name, uid) values ('office', gen_random_uuid());
    insert into semap.source (map_id, name, watermark) values
      (1, 'lidar', '2026-01-31 12:00:09.5Z'), (1, 'silent', '-infinity');
    insert into semap.continuous_query (map_id, name, object_concept_id)
      select 1, 'track_in_room', concept_id from semap.concept where name = 'Room';
    insert into semap.rule (map_id, name, version, query_id, declaration, enabled)
      values (1, 'visits', 3, 1, '{declaration}', false);
    insert into semap.relation_change (uid, map_id, query_id, query_name, track_id, track_name, instance_id,
                                       instance_name, kind, cause, stamp, since)
      values ('{2}', 1, 1, 'track_in_room', 4, 'ann', 7, 'Room07', 'ended', 'moved', '2026-01-31 12:00:08Z', '2026-01-31 12:00Z');
    insert into semap.event (seq, event_id, map_id, rule_name, rule_version, type, stamp, cause, track_id, track_name,
                             instance_id, instance_name, since)
      values (1, '{0}', 1, 'visits', 3, 'left', '2026-01-31 12:00:09Z', 'moved', 4, 'ann', 7, 'Room07', '2026-01-31 12:00Z'),
             (2, '{1}', 1, 'visits', 3, 'left', '2026-01-31 12:00:10Z', 'moved', 4, 'ann', 7, 'Room07', '2026-01-31 12:00Z');
    insert into semap.event_evidence (event_id, change_uid) values ('{0}', '{2}'), ('{0}', '{3}'), ('{1}', '{4}');
    insert into semap.progress (worker, lsn, event_seq, rule_state, watermarks)
      select 'rules', '0/1', 2,
             jsonb_build_object('1', jsonb_build_object('map_id', 1, 'name', 'visits', 'version', 3, 'query_id', 1,
                                                        'declaration', declaration, 'enabled', enabled)),
             '{{"1": "2026-01-31T12:00:09.5+00:00"}}'
      from semap.rule
"""


def test_rules_events_and_progress_go_on(empty_database: str) -> None:
    migrate_to(empty_database, "0006")
    with connect(empty_database) as connection:
        connection.execute(OLD.format(*UIDS, declaration=json.dumps(VISITS)))
        before = connection.execute("select to_jsonb(e) from semap.event e order by seq").fetchall()
        migrate(empty_database, slot=False)

        def rows(statement: str) -> list[tuple]:
            return connection.execute(statement).fetchall()

        rule = {
            "map_id": 1, "name": "visits", "version": 3, "queries": {"track_in_room": 1}, "declaration": VISITS,
            "enabled": False, "backfill_from": None, "seam": None,
        }  # fmt: skip
        assert rows("select semap.rule_json(r) from semap.rule r") == [(rule,)]
        assert rows("select rule_state from semap.progress") == [({"1": rule},)]
        stamp_us = 1_769_860_809_500_000
        mark = {"complete_us": stamp_us, "awaited": True}
        assert rows("select watermarks from semap.progress") == [
            ({"maps": {"1": {"released_us": stamp_us, "sources": {"1": mark}}}},)
        ]
        assert rows("select rule_id, query_id from semap.rule_query") == [(1, 1)]
        assert rows("select rule_id, version, name, declaration from semap.rule_version") == [
            (1, 3, "visits", VISITS)
        ]
        added = {"key": {}, "measures": {}, "confidence": None, "by_batch": False}
        after = rows("select to_jsonb(e) from semap.event e order by seq")
        assert after == [({**event, **added},) for (event,) in before]
        assert rows(
            "select event_id, place, uid, variable, source, to_char(stamp at time zone 'UTC', 'HH24:MI:SS')"
            " from semap.event_evidence order by event_id, place"
        ) == [
            (UIDS[0], 1, UIDS[2], "", "relation", "12:00:08"),
            (UIDS[0], 2, UIDS[3], "", "relation", "12:00:09"),
            (UIDS[1], 1, UIDS[4], "", "relation", "12:00:10"),
        ]


def test_a_database_without_anything_is_migrated_from_the_old_version(empty_database: str) -> None:
    migrate_to(empty_database, "0006")
    migrate(empty_database, slot=False)
    with connect(empty_database) as connection:
        assert connection.execute("select count(*) from semap.rule").fetchone() == (0,)
