"""What the deliverer of webhooks reads and writes.

Each outcome moves the cursor only from where the deliverer saw it, so that one that was replaced by another,
or whose webhook was changed meanwhile, changes nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from uuid import UUID

from sqlalchemy import Connection, and_, delete, extract, func, literal_column, or_, select, text, update

from semap.store.database.connection import translated
from semap.store.database.tables import webhook, webhook_dead_letter, webhook_secret

MOST_DEAD_LETTERS = 10_000

GIVE_UP = text("""
    with moved as (
      update semap.webhook
      set cursor = :seq, attempts = 0, next_attempt_at = '-infinity', given_up_in_row = given_up_in_row + 1,
          failed_count = failed_count + 1, last_error = :error, last_error_at = clock_timestamp()
      where webhook_id = :webhook_id and cursor = :cursor
      returning webhook_id
    )
    insert into semap.webhook_dead_letter
      (webhook_id, seq, event_id, map, type, body, attempts, error, status)
    select webhook_id, :seq, :event_id, :map, :type, :body, :attempts, :error, :status from moved
    on conflict (webhook_id, seq) do nothing
""")


@dataclass(frozen=True)
class Line:
    """The line of events before a webhook: what it sends where, and how far it is.

    due_s  from now until the next try; negative where that is past
    keys   secrets that sign, the newest first
    """

    webhook_id: int
    url: str
    maps: frozenset[str] | None
    event_type: str | None
    rule_name: str | None
    filter: str | None
    cursor: int
    attempts: int
    given_up_in_row: int
    due_s: float
    keys: tuple[bytes, ...]


@dataclass(frozen=True)
class Letter:
    """An event that was given up and is to be sent again."""

    dead_letter_id: int
    event_id: UUID
    body: str


@dataclass(frozen=True)
class Failure:
    """An event that was not taken."""

    seq: int
    event_id: UUID
    map: str
    type: str
    body: str
    attempts: int
    error: str
    status: int | None


def take_turn(connection: Connection) -> bool:
    """Whether nobody else delivers; the turn lasts as long as the session of this connection."""
    with translated():
        return bool(connection.scalar(text("select pg_try_advisory_lock(7371, 0)")))


def active_webhooks(connection: Connection) -> frozenset[int]:
    with translated():
        return frozenset(connection.scalars(select(webhook.c.webhook_id).where(webhook.c.state == "active")))


def read_line(
    connection: Connection, webhook_id: int, *, active_only: bool = True
) -> tuple[Line, Letter | None] | None:
    """A webhook, with the first thing that it is to send again; None where there is no such active one."""
    chosen = webhook.c.webhook_id == webhook_id
    if active_only:
        chosen = and_(chosen, webhook.c.state == "active")
    due = (
        func.greatest(webhook.c.next_attempt_at, literal_column("timestamptz 'epoch'"))
        - func.clock_timestamp()
    )
    with translated():
        row = connection.execute(
            select(
                webhook.c.url,
                webhook.c.maps,
                webhook.c.event_type,
                webhook.c.rule_name,
                webhook.c.filter,
                webhook.c.cursor,
                webhook.c.attempts,
                webhook.c.given_up_in_row,
                extract("epoch", due).label("due_s"),
            ).where(chosen)
        ).one_or_none()
        if row is None:
            return None
        keys = connection.scalars(
            select(webhook_secret.c.secret)
            .where(
                webhook_secret.c.webhook_id == webhook_id,
                or_(
                    webhook_secret.c.expires_at.is_(None),
                    webhook_secret.c.expires_at > func.clock_timestamp(),
                ),
            )
            .order_by(webhook_secret.c.webhook_secret_id.desc())
        ).all()
        letter = connection.execute(
            select(
                webhook_dead_letter.c.webhook_dead_letter_id,
                webhook_dead_letter.c.event_id,
                webhook_dead_letter.c.body,
            )
            .where(
                webhook_dead_letter.c.webhook_id == webhook_id,
                webhook_dead_letter.c.resend_requested_at.is_not(None),
            )
            .order_by(webhook_dead_letter.c.webhook_dead_letter_id)
            .limit(1)
        ).one_or_none()
    line = Line(
        webhook_id=webhook_id,
        url=row.url,
        maps=None if row.maps is None else frozenset(row.maps),
        event_type=row.event_type,
        rule_name=row.rule_name,
        filter=row.filter,
        cursor=row.cursor,
        attempts=row.attempts,
        given_up_in_row=row.given_up_in_row,
        due_s=float(row.due_s),
        keys=tuple(map(bytes, keys)),
    )
    return line, None if letter is None else Letter(*letter)


def pass_over(connection: Connection, webhook_id: int, cursor: int, to: int) -> None:
    """Nothing was selected from a cursor to another."""
    with translated():
        connection.execute(
            update(webhook)
            .where(webhook.c.webhook_id == webhook_id, webhook.c.cursor == cursor)
            .values(cursor=to)
        )


def note_delivered(connection: Connection, webhook_id: int, cursor: int, seq: int) -> bool:
    """An event was taken; whether the webhook goes on as it was."""
    with translated():
        state = connection.scalar(
            update(webhook)
            .where(webhook.c.webhook_id == webhook_id, webhook.c.cursor == cursor)
            .values(
                cursor=seq,
                attempts=0,
                next_attempt_at="-infinity",
                given_up_in_row=0,
                delivered_count=webhook.c.delivered_count + 1,
                last_delivered_at=func.clock_timestamp(),
            )
            .returning(webhook.c.state)
        )
    return bool(state == "active")


def note_failed(
    connection: Connection, webhook_id: int, cursor: int, failure: Failure, wait_s: float
) -> None:
    """An event was not taken, and is tried again after so long."""
    with translated():
        connection.execute(
            update(webhook)
            .where(webhook.c.webhook_id == webhook_id, webhook.c.cursor == cursor)
            .values(
                attempts=failure.attempts,
                next_attempt_at=func.clock_timestamp() + func.make_interval(0, 0, 0, 0, 0, 0, wait_s),
                failed_count=webhook.c.failed_count + 1,
                last_error=failure.error,
                last_error_at=func.clock_timestamp(),
            )
        )


def give_up(connection: Connection, webhook_id: int, cursor: int, failure: Failure) -> None:
    """Set an event aside and go on behind it; a webhook with too many of them is disabled."""
    with translated():
        connection.execute(
            GIVE_UP,
            {
                "webhook_id": webhook_id,
                "cursor": cursor,
                "seq": failure.seq,
                "event_id": failure.event_id,
                "map": failure.map,
                "type": failure.type,
                "body": failure.body,
                "attempts": failure.attempts,
                "error": failure.error,
                "status": failure.status,
            },
        )
        letters = connection.scalar(
            select(func.count()).where(webhook_dead_letter.c.webhook_id == webhook_id)
        )
    if int(letters or 0) >= MOST_DEAD_LETTERS:
        disable(connection, webhook_id, f"{MOST_DEAD_LETTERS} events were given up")


def disable(connection: Connection, webhook_id: int, reason: str) -> None:
    """Send nothing more until somebody makes the webhook active again."""
    with translated():
        connection.execute(
            update(webhook)
            .where(webhook.c.webhook_id == webhook_id, webhook.c.state == "active")
            .values(
                state="disabled", state_reason=reason, last_error=reason, last_error_at=func.clock_timestamp()
            )
        )


def note_resent(connection: Connection, webhook_id: int, dead_letter_id: int) -> None:
    """What had been given up was taken."""
    with translated():
        gone = connection.execute(
            delete(webhook_dead_letter).where(webhook_dead_letter.c.webhook_dead_letter_id == dead_letter_id)
        )
        connection.execute(
            update(webhook)
            .where(webhook.c.webhook_id == webhook_id)
            .values(
                given_up_in_row=0,
                delivered_count=webhook.c.delivered_count + gone.rowcount,
                last_delivered_at=func.clock_timestamp(),
            )
        )


def note_not_resent(connection: Connection, webhook_id: int, error: str, status: int | None) -> None:
    """What had been given up was not taken again: nothing more is sent again until somebody asks."""
    with translated():
        connection.execute(
            update(webhook_dead_letter)
            .where(
                webhook_dead_letter.c.webhook_id == webhook_id,
                webhook_dead_letter.c.resend_requested_at.is_not(None),
            )
            .values(resend_requested_at=None, error=error, status=status)
        )
        connection.execute(
            update(webhook)
            .where(webhook.c.webhook_id == webhook_id)
            .values(last_error=error, last_error_at=func.clock_timestamp())
        )
