"""Pages about brokers do what they say, with a broker of the test's own in place of the reader's."""

from __future__ import annotations

from pathlib import Path

import pytest
from nats_server import serving
from patience import until
from transcript import Session

from bench.kafka.broker import KafkaMissing, running_broker

DOCS = Path(__file__).parents[2] / "docs"


def with_broker(page: str, folder: Path, said: str, address: str) -> Path:
    """The page with another address in it."""
    text = (DOCS / page).read_text()
    assert said in text
    copied = folder / "page.md"
    copied.write_text(text.replace(said, address))
    return copied


@pytest.mark.parametrize("page", ["how-to/kafka.md", "how-to/rules-apart.md"])
def test_a_page_about_kafka_is_true(
    reader: Session, tmp_path_factory: pytest.TempPathFactory, page: str
) -> None:
    folder = tmp_path_factory.mktemp("kafka")
    try:
        with running_broker(folder, until) as broker:
            reader.follow(with_broker(page, folder, "localhost:9092", broker.address))
    except KafkaMissing as missing:
        pytest.skip(str(missing))


def test_the_page_about_nats_is_true(reader: Session, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("nats")
    with serving(folder) as server:
        reader.follow(with_broker("bridges/nats.md", folder, "nats://localhost:4222", server.url))
