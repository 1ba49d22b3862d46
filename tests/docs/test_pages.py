"""Every command of the documentation does what its page says."""

from __future__ import annotations

import shutil
import socket
from contextlib import suppress
from pathlib import Path

import pytest
from bridge.mosquitto import needs_mosquitto
from semap_bridge.config import read_config
from server import reachable_folder
from transcript import Session, blocks

from semap.cluster import Cluster

CHECKOUT = Path(__file__).parents[2]


OTHERS = ("index", "tutorial", "client", "bridges")
PAGES = (
    "README.md",
    "docs/tutorial.md",
    "docs/client.md",
    "docs/bridges.md",
    "docs/bridges/bacnet.md",
    "docs/bridges/foxglove.md",
    "docs/bridges/omlox.md",
    "docs/how-to/own-building.md",
    "docs/how-to/own-tracker.md",
    "docs/how-to/tokens.md",
    "docs/how-to/write-a-map.md",
)
SLOW = ("docs/how-to/recording.md", "docs/how-to/ros2-robot.md")
ON_ITS_OWN_SERVER = "docs/how-to/shards.md"
WITH_BROKERS = ("docs/how-to/kafka.md", "docs/how-to/rules-apart.md", "docs/bridges/nats.md")
"""See test_broker_pages."""


@pytest.mark.parametrize("page", PAGES)
def test_a_page_is_true(reader: Session, page: str) -> None:
    if "$ curl " in (CHECKOUT / page).read_text() and shutil.which("curl") is None:
        pytest.skip("there is no curl: apt-get install curl")
    reader.follow(CHECKOUT / page)


@pytest.mark.slow
@pytest.mark.parametrize("page", SLOW)
def test_a_page_about_recordings_is_true(reader: Session, page: str) -> None:
    reader.follow(CHECKOUT / page)


def test_the_page_about_shards_is_true(reader: Session) -> None:
    """On a server of semap's own, whose databases the page lets it make."""
    with reachable_folder() as home:
        reader.environment = {
            **{name: value for name, value in reader.environment.items() if name != "SEMAP_DSN"},
            "SEMAP_HOME": str(home),
        }
        try:
            reader.follow(CHECKOUT / "docs/how-to/shards.md")
        finally:
            Cluster(home).stop()


@needs_mosquitto
@pytest.mark.skipif(
    shutil.which("mosquitto_pub") is None,
    reason="there is no mosquitto_pub: apt-get install mosquitto-clients",
)
def test_the_page_about_a_house_is_true(reader: Session, tmp_path: Path) -> None:
    programs = f"{reader.environment['PATH']}:/usr/sbin:/usr/local/sbin"
    reader.environment = {**reader.environment, "PATH": programs}
    page = (CHECKOUT / "docs/how-to/my-house.md").read_text()
    (tmp_path / "my-house.md").write_text(page.replace("1883", str(_port_of_four_digits())))
    reader.follow(tmp_path / "my-house.md")


def _port_of_four_digits() -> int:
    """So that tables are as wide as the page shows them."""
    for port in range(8100, 10_000):
        with suppress(OSError), socket.create_server(("127.0.0.1", port)):
            return port
    raise AssertionError("no port is free")


@pytest.mark.parametrize("page", sorted(Path(CHECKOUT / "docs").rglob("*.md")), ids=lambda page: page.stem)
def test_every_config_of_bridges_that_is_shown_is_one(page: Path, tmp_path: Path) -> None:
    shown = [each for each in blocks(page.read_text()) if each.kind == "yaml" and "bridges:" in each.body]
    for number, block in enumerate(shown):
        config = tmp_path / f"{number}.yaml"
        config.write_text(block.body)
        assert read_config(config).bridges, f"{page.name}, line {block.line}"


def test_every_page_for_beginners_that_shows_commands_is_followed() -> None:
    """Those about one part of semap are held true by the tests of that part."""
    docs = CHECKOUT / "docs"
    pages = [
        CHECKOUT / "README.md",
        *docs.glob("how-to/*.md"),
        *docs.glob("bridges/*.md"),
        *(docs / f"{name}.md" for name in OTHERS),
    ]
    shown = {
        str(page.relative_to(CHECKOUT))
        for page in pages
        if any(block.kind in ("console", "pycon") for block in blocks(page.read_text()))
    }
    assert shown == {*PAGES, *SLOW, *WITH_BROKERS, ON_ITS_OWN_SERVER, "docs/how-to/my-house.md"}
