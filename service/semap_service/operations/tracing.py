"""Traces by OpenTelemetry, where its packages are there (extra `otel`) and it was said where they go.

A request is a span with its route and id, each statement of the database a span below it. A `traceparent`
that comes with a request is carried on. All else is set by OpenTelemetry's own variables (OTEL_SERVICE_NAME,
OTEL_TRACES_SAMPLER, OTEL_EXPORTER_OTLP_HEADERS, ...).
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from semap import __version__
from semap_service.context.request_id import IDENTITY, request_id

if TYPE_CHECKING:
    from fastapi import FastAPI
    from opentelemetry.sdk.trace import TracerProvider
    from opentelemetry.sdk.trace.export import SpanExporter

log = logging.getLogger(__name__)

ENDPOINTS = ("OTEL_EXPORTER_OTLP_ENDPOINT", "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT")
NOT_TRACED = "/health$,/ready$,/metrics$"


def is_wanted(environment: Mapping[str, str] = os.environ) -> bool:
    """Whether somebody has said where traces go."""
    is_off = environment.get("OTEL_SDK_DISABLED", "").lower() == "true"
    return not is_off and any(environment.get(name) for name in ENDPOINTS)


@contextmanager
def traced(process: str, app: FastAPI | None = None) -> Iterator[None]:
    """Trace the work inside, if that is wanted and can be; what was not sent yet is sent at the end.

    process  the name of the service, unless OTEL_SERVICE_NAME says another
    """
    if not is_wanted():
        yield
        return
    try:
        from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter  # noqa: PLC0415

        provider = spans_to(OTLPSpanExporter(), process)
        trace_statements(provider)
        if app is not None:
            trace_requests(app, provider)
    except ImportError as error:
        log.warning("Nothing is traced, since %s is missing: pip install 'semap[otel]'", error.name)
        yield
        return
    try:
        yield
    finally:
        provider.shutdown()


def spans_to(exporter: SpanExporter, process: str) -> TracerProvider:
    """A provider that hands finished spans over in batches, beside the work."""
    from opentelemetry.sdk.resources import Resource  # noqa: PLC0415
    from opentelemetry.sdk.trace import TracerProvider  # noqa: PLC0415
    from opentelemetry.sdk.trace.export import BatchSpanProcessor  # noqa: PLC0415

    named = {"service.version": __version__}
    if "OTEL_SERVICE_NAME" not in os.environ:
        named["service.name"] = process
    provider = TracerProvider(resource=Resource.create(named))
    provider.add_span_processor(BatchSpanProcessor(exporter))
    return provider


def trace_statements(provider: TracerProvider) -> None:
    """A span for each statement that psycopg sends from now on; without its parameters."""
    from opentelemetry.instrumentation.psycopg import PsycopgInstrumentor  # noqa: PLC0415

    PsycopgInstrumentor().instrument(tracer_provider=provider, skip_dep_check=True)


def trace_requests(app: FastAPI, provider: TracerProvider) -> None:
    """A span for each request that the app answers, before it has answered any."""
    from opentelemetry.instrumentation.fastapi import FastAPIInstrumentor  # noqa: PLC0415

    FastAPIInstrumentor.instrument_app(
        app,
        tracer_provider=provider,
        excluded_urls=NOT_TRACED,
        server_request_hook=_with_id,
        exclude_spans=["receive", "send"],
    )


def _with_id(span: Any, scope: dict[str, Any]) -> None:
    scope[IDENTITY] = request_id(dict(scope["headers"]))
    if span and span.is_recording():
        span.set_attribute("semap.request_id", scope[IDENTITY])
