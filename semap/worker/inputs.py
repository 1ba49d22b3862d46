"""What the rule worker reads off the log."""

from __future__ import annotations

import json
import logging
from datetime import datetime
from uuid import UUID

from semap.errors import InvalidInput, UntrustedBytes
from semap.model.relation import RelationChange
from semap.replication.pgoutput import Change, Row
from semap.rules.engine import Rule, RuleChanged

log = logging.getLogger(__name__)


def rule_input(change: Change) -> RelationChange | RuleChanged | None:
    """The input of the rules that a change of a table is; None for one that is none.

    raises UntrustedBytes if a row lacks a column or holds a value of another type
    """
    try:
        if change.table == "relation_change" and change.operation == "insert":
            return _relation_change(change.row)
        if change.table == "rule" and change.operation in ("insert", "update"):
            return _rule_changed(change.row)
        if change.table == "rule" and change.operation == "delete":
            return RuleChanged(_integer(change.row, "rule_id"), None)
    except (KeyError, ValueError) as error:
        raise UntrustedBytes(f"A row of {change.table} is not as expected: {error}") from error
    return None


def deleted_map(change: Change) -> int | None:
    """The id of a map that a change deletes."""
    if change.table != "map" or change.operation != "delete":
        return None
    return _integer(change.row, "map_id")


def watermark(change: Change) -> tuple[str, str] | None:
    """The id of a source and its watermark (RFC 3339) where a change carries one."""
    if change.table != "source" or change.operation not in ("insert", "update"):
        return None
    text = change.row["watermark"]
    if text is None or text == "-infinity":
        return None
    return str(change.row["source_id"]), datetime.fromisoformat(text).isoformat()


def _relation_change(row: Row) -> RelationChange:
    return RelationChange(
        uid=UUID(_text(row, "uid")),
        map_id=_integer(row, "map_id"),
        query_id=_integer(row, "query_id"),
        track_id=_integer(row, "track_id"),
        track_name=_text(row, "track_name"),
        instance_id=_integer(row, "instance_id"),
        instance_name=_text(row, "instance_name"),
        kind="began" if _text(row, "kind") == "began" else "ended",
        cause=_text(row, "cause"),  # type: ignore[arg-type]
        stamp=datetime.fromisoformat(_text(row, "stamp")),
        since=datetime.fromisoformat(_text(row, "since")),
    )


def _rule_changed(row: Row) -> RuleChanged:
    """A rule that cannot be read is out of force: one row may not stop all others."""
    rule_id = _integer(row, "rule_id")
    document = {
        "map_id": _text(row, "map_id"),
        "query_id": _text(row, "query_id"),
        "version": _text(row, "version"),
        "enabled": _text(row, "enabled") == "t",
        "name": _text(row, "name"),
        "declaration": json.loads(_text(row, "declaration")),
    }
    try:
        return RuleChanged(rule_id, Rule.from_json(document))
    except InvalidInput as error:
        log.error("Rule %d is not in force, since it cannot be read: %s", rule_id, error)
        return RuleChanged(rule_id, None)


def _text(row: Row, column: str) -> str:
    value = row[column]
    if value is None:
        raise ValueError(f"{column} is null")
    return value


def _integer(row: Row, column: str) -> int:
    return int(_text(row, column))
