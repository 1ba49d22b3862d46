"""The bytes of messages, as other people's programs read them."""

import json

import pytest
from semap_service.documents.feed import Hello
from semap_service.feed.encoding import Envelope, SocketEncoding, StreamEncoding
from semap_service.feed.ring import Entry
from semap_service.http.websocket import text_frame, text_of
from stored import stored
from websockets.client import ClientProtocol
from websockets.frames import Opcode
from websockets.protocol import State
from websockets.uri import parse_uri

ENTRIES = [Entry.of(stored(5)), Entry.of(stored(6, measures={"said": "one\ntwo\r\u2028"}))]


def read(data: bytes) -> list[str]:
    client = ClientProtocol(parse_uri("ws://x/"))
    client.state = State.OPEN
    client.reader.feed_data(data)
    client.parser = client.parse()
    next(client.parser)
    frames = client.events_received()
    assert all((frame.opcode, frame.fin) == (Opcode.TEXT, True) for frame in frames)
    return [bytes(frame.data).decode() for frame in frames]


@pytest.mark.parametrize("length", [0, 1, 125, 126, 127, 65_535, 65_536, 200_000])
def test_a_frame_is_read_as_it_was_meant(length: int) -> None:
    payload = ("ä" * (length // 2) + "x" * (length % 2)).encode()
    assert read(text_frame(payload) * 2) == [payload.decode()] * 2
    assert text_of(text_frame(payload)) == payload.decode()


def test_a_batch_holds_each_event() -> None:
    encoding = SocketEncoding(Envelope())
    (message,) = map(json.loads, read(encoding.events(ENTRIES, 9)))
    documents = [json.loads(entry.document) for entry in ENTRIES]
    assert message == {"type": "events", "cursor": 9, "events": documents}
    (message,) = map(json.loads, read(SocketEncoding(Envelope("urn:x")).events(ENTRIES, 9)))
    assert [each["data"] for each in message["events"]] == documents
    assert read(encoding.heartbeat(3)) == ['{"type":"heartbeat","cursor":3}']


def test_a_stream_has_a_line_for_each_event() -> None:
    """Whatever stands in an event, a message is two lines and an empty one."""
    encoding = StreamEncoding(Envelope())
    lines = encoding.events(ENTRIES, 9).decode().split("\n")
    assert [line.partition(": ")[0] for line in lines] == ["id", "data", "", "id", "data", "", ""]
    assert "\r" not in encoding.events(ENTRIES, 9).decode()
    assert [json.loads(lines[at].removeprefix("data: "))["seq"] for at in (1, 4)] == [5, 6]
    hello = encoding.hello(Hello(cursor=4, head=6, oldest=None, resumed="replayed")).decode()
    assert hello.startswith("retry: 1000\nid: 4\nevent: hello\ndata: {")
    assert encoding.heartbeat(7) == b": heartbeat\nid: 7\n\n"
