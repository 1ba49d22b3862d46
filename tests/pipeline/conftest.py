from collections.abc import Iterator

import pytest
from semap_ingest.pipeline.ingest_recording import Plan, ingest_recording
from semap_ingest.simulation.office import OfficePaths, write_office
from semap_ingest.simulation.settings import OfficeSettings
from semap_service.exchange.map_file import bring_in, read_file
from server import fresh_database
from stored_results import stored

from semap.cluster import Cluster
from semap.store.database import one_transaction


@pytest.fixture(scope="session")
def office(tmp_path_factory) -> OfficePaths:
    """Six seconds of a laser among three persons, with doors that move."""
    folder = tmp_path_factory.mktemp("office") / "short"
    return write_office(folder, OfficeSettings(seed=3, people=3, duration_s=6.0, camera=False))


@pytest.fixture(scope="session")
def office_template(cluster: Cluster, template: str, office: OfficePaths) -> str:
    """The name of a database with the map of the office, to be copied."""
    cluster.create_database("office_template", template)
    with one_transaction(cluster.dsn("office_template"), "semap_api") as connection:
        bring_in(connection, read_file(office.map), "office", "office")
    return "office_template"


@pytest.fixture
def office_map(cluster: Cluster, office_template: str) -> Iterator[str]:
    """The DSN of a database with the map of the office."""
    with fresh_database(cluster, office_template) as dsn:
        yield dsn


@pytest.fixture(scope="session")
def plan(office: OfficePaths) -> Plan:
    return Plan("office", "robot", office.recording)


@pytest.fixture(scope="session")
def at_once(cluster: Cluster, office_template: str, plan: Plan) -> dict[str, list[str]]:
    """What one run at full speed leaves."""
    with fresh_database(cluster, office_template) as dsn:
        ingest_recording(dsn, plan)
        return stored(dsn)
