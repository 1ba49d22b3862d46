"""What an error says of itself (RFC 9457)."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from semap_service.context.request_id import current_request_id

MOST_PLACES = 20


class Place(BaseModel):
    """What is wrong with which part of a request."""

    where: str = Field(examples=["body.name"])
    message: str


class Problem(BaseModel):
    """What went wrong, and what to do about it (RFC 9457)."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "type": "urn:semap:problem:not-found",
                    "title": "Not Found",
                    "status": 404,
                    "detail": "There is no map office.",
                    "instance": "/maps/office",
                    "remedy": "List the maps to see their names.",
                    "errors": [],
                }
            ]
        }
    )

    type: str = Field(description="The kind of problem, or about:blank where the status says it all.")
    title: str
    status: int
    detail: str
    instance: str = Field(description="The path that was asked for.")
    remedy: str = Field(description="What can be done about it; may be empty.")
    errors: list[Place] = Field(
        max_length=MOST_PLACES, description="The places in the request that are wrong, the first of them."
    )
    more_errors: int = Field(
        default=0, ge=0, description="How many more there are; left out where these are all."
    )
    request_id: str = Field(
        default_factory=current_request_id,
        description="The id of the request, as the log of the service has it.",
    )
