"""OGC API Features over HTTP: what GIS programs ask, against what is known of the map."""

from __future__ import annotations

import base64
import gzip
import json
import random
import shutil
import subprocess
from itertools import pairwise
from typing import Any

import pyproj
import pytest
import shapely
from jsonschema import Draft202012Validator
from running import START, Service
from shapely import affinity
from shapely.geometry import shape

MAP_FRAME = "urn:semap:crs:map-frame"
EPSG = "http://www.opengis.net/def/crs/EPSG/0/{}"
ROOMS = "/collections/office.Room/items"
LINK = {"type": "object", "required": ["href", "rel", "type", "title"]}


def furnish(service: Service, count: int = 30) -> dict[str, dict[str, Any]]:
    """Rooms at random places, with what is known of each by its name."""
    chance = random.Random(7)
    service.make_map()
    known = {}
    for n in range(count):
        x_m, y_m = chance.uniform(-40, 40), chance.uniform(-40, 40)
        area = affinity.rotate(
            shapely.box(x_m, y_m, x_m + chance.uniform(1, 6), y_m + 3), chance.uniform(0, 90)
        )
        more: dict[str, Any] = {"attributes": {"seats": chance.randrange(5), "kind": chance.choice("abc")}}
        if n % 3:
            more |= {"elevation_m": 3.0 * (n % 2), "height_m": 2.5}
        if n % 2:
            more["alias"] = chance.choice(["hall", "Büro", "lab"])
        name = f"room {n:02}"
        made = service.make_room(name, area, **more)
        known[name] = {"id": made["id"], "area": area, "name": name, "alias": more.get("alias"), **more["attributes"],
                       "z_min_m": more.get("elevation_m"), "z_max_m": more.get("elevation_m", -99) + 2.5}  # fmt: skip
    return known


def names(document: dict) -> list[str]:
    return [each["properties"]["name"] for each in document["features"]]


def link(document: dict, rel: str) -> str | None:
    return next((each["href"] for each in document["links"] if each["rel"] == rel), None)


def follow(service: Service, href: str) -> dict:
    answer = service.client.get(href)
    assert answer.status_code == 200, answer.text
    return answer.json()


def through(service: Service, path: str, **parameters: object) -> tuple[list[str], dict]:
    """The names on all pages from this one on, and the last page."""
    page = service.get(path, **parameters) if parameters else follow(service, path)
    found = [names(page)]
    while (further := link(page, "next")) is not None:
        page = follow(service, further)
        found.append(names(page))
    return [name for each in found for name in each], page


def test_where_clients_begin(service: Service):
    service.make_map()
    landing = service.get("/")
    for each in landing["links"]:
        Draft202012Validator(LINK).validate(each)
        answer = service.raw.get(each["href"])
        assert answer.status_code == 200, each
        assert answer.headers["content-type"].split("; charset")[0] == each["type"], each
    relations = {each["rel"] for each in landing["links"]}
    assert {"self", "service-desc", "service-doc", "conformance", "data"} <= relations
    assert (
        service.raw.get("/", headers={"Accept": "text/html,*/*"})
        .headers["content-type"]
        .startswith("text/html")
    )

    assert (
        "http://www.opengis.net/spec/ogcapi-features-1/1.0/conf/core"
        in service.get("/conformance")["conformsTo"]
    )
    listed = service.get("/collections")
    ids = [each["id"] for each in listed["collections"]]
    assert ids == ["office.Door", "office.Room", "office.events", "office.relations", "office.tracks"]
    for each in listed["collections"]:
        assert each == {**service.get(f"/collections/{each['id']}")}
        for one in each["links"]:
            answer = service.client.get(one["href"])
            assert (answer.status_code, answer.headers["content-type"]) == (200, one["type"])
    pages, at = [], "/collections?limit=2"
    while at is not None:
        page = follow(service, at)
        pages += [each["id"] for each in page["collections"]]
        at = link(page, "next")
    assert pages == ids


