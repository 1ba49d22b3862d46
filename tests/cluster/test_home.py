from pathlib import Path

import pytest

from semap.cluster import default_home


@pytest.mark.parametrize(
    ("uid", "environment", "expected"),
    [
        (0, {}, "/var/lib/semap"),
        (1000, {}, "/home/ada/.local/share/semap"),
        (1000, {"XDG_DATA_HOME": "/data"}, "/data/semap"),
        (1000, {"XDG_DATA_HOME": "relative"}, "/home/ada/.local/share/semap"),
        (1000, {"XDG_DATA_HOME": ""}, "/home/ada/.local/share/semap"),
        (1000, {"XDG_DATA_HOME": "/data", "SEMAP_HOME": "~/map"}, "/home/ada/map"),
        (0, {"SEMAP_HOME": "/srv/map"}, "/srv/map"),
    ],
)
def test_where_the_data_go(
    uid: int, environment: dict[str, str], expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("SEMAP_HOME", "XDG_DATA_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", "/home/ada")
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr("os.geteuid", lambda: uid)
    assert default_home() == Path(expected)
