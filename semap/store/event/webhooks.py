"""Webhooks as the service shows and changes them.

Whatever changes where or whether a webhook sends lets it try again at once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Literal
from uuid import UUID

from sqlalchemy import ColumnElement, Connection, delete, func, insert, literal_column, select, true, update

from semap.errors import Conflict, NotFound
from semap.store.database.connection import translated
from semap.store.database.event_number import newest_event
from semap.store.database.tables import webhook, webhook_dead_letter, webhook_secret

State = Literal["active", "paused", "disabled"]

MOST_WEBHOOKS = 200
RESTARTED = {"attempts": 0, "next_attempt_at": "-infinity", "given_up_in_row": 0}


@dataclass(frozen=True)
class Webhook:
    """Where which events are sent, and how that goes.

    maps            names of maps; None: all
    filter          CQL2 text
    cursor          number of the last event that is done with
    attempts        how often the next one was tried in vain
    dead_letters    events that were given up
    """

    webhook_id: int
    url: str
    description: str
    maps: tuple[str, ...] | None
    event_type: str | None
    rule_name: str | None
    filter: str | None
    state: State
    state_reason: str
    cursor: int
    attempts: int
    next_attempt_at: datetime | None
    delivered_count: int
    failed_count: int
    last_delivered_at: datetime | None
    last_error: str
    last_error_at: datetime | None
    created_by: str
    created_at: datetime
    dead_letters: int


@dataclass(frozen=True)
class DeadLetter:
    """An event that was given up."""

    dead_letter_id: int
    seq: int
    event_id: UUID
    map: str
    type: str
    attempts: int
    error: str
    status: int | None
    given_up_at: datetime
    resend_requested_at: datetime | None


def create_webhook(
    connection: Connection, values: Mapping[str, object], secret: bytes, *, after: int | None = None
) -> int:
    """A new webhook; returns its id.

    values  columns of the table
    after   the number of the event after which it begins; None: the newest one
    raises  Conflict where there are as many as there may be, or there is no such event yet
    """
    with translated():
        connection.execute(select(func.pg_advisory_xact_lock(7372)))
        if int(connection.scalar(select(func.count()).select_from(webhook)) or 0) >= MOST_WEBHOOKS:
            raise Conflict(f"There are {MOST_WEBHOOKS} webhooks already.", "Delete one that is not needed.")
    newest = newest_event(connection)
    if after is not None and after > newest:
        raise Conflict(f"The newest event has the number {newest}.", "Leave `after` out to begin there.")
    with translated():
        webhook_id = connection.scalar(
            insert(webhook)
            .values(**values, cursor=newest if after is None else after)
            .returning(webhook.c.webhook_id)
        )
        connection.execute(insert(webhook_secret).values(webhook_id=webhook_id, secret=secret))
    return int(webhook_id or 0)


def list_webhooks(connection: Connection, *, after: int = 0, limit: int = 100) -> tuple[Webhook, ...]:
    """In the order of ids."""
    found = _WEBHOOKS.where(webhook.c.webhook_id > after).order_by(webhook.c.webhook_id).limit(limit)
    with translated():
        return tuple(_webhook(row) for row in connection.execute(found))


def get_webhook(connection: Connection, webhook_id: int) -> Webhook:
    """raises NotFound"""
    with translated():
        row = connection.execute(_WEBHOOKS.where(webhook.c.webhook_id == webhook_id)).one_or_none()
    if row is None:
        raise _unknown(webhook_id)
    return _webhook(row)


def hold_webhook(connection: Connection, webhook_id: int) -> None:
    """Let nobody else change a webhook until the transaction ends; deliveries wait meanwhile.

    raises  NotFound
    """
    with translated():
        held = connection.scalar(
            select(webhook.c.webhook_id).where(webhook.c.webhook_id == webhook_id).with_for_update()
        )
    if held is None:
        raise _unknown(webhook_id)


def change_webhook(connection: Connection, webhook_id: int, values: Mapping[str, object]) -> None:
    """Change columns of a webhook.

    raises  NotFound
    """
    restarted = RESTARTED if values.keys() - {"description"} else {}
    reason = {"state_reason": ""} if "state" in values else {}
    if not values:
        get_webhook(connection, webhook_id)
        return
    with translated():
        changed = connection.execute(
            update(webhook).where(webhook.c.webhook_id == webhook_id).values(**restarted, **reason, **values)
        )
    if changed.rowcount == 0:
        raise _unknown(webhook_id)


def delete_webhook(connection: Connection, webhook_id: int) -> None:
    """raises NotFound"""
    with translated():
        gone = connection.execute(delete(webhook).where(webhook.c.webhook_id == webhook_id))
    if gone.rowcount == 0:
        raise _unknown(webhook_id)


def rotate_secret(connection: Connection, webhook_id: int, secret: bytes, keep_s: int) -> None:
    """Sign with another secret, and with the present one for so long; still older ones go at once.

    raises  NotFound
    """
    own = webhook_secret.c.webhook_id == webhook_id
    hold_webhook(connection, webhook_id)
    with translated():
        present = select(func.max(webhook_secret.c.webhook_secret_id)).where(own).scalar_subquery()
        connection.execute(
            delete(webhook_secret).where(
                own, webhook_secret.c.webhook_secret_id < present if keep_s > 0 else true()
            )
        )
        connection.execute(
            update(webhook_secret)
            .where(own)
            .values(expires_at=func.clock_timestamp() + func.make_interval(0, 0, 0, 0, 0, 0, keep_s))
        )
        connection.execute(insert(webhook_secret).values(webhook_id=webhook_id, secret=secret))


def list_dead_letters(
    connection: Connection, webhook_id: int, *, after: int = 0, limit: int = 100
) -> tuple[DeadLetter, ...]:
    """In the order in which they were given up.

    raises  NotFound if there is no such webhook
    """
    get_webhook(connection, webhook_id)
    letter = webhook_dead_letter.c
    found = (
        select(
            letter.webhook_dead_letter_id,
            letter.seq,
            letter.event_id,
            letter.map,
            letter.type,
            letter.attempts,
            letter.error,
            letter.status,
            letter.given_up_at,
            letter.resend_requested_at,
        )
        .where(letter.webhook_id == webhook_id, letter.webhook_dead_letter_id > after)
        .order_by(letter.webhook_dead_letter_id)
        .limit(limit)
    )
    with translated():
        rows: Sequence[Any] = connection.execute(found).all()
    return tuple(DeadLetter(*row) for row in rows)


def ask_resend(connection: Connection, webhook_id: int, dead_letter_id: int | None = None) -> int:
    """Have one, or all, of what was given up sent again; returns how many.

    raises  NotFound
    """
    chosen: list[ColumnElement[bool]] = [webhook_dead_letter.c.webhook_id == webhook_id]
    if dead_letter_id is not None:
        chosen.append(webhook_dead_letter.c.webhook_dead_letter_id == dead_letter_id)
    with translated():
        asked = connection.execute(
            update(webhook_dead_letter).where(*chosen).values(resend_requested_at=func.clock_timestamp())
        ).rowcount
    if asked == 0:
        get_webhook(connection, webhook_id)
        if dead_letter_id is not None:
            raise NotFound("dead letter", dead_letter_id, "List the dead letters of the webhook.")
    return asked


def drop_dead_letters(connection: Connection, webhook_id: int) -> None:
    """Forget all that was given up.

    raises  NotFound
    """
    get_webhook(connection, webhook_id)
    with translated():
        connection.execute(delete(webhook_dead_letter).where(webhook_dead_letter.c.webhook_id == webhook_id))


def _unknown(webhook_id: int) -> NotFound:
    return NotFound("webhook", webhook_id, "List the webhooks to see their ids.")


def _webhook(row: Sequence[Any]) -> Webhook:
    id_, url, description, maps, *rest = row
    return Webhook(id_, url, description, None if maps is None else tuple(maps), *rest)


_WEBHOOKS = select(
    webhook.c.webhook_id,
    webhook.c.url,
    webhook.c.description,
    webhook.c.maps,
    webhook.c.event_type,
    webhook.c.rule_name,
    webhook.c.filter,
    webhook.c.state,
    webhook.c.state_reason,
    webhook.c.cursor,
    webhook.c.attempts,
    func.nullif(webhook.c.next_attempt_at, literal_column("timestamptz '-infinity'")),
    webhook.c.delivered_count,
    webhook.c.failed_count,
    webhook.c.last_delivered_at,
    webhook.c.last_error,
    webhook.c.last_error_at,
    webhook.c.created_by,
    webhook.c.created_at,
    select(func.count()).where(webhook_dead_letter.c.webhook_id == webhook.c.webhook_id).scalar_subquery(),
)
