"""The demo's scene with a camera and a laser."""

import sys

import pytest
from rule_work import running_worker
from semap_service.cli import demo
from semap_service.cli.recorded_office import play_recorded_office, verdict
from semap_service.processes.supervisor import Supervisor


def test_the_verdict_says_what_is_wrong():
    assert verdict(52, 52, 0) == "All 52 that happened were found within half a second, and nothing else was."
    assert verdict(52, 51, 0) == (
        "51 of 52 that happened were found within half a second; 0 events fit nothing that did."
    )
    assert verdict(52, 52, 1).endswith("; 1 event fit nothing that did.")


@pytest.mark.parametrize(("module", "name"), [("cv2", "OpenCV"), ("rosbags", "rosbags")])
def test_without_the_perception_extra_the_demo_goes_on(monkeypatch, capsys, module, name):
    monkeypatch.setitem(sys.modules, module, None)
    demo._play_recording("dbname=nowhere", fast=True)
    assert capsys.readouterr().out == (
        f"   Left out, since it needs {name}: pip install 'semap[perception]'\n"
    )


@pytest.mark.slow
def test_it_is_made_once_and_judged(database, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    said, steps = [], []
    with running_worker(database):
        play_recorded_office(database, None, said.append, lambda done, total: steps.append((done, total)))
    assert said[0].startswith("The recording is made once")
    assert said[1] == "Playing 93 s of images (30 Hz) and scans (15 Hz), as fast as it goes:"
    assert steps[-1][0] == steps[-1][1]
    events = [line for line in said if "2026-01-05 09:1" in line]
    *_, transitions, doors, relations, last = said
    for line, part in ((transitions, "transitions"), (doors, "doors"), (relations, "complex")):
        assert line.split()[0] == part
    happened, found, made_up = (
        sum(int(line.split()[column]) for line in (transitions, doors, relations)) for column in (1, 2, 3)
    )
    assert found + made_up == len(events)
    assert last == verdict(happened, found, made_up)
    assert transitions.split()[1:4] == ["16", "16", "0"]
    with running_worker(database):
        said.clear()
        play_recorded_office(database, None, said.append, lambda done, total: None)
    assert said[0].startswith("Playing")


@pytest.mark.slow
def test_a_bridge_hears_it_live(database, monkeypatch, tmp_path):
    pytest.importorskip("cyclonedds")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    said = []
    with running_worker(database), Supervisor(database) as supervisor:
        play_recorded_office(database, None, said.append, lambda done, total: None, supervisor)
    assert (
        said[1]
        == "Publishing 93 s of images (30 Hz) and scans (15 Hz) as ROS 2 topics, which a bridge hears:"
    )
    events = [line for line in said if "2026-01-05 09:1" in line]
    *_, transitions, doors, relations, last = said
    happened, found, made_up = (
        sum(int(line.split()[column]) for line in (transitions, doors, relations)) for column in (1, 2, 3)
    )
    assert found + made_up == len(events)
    assert found > happened / 2, said
    assert last == verdict(happened, found, made_up)
