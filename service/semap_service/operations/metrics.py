"""/metrics: what the database knows about all processes, and what this one counts by itself.

The database carries what the worker and the ingest know, so that there is one place to ask, which outlives
each of them. A scrape is a few bounded statements on a connection kept for that, so that a service whose
connections are all in use still answers. A database that does not answer is said: semap_database_up is 0.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from datetime import datetime
from threading import Lock
from typing import Protocol

from prometheus_client import Metric
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, InfoMetricFamily
from prometheus_client.exposition import generate_latest as as_text
from prometheus_client.openmetrics.exposition import generate_latest as as_openmetrics
from sqlalchemy import Engine
from sqlalchemy.pool import QueuePool

from semap import __version__
from semap.errors import SemapError
from semap.store.operate.metrics import Figures, newest, read_figures, sample_lags
from semap.store.operate.schema import head_version
from semap_service.context.caller import SYSTEM, acting_as
from semap_service.database.transaction import transaction
from semap_service.operations.instruments import Instruments

TEXT = "text/plain; version=0.0.4; charset=utf-8"
OPENMETRICS = "application/openmetrics-text; version=1.0.0; charset=utf-8"
STATEMENT_S = 1.0


class FeedCounts(Protocol):
    """What the feed knows of its clients."""

    connected: bool
    clients: dict[str, int]
    sent: int
    too_slow: int


class Metrics:
    """Mutable: up to where lags were looked at. Two scrapes at once each see all."""

    def __init__(self, instruments: Instruments, engine: Engine, served: Engine) -> None:
        self._instruments = instruments
        self._engine = engine
        self._served = served
        self._lock = Lock()
        self._cursors: tuple[int, int] | None = None

    def scrape(self, feed: FeedCounts, accept: str) -> tuple[bytes, str]:
        """The metrics, and their media type: OpenMetrics where it is asked for."""
        started_s = time.perf_counter()
        figures = self._figures()
        families = [
            *self._instruments.registry.collect(),
            *_of_feed(feed),
            *_of_pool(self._served),
            *(_of_database(figures) if figures else ()),
            _gauge("database_up", "Whether the database answered this scrape.", figures is not None),
            InfoMetricFamily(
                "semap_build",
                "Which semap this is.",
                {"version": __version__, "schema": head_version()},
            ),
            _gauge(
                "scrape_duration_seconds",
                "How long it took to gather this.",
                time.perf_counter() - started_s,
            ),
        ]
        if "application/openmetrics-text" in accept:
            return as_openmetrics(_Families(families)), OPENMETRICS  # type: ignore[no-untyped-call]
        return as_text(_Families(families)), TEXT

    def _figures(self) -> Figures | None:
        try:
            with (
                self._lock,
                acting_as(SYSTEM, statement_s=STATEMENT_S),
                transaction(self._engine) as connection,
            ):
                if self._cursors is None:
                    self._cursors = newest(connection)
                samples = sample_lags(connection, *self._cursors)
                figures = read_figures(connection)
                self._cursors = samples.relation_cursor, samples.event_cursor
                if figures.worker is not None and figures.worker.events < samples.event_cursor:
                    self._cursors = None  # an older database has taken its place
        except SemapError:
            return None
        for lag_s in samples.relations_s:
            self._instruments.stage_s.labels("stamp_to_relation").observe(lag_s)
        for map_name, rule, lag_s in samples.events:
            self._instruments.rule_took(map_name, rule, lag_s)
        return figures


class _Families:
    """A registry of what is known already, as the writers of prometheus_client want it."""

    def __init__(self, families: Iterable[Metric]) -> None:
        self._families = families

    def collect(self) -> Iterator[Metric]:
        yield from self._families


def _gauge(name: str, said: str, value: float) -> GaugeMetricFamily:
    return GaugeMetricFamily(f"semap_{name}", said, value=float(value))


def _counter(name: str, said: str, value: float) -> CounterMetricFamily:
    return CounterMetricFamily(f"semap_{name}", said, value=float(value))


def _of_feed(feed: FeedCounts) -> Iterator[Metric]:
    yield _gauge("feed_connected", "Whether new events are pushed; else they are polled for.", feed.connected)
    clients = GaugeMetricFamily("semap_feed_clients", "Clients that follow a feed now.", labels=["kind"])
    for kind, count in sorted(feed.clients.items()):
        clients.add_metric([kind], count)
    yield clients
    yield _counter("feed_sent_events", "Events that were sent to clients of feeds.", feed.sent)
    yield _counter("feed_too_slow", "Clients that were closed because they did not keep up.", feed.too_slow)


def _of_pool(engine: Engine) -> Iterator[Metric]:
    pool = engine.pool
    assert isinstance(pool, QueuePool)  # noqa: S101  (as open_engine makes it)
    connections = GaugeMetricFamily(
        "semap_database_connections", "Connections of this service to the database.", labels=["state"]
    )
    connections.add_metric(["in_use"], pool.checkedout())
    connections.add_metric(["idle"], pool.checkedin())
    yield connections
    yield _gauge(
        "database_connections_limit",
        "How many there may be; requests beyond that wait.",
        pool.size() + pool._max_overflow,
    )


def _of_database(figures: Figures) -> Iterator[Metric]:
    yield from _of_slots(figures)
    yield from _of_worker(figures)
    yield from _of_sources(figures)
    jobs = GaugeMetricFamily("semap_jobs", "Imports that run beside a request.", labels=["state"])
    for state in ("waiting", "running", "done", "failed", "cancelled"):
        jobs.add_metric([state], figures.jobs.get(state, 0))
    yield jobs
    yield from _of_webhooks(figures)
    yield from _of_bridges(figures)


def _of_slots(figures: Figures) -> Iterator[Metric]:
    active = GaugeMetricFamily("semap_slot_active", "Whether a process reads the slot.", labels=["slot"])
    behind = GaugeMetricFamily(
        "semap_slot_lag_bytes", "How much of the log its reader has not confirmed.", labels=["slot"]
    )
    kept = GaugeMetricFamily(
        "semap_slot_retained_bytes", "How much of the log the server keeps for it.", labels=["slot"]
    )
    for slot in figures.slots:
        active.add_metric([slot.name], slot.active)
        behind.add_metric([slot.name], max(0, slot.behind_bytes))
        kept.add_metric([slot.name], max(0, slot.kept_bytes))
    yield from (active, behind, kept)


def _of_worker(figures: Figures) -> Iterator[Metric]:
    worker = figures.worker
    if worker is None:
        return
    yield _counter("events", "Events that rules have made.", worker.events)
    yield _counter("relation_changes", "Relations that began or ended.", worker.relation_changes)
    yield _counter("late_rows", "Rows that came after the watermark had passed them.", worker.late_rows)
    yield _gauge(
        "worker_committed_timestamp_seconds",
        "When the rule worker last committed.",
        worker.committed_at.timestamp(),
    )
    dropped = CounterMetricFamily(
        "semap_dropped_attempts",
        "Attempts that a rule has given up because too many were under way in one key.",
        labels=["rule_id", "rule"],
    )
    for rule_id, (rule, count) in sorted(worker.dropped.items()):
        dropped.add_metric([rule_id, rule], count)
    yield dropped


def _of_sources(figures: Figures) -> Iterator[Metric]:
    received = CounterMetricFamily("semap_received", "Input by source.", labels=["map", "source", "kind"])
    late = CounterMetricFamily(
        "semap_late_states",
        "States that came after the present of what they are about.",
        labels=["map", "source"],
    )
    late_waiting = _per_source("late_states_waiting", "Late states whose corrections are not written yet.")
    received_at = _per_source("received_timestamp_seconds", "When something last came in.")
    watermark = _per_source("watermark_timestamp_seconds", "The watermark of a source.")
    silent = _per_source("silent", "Whether rules wait for it no more, since it is idle or has ended.")
    for source in figures.sources:
        labels = [source.map, source.name]
        received.add_metric([*labels, "track_state"], source.track_states)
        received.add_metric([*labels, "line"], source.lines)
        received.add_metric([*labels, "object_state"], source.object_states)
        late.add_metric(labels, source.late_states)
        late_waiting.add_metric(labels, source.late_waiting)
        received_at.add_metric(labels, source.received_at.timestamp())
        silent.add_metric(labels, source.is_silent)
        if isinstance(source.watermark, datetime):
            watermark.add_metric(labels, source.watermark.timestamp())
    yield from (received, late, late_waiting, received_at, watermark, silent)


def _per_source(name: str, said: str) -> GaugeMetricFamily:
    return GaugeMetricFamily(f"semap_source_{name}", said, labels=["map", "source"])


def _of_webhooks(figures: Figures) -> Iterator[Metric]:
    label = ["webhook"]
    active = GaugeMetricFamily("semap_webhook_active", "Whether events are sent to it.", labels=label)
    waiting = GaugeMetricFamily(
        "semap_webhook_waiting_events", "Events after its cursor, selected or not.", labels=label
    )
    dead = GaugeMetricFamily(
        "semap_webhook_dead_letters", "Events that it did not take, at most 100.", labels=label
    )
    delivered = CounterMetricFamily("semap_webhook_delivered", "Events that it took.", labels=label)
    failed = CounterMetricFamily("semap_webhook_failed_attempts", "Attempts in vain.", labels=label)
    for webhook in figures.webhooks:
        own = [str(webhook.webhook_id)]
        active.add_metric(own, webhook.state == "active")
        waiting.add_metric(own, webhook.waiting)
        dead.add_metric(own, webhook.dead_letters)
        delivered.add_metric(own, webhook.delivered)
        failed.add_metric(own, webhook.failed)
    yield from (active, waiting, dead, delivered, failed)


def _of_bridges(figures: Figures) -> Iterator[Metric]:
    label = ["map", "bridge", "kind"]
    connected = GaugeMetricFamily("semap_bridge_connected", "Whether it waits for nobody.", labels=label)
    told_at = GaugeMetricFamily("semap_bridge_told_timestamp_seconds", "When it last spoke.", labels=label)
    lag = GaugeMetricFamily(
        "semap_bridge_lag_seconds", "How long the last that came in waited to be passed on.", labels=label
    )
    counters = {
        name: CounterMetricFamily(f"semap_bridge_{name}", said, labels=label)
        for name, said in (
            ("received", "Records that came in."),
            ("committed", "Records that were stored."),
            ("delivered", "Events that were given out."),
            ("dropped", "Records of a live source that nothing could keep."),
            ("reconnects", "Times that the peer was lost, or refused it."),
        )
    }
    refused = CounterMetricFamily(
        "semap_bridge_refused", "Records that cannot be used.", labels=[*label, "reason"]
    )
    for bridge in figures.bridges:
        own = [bridge.map, bridge.name, bridge.kind]
        connected.add_metric(own, bridge.is_connected)
        told_at.add_metric(own, bridge.told_at.timestamp())
        if bridge.lag_s is not None:
            lag.add_metric(own, bridge.lag_s)
        for name, counter in counters.items():
            counter.add_metric(own, getattr(bridge, name))
        for reason, count in sorted(bridge.refusals.items()):
            refused.add_metric([*own, reason], count)
    yield from (connected, told_at, lag, *counters.values(), refused)
