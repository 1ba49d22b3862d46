"""/webhooks: events sent to web addresses"""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from datetime import timedelta
from typing import Annotated, Any, Literal
from uuid import UUID

from fastapi import APIRouter, Response
from fastapi import Request as HttpRequest
from pydantic import Field, model_validator
from sqlalchemy import Connection

from semap.errors import NotFound
from semap.store.event import webhooks
from semap.store.event.event_selection import Selection
from semap.store.event.webhook_delivery import Line, read_line
from semap.store.map.places import place_of
from semap_service.context.caller import current_caller
from semap_service.database.transaction import Database, Edit, transaction
from semap_service.documents.document import (
    LARGEST_ID,
    After,
    Document,
    Id,
    Limit,
    Name,
    Next,
    Request,
    SmallId,
    Stamp,
    next_after,
    stored,
)
from semap_service.http.etag import TaggedRoute, edits, reads
from semap_service.http.problem import problems
from semap_service.webhooks.address import LONGEST_URL, require_url
from semap_service.webhooks.delivery import Deliverer
from semap_service.webhooks.signature import new_secret, shown

router = APIRouter(tags=["webhooks"], route_class=TaggedRoute)

LONGEST_KEEP = timedelta(days=7)
COLUMNS = {"type": "event_type", "rule": "rule_name"}

Url = Annotated[
    str,
    Field(
        min_length=1,
        max_length=LONGEST_URL,
        description="http or https, without credentials; each event is sent there by POST.",
        examples=["https://example.org/semap"],
    ),
]
Maps = Annotated[
    list[Name] | None,
    Field(min_length=1, max_length=100, description="Only events of maps of these names; null: of all."),
]
Filter = Annotated[
    str | None,
    Field(
        max_length=10_000,
        pattern=r"^[^\x00]*$",
        description="Only events for which this CQL2 text is true.",
        examples=["confidence > 0.8 AND instance = 'Room07'"],
    ),
]
Description = Annotated[str, Field(max_length=1000, pattern=r"^[^\x00]*$", description="For people.")]


class NewWebhook(Request):
    """Where which events are to be sent."""

    url: Url
    description: Description = ""
    maps: Maps = None
    type: Name | None = Field(None, description="Only events of this type.")
    rule: Name | None = Field(None, description="Only events of this rule.")
    filter: Filter = None
    after: int | None = Field(
        None, ge=0, le=LARGEST_ID, description="Begin after this event. [default: with what comes]"
    )


class WebhookChanges(Request):
    """The changes; omitted members stay unchanged. Each change except of the description causes an attempt at
    once."""

    url: Url | None = None
    description: Description | None = None
    maps: Maps = None
    type: Name | None = None
    rule: Name | None = None
    filter: Filter = None
    state: Literal["active", "paused"] | None = Field(
        None, description="paused: events of the meantime are sent when it is active again."
    )

    @model_validator(mode="after")
    def _some_are_never_null(self) -> WebhookChanges:
        for name in ("url", "description", "state"):
            if name in self.model_fields_set and getattr(self, name) is None:
                raise ValueError(f"{name} cannot be null; leave it out to keep it")
        return self


class WebhookDocument(Document):
    """Where which events are sent, and how that goes."""

    id: int = stored("webhook_id")
    url: str
    description: str
    maps: list[str] | None
    type: str | None = stored("event_type")
    rule: str | None = stored("rule_name")
    filter: str | None
    state: Literal["active", "paused", "disabled"] = Field(
        description="disabled: by semap, for `state_reason`, until it is made active again."
    )
    state_reason: str
    cursor: int = Field(description="The number of the last event that is done with.")
    attempts: int = Field(description="How often the event that is next was tried in vain.")
    next_attempt_at: Stamp | None = Field(
        description="When it is tried again; null: as soon as there is one."
    )
    delivered: int = stored("delivered_count", description="Events that the receiver took.")
    failed: int = stored("failed_count", description="Attempts that it did not take.")
    dead_letters: int = Field(description="Events that were given up and can be sent again.")
    last_delivered_at: Stamp | None
    last_error: str
    last_error_at: Stamp | None
    created_by: str
    created_at: Stamp


class WebhookWithSecret(WebhookDocument):
    """A webhook with its secret, shown only once."""

    secret: str = Field(description="Verifies messages (Standard Webhooks). It is not shown again.")


