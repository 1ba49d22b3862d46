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
    """How semap is doing, for Prometheus: what comes in, lags, rules, feeds, webhooks, jobs, requests.

    It answers while the database does not: semap_database_up is 0 then. OpenMetrics is given to those who
    accept application/openmetrics-text.
    """
    metrics: Metrics = request.app.state.metrics
    body, kind = metrics.scrape(request.app.state.feed, request.headers.get("accept", ""))
    return Response(body, headers={"Content-Type": kind})
