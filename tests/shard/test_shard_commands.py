"""semap shard and semap map place, and the commands of maps that find the shard by themselves."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from psycopg.conninfo import make_conninfo
from semap_service.cli import commands
from server import fresh_database
from shard.serving import FLAT
from typer.testing import CliRunner

from semap.cluster import Cluster
from semap.errors import Conflict, SemapError
from semap.store.database.connection import connect

PASSWORD = "hunter2-hunter2"


def run(dsn: str, *arguments: str) -> str:
    done = CliRunner().invoke(commands(), arguments, env={"SEMAP_DSN": dsn})
    if isinstance(done.exception, SemapError):
        raise done.exception
    assert done.exit_code == 0, done.output
    assert PASSWORD not in done.output
    return done.output


def test_shards_are_added_listed_and_drained_and_show_no_password(
    cluster: Cluster, template: str, database: str
) -> None:
    with fresh_database(cluster, template) as north:
        told = run(database, "shard", "add", "north", "--dsn", f"{north} password={PASSWORD}")
        assert "semap map place MAP --shard north" in told
        run(database, "map", "place", "wing", "--shard", "north")
        run(database, "shard", "drain", "north")
        with pytest.raises(Conflict, match="drained"):
            run(database, "map", "place", "annex", "--shard", "north")
        rows = json.loads(run(database, "shard", "list", "--json"))
        assert [(row["name"], row["maps"], row["draining"]) for row in rows] == [
            ("main", 0, False),
            ("north", 1, True),
        ]
        name = north.rpartition("dbname=")[2]
        assert rows[1]["database"].endswith(f"dbname={name}")
        assert name in run(database, "shard", "list")
        run(database, "shard", "drain", "north", "--undo")
        run(database, "map", "place", "annex", "--shard", "north")


def test_commands_find_the_shard_of_the_map_they_name(database: str, north: str, tmp_path: Path) -> None:
    file = tmp_path / "flat.geojson"
    file.write_text(json.dumps(FLAT))
    run(database, "map", "create", "house")
    run(database, "map", "place", "flat", "--shard", "north")
    run(database, "map", "import", str(file))
    listed = json.loads(run(database, "map", "list", "--json"))
    assert [(row["name"], row["shard"], row["instances"]) for row in listed] == [
        ("flat", "north", 1),
        ("house", "main", 0),
    ]
    assert "kitchen" in run(database, "map", "show", "flat")
    assert "room_visits" in run(database, "rule", "list", "--map", "flat")
    tracks = tmp_path / "stroll.csv"
    tracks.write_text("track,stamp,x,y\ncat,2026-01-31T12:00:00Z,1.0,1.5\n")
    run(database, "ingest", "tracks", str(tracks), "--map", "flat")
    with connect(north) as owner:
        assert owner.execute("select name from semap.track").fetchall() == [("cat",)]
    run(database, "map", "delete", "flat", "--yes")
    run(database, "map", "import", str(file))  # its place went with it: it is made where new maps are
    assert [row["shard"] for row in json.loads(run(database, "map", "list", "--json"))] == ["main", "main"]


def test_whoever_may_edit_maps_alone_needs_not_know_the_way_to_shards(
    database: str, north: str, tmp_path: Path
) -> None:
    """Of a database with shards, for a map that is not on them."""
    file = tmp_path / "flat.geojson"
    file.write_text(json.dumps(FLAT))
    run(database, "map", "create", "house")
    with connect(database) as owner:
        for role in ("semap_api", "semap_ingest", "semap_read"):
            owner.execute(f"grant {role} to current_user")
        owner.execute("drop role if exists editor")
        owner.execute("create role editor login in role semap_api, semap_read, semap_ingest")
    try:
        editor = make_conninfo(database, user="editor")
        assert "no maps" not in run(editor, "map", "show", "house").lower()
        assert "room_visits" in run(editor, "rule", "list", "--map", "house")
        run(editor, "map", "import", str(file), "--map", "house")
    finally:
        with connect(database) as owner:
            owner.execute("drop role editor")
