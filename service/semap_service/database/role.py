"""Which PostgreSQL role a piece of work has, and which maps it sees (sql/910_access.sql)."""

from __future__ import annotations

from semap_service.context.caller import Acting, Scope

ROLES: dict[Scope, str] = {
    "read": "semap_read",
    "ingest": "semap_ingest",
    "write": "semap_api",
    "admin": "semap_admin",
}
"""Of callers for all maps; of those who are restricted to maps with _map behind."""


def entering(acting: Acting) -> str:
    """The statements with which a transaction begins; nothing in them is of the caller's making.

    `set local` takes no snapshot, so that the isolation level can still be chosen after it.
    """
    role = ROLES[acting.scope]
    statements = [f"set local role {role}"]
    if acting.caller.map_ids is not None:
        ids = ",".join(str(int(each)) for each in sorted(acting.caller.map_ids))
        statements = [f"set local role {role}_map", f"set local semap.maps = '{{{ids}}}'"]
    if acting.statement_s is not None:
        statements.append(f"set local statement_timeout = {int(acting.statement_s * 1000)}")
    return "; ".join(statements)


def whole_map_role(acting: Acting) -> str | None:
    """The statement that gives the same rights without row-level security; None where there is none."""
    return None if acting.caller.map_ids is None else f"set local role {ROLES[acting.scope]}"
