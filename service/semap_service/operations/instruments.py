"""What this process counts by itself, for Prometheus: requests, and how long stages and rules took.

Labels are few by design: routes are templates, methods are those of HTTP, at most RULES rules are told apart.
"""

from __future__ import annotations

from prometheus_client import (
    CollectorRegistry,
    Counter,
    Gauge,
    Histogram,
    ProcessCollector,
    disable_created_metrics,
)

METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS", "WEBSOCKET"})
OTHER = "other"
RULES = 200

REQUEST_S = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0)
LAG_S = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 60.0, 600.0)


class Instruments:
    """Mutable: the counters of one service; each has a registry of its own."""

    def __init__(self) -> None:
        disable_created_metrics()  # type: ignore[no-untyped-call]  # a third more lines, read by nobody
        self.registry = CollectorRegistry()
        self.requests = Counter(
            "semap_http_requests",
            "Requests that were answered.",
            ("route", "method", "status"),
            registry=self.registry,
        )
        self.request_s = Histogram(
            "semap_http_request_duration_seconds",
            "From a request to the end of its answer; streams are left out.",
            ("route", "method"),
            buckets=REQUEST_S,
            registry=self.registry,
        )
        self.open_requests = Gauge(
            "semap_http_requests_in_progress", "Requests and streams that are open.", registry=self.registry
        )
        self.stage_s = Histogram(
            "semap_stage_lag_seconds",
            "How long after what came before a stage was done: stamp_to_relation (from event time), "
            "relation_to_event, event_to_feed.",
            ("stage",),
            buckets=LAG_S,
            registry=self.registry,
        )
        self.rule_s = Histogram(
            "semap_rule_latency_seconds",
            "From when the last evidence of an event was written until the event was.",
            ("map", "rule"),
            buckets=LAG_S,
            registry=self.registry,
        )
        self._rules: set[tuple[str, str]] = set()
        ProcessCollector(registry=self.registry)

    def answered(self, route: str, method: str, status: int, duration_s: float | None) -> None:
        """Count a request; duration_s is None for a stream, whose length says nothing."""
        known = method if method in METHODS else OTHER
        self.requests.labels(route, known, str(status)).inc()
        if duration_s is not None:
            self.request_s.labels(route, known).observe(duration_s)

    def feed_took(self, lag_s: float) -> None:
        """An event that was written so long ago has reached the feed."""
        self.stage_s.labels("event_to_feed").observe(max(0.0, lag_s))

    def rule_took(self, map_name: str, rule: str, lag_s: float) -> None:
        """A rule has made an event so long after its last evidence was written."""
        self.stage_s.labels("relation_to_event").observe(lag_s)
        key = (map_name, rule)
        if key not in self._rules:
            if len(self._rules) >= RULES:
                key = (OTHER, OTHER)
            self._rules.add(key)
        self.rule_s.labels(*key).observe(lag_s)
