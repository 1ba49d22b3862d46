"""/metrics: what is said there is what happened, in both formats, also without a database."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path

from prometheus_client.openmetrics.parser import text_string_to_metric_families as parse_openmetrics
from prometheus_client.parser import text_string_to_metric_families as parse_text
from rule_work import running_worker
from running import Service
from shapely import box

from semap.cluster import Cluster
from semap.store.database.connection import connect

Samples = dict[tuple[str, frozenset[tuple[str, str]]], float]

CONVENTIONAL = re.compile(r"semap_[a-z_]+(_total|_seconds|_bytes|_bucket|_sum|_count|_info)?|process_[a-z_]+")


def scraped(service: Service) -> Samples:
    said = service.client.get("/metrics")
    assert said.status_code == 200
    return {
        (sample.name, frozenset(sample.labels.items())): sample.value
        for family in parse_text(said.text)
        for sample in family.samples
    }


def value(samples: Samples, name: str, **labels: str) -> float:
    return samples[name, frozenset(labels.items())]


def test_what_came_in_and_what_was_made_of_it(service: Service, database: str) -> None:
    service.make_map()
    service.make_room("kitchen", box(0, 0, 4, 3), height_m=2.5)
    begun_at = datetime.now(UTC).timestamp()
    before = scraped(service)
    assert value(before, "semap_database_up") == 1
    assert value(before, "semap_events_total") == 0
    with running_worker(database):
        service.walk([(1, 1), (2, 1), (9, 9), (1, 1)])
        service.until(lambda: service.get("/events")["events"].__len__() == 3)
        said = scraped(service)
        slot = f"semap_rules_{service.plain.execute('select oid from pg_database where datname = current_database()').fetchone()[0]}"
        assert value(said, "semap_slot_active", slot=slot) == 1
        assert (
            0
            <= value(said, "semap_slot_lag_bytes", slot=slot)
            <= value(said, "semap_slot_retained_bytes", slot=slot)
        )
    assert value(said, "semap_received_total", map="office", source="lidar", kind="track_state") == 4
    assert value(said, "semap_late_states_total", map="office", source="lidar") == 0
    assert value(said, "semap_events_total") == 3
    assert value(said, "semap_relation_changes_total") == 3
    assert value(said, "semap_rule_latency_seconds_count", map="office", rule="room_visits") == 3
    assert value(said, "semap_rule_latency_seconds_sum", map="office", rule="room_visits") > 0
    for stage in ("stamp_to_relation", "relation_to_event", "event_to_feed"):
        assert value(said, "semap_stage_lag_seconds_count", stage=stage) > 0
    again = scraped(service)
    assert value(again, "semap_rule_latency_seconds_count", map="office", rule="room_visits") == 3
    received_at = value(said, "semap_source_received_timestamp_seconds", map="office", source="lidar")
    assert begun_at <= received_at <= datetime.now(UTC).timestamp()


def test_states_that_come_late_and_again_are_counted(service: Service) -> None:
    service.make_map()
    track_id = service.walk([(1, 1), (2, 1)])
    service.plain.execute(
        "insert into semap.track_state (track_id, stamp, x_m, y_m) values (%s, '2026-01-31 11:00Z', 0, 0)",
        [track_id],
    )
    said = scraped(service)
    assert value(said, "semap_received_total", map="office", source="lidar", kind="track_state") == 3
    assert value(said, "semap_late_states_total", map="office", source="lidar") == 1
    assert value(said, "semap_source_late_states_waiting", map="office", source="lidar") == 1
    service.client.delete("/maps/office")
    assert not any("lidar" in str(labels) for _, labels in scraped(service))


def test_requests_are_counted_by_template(service: Service) -> None:
    for name in ("nowhere", "elsewhere", "somewhere"):
        assert service.client.get(f"/maps/{name}").status_code == 404
    service.raw.request("BREW", "/maps")
    service.raw.get("/no/such/path/at/all")
    said = scraped(service)
    assert value(said, "semap_http_requests_total", route="/maps/{name}", method="GET", status="404") == 3
    assert value(said, "semap_http_request_duration_seconds_count", route="/maps/{name}", method="GET") == 3
    assert value(said, "semap_http_requests_total", route="other", method="GET", status="404") == 1
    assert not any("BREW" in str(labels) for _, labels in said)


def test_both_formats_hold_the_same_and_keep_the_conventions(service: Service) -> None:
    asked = {"Accept": "application/openmetrics-text;version=1.0.0,text/plain;q=0.5"}
    said = service.client.get("/metrics", headers=asked)
    assert said.headers["content-type"].startswith("application/openmetrics-text")
    assert said.text.endswith("# EOF\n")
    as_openmetrics = {family.name for family in parse_openmetrics(said.text)}
    as_text = {name for name, _ in scraped(service)}
    assert {name for name in as_openmetrics if name.startswith("semap_")} == {
        re.sub("_(total|info|bucket|sum|count|created)$", "", name)
        for name in as_text
        if name.startswith("semap_")
    } | {"semap_rule_latency_seconds", "semap_stage_lag_seconds"} | {
        name
        for name in as_openmetrics
        if name.startswith(
            (
                "semap_feed",
                "semap_webhook",
                "semap_received",
                "semap_late",
                "semap_source",
                "semap_dropped",
                "semap_bridge",
            )
        )
    }  # families without a sample are only announced
    assert all(CONVENTIONAL.fullmatch(name) for name in as_text if not name.startswith("python"))


def test_what_the_documentation_names_is_there(service: Service) -> None:
    page = (Path(__file__).parents[2] / "docs" / "operations.md").read_text()
    said = service.client.get("/metrics", headers={"Accept": "application/openmetrics-text"}).text
    families = {family.name: family.type for family in parse_openmetrics(said)}
    suffixes = {
        "counter": ["_total"],
        "histogram": ["", "_bucket", "_sum", "_count"],
        "info": ["_info"],
        "gauge": [""],
    }
    there = {f"{name}{suffix}" for name, kind in families.items() for suffix in suffixes[kind]}
    named = set(
        re.findall(
            r"\bsemap_(?!rules_|restored)[a-z_]+", page.partition("## Metrics")[2].partition("## Traces")[0]
        )
    )
    assert named <= there
    assert {name for name, kind in families.items() if name.startswith("semap_")} <= {
        re.sub("_(total|bucket|sum|count|info)$", "", name) for name in named
    }


def test_it_answers_without_a_database(service: Service, cluster: Cluster) -> None:
    database = service.plain.execute("select current_database()").fetchone()[0]
    with connect(cluster.dsn("postgres")) as other:
        other.execute(f"alter database {database} allow_connections false")
        try:
            other.execute(
                "select pg_terminate_backend(pid) from pg_stat_activity where datname = %s", [database]
            )
            service.until(lambda: value(scraped(service), "semap_database_up") == 0)
            assert service.raw.get("/ready").status_code == 503
            assert service.raw.get("/health").status_code == 503
        finally:
            other.execute(f"alter database {database} allow_connections true")
    service.until(lambda: value(scraped(service), "semap_database_up") == 1)


def test_a_scrape_names_a_hundred_sources_at_most(service: Service) -> None:
    service.make_map()
    service.plain.execute(
        "insert into semap.source (map_id, name) select map_id, 's' || n from semap.map, generate_series(1, 300) n"
    )
    service.plain.execute("insert into semap.source_count (source_id) select source_id from semap.source")
    assert service.raw.get("/metrics").text.count("semap_late_states_total{") == 100