def test_the_interface_is_described_in_openapi_30(service: Service):
    described = service.get("/api")
    assert described["openapi"] == "3.0.3"

    def look(part: object, where: str, in_names: bool = False) -> None:
        if isinstance(part, list):
            for n, each in enumerate(part):
                look(each, f"{where}[{n}]")
        if isinstance(part, dict):
            for name, each in part.items():
                if not in_names:
                    assert name not in ("const", "prefixItems", "$schema"), where
                    assert name != "type" or not isinstance(each, list), where
                    assert name != "examples" or not isinstance(each, list), where
                    assert name not in ("exclusiveMinimum", "exclusiveMaximum") or isinstance(each, bool), (
                        where
                    )
                if name not in ("example", "default", "enum"):
                    look(
                        each,
                        f"{where}.{name}",
                        name in ("properties", "schemas", "paths", "responses", "content"),
                    )
            if not in_names:
                assert part.get("type") != "null", where

    look(described, "")
    items = described["paths"]["/collections/{collectionId}/items"]["get"]
    limit = next(each for each in items["parameters"] if each["name"] == "limit")
    assert (
        limit["schema"]
        == {"type": "integer", "maximum": 10_000, "minimum": 1, "default": 100} | limit["schema"]
    )


def test_boxes_and_filters_find_what_lies_there(service: Service):
    known = furnish(service)
    chance = random.Random(3)
    to_map = pyproj.Transformer.from_crs(
        "OGC:CRS84", "+proj=aeqd +lat_0=0 +lon_0=0 +datum=WGS84 +units=m", always_xy=True
    )
    for _ in range(12):
        x_m, y_m = chance.uniform(-50, 40), chance.uniform(-50, 40)
        box = shapely.box(x_m, y_m, x_m + chance.uniform(0.1, 40), y_m + chance.uniform(0.1, 40))
        expected = {name for name, each in known.items() if each["area"].intersects(box)}
        metric = ",".join(map(str, box.bounds))
        on_map = service.get(ROOMS, bbox=metric, **{"bbox-crs": MAP_FRAME, "limit": 1000})
        assert set(names(on_map)) == expected
        assert on_map["numberMatched"] == on_map["numberReturned"] == len(expected)
        west, south = to_map.transform(*box.bounds[:2], direction="INVERSE")
        east, north = to_map.transform(*box.bounds[2:], direction="INVERSE")
        assert set(names(service.get(ROOMS, bbox=f"{west},{south},{east},{north}", limit=1000))) == expected
        lat_first = {"bbox": f"{south},{west},{north},{east}", "bbox-crs": EPSG.format(4326), "limit": 1000}
        assert set(names(service.get(ROOMS, **lat_first))) == expected
        asked = f"s_intersects(geometry,BBOX({west},{south},{east},{north})) and seats >= 2".replace(
            "seats", "attributes.seats"
        )
        wanted = {name for name in expected if known[name]["seats"] >= 2}
        assert set(names(service.get(ROOMS, filter=asked, limit=1000))) == wanted
        document = {"op": "s_within", "args": [{"property": "geometry"}, json.loads(shapely.to_geojson(box))]}
        inside = {name for name, each in known.items() if each["area"].within(box)}
        assert (
            set(
                names(
                    service.get(
                        ROOMS, filter=json.dumps(document), **{"filter-crs": MAP_FRAME, "limit": 1000}
                    )
                )
            )
            == inside
        )
        apart = f"s_disjoint(geometry,BBOX({west},{south},{east},{north}))"
        assert set(names(service.get(ROOMS, filter=apart, limit=1000))) == set(known) - expected
    everywhere = set(known)
    for box in ("-180,-90,180,90", "-1,-1,1,1", "179,-90,1,90", "-180,-90,-5000,180,90,5000"):
        assert set(names(service.get(ROOMS, bbox=box, limit=1000))) == everywhere, box
    assert names(service.get(ROOMS, bbox="170,-10,-170,10", limit=1000)) == []
    assert names(service.get(ROOMS, bbox="20,20,30,30", limit=1000)) == []
    assert (
        set(names(service.get(ROOMS, filter="s_disjoint(geometry,BBOX(20,20,30,30))", limit=1000)))
        == everywhere
    )
    assert (
        set(names(service.get(ROOMS, filter="s_within(geometry,BBOX(-170,-80,170,80))", limit=1000)))
        == everywhere
    )
    inner = known["room 02"]["area"].centroid
    for corner in ((inner.x, inner.y), (inner.x + 30, inner.y)):
        flat = shapely.box(inner.x, inner.y, *corner).bounds
        met = shapely.LineString([(inner.x, inner.y), corner]) if corner[0] > inner.x else inner
        expected = {name for name, each in known.items() if each["area"].intersects(met)}
        found = service.get(ROOMS, bbox=",".join(map(str, flat)), **{"bbox-crs": MAP_FRAME, "limit": 1000})
        assert set(names(found)) == expected
    assert service.get(ROOMS, bbox="0,0,0,0")["numberMatched"] >= 0
    low = {name for name, each in known.items() if each["z_min_m"] is None or each["z_min_m"] <= 1}
    assert set(names(service.get(ROOMS, bbox="-1,-1,0.5,1,1,1", limit=1000))) == low
    feature = service.get(f"{ROOMS}/{known['room 01']['id']}", crs=MAP_FRAME)
    assert (
        shape(feature["geometry"]).equals_exact(known["room 01"]["area"], 1e-6)
        or shape(feature["geometry"]).symmetric_difference(known["room 01"]["area"]).area < 1e-4
    )
    assert {point[2] for point in feature["geometry"]["coordinates"][0]} == {3.0}


