"""What the client asks and is told, without any I/O.

An operation is a plan: a generator that yields what is to be done next, a request or a pause, and is sent
the answer. It returns what the caller asked for, or raises. Two thin drivers carry plans out, one that
blocks and one that awaits (`semap.client.blocking`, `semap.client.awaiting`); neither knows any operation.
"""

from __future__ import annotations

import json
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from http import HTTPStatus
from pathlib import Path
from typing import Any, TypeAlias, TypeVar
from urllib.parse import quote

from pydantic import TypeAdapter, ValidationError

from semap.client.problem import error_of
from semap.errors import ServiceUnreachable, UntrustedBytes

T = TypeVar("T")

SAFE = ("GET", "HEAD")


@dataclass(frozen=True)
class Upload:
    """A file of a form: bytes, or a path that is read as it is sent."""

    name: str
    content: bytes | Path


@dataclass(frozen=True)
class Request:
    """One request; `repeatable` where doing it twice is the same as doing it once."""

    method: str
    path: str
    query: Mapping[str, Any] = field(default_factory=dict)
    body: Any = None
    form: Mapping[str, str] = field(default_factory=dict)
    files: Mapping[str, Upload] = field(default_factory=dict)
    headers: Mapping[str, str] = field(default_factory=dict)
    repeatable: bool = False


@dataclass(frozen=True)
class Pause:
    """Nothing is done for so long."""

    seconds: float


@dataclass(frozen=True)
class Lost:
    """No answer came; `unsent` where the request cannot have arrived."""

    reason: str
    unsent: bool


@dataclass(frozen=True)
class Answer:
    """What the service said."""

    status: int
    headers: Mapping[str, str]
    content: bytes

    def document(self) -> Any:
        """raises UntrustedBytes for what is no JSON"""
        try:
            return json.loads(self.content)
        except ValueError as error:
            raise UntrustedBytes(
                "The answer is no JSON.", "See that the address is that of semap, not of something before it."
            ) from error

    def read(self, kind: type[T]) -> T:
        """The document as a value. raises UntrustedBytes where it is none"""
        return read(kind, self.document())

    def raise_for_problem(self) -> None:
        """raises the error that a problem document (RFC 9457) stands for"""
        if self.status >= HTTPStatus.BAD_REQUEST:
            raise error_of(self.status, self.headers, self.content)


Step: TypeAlias = Request | Pause
Told: TypeAlias = Answer | Lost | None
Plan: TypeAlias = Generator[Step, Told, T]


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def read(kind: type[T], document: object) -> T:
    """A document as a value; members that the value does not know are passed over.

    raises  UntrustedBytes where the document does not fit
    """
    wanted: Any = kind
    try:
        value: T = _adapter(wanted).validate_python(document)
    except ValidationError as error:
        raise UntrustedBytes(
            f"The service answers with no {getattr(kind, '__name__', kind)}: {error.errors()[0]['msg']}.",
            "Let the client and the service be of the same version.",
        ) from error
    return value


def ask(request: Request) -> Plan[Answer]:
    """One request, and its answer if it is no problem."""
    told = yield request
    if isinstance(told, Answer):
        told.raise_for_problem()
        return told
    raise ServiceUnreachable(
        f"{request.method} {request.path} was not answered: {told.reason if told else 'nothing came'}.",
        "See that semap is up, and that the address and port are right.",
    )


def get(kind: type[T], path: str, **query: Any) -> Plan[T]:
    """A document that is only read."""
    answer = yield from ask(Request("GET", path, given(query)))
    return answer.read(kind)


def pages(kind: type[T], path: str, member: str, limit: int | None, **query: Any) -> Plan[Sequence[T]]:
    """The entries of a list, page by page: all of them, or the first `limit`.

    member  the name of the list in each page's document
    """
    found: list[T] = []
    wanted = given(query)
    while limit is None or len(found) < limit:
        size = PAGE if limit is None else min(PAGE, limit - len(found))
        answer = yield from ask(Request("GET", path, {**wanted, "limit": size}))
        document = answer.document()
        entries = document[member] if isinstance(document, dict) and member in document else None
        found += read(list[kind], entries)  # type: ignore[valid-type]
        # the second only where something between the two answers for the service
        if document.get("next") in (None, wanted.get("after")):
            break
        wanted["after"] = document["next"]
    return tuple(found)


PAGE = 1000
"""So many entries are asked for at once, which is the most that the service gives."""


def segment(name: object) -> str:
    """A name as one part of a path; `.` and `..` too, which a path would otherwise be shortened by."""
    text = quote(str(name), safe="")
    return text.replace(".", "%2E") if text in (".", "..") else text


def given(query: Mapping[str, Any]) -> dict[str, Any]:
    """The parameters of a query that are not None, as HTTP writes them."""
    return {name: _text(value) for name, value in without_none(query).items()}


def without_none(values: Mapping[str, Any]) -> dict[str, Any]:
    """What the caller has given of a document."""
    return {name: value for name, value in values.items() if value is not None}


def _text(value: Any) -> Any:
    if isinstance(value, bool):
        return "true" if value else "false"
    return value.isoformat() if hasattr(value, "isoformat") else value
