"""Traces: a span for a request, one below it for each statement, the caller's trace carried on; else nothing."""

from __future__ import annotations

import asyncio
import subprocess
import sys
from collections.abc import Iterator

import httpx
import pytest
from fastapi import FastAPI
from opentelemetry.instrumentation.fastapi import FastAPIInstrumentor
from opentelemetry.instrumentation.psycopg import PsycopgInstrumentor
from opentelemetry.sdk.trace import ReadableSpan
from opentelemetry.sdk.trace.export.in_memory_span_exporter import InMemorySpanExporter
from semap_service.operations import tracing
from semap_service.serving.app import create_app

TRACE = "4bf92f3577b34da6a3ce929d0e0e4736"


@pytest.fixture
def spans(monkeypatch: pytest.MonkeyPatch) -> Iterator[InMemorySpanExporter]:
    exporter = InMemorySpanExporter()
    monkeypatch.setenv("OTEL_EXPORTER_OTLP_ENDPOINT", "http://127.0.0.1:1")
    monkeypatch.setattr(
        "opentelemetry.exporter.otlp.proto.http.trace_exporter.OTLPSpanExporter", lambda: exporter
    )
    yield exporter
    PsycopgInstrumentor().uninstrument()


def test_a_request_and_its_statements_are_one_trace(database: str, spans: InMemorySpanExporter) -> None:
    app = create_app(database, without_tokens=True)
    with tracing.traced("semap serve", app):
        asyncio.run(ask(app))
    finished = spans.get_finished_spans()
    requests = [span for span in finished if span.name.startswith("GET /maps")]
    assert {span.name for span in requests} == {"GET /maps/{name}", "GET /maps"}
    assert not any("health" in span.name for span in finished)
    [one] = [span for span in requests if span.name == "GET /maps/{name}"]
    assert f"{one.context.trace_id:032x}" == TRACE
    assert attributes(one)["semap.request_id"] == TRACE
    statements = [
        span for span in finished if span.parent is not None and span.parent.span_id == one.context.span_id
    ]
    assert any("semap.map" in str(attributes(span).get("db.statement")) for span in statements)
    assert {span.resource.attributes["service.name"] for span in finished} == {"semap serve"}
    FastAPIInstrumentor.uninstrument_app(app)


async def ask(app: FastAPI) -> None:
    async with (
        app.router.lifespan_context(app),
        httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://127.0.0.1") as client,
    ):
        await client.get("/health")
        answer = await client.get("/maps/office", headers={"traceparent": f"00-{TRACE}-00f067aa0ba902b7-01"})
        assert answer.status_code == 404
        assert answer.headers["x-request-id"] == TRACE
        await client.get("/maps")


def attributes(span: ReadableSpan) -> dict[str, object]:
    return dict(span.attributes or {})


@pytest.mark.parametrize(
    ("environment", "wanted"),
    [
        ({}, False),
        ({"OTEL_EXPORTER_OTLP_ENDPOINT": ""}, False),
        ({"OTEL_EXPORTER_OTLP_ENDPOINT": "http://collector:4318"}, True),
        ({"OTEL_EXPORTER_OTLP_TRACES_ENDPOINT": "http://collector:4318/v1/traces"}, True),
        ({"OTEL_EXPORTER_OTLP_ENDPOINT": "http://collector:4318", "OTEL_SDK_DISABLED": "TRUE"}, False),
    ],
)
def test_only_where_somebody_wants_it(environment: dict[str, str], wanted: bool) -> None:
    assert tracing.is_wanted(environment) == wanted


def test_without_its_packages_nothing_happens_but_a_word(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OTEL_EXPORTER_OTLP_ENDPOINT", "http://127.0.0.1:1")
    monkeypatch.setitem(sys.modules, "opentelemetry.exporter.otlp.proto.http.trace_exporter", None)
    with tracing.traced("semap work"):
        pass
    assert "pip install 'semap[otel]'" in caplog.text


def test_it_costs_nothing_where_nobody_wants_it() -> None:
    ask = (
        "import sys; from semap_service.operations.tracing import traced\n"
        "with traced('semap work'): sys.exit('opentelemetry.sdk' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", ask], env={"PATH": ""}, check=False).returncode == 0
