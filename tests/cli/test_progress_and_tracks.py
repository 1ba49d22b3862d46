"""What a command says of long work, of tracks that have ended, and of rows that cannot be used."""

from __future__ import annotations

import json
from pathlib import Path

import shapely
from semap_service.cli import commands
from semap_service.cli.progress import LINE_EACH_S, in_lines
from typer.testing import CliRunner
from world import World


def run(*arguments: object) -> tuple[int, str, str]:
    ran = CliRunner().invoke(commands(), [str(each) for each in arguments])
    return ran.exit_code, ran.stdout, ran.stderr


def test_progress_without_a_terminal_is_a_line_now_and_then() -> None:
    now_s = 100.0
    said: list[str] = []
    advance = in_lines("states", said.append, lambda: now_s)
    for done in range(0, 1001, 50):
        advance(done, 1000)
        now_s += LINE_EACH_S / 4
    assert said == [f"{done} of 1000 states ({done // 10} %)" for done in (200, 400, 600, 800, 1000)]
    quick: list[str] = []
    short = in_lines("states", quick.append, lambda: now_s)
    short(1000, 1000)
    assert quick == []


WALK = "track,stamp,x,y\ncat,2026-01-31T12:00:00Z,1,1\ncat,2026-01-31T12:00:01Z,nan,1\ncat,2026-01-31T12:00:02Z,2,1\n"


def test_rows_that_cannot_be_used_are_told_and_tell_by_the_exit_status(world: World, tmp_path: Path) -> None:
    world.add_room("room", shapely.box(0, 0, 4, 4))
    (tmp_path / "walk.csv").write_text(WALK)
    ingest = ("ingest", "tracks", tmp_path / "walk.csv", "--map", "world", "--dsn", world.dsn)
    status, shown, said = run(*ingest)
    assert status == 1
    assert "2 states of 1 track written" in shown
    assert "1 row left out:" in said
    assert "walk.csv, line 3: x is nan, no finite number. Mend it, or remove the row." in said
    assert run(*ingest, "--skip-bad")[0] == 0
    assert json.loads(run(*ingest, "--skip-bad", "--json")[1])["left_out"] == 1


def test_tracks_that_have_all_ended_are_counted(world: World, tmp_path: Path) -> None:
    world.add_room("room", shapely.box(0, 0, 4, 4))
    listing = ("track", "list", "--dsn", world.dsn)
    assert run(*listing)[1] == "No tracks. Bring in movement: semap ingest --help\n"
    (tmp_path / "walk.csv").write_text(WALK)
    run("ingest", "tracks", tmp_path / "walk.csv", "--map", "world", "--dsn", world.dsn)
    assert run(*listing)[1] == "No track lives now; 1 track ended. To list them: semap track list --all\n"
    assert "cat" in run(*listing, "--all")[1]