def test_what_has_no_shape_is_where_its_frame_is(service: Service):
    """As doors are that were drawn as lines; also when what they stand on is moved."""
    service.make_map()
    hall = service.make_room("hall", shapely.box(0, 0, 4, 3))
    things = {"concept": "Door", "pose": {"x_m": 3, "y_m": 1, "z_m": 0.5}}
    for name, more in (("door", {}), ("hatch", {"frame": "hall"})):
        service.post_instance({**things, "name": name, **more}).raise_for_status()
    service.client.patch(f"/instances/{hall['id']}", json={"pose": {"x_m": 10}}).raise_for_status()
    doors = {"door": [3, 1, 0.5], "hatch": [13, 1, 0.5]}
    found = service.get("/collections/office.Door/items", crs=MAP_FRAME)["features"]
    assert {each["properties"]["name"]: each["geometry"]["coordinates"] for each in found} == doors
    for box, inside in (("2,0,4,2", ["door"]), ("12,0,14,2", ["hatch"]), ("5,5,6,6", [])):
        asked: dict[str, Any] = {"bbox": box, "bbox-crs": MAP_FRAME}
        assert names(service.get("/collections/office.Door/items", **asked)) == inside
    point = {"filter": "s_intersects(geometry,POINT(3 1))", "filter-crs": MAP_FRAME}
    assert names(service.get("/collections/office.Door/items", **point)) == ["door"]


def test_pages_are_the_whole_in_order(service: Service):
    known = furnish(service, 17)
    for sortby in (None, "name", "-alias", "alias,-name", "-z_min_m,alias", "+concept,-id"):
        check_pages(service, known, sortby)


def check_pages(service: Service, known: dict[str, dict[str, Any]], sortby: str | None) -> None:
    def key(each: dict) -> tuple:
        parts: list = []
        for one in (sortby or "").split(",") if sortby else []:
            value = {"concept": "Room"}.get(one.lstrip("+-"), each.get(one.lstrip("+-")))
            turned = None if value is None else (value if not one.startswith("-") else Falling(value))
            parts.append((value is None, turned if turned is not None else 0))
        return (*parts, each["id"])

    expected = [each["name"] for each in sorted(known.values(), key=key)]
    asked = {"limit": 5} | ({"sortby": sortby} if sortby else {})
    found, last = through(service, ROOMS, **asked)
    assert found == expected
    assert last["numberMatched"] == 17
    back, first = [names(last)], last
    while (before := link(first, "prev")) is not None:
        first = follow(service, before)
        back.insert(0, names(first))
    assert [name for each in back for name in each] == expected
    by_offset, _ = through(service, ROOMS, offset=0, **asked)
    assert by_offset == expected
    assert names(service.get(ROOMS, offset=3, **asked)) == expected[3:8]


class Falling(str):
    """A value that sorts the other way round."""

    def __new__(cls, value: object) -> Falling:
        made = super().__new__(cls, value)
        made.value = value
        return made

    def __lt__(self, other: Any) -> bool:
        return self.value > other.value


def test_a_cursor_leaves_nothing_out_and_repeats_nothing_while_features_come_and_go(service: Service):
    known = furnish(service, 8)
    page = service.get(ROOMS, limit=3, sortby="name")
    first = names(page)
    for name in first[:2]:
        assert service.client.delete(f"/instances/{known[name]['id']}").status_code == 204
    service.make_room("room 00b", shapely.box(0, 0, 1, 1))
    found, _ = through(service, link(page, "next"))
    assert first + found == sorted(known)

    pages, at = [], f"{ROOMS}?limit=4"
    while at is not None:
        pages.append(follow(service, at))
        at = link(pages[-1], "next")
    assert [each["numberReturned"] for each in pages] == [4, 3]
    assert {each["numberMatched"] for each in pages} == {7}
    ids = [each["id"] for page in pages for each in page["features"]]
    assert all(a < b for a, b in pairwise(ids))


