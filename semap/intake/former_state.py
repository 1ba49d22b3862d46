"""What an object was before, once all of its earlier states have come.

The database notes the former state of each row as it is known when the row arrives. Where states arrive out
of order, within the lateness of their source, that is corrected when the row is due.
"""

from __future__ import annotations

from collections.abc import Sequence

import psycopg

from semap.rules.row import Row
from semap.store.database.connection import translated

FORMER = """
    select o.uid::text, b.value, (extract(epoch from b.since) * 1000000)::bigint
    from semap.object_state o
    left join lateral semap.object_state_before(o.instance_id, o.property, o.stamp, o.value) b on true
    where o.uid = any (%s::uuid[])
"""


def changes_only(connection: psycopg.Connection, rows: Sequence[Row]) -> Sequence[Row]:
    """The same rows without states that change nothing; those that do get the former state."""
    uids = [row.uid for row in rows if row.source == "object_state"]
    if not uids:
        return rows
    with translated():
        former = {uid: (value, since_us) for uid, value, since_us in connection.execute(FORMER, [uids])}
    found = []
    for row in rows:
        if row.uid not in former:
            found.append(row)
            continue
        value, since_us = former[row.uid]
        if value == row.values["type"]:
            continue
        values = {**row.values, "previous": value}
        if since_us is not None:
            values |= {"since": since_us, "duration_s": (row.own_stamp_us - since_us) / 1e6}
        found.append(row.saying(values))
    return found