class WebhookList(Document):
    webhooks: list[WebhookDocument] = Field(description="In the order of their ids.")
    next: Next


class NewSecret(Request):
    keep_s: int = Field(
        86_400,
        ge=0,
        le=int(LONGEST_KEEP.total_seconds()),
        description="So long the present secret signs too [s]; 0: not any more.",
    )


class SecretDocument(Document):
    secret: str = Field(description="It is not shown again.")


class PingDocument(Document):
    """The outcome of a test message."""

    message_id: str
    taken: bool = Field(description="Whether the receiver answered with a status of 200 to 299.")
    status: int | None = Field(description="null: no answer.")
    error: str = Field(description="Why it was not taken; empty where it was.")
    took_s: float


class DeadLetterDocument(Document):
    """An event that the receiver did not take."""

    id: int
    seq: int = Field(description="The number of the event.")
    event_id: UUID = Field(description="It is sent again under this id, as webhook-id.")
    map: str
    type: str
    attempts: int
    error: str = Field(description="The outcome of the last attempt.")
    status: int | None
    given_up_at: Stamp
    resend_requested_at: Stamp | None = Field(description="null: it is not to be sent again, as yet.")


class DeadLetterList(Document):
    dead_letters: list[DeadLetterDocument] = Field(description="In the order in which they were given up.")
    next: Next


class ResendDocument(Document):
    requested: int = Field(description="How many are to be sent again.")


@router.get("/webhooks", operation_id="list_webhooks", responses=reads())
def list_webhooks(database: Database, limit: Limit = 100, after: After = 0) -> WebhookList:
    """All webhooks, in the order of their ids."""
    with transaction(database) as connection:
        found = webhooks.list_webhooks(connection, after=after, limit=limit)
    return WebhookList(
        webhooks=[WebhookDocument.model_validate(each) for each in found],
        next=next_after([each.webhook_id for each in found], limit),
    )


@router.post("/webhooks", operation_id="create_webhook", status_code=201, responses=problems(404, 409))
def create(
    request: HttpRequest, database: Database, new: NewWebhook, response: Response
) -> WebhookWithSecret:
    """Send events to a web address: each at least once, in their order, signed, as CloudEvents in JSON."""
    values = new.model_dump(exclude={"after"})
    secret = new_secret()
    with transaction(database) as connection:
        columns = _columns(request, connection, values)
        id_ = webhooks.create_webhook(
            connection, {**columns, "created_by": current_caller().name}, secret, after=new.after
        )
        made = webhooks.get_webhook(connection, id_)
    _deliverer(request).wake_soon()
    response.headers["Location"] = f"/webhooks/{id_}"
    return WebhookWithSecret(**dict(WebhookDocument.model_validate(made)), secret=shown(secret))


@router.get("/webhooks/{id}", operation_id="get_webhook", responses=reads(404))
def get(database: Database, id: SmallId) -> WebhookDocument:  # noqa: A002
    """A webhook, and how its deliveries go. Its ETag changes with each of them."""
    with transaction(database) as connection:
        return WebhookDocument.model_validate(webhooks.get_webhook(connection, id))


@router.patch("/webhooks/{id}", operation_id="change_webhook", responses=edits(404))
def change(
    request: HttpRequest,
    edit: Edit,
    id: SmallId,  # noqa: A002
    changes: WebhookChanges,
) -> WebhookDocument:
    """Change a webhook, pause it, or make it active again.

    The ETag includes the state of its deliveries: a delivery meanwhile changes it.
    """
    values = changes.model_dump(exclude_unset=True)
    with edit.begin(lambda connection: _held(connection, id)) as connection:
        webhooks.change_webhook(connection, id, _columns(request, connection, values))
        changed = webhooks.get_webhook(connection, id)
    _deliverer(request).wake_soon()
    return WebhookDocument.model_validate(changed)


@router.delete("/webhooks/{id}", operation_id="delete_webhook", status_code=204, responses=edits(404))
def delete(request: HttpRequest, edit: Edit, id: SmallId) -> None:  # noqa: A002
    """Delete a webhook with its dead letters; nothing more is sent."""
    with edit.begin(lambda connection: _held(connection, id)) as connection:
        webhooks.delete_webhook(connection, id)
    _deliverer(request).wake_soon()


