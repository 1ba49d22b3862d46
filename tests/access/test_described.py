"""The whole published description, asked at random with each scope: no answer is outside it, none is a fault."""

from __future__ import annotations

import json
import traceback
import warnings
from collections.abc import Iterator
from functools import cache

import pytest
from guarded import KINDS, Guarded, furnish, give_tokens, guarded
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st
from patience import PATIENCE_S
from semap_service.serving.app import create_app
from server import database_with_slot

from semap.cluster import Cluster

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import schemathesis
    from schemathesis import GenerationMode
    from schemathesis.checks import not_a_server_error
    from schemathesis.specs.openapi.checks import (
        content_type_conformance,
        response_headers_conformance,
        response_schema_conformance,
        status_code_conformance,
    )

CHECKS = [
    not_a_server_error,
    status_code_conformance,
    content_type_conformance,
    response_headers_conformance,
    response_schema_conformance,
]
LEFT_OUT = {"/events/stream": "it does not end", "/ready": "503 is what it says without a worker"}
EXAMPLES = {"read": 1, "write": 2, "ingest": 1, "admin": 2}
LONG_EXAMPLES = 150
LONGEST_WAIT_S = 0.05
READING_FIRST = ("GET", "POST", "PUT", "PATCH", "DELETE")
OF_PATHS = {
    "frames": "frame", "descriptions": "description", "instances": "instance", "rooms": "instance",
    "doors": "instance", "tracks": "track", "queries": "query", "rules": "rule", "changes": "change",
}  # fmt: skip


@pytest.fixture
def furnished(cluster: Cluster, template: str) -> Iterator[tuple[Guarded, dict[str, int]]]:
    """A service over a database of its own, which what is asked may destroy."""
    with database_with_slot(cluster, template) as dsn:
        ids = furnish(dsn)
        with guarded(dsn) as service:
            give_tokens(service)
            yield service, ids


@pytest.mark.parametrize("kind", KINDS)
def test_every_answer_is_as_published(furnished: tuple[Guarded, dict[str, int]], kind: str) -> None:
    ask_everything(*furnished, kind, EXAMPLES[kind])


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_every_answer_is_as_published_at_length(furnished: tuple[Guarded, dict[str, int]], kind: str) -> None:
    ask_everything(*furnished, kind, LONG_EXAMPLES)


@cache
def described():
    """What every service publishes; it takes long to make."""
    return schemathesis.openapi.from_dict(json.loads(json.dumps(create_app("").openapi())))


def ask_everything(service: Guarded, ids: dict[str, int], kind: str, examples: int) -> None:
    operations = [found.ok() for found in described().get_all_operations()]
    assert len(operations) > 50
    failures = []
    with service.client(kind) as client:
        for operation in sorted(operations, key=lambda each: READING_FIRST.index(each.method.upper())):
            if operation.path in LEFT_OUT:
                continue
            try:
                ask(service, client, operation, ids, examples)
            except (Exception, BaseExceptionGroup) as failure:  # all of them are told at the end
                told = "".join(traceback.format_exception(failure, limit=0))
                failures.append(f"{operation.method} {operation.path}: {told}")
    assert not failures, "\n\n".join(failures)


def ask(service, client, operation, ids: dict[str, int], examples: int) -> None:
    """So many requests that fit the description, and as many that do not; on things that exist and others."""
    modes = (GenerationMode.POSITIVE, GenerationMode.NEGATIVE)

    @seed(1)
    @settings(
        max_examples=examples,
        derandomize=True,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(
        case=st.one_of(*(operation.as_strategy(generation_mode=mode) for mode in modes)),
        exists=st.sampled_from([True, True, False]),
    )
    def each(case, exists: bool) -> None:
        if exists:
            case.path_parameters.update(things(operation.path, case.path_parameters, ids))
        wait = (case.query or {}).get("wait")
        if isinstance(wait, int | float) and wait > LONGEST_WAIT_S:
            case.query["wait"] = LONGEST_WAIT_S
        case.call_and_validate(
            base_url=service.url, headers=dict(client.headers), checks=CHECKS, timeout=PATIENCE_S
        )

    each()


def things(path: str, parameters: dict, ids: dict[str, int]) -> dict[str, object]:
    """What is there, for the parameters of a path."""
    kind = path.split("/")[1]
    found: dict[str, object] = {}
    if "name" in parameters:
        found["name"] = "Room" if kind == "concepts" else "office"
    if "id" in parameters and kind in OF_PATHS:
        found["id"] = ids[OF_PATHS[kind]]
    if "operator" in parameters:
        found["operator"] = "topology"
    if "type" in parameters:
        found["type"] = "Footprint"
    for each in ("collectionId", "collection"):
        if each in parameters:
            found[each] = "office.tracks" if "tgsequence" in path or "tproperties" in path else "office.Room"
    return found
