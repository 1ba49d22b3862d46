"""A token for one map sees the collections, the past and the ways of that map, and of no other."""

from __future__ import annotations

PATHS = (
    "/collections/{map}.Room/items?filter=s_intersects(geometry,POINT(0 0))",
    "/collections/{map}.Room/items?bbox=-1,-1,1,1&sortby=-name",
    "/collections/{map}.tracks/items",
    "/collections/{map}.relations/items",
    "/collections/{map}.events/items?datetime=1970-01-01T00:00:01Z/..",
    "/collections/{map}.tracks",
    "/maps/{map}/moment?at=1970-01-01T00:00:03Z",
    "/maps/{map}/timeline?from=1970-01-01T00:00:00Z&to=1970-01-01T00:00:09Z",
    "/maps/{map}/extent",
)


def test_the_features_of_one_map(building):
    with building.service.client("annex") as client, building.service.client("admin") as admin:
        for path in PATHS:
            answer = client.get(path.format(map="annex"))
            assert answer.status_code == 200, answer.text
            assert answer.json() == admin.get(path.format(map="annex")).json(), path
            assert admin.get(path.format(map="office")).status_code == 200, path
            assert client.get(path.format(map="office")).status_code == 404, path
        assert len(client.get("/maps/annex/moment?at=1970-01-01T00:00:03Z").json()["tracks"]) == 1
        maps = {each["id"].partition(".")[0] for each in client.get("/collections").json()["collections"]}
        assert maps == {"annex"}
        everywhere = admin.get("/collections").json()["collections"]
        assert {each["id"].partition(".")[0] for each in everywhere} == {"annex", "office"}


def test_the_way_of_a_track_of_one_map(building):
    track, room = building.ids["track"], building.ids["instance"]
    with building.service.client("annex") as client, building.service.client("admin") as admin:
        own = client.get("/collections/annex.tracks/items").json()["features"][0]["id"]
        for path in (
            f"/tracks/{own}/history",
            f"/collections/annex.tracks/items/{own}/tgsequence",
            f"/collections/annex.tracks/items/{own}/tgsequence?leaf=1970-01-01T00:00:03.5Z",
        ):
            assert client.get(path).json() == admin.get(path).json()
            assert "[3.5" in client.get(f"{path}&crs=urn:semap:crs:map-frame").text or "leaf" not in path
        assert len(client.get(f"/tracks/{own}/history").json()["states"]) == 6
        for path in (
            f"/tracks/{track}/history",
            f"/collections/office.tracks/items/{track}/tgsequence",
            f"/collections/annex.tracks/items/{track}/tgsequence",
            f"/instances/{room}/where",
            f"/instances/{room}/relations",
            f"/route?from={room}&to={room}",
        ):
            assert client.get(path).status_code == 404, path
        here = client.get("/rooms?map=annex").json()["rooms"][0]["id"]
        assert client.get(f"/route?from={here}&to={here}").json()["length_m"] == 0


def test_where_clients_begin_needs_no_token(building):
    with building.service.client() as client:
        for path, status in (("/", 200), ("/conformance", 200), ("/api", 200), ("/collections", 401)):
            assert client.get(path).status_code == status, path