@router.post("/webhooks/{id}/secret", operation_id="rotate_webhook_secret", responses=problems(404))
def rotate_secret(database: Database, id: SmallId, new: NewSecret) -> SecretDocument:  # noqa: A002
    """Sign with another secret from now on. Meanwhile messages carry a signature of each."""
    secret = new_secret()
    with transaction(database) as connection:
        webhooks.rotate_secret(connection, id, secret, new.keep_s)
    return SecretDocument(secret=shown(secret))


@router.post("/webhooks/{id}/ping", operation_id="ping_webhook", responses=problems(404))
async def ping(request: HttpRequest, database: Database, id: SmallId) -> PingDocument:  # noqa: A002
    """Send one message of the type org.semap.ping, and return the outcome."""
    line = await asyncio.to_thread(_line, database, id)
    message_id, answer = await _deliverer(request).ping(line)
    return PingDocument(
        message_id=message_id,
        taken=answer.taken,
        status=answer.status,
        error=answer.error,
        took_s=answer.took_s,
    )


@router.get("/webhooks/{id}/dead-letters", operation_id="list_dead_letters", responses=reads(404))
def list_dead_letters(
    database: Database,
    id: SmallId,  # noqa: A002
    limit: Limit = 100,
    after: After = 0,
) -> DeadLetterList:
    """Events that the receiver did not take, in the order in which they were given up."""
    with transaction(database) as connection:
        found = webhooks.list_dead_letters(connection, id, after=after, limit=limit)
    return DeadLetterList(
        dead_letters=[
            DeadLetterDocument.model_validate({**asdict(each), "id": each.dead_letter_id}) for each in found
        ],
        next=next_after([each.dead_letter_id for each in found], limit),
    )


@router.post(
    "/webhooks/{id}/dead-letters/resend",
    operation_id="resend_dead_letters",
    status_code=202,
    responses=problems(404),
)
def resend_all(request: HttpRequest, database: Database, id: SmallId) -> ResendDocument:  # noqa: A002
    """Send all of them again, the oldest first, until one fails. Accepted ones leave the list."""
    with transaction(database) as connection:
        asked = webhooks.ask_resend(connection, id)
    _deliverer(request).wake_soon()
    return ResendDocument(requested=asked)


@router.post(
    "/webhooks/{id}/dead-letters/{dead_letter_id}/resend",
    operation_id="resend_dead_letter",
    status_code=202,
    responses=problems(404),
)
def resend_one(
    request: HttpRequest,
    database: Database,
    id: SmallId,  # noqa: A002
    dead_letter_id: Id,
) -> ResendDocument:
    """Send one of them again."""
    with transaction(database) as connection:
        asked = webhooks.ask_resend(connection, id, dead_letter_id)
    _deliverer(request).wake_soon()
    return ResendDocument(requested=asked)


@router.delete(
    "/webhooks/{id}/dead-letters",
    operation_id="delete_dead_letters",
    status_code=204,
    responses=problems(404),
)
def delete_dead_letters(database: Database, id: SmallId) -> None:  # noqa: A002
    """Forget all of them."""
    with transaction(database) as connection:
        webhooks.drop_dead_letters(connection, id)


def _columns(request: HttpRequest, connection: Connection, values: dict[str, Any]) -> dict[str, Any]:
    """What a document gives, for the table.

    raises  InvalidInput for a URL or a filter that cannot be used, NotFound for a map
    """
    if "url" in values:
        require_url(values["url"], allow_private=_deliverer(request).settings.allow_private)
    Selection(filter=values.get("filter")).check()
    for name in values.get("maps") or ():
        place_of(connection, name)
    return {COLUMNS.get(key, key): value for key, value in values.items()}


def _line(database: Database, webhook_id: int) -> Line:
    with transaction(database) as connection:
        found = read_line(connection, webhook_id, active_only=False)
    if found is None:
        raise NotFound("webhook", webhook_id, "List the webhooks to see their ids.")
    return found[0]


def _deliverer(request: HttpRequest) -> Deliverer:
    deliverer: Deliverer = request.app.state.webhooks
    return deliverer


def _held(connection: Connection, webhook_id: int) -> WebhookDocument:
    """It as it stays until the transaction ends, also for the deliverer, which takes no other lock."""
    webhooks.hold_webhook(connection, webhook_id)
    return WebhookDocument.model_validate(webhooks.get_webhook(connection, webhook_id))
