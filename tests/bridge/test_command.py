"""`semap bridge`: one command, a process for each bridge; what is wrong is said with its remedy."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from bridging import config, line, stored
from semap_bridge import kinds
from semap_bridge.adapter import Adapter
from semap_bridge.config import read_config
from world import SECOND_US, World

from semap.errors import InvalidInput
from semap.store.motion.bridges import LOCK

FIRST_US = 1_700_000_000 * SECOND_US
TWO = """  - name: one
    kind: ndjson
    read: one.ndjson
  - name: other
    kind: ndjson
    read: other.ndjson
"""


def semap(world: World, *arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "semap_service", "bridge", *map(str, arguments)],
        env={**os.environ, "SEMAP_DSN": world.dsn}, capture_output=True, text=True, check=False,
    )  # fmt: skip


def test_a_process_runs_each_bridge_until_all_is_read(world: World, tmp_path: Path) -> None:
    for number, name in enumerate(("one", "other")):
        (tmp_path / f"{name}.ndjson").write_bytes(line(name, FIRST_US, float(number)))
    path = config(tmp_path, TWO)
    seen = semap(world, "check", path, "--seconds", "0.5", "--json")
    assert seen.returncode == 0, seen.stderr
    assert [each["what"] for each in json.loads(seen.stdout)] == [
        "one.ndjson",
        "states",
        "other.ndjson",
        "states",
    ]
    assert stored(world) == []
    ran = semap(world, path)
    assert ran.returncode == 0, ran.stderr
    assert [each[0] for each in stored(world)] == ["one", "other"]
    told = json.loads(semap(world, "list", "--json").stdout)
    assert [(each["bridge"], each["state"], each["committed"]) for each in told] == [
        ("one", "ended", 1), ("other", "ended", 1)
    ]  # fmt: skip


def test_a_bridge_that_is_forgotten_begins_anew(world: World, tmp_path: Path) -> None:
    for name in ("one", "other"):
        (tmp_path / f"{name}.ndjson").write_bytes(line(name, FIRST_US, 1.0))
    path = config(tmp_path, TWO)
    assert semap(world, path).returncode == 0
    held = LOCK, f"{world.map_id}/one"
    world.run("select pg_advisory_lock(%s, hashtext(%s))", *held)
    assert "The bridge one runs." in semap(world, "forget", "one", "--map", "world").stderr
    world.run("select pg_advisory_unlock(%s, hashtext(%s))", *held)
    assert semap(world, "forget", "one", "--map", "world").returncode == 0
    assert world.rows("select distinct name from semap.bridge_position") == [("other",)]
    assert [each["bridge"] for each in json.loads(semap(world, "list", "--json").stdout)] == ["other"]
    assert "There is no bridge one." in semap(world, "forget", "one", "--map", "world").stderr
    assert semap(world, path).returncode == 0
    assert len(stored(world)) == 2


def test_a_check_fails_where_something_is_wrong(world: World, tmp_path: Path) -> None:
    (tmp_path / "one.ndjson").write_bytes(b"nonsense\n" + line("t", FIRST_US, 1.0))
    seen = semap(world, "check", config(tmp_path, TWO), "--seconds", "0.2", "--json")
    assert seen.returncode == 1, seen.stderr
    said = [(each["bridge"], each["trouble"]) for each in json.loads(seen.stdout) if each["trouble"]]
    assert ("one", "1 records: not JSON.") in said
    assert any(name == "other" and "no file" in trouble for name, trouble in said)
    assert world.one("select count(*) from semap.source where name in ('one', 'other')") == 0


def test_a_kind_and_a_map_are_a_config(world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    seen = semap(world, "check", "bacnet", "--map", "world", "--seconds", "0.1")
    assert "device: Field required" in seen.stderr, seen.stdout
    assert "semap bridge ndjson --map MAP" in semap(world, "ndjson").stderr
    (tmp_path / "ndjson").write_bytes(config(tmp_path, TWO).read_bytes())
    assert [each.settings.name for each in read_config(Path("ndjson")).bridges] == ["one", "other"]
    assert "Omit --map" in semap(world, "bridges.yaml", "--map", "world").stderr
    told = semap(world, "check", "foxglove", "--map", "world", "--seconds", "0.1", "--json")
    assert told.returncode == 0, told.stderr
    assert {each["bridge"] for each in json.loads(told.stdout)} == {"foxglove"}


def test_a_package_that_is_missing_is_named_with_its_extra(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    package = tmp_path / "semap_bridge_missing.py"
    package.write_text("import no_such_package\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(kinds, "FOLDER", "")
    known = {**kinds.KINDS, "house": kinds.Kind("semap_bridge_missing:House", "mqtt", "a house")}
    monkeypatch.setattr(kinds, "KINDS", known)
    with pytest.raises(
        InvalidInput, match=r"bridges.yaml:4: the kind house needs .* no_such_package"
    ) as missing:
        kinds.adapter_of("house", "bridges.yaml:4")
    assert missing.value.remedy == "pip install 'semap[mqtt]'"


@pytest.mark.parametrize("kind", sorted(kinds.KINDS))
def test_each_kind_is_an_adapter_whose_settings_say_what_they_are(kind: str) -> None:
    try:
        adapter = kinds.adapter_of(kind, "here")
    except InvalidInput as error:
        pytest.skip(f"{error} {error.remedy}")
    assert issubclass(adapter, Adapter)
    assert all(field.description for field in adapter.Settings.model_fields.values())