def test_a_map_with_an_anchor_lies_where_it_says(service: Service):
    service.make_map()
    corner = shapely.box(1, 2, 5, 9)
    room = service.make_room("west", corner, elevation_m=1.5, height_m=2)
    anchor = {
        "epsg": 25832,
        "pose": {"x_m": 447000.0, "y_m": 5409000.0, "z_m": 300.0, "qz": 0.5, "qw": 0.75**0.5},
    }
    assert service.raw.put("/maps/office/anchor", json=anchor).status_code in (200, 204)
    on_earth = affinity.translate(affinity.rotate(corner, 60, origin=(0, 0)), 447000, 5409000)
    crs = service.get("/collections/office.Room")["crs"]
    assert EPSG.format(25832) in crs
    for code, north_first in ((25832, False), (3857, False), (4326, True)):
        found = service.get(f"{ROOMS}/{room['id']}", crs=EPSG.format(code))
        to = pyproj.Transformer.from_crs(25832, code)
        expected = shapely.transform(
            on_earth, lambda points, to=to: list(zip(*to.transform(*points.T), strict=True))
        )
        tolerance = 2e-9 if north_first else 2e-3 if code == 3857 else 2e-6
        assert shape(found["geometry"]).normalize().equals_exact(expected.normalize(), tolerance)
        heights = {round(point[2], 6) for point in found["geometry"]["coordinates"][0]}
        assert heights == {301.5}
    degrees = shape(service.get(f"{ROOMS}/{room['id']}")["geometry"])
    west, south, east, north = degrees.bounds
    assert shapely.box(*service.get("/collections/office.Room")["extent"]["spatial"]["bbox"][0]).equals_exact(
        shapely.box(west, south, east, north), 1e-9
    )
    assert names(service.get(ROOMS, bbox=f"{west},{south},{east},{north}")) == ["west"]
    assert names(service.get(ROOMS, bbox=f"{east + 1e-6},{south},{east + 1},{north}")) == []
    assert names(service.get(ROOMS, bbox="446990,5408990,447020,5409020", **{"bbox-crs": "EPSG:25832"})) == [
        "west"
    ]
    answer = service.raw.get(ROOMS, params={"crs": "urn:ogc:def:crs:EPSG::25832"})
    assert answer.headers["content-crs"] == f"<{EPSG.format(25832)}>"


def test_times_properties_and_what_moves(service: Service):
    furnish(service, 3)
    service.make_room("stage", shapely.box(100, 100, 104, 104))
    track = service.walk([(101, 101), (102, 102)])
    service.happen(1, 3)
    service.plain.execute(
        "update semap.event set stamp = stamp + (seq || ' minutes')::interval, since = since + (seq || ' minutes')::interval"
    )
    events = "/collections/office.events/items"
    for asked, expected in (
        ("2026-01-31T12:01:00Z/2026-01-31T12:02:00Z", [1, 2]),
        ("2026-01-31T12:01:00Z", [1]),
        ("../2026-01-31T12:02:00Z", [1, 2]),
        ("2026-01-31T13:02:00.000001+01:00/..", [3]),
        ("/2026-01-31T12:00:59Z", []),
        ("2026-01-31T12:01:30Z", []),
    ):
        assert [each["id"] for each in service.get(events, datetime=asked)["features"]] == expected, asked
    interval = service.get("/collections/office.events")["extent"]["temporal"]["interval"]
    assert interval == [["2026-01-31T12:01:00.000000Z", "2026-01-31T12:03:00.000000Z"]]
    (there,) = service.get("/collections/office.relations/items", filter="instance = 'stage'", crs=MAP_FRAME)[
        "features"
    ]
    assert there["geometry"] == {"type": "Point", "coordinates": [102, 102]}
    assert there["properties"]["track"] == "person"
    assert service.get("/collections/office.relations/items", datetime="2026-01-31T12:00:00Z")[
        "features"
    ] == [
        {**there, "geometry": service.get(f"/collections/office.relations/items/{there['id']}")["geometry"]}
    ]
    assert (
        service.get("/collections/office.relations/items", datetime="2026-01-31T11:59:59Z")["features"] == []
    )
    service.plain.execute("update semap.event set track_id = %s, stamp = %s where seq = 1", [track, START])
    found = service.get(f"{events}/1", crs=MAP_FRAME)
    assert found["geometry"] == {"type": "Point", "coordinates": [101, 101]}
    few = service.get(ROOMS, properties="name,attributes", limit=1)["features"][0]["properties"]
    assert set(few) == {"name", "attributes"}
    queryables = service.get("/collections/office.Room/queryables")
    assert queryables["properties"]["geometry"]["x-ogc-role"] == "primary-geometry"
    assert set(service.get("/collections/office.Room/sortables")["properties"]) < set(
        queryables["properties"]
    )


