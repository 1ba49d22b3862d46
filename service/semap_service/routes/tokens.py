"""/tokens: who may call the service; /caller: what the one who asks may do"""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Response
from pydantic import Field
from starlette.requests import Request as HTTPRequest

from semap.store.operate import tokens
from semap.store.operate.tokens import LONGEST_NAME, MOST_MAPS
from semap_service.context.caller import SCOPES, Scope, current_caller
from semap_service.database.transaction import Database, transaction
from semap_service.documents.document import (
    LARGEST_SMALL_ID,
    After,
    Document,
    InStamp,
    Limit,
    Name,
    Next,
    Request,
    SmallId,
    Stamp,
    next_after,
    stored,
)
from semap_service.http.problem import problems

router = APIRouter(tags=["tokens"])


class TokenDocument(Document):
    """A token as its keepers see it; the token itself was shown once, when it was made."""

    id: int = stored("token_id")
    name: str = Field(examples=["door gateway"])
    hint: str = Field(description="How the token begins.", examples=["semap_q3Zx"])
    scopes: list[Scope] = Field(description="write and ingest include read, admin includes all.")
    maps: list[str] | None = Field(description="The only maps that there are for it; null: all.")
    created_at: Stamp
    created_by: str = Field(description="The token that made it, or `semap token`.")
    expires_at: Stamp | None
    last_used_at: Stamp | None = Field(description="To the minute.")
    revoked_at: Stamp | None


class NewTokenDocument(TokenDocument):
    """A token that was just made."""

    token: str = Field(
        description="Keep it: it is not shown again.",
        examples=["semap_q3ZxGqvUOGHgbb9JHy0K1lB6hXcEQZ9o3C1j1C0Mf1o"],
    )


class TokenList(Document):
    tokens: list[TokenDocument] = Field(description="In the order in which they were made.")
    next: Next


class NewToken(Request):
    """A token to be made."""

    name: Annotated[Name, Field(max_length=LONGEST_NAME, description="For what, or for whom.")]
    scopes: Annotated[list[Scope], Field(min_length=1, max_length=4)] = Field(examples=[["read"]])
    maps: Annotated[list[Name], Field(min_length=1, max_length=MOST_MAPS)] | None = Field(
        None, description="The only maps that there are for it. [default: all]"
    )
    expires_at: InStamp | None = Field(None, description="[default: never]")


class CallerDocument(Document):
    """Who asks, and what its token allows."""

    name: str = Field(description="Of the token; `anyone` where the service asks for none.")
    scopes: list[Scope] = Field(description="With all that they include.")
    maps: list[str] | None = Field(description="The only maps that there are for it; null: all.")


@router.get("/caller", operation_id="get_caller", responses=problems())
def get_caller() -> CallerDocument:
    """Who you are to the service: what you may not do needs not be tried."""
    caller = current_caller()
    return CallerDocument(
        name=caller.name,
        scopes=[each for each in SCOPES if caller.may(each)],
        maps=None if caller.maps is None else sorted(caller.maps),
    )


@router.get("/tokens", operation_id="list_tokens", responses=problems())
def list_tokens(database: Database, limit: Limit = 100, after: After = 0) -> TokenList:
    """All tokens, also those that have expired or were revoked."""
    with transaction(database) as connection:
        found = tokens.list_tokens(connection, after=min(after, LARGEST_SMALL_ID), limit=limit)
    return TokenList(
        tokens=[TokenDocument.model_validate(each) for each in found],
        next=next_after([each.token_id for each in found], limit),
    )


@router.post("/tokens", operation_id="add_token", status_code=201, responses=problems(404, 409))
def add_token(database: Database, new: NewToken, response: Response) -> NewTokenDocument:
    """Make a token; this answer is the only one that shows it."""
    with transaction(database) as connection:
        made, secret = tokens.add_token(
            connection,
            new.name,
            new.scopes,
            maps=new.maps,
            expires_at=new.expires_at,
            created_by=current_caller().name,
        )
    response.headers["Location"] = f"/tokens/{made.token_id}"
    response.headers["Cache-Control"] = "no-store"
    return NewTokenDocument(**dict(TokenDocument.model_validate(made)), token=secret)


@router.get("/tokens/{id}", operation_id="get_token", responses=problems(404))
def get_token(database: Database, id: SmallId) -> TokenDocument:  # noqa: A002
    """A token as its keepers see it."""
    with transaction(database) as connection:
        return TokenDocument.model_validate(tokens.get_token(connection, id))


@router.delete("/tokens/{id}", operation_id="revoke_token", status_code=204, responses=problems(404))
def revoke_token(database: Database, request: HTTPRequest, id: SmallId) -> None:  # noqa: A002
    """Let a token be of no use any more; its feeds and jobs are ended within seconds."""
    with transaction(database) as connection:
        tokens.revoke_token(connection, id)
    request.app.state.token_cache.forget(id)
