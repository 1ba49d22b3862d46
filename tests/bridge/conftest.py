from collections.abc import Iterator

import pytest
from patience import until
from semap_bridge.relay.topics import Topics as RelayTopics
from semap_ingest.simulation.office import OfficePaths, write_office
from semap_ingest.simulation.settings import OfficeSettings
from semap_service.evaluation.play import set_the_stage
from server import database_with_slot
from topics import Topics

from bench.kafka.broker import Broker, KafkaMissing, running_broker
from semap.cluster import Cluster


@pytest.fixture(scope="session")
def office(tmp_path_factory: pytest.TempPathFactory) -> OfficePaths:
    """Twelve seconds of a laser among three persons, with doors that move."""
    folder = tmp_path_factory.mktemp("office") / "short"
    return write_office(folder, OfficeSettings(seed=3, people=3, duration_s=12.0, camera=False))


@pytest.fixture(scope="session")
def office_template(cluster: Cluster, template: str, office: OfficePaths) -> str:
    """The name of a database with the office on two maps, with its rules."""
    cluster.create_database("bridged_office", template)
    for name in ("office", "file"):
        set_the_stage(cluster.dsn("bridged_office"), office.map, name)
    return "bridged_office"


@pytest.fixture
def office_map(cluster: Cluster, office_template: str) -> Iterator[str]:
    """The DSN of a database with the maps of the office."""
    with database_with_slot(cluster, office_template) as dsn:
        yield dsn


@pytest.fixture(scope="module")
def broker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Broker]:
    """A broker of Kafka for the tests of a file."""
    try:
        with running_broker(tmp_path_factory.mktemp("kafka"), until) as running:
            yield running
    except KafkaMissing as missing:
        pytest.skip(str(missing))


@pytest.fixture
def relay(broker: Broker) -> RelayTopics:
    made = RelayTopics(broker.address, Topics(broker).word)
    made.make(partitions=3)
    return made