def test_an_answer_that_is_known_is_not_sent_again_and_gzip_has_a_tag_of_its_own(service: Service):
    known = furnish(service, 6)
    plain = service.raw.get(ROOMS, headers={"Accept-Encoding": "identity"})
    packed = service.raw.get(ROOMS, headers={"Accept-Encoding": "gzip"})
    assert packed.headers["content-encoding"] == "gzip"
    assert packed.json() == plain.json()
    assert "content-encoding" not in plain.headers
    assert "Accept-Encoding" in plain.headers["vary"]
    assert "Accept-Encoding" in packed.headers["vary"]
    assert packed.headers["etag"] != plain.headers["etag"]
    for answer in (plain, packed):
        for accepted in ("gzip", "identity"):
            headers = {"If-None-Match": answer.headers["etag"], "Accept-Encoding": accepted}
            again = service.raw.get(ROOMS, headers=headers)
            assert (again.status_code, again.content) == (304, b"")
            assert again.headers["etag"] == answer.headers["etag"]
    room = f"/instances/{known['room 01']['id']}"
    etag = service.raw.get(room, headers={"Accept-Encoding": "gzip"}).headers["etag"]
    changed = service.raw.patch(room, json={"alias": "new"}, headers={"If-Match": etag})
    assert changed.status_code == 200
    assert service.raw.patch(room, json={"alias": "other"}, headers={"If-Match": etag}).status_code == 412
    assert service.raw.get(ROOMS, headers={"If-None-Match": plain.headers["etag"]}).status_code == 200
    raw = service.raw.build_request("GET", ROOMS, headers={"Accept-Encoding": "gzip"})
    sent = service.raw.send(raw, stream=True)
    assert json.loads(gzip.decompress(b"".join(sent.iter_raw()))) == service.get(ROOMS)
    assert 'rel="self"' in plain.headers["link"]


WRONG = (
    {"bbox": "1,2,3"},
    {"bbox": "a,b,c,d"},
    {"bbox": "0,10,1,5"},
    {"bbox": "nan,0,1,1"},
    {"bbox": "0,0,5,1,1,1"},
    {"bbox": "0,0,1,1", "bbox-crs": "http://www.opengis.net/def/crs/EPSG/0/99999"},
    {"datetime": "yesterday"},
    {"datetime": "2026-01-31T12:00:00"},
    {"datetime": "../.."},
    {"datetime": "2026-01-31T12:00:00Z/2025-01-31T12:00:00Z"},
    {"filter": "nope = 1"},
    {"filter": "name ="},
    {"filter": "{", "filter-lang": "cql2-json"},
    {"filter": '"x"', "filter-lang": "cql2-json"},
    {"filter": "name = 'x'", "filter-lang": "sql"},
    {"filter": "[" * 5000},
    {"sortby": "attributes"},
    {"sortby": "nope"},
    {"sortby": ""},
    {"properties": "nope"},
    {"crs": "http://www.opengis.net/def/crs/EPSG/0/25832"},
    {"cursor": "xyz"},
    {
        "cursor": base64.urlsafe_b64encode(rb'{"o":"name","v":["\ud800","1"],"b":false}').decode(),
        "sortby": "name",
    },
    {"cursor": "eyJvIjoiIiwidiI6WyJhIl0sImIiOmZhbHNlfQ"},
    {"cursor": "eyJvIjoiIiwidiI6WyIxIiwiMiJdLCJiIjpmYWxzZX0"},
    {"cursor": "eyJvIjoiIiwidiI6W10sImIiOmZhbHNlfQ", "offset": "1"},
    {"limit": "0"},
    {"limit": "-1"},
    {"offset": "-1"},
    {"unknown": "1"},
    {"f": "html"},
)


def test_what_cannot_be_understood_is_400_with_a_remedy(service: Service):
    service.make_map()
    for parameters in WRONG:
        answer = service.client.get(ROOMS, params=parameters)
        assert answer.status_code == 400, (parameters, answer.text)
        assert answer.json()["remedy"]
    for path in (
        "/collections/office.Nope",
        "/collections/nope.Room/items",
        "/collections/office",
        f"{ROOMS}/x",
        f"{ROOMS}/99999999999999999999",
    ):
        assert service.client.get(path).status_code == 404, path


