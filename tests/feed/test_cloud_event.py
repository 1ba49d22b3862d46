"""Events as CloudEvents, as the CNCF's own Python SDK reads them."""

import json

import pytest
from cloudevents.core.formats.json import JSONFormat
from cloudevents.core.v1.event import CloudEvent
from jsonschema import Draft202012Validator
from semap_service.documents.cloud_event import CloudEventDocument
from stored import STAMP, stored

from semap.store.event.cloud_event import cloud_event, cloud_event_json, event_json

SCHEMA = "http://127.0.0.1:8000/schemas/event"
EVENTS = {
    "plain": stored(17),
    "of a track only": stored(18, instance_id=None, instance_name=None),
    "of nobody": stored(19, track_id=None, track_name=None, instance_id=None, instance_name=None),
    "with odd names": stored(20, map="Büro 2/Ost?", type="größer als", instance_name='a "b"\n☃'),
}


@pytest.mark.parametrize("name", EVENTS)
def test_the_sdk_reads_them(name: str) -> None:
    event = EVENTS[name]
    written = cloud_event_json(event, event_json(event), SCHEMA)
    read = JSONFormat().read(CloudEvent, written)
    assert read.get_id() == str(event.event_id)
    assert read.get_type() == f"semap.event.{event.type}"
    assert read.get_time() == STAMP
    assert read.get_subject() == (event.instance_name or event.track_name)
    assert read.get_datacontenttype() == "application/json"
    assert read.get_dataschema() == SCHEMA
    assert read.get_extension("sequence") == f"{event.seq:019}"
    assert read.get_data() == json.loads(event_json(event))
    assert json.loads(written) == cloud_event(event, SCHEMA)
    document = CloudEventDocument.model_json_schema(mode="serialization")
    Draft202012Validator(document, format_checker=Draft202012Validator.FORMAT_CHECKER).validate(
        json.loads(written)
    )


def test_sequences_sort_as_numbers_do() -> None:
    numbers = [2, 10, 9, 2**63 - 1]
    assert sorted(numbers, key=lambda seq: str(cloud_event(stored(seq))["sequence"])) == sorted(numbers)


def test_the_source_is_the_path_of_the_map() -> None:
    assert cloud_event(EVENTS["plain"])["source"] == "/maps/office"
    assert cloud_event(EVENTS["with odd names"])["source"] == "/maps/B%C3%BCro%202%2FOst%3F"


def test_a_receiver_that_cannot_be_told_of_the_schema_is_not() -> None:
    assert "dataschema" not in cloud_event(EVENTS["plain"])
