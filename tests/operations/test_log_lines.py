"""Lines of the log: complete, one line each, without secrets."""

from __future__ import annotations

import json
import logging
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st
from semap_service.context.request_id import CURRENT, request_id
from semap_service.operations.log_lines import JsonLines, TextLines
from semap_service.operations.redaction import HIDDEN, redacted


def record(message: str, *values: object, **extra: object) -> logging.LogRecord:
    made = logging.getLogger("semap").makeRecord(
        "semap.test", logging.WARNING, __file__, 1, message, values, None, extra=extra
    )
    made.created = 1_767_182_400.5
    return made


def test_a_line_for_programs() -> None:
    context = CURRENT.set("abc")
    try:
        line = JsonLines().format(record("%s took %d", "it", 3, status=200, caller=None))
    finally:
        CURRENT.reset(context)
    assert json.loads(line) == {
        "time": "2025-12-31T12:00:00.500Z", "level": "warning", "logger": "semap.test", "message": "it took 3",
        "request_id": "abc", "status": 200, "caller": None,
    }  # fmt: skip


def test_a_line_for_people() -> None:
    assert TextLines().format(record("hello")) == "12:00:00 semap.test: hello"


@given(st.text())
def test_nobody_forges_a_line(text: str) -> None:
    for form in (TextLines(), JsonLines()):
        assert len(form.format(record("%s", text)).splitlines()) == 1


def test_a_stack_goes_into_the_line() -> None:
    try:
        raise ValueError("postgresql://me:geheim@host/db")
    except ValueError:
        made = record("failed")
        made.exc_info = sys.exc_info()
    line = json.loads(JsonLines().format(made))
    assert "test_a_stack_goes" in line["error"]
    assert f"postgresql://me:{HIDDEN}@host/db" in line["error"]
    assert "geheim" not in TextLines().format(made)


@pytest.mark.parametrize(
    "text",
    [
        "postgresql://me:geheim@host:5432/db", "postgres://me:ge@heim@host/db", "postgresql+psycopg://:geheim@host/db",
        "me:geheim@127.0.0.1", 'missing "=" after "me:geheim@host" in it', "host=h password=geheim user=me", "host=h password='geheim' x", r"password = 'ge\'heim' user=me", "PASSWORD=geheim",
        "postgresql://host/db?user=me&password=geheim&x=1", "Authorization: Bearer geheim", "bearer.geheim",
        "semap_geheimgeheimgeheimgeheimgeheimgeheim1", "whsec_geheim+/=",
    ],
)  # fmt: skip
def test_secrets_are_hidden(text: str) -> None:
    shown = redacted(text)
    assert "heim" not in shown
    assert HIDDEN in shown
    assert redacted(shown) == shown


@pytest.mark.parametrize("text", ["semap_rules_16384", "http://127.0.0.1:8000/a@b", "the password is wrong"])
def test_the_rest_stays(text: str) -> None:
    assert redacted(text) == text


@pytest.mark.parametrize("own", ["abc", "A-1._:z", "x" * 128])
def test_a_callers_own_id_is_kept(own: str) -> None:
    assert request_id({b"x-request-id": own.encode()}) == own


TRACE = "4bf92f3577b34da6a3ce929d0e0e4736"


@pytest.mark.parametrize("own", [b"", b"x" * 129, b"a b", b"a\nb", b"\xff", b"-a", b'a"b'])
def test_an_id_that_is_none_gives_way_to_the_trace(own: bytes) -> None:
    parent = f"00-{TRACE}-00f067aa0ba902b7-01".encode()
    assert request_id({b"x-request-id": own, b"traceparent": parent}) == TRACE


@pytest.mark.parametrize(
    "parent",
    [
        b"", b"00-" + b"0" * 32 + b"-00f067aa0ba902b7-01", b"00-" + TRACE.encode() + b"-" + b"0" * 16 + b"-01",
        b"ff-" + TRACE.encode() + b"-00f067aa0ba902b7-01", b"00-" + TRACE.upper().encode() + b"-00f067aa0ba902b7-01",
        TRACE.encode(), b"00-" + TRACE.encode() + b"-00f067aa0ba902b7",
    ],
)  # fmt: skip
def test_else_one_is_made(parent: bytes) -> None:
    first, second = (request_id({b"traceparent": parent}) for _ in range(2))
    assert first != second
    assert len(first) == 32
