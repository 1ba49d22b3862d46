"""OGC API Moving Features: the ways of tracks, against the states that they were made of."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta
from itertools import pairwise

import pytest
from running import START, Service

MAP_FRAME = "urn:semap:crs:map-frame"
PLACES = [(0.0, 0.0), (3.0, 4.0), (3.0, 4.0), (6.0, 8.0), (6.0, 10.0)]


def at(seconds: float) -> str:
    return (START + timedelta(seconds=seconds)).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def way(service: Service, here: str, **asked: object) -> list[tuple[list[float], list[list[float]]]]:
    """Times [s since START] and places [m] of each piece."""
    found = service.get(f"{here}/tgsequence", **{"crs": MAP_FRAME, **asked})
    assert found["type"] == "TemporalGeometrySequence"
    return [(seconds(piece["datetimes"]), piece["coordinates"]) for piece in found["geometrySequence"]]


def seconds(stamps: list[str]) -> list[float]:
    return [(datetime.fromisoformat(each).astimezone(UTC) - START).total_seconds() for each in stamps]


def test_the_way_of_a_track(service: Service):
    service.make_map()
    track = service.walk(PLACES)
    here = f"/collections/office.tracks/items/{track}"
    everything = [([0, 1, 2, 3, 4], [list(each) for each in PLACES])]

    feature = service.get(here)
    assert feature["time"] == [at(0), at(4)]
    assert feature["trs"]["properties"]["name"] == "urn:ogc:data:time:iso8601"
    (tgsequence,) = [each["href"] for each in feature["links"] if each["rel"] == "tgsequence"]
    assert service.client.get(tgsequence).status_code == 200

    assert way(service, here) == everything
    degrees = service.get(f"{here}/tgsequence")["geometrySequence"][0]["coordinates"]
    assert degrees[3] == pytest.approx([6 / 111319.490793, 8 / 110574.275822], abs=1e-9)

    # an interval gives the states in it and those on either side, between which the track was on its way
    assert way(service, here, datetime=f"{at(0.5)}/{at(2)}") == [([0, 1, 2], [[0, 0], [3, 4], [3, 4]])]
    assert way(service, here, datetime=f"{at(3.5)}/..") == [([3, 4], [[6, 8], [6, 10]])]
    assert way(service, here, datetime=f"{at(60)}/..") == [([4], [[6, 10]])]
    cut = way(service, here, datetime=f"{at(0.5)}/{at(3.25)}", subTrajectory=True)
    assert cut == [([0.5, 1, 2, 3, 3.25], [[1.5, 2], [3, 4], [3, 4], [6, 8], [6, 8.5]])]
    assert way(service, here, leaf=f"{at(-1)},{at(0.5)},{at(3)},{at(9)}") == [([0.5, 3], [[1.5, 2], [6, 8]])]
    assert way(service, here, leaf=at(77)) == []
    assert way(service, here, leaf=at(1), datetime=f"{at(2)}/{at(3)}") == []

    (piece,) = service.get(f"{here}/tgsequence")["geometrySequence"]
    one = f"{here}/tgsequence/{piece['id']}"
    assert service.get(one) == piece
    lengths = [math.dist(a, b) for a, b in pairwise(PLACES)]
    (distance,) = service.get(f"{one}/distance")["valueSequence"]
    assert distance["values"] == [0, 5, 5, 10, 12]
    (velocity,) = service.get(f"{one}/velocity")["valueSequence"]
    assert velocity["values"] == [*lengths, lengths[-1]]
    assert velocity["interpolation"] == "Step"
    (acceleration,) = service.get(f"{one}/acceleration")["valueSequence"]
    assert acceleration["values"] == [-5, 5, -3, 0, 0]

    for asked in (
        {"leaf": at(1), "subTrajectory": True, "datetime": f"{at(0)}/{at(1)}"},
        {"subTrajectory": True},
        {"subTrajectory": True, "datetime": f"{at(0)}/.."},
        {"leaf": f"{at(2)},{at(1)}"},
        {"leaf": "now"},
        {"limit": 0},
        {"after": "x"},
        {"bbox": "0,0,1,1"},
    ):
        assert service.client.get(f"{here}/tgsequence", params=asked).status_code == 400, asked
    for path in (
        f"{here}/tgsequence/1",
        "/collections/office.tracks/items/999/tgsequence",
        "/collections/office.Room/items/1/tgsequence",
    ):
        assert service.client.get(path).status_code == 404, path


def test_a_way_in_pieces_and_its_properties(service: Service):
    service.make_map()
    track = service.walk([])
    here = f"/collections/office.tracks/items/{track}"
    assert way(service, here) == []
    last = (700, 2400)
    service.plain.execute(
        "insert into semap.track_state (track_id, stamp, x_m, y_m, z_m, is_last, speed_mps)"
        " select %s, %s::timestamptz + n * interval '1 s', n, 0, 2, n = any (%s), case when n %% 2 = 0 then n end"
        " from generate_series(0, 2400) n",
        [track, START, list(last)],
    )
    found = way(service, here)
    assert [(times[0], times[-1], len(times)) for times, _ in found] == [
        (0, 700, 701),
        (701, 1700, 1000),
        (1700, 2400, 701),
    ]
    assert found[0][1][7] == [7, 0, 2]

    pieces, href = [], f"{service.url}{here}/tgsequence?limit=1&crs={MAP_FRAME}"
    while href is not None:
        page = service.client.get(href).json()
        pieces += [(seconds(each["datetimes"]), each["coordinates"]) for each in page["geometrySequence"]]
        href = next((each["href"] for each in page["links"] if each["rel"] == "next"), None)
    assert pieces == found
    assert way(service, here, leaf=f"{at(700)},{at(700.5)},{at(701)}") == [
        ([700, 701], [[700, 0, 2], [701, 0, 2]])
    ]

    listed = service.get(f"{here}/tproperties")
    assert "speed_mps" in [each["name"] for each in listed["temporalProperties"]]
    speed = service.get(f"{here}/tproperties/speed_mps", datetime=f"{at(10)}/{at(14)}")
    (known,) = speed["valueSequence"]
    assert (seconds(known["datetimes"]), known["values"]) == ([10, 12, 14], [10, 12, 14])
    assert speed["form"] == "MTS"
    assert service.get(f"{here}/tproperties/width_m")["valueSequence"] == []
    assert service.client.get(f"{here}/tproperties/nope").status_code == 400
