"""What the database asks of predicates, as rows of `semap.predicate`."""

from __future__ import annotations

from sqlalchemy import Connection, delete
from sqlalchemy.dialects.postgresql import insert

from semap.model.predicate import predicates
from semap.store.database.tables import predicate


def keep_predicates(connection: Connection) -> None:
    """Bring the rows in line with the files; a predicate that is gone is refused while queries ask for it."""
    rows = [
        {
            "name": each.name,
            "needs": each.needs,
            "takes": each.takes,
            "relates": each.relates,
            "follows_from": each.follows_from,
            "region_test": each.region_test,
            "subject_compared": each.subject,
            "object_compared": each.object,
            "reach": each.reach,
        }
        for each in predicates().values()
    ]
    connection.execute(delete(predicate).where(predicate.c.name.not_in(predicates())))
    said = insert(predicate)
    changed = {name: said.excluded[name] for name in rows[0] if name != "name"}
    connection.execute(said.on_conflict_do_update(index_elements=["name"], set_=changed), rows)