def test_head_is_get_without_its_content(service: Service):
    furnish(service)
    tagged = service.raw.get(ROOMS)
    for path in (
        "/",
        "/collections",
        ROOMS,
        "/maps",
        "/events",
        "/openapi.json",
        "/docs",
        "/collections/no.Room",
    ):
        headed, whole = service.raw.head(path), service.raw.get(path)
        assert (headed.status_code, headed.content) == (whole.status_code, b""), path
        for name in ("content-type", "content-length", "content-encoding", "etag", "content-crs", "link"):
            if path != "/collections/no.Room" or name != "content-length":
                assert headed.headers.get(name) == whole.headers.get(name), (path, name)
    assert service.raw.head(ROOMS, headers={"If-None-Match": tagged.headers["etag"]}).status_code == 304
    assert service.raw.head("/events/stream").status_code == 405
    assert service.raw.get("/health").status_code == 200


def test_a_limit_beyond_the_largest_is_the_largest(service: Service):
    """OGC 17-069r4, /req/core/fc-limit-response-1."""
    service.make_map()
    track = service.walk([(0.0, 0.0), (1.0, 0.0)])
    for path in (ROOMS, "/collections", f"/collections/office.tracks/items/{track}/tgsequence"):
        for limit in (10_001, 10**30):
            assert service.client.get(path, params={"limit": limit}).status_code == 200, path


def test_names_with_dots_and_other_signs(service: Service):
    for name in ("a", "a.b", "ü & ?#%", "a.tracks"):
        service.make_map(name)
    listed = service.get("/collections")["collections"]
    assert len(listed) == 20
    for each in listed:
        self = link(each, "self")
        assert service.raw.get(self).json()["id"] == each["id"]
        assert service.raw.get(link(each, "items")).status_code == 200
    # of a concept of that name there is no collection: /office.tracks is what is followed
    service.raw.post("/concepts", json={"name": "tracks", "parents": ["Room"]})
    service.make_map()
    service.make_room("lab", shapely.box(0, 0, 1, 1))
    service.plain.execute("update semap.instance set concept_id = semap.concept_named('tracks')")
    ids = [each["id"] for each in service.get("/collections")["collections"]]
    assert len(ids) == len(set(ids)) == 27


@pytest.mark.skipif(shutil.which("ogrinfo") is None, reason="there is no ogrinfo: apt-get install gdal-bin")
def test_gdal_reads_every_collection(service: Service, tmp_path):
    known = furnish(service, 23)
    service.walk([(1, 1), (2, 2)])
    service.happen(1, 4)

    def ogrinfo(*arguments: str) -> str:
        command = ["ogrinfo", "-ro", *arguments]
        return subprocess.run(command, check=True, capture_output=True, text=True, timeout=60).stdout

    everything = ogrinfo("-al", f"OAPIF:{service.url}", "-oo", "PAGE_SIZE=10")
    layers = {part.split("\n", 1)[0].strip(): part for part in everything.split("Layer name: ")[1:]}
    counts = {"Room": 23, "Door": 0, "Thing": 23, "tracks": 1, "relations": 0, "events": 4}
    for name, count in counts.items():
        assert f"Feature Count: {count}\n" in layers[f"office.{name}"], name
        assert layers[f"office.{name}"].count("OGRFeature(") == count
    extent = service.get("/collections/office.Room")["extent"]["spatial"]["bbox"][0]
    (line,) = [each for each in layers["office.Room"].splitlines() if each.startswith("Extent:")]
    read = [
        float(each)
        for each in line.removeprefix("Extent:")
        .replace("(", " ")
        .replace(")", " ")
        .replace(",", " ")
        .replace("-  ", " ")
        .split()
        if each != "-"
    ]
    assert read == pytest.approx(extent, abs=2e-6)
    room = known["room 04"]
    one = ogrinfo("-al", f"OAPIF:{service.url}", "office.Room", "-where", "name = 'room 04'")
    assert "Feature Count: 1\n" in one
    assert f"id (Integer) = {room['id']}" in one
    west, south, *_ = extent
    half = ogrinfo("-al", f"OAPIF:{service.url}", "office.Room", "-spat", str(west), str(south), "0", "0")
    assert half.count("OGRFeature(") == service.get(ROOMS, bbox=f"{west},{south},0,0")["numberMatched"] > 0
