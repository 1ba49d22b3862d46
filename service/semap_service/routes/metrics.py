"""GET /metrics"""

from __future__ import annotations

from fastapi import APIRouter, Response
from starlette.requests import Request

from semap_service.http.problem import problems
from semap_service.operations.metrics import OPENMETRICS, TEXT, Metrics

router = APIRouter(tags=["service"])

EXPOSITIONS = {
    "description": "Metrics as text for Prometheus, or as OpenMetrics.",
    "content": {kind: {} for kind in (TEXT, OPENMETRICS)},
}


@router.get(
    "/metrics",
    operation_id="get_metrics",
    status_code=200,
    response_class=Response,
    responses={**problems(), 200: EXPOSITIONS},
)
def get_metrics(request: Request) -> Response:
    """Metrics for Prometheus: input, lags, rules, feeds, webhooks, jobs, requests.

    It answers while the database is down: semap_database_up is 0 then. The format is OpenMetrics for clients
    that accept application/openmetrics-text.
    """
    metrics: Metrics = request.app.state.metrics
    body, kind = metrics.scrape(request.app.state.feed, request.headers.get("accept", ""))
    return Response(body, headers={"Content-Type": kind})
