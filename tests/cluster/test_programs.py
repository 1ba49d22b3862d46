from pathlib import Path

import pytest

from semap.cluster.programs import ServerPrograms, find_programs
from semap.errors import ServerMissing


def installation(prefix: Path, version: str, *, postgis: bool = True) -> Path:
    """Programs that say their version and do nothing."""
    folder = prefix / "bin"
    folder.mkdir(parents=True)
    for program in ("postgres", "initdb", "pg_ctl"):
        (folder / program).write_text(f"#!/bin/sh\necho '{program} (PostgreSQL) {version}'\n")
        (folder / program).chmod(0o755)
    if postgis:
        extensions = prefix / "share" / "extension"
        extensions.mkdir(parents=True)
        (extensions / "postgis.control").touch()
    return folder


def test_the_highest_version_that_has_postgis(tmp_path: Path) -> None:
    folders = [
        installation(tmp_path / "a", "15.4 (Debian 15.4-1)"),
        installation(tmp_path / "b", "16.2"),
        installation(tmp_path / "c", "17beta1", postgis=False),
    ]
    assert find_programs(folders=folders) == ServerPrograms(folders[1], 16)


def test_existing_data_decide_the_version(tmp_path: Path) -> None:
    folders = [installation(tmp_path / "a", "15.4"), installation(tmp_path / "b", "16.2")]
    assert find_programs(15, folders) == ServerPrograms(folders[0], 15)
    with pytest.raises(
        ServerMissing, match=r"^PostgreSQL 17 with PostGIS was not found.*cannot read the data of"
    ):
        find_programs(17, folders)


def test_what_is_missing_is_said_for_each_installation(tmp_path: Path) -> None:
    old = installation(tmp_path / "old", "14.9")
    bare = installation(tmp_path / "bare", "15.1", postgis=False)
    with pytest.raises(ServerMissing) as missing:
        find_programs(folders=[old, bare, tmp_path / "nothing"])
    assert str(missing.value) == (
        "PostgreSQL 15 or newer with PostGIS was not found: "
        f"PostgreSQL 14 in {old} is older than 15; PostgreSQL 15 in {bare} has no PostGIS."
    )
    assert "apt-get install postgresql-postgis" in missing.value.remedy


def test_pg_config_knows_where_the_extensions_are(tmp_path: Path) -> None:
    folder = installation(tmp_path / "a", "15.4", postgis=False)
    (tmp_path / "elsewhere" / "extension").mkdir(parents=True)
    (tmp_path / "elsewhere" / "extension" / "postgis.control").touch()
    (folder / "pg_config").write_text(f"#!/bin/sh\necho '{tmp_path}/elsewhere'\n")
    (folder / "pg_config").chmod(0o755)
    assert find_programs(folders=[folder]).folder == folder


def test_the_named_folder_is_the_only_one_looked_at(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SEMAP_PG_BIN", str(tmp_path))
    with pytest.raises(ServerMissing, match=r"was not found\.$"):
        find_programs()
    monkeypatch.setenv("SEMAP_PG_BIN", str(installation(tmp_path / "a", "18.0")))
    assert find_programs() == ServerPrograms(tmp_path / "a" / "bin", 18)


def test_a_link_on_the_path_leads_to_the_programs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = installation(tmp_path / "a", "99.0")
    (tmp_path / "links").mkdir()
    (tmp_path / "links" / "postgres").symlink_to(folder / "postgres")
    monkeypatch.delenv("SEMAP_PG_BIN", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path / "links"), prepend=":")
    assert find_programs() == ServerPrograms(folder, 99)
