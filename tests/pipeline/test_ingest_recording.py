"""What is written is the same however it is brought in: once, in pieces, at a pace, through failures."""

from __future__ import annotations

import random
from dataclasses import replace
from threading import Event as Signal
from threading import Thread

import numpy as np
import pytest
from semap_ingest.pipeline import delivery as delivery_module
from semap_ingest.pipeline import registration
from semap_ingest.pipeline.ingest_recording import ingest_recording
from stored_results import stored

from semap.errors import Conflict, InvalidInput, NotFound
from semap.store.database.connection import connect

BREAK = (
    "select pg_terminate_backend(pid) from pg_stat_activity"
    " where application_name = 'semap ingest' and datname = current_database()"
)


class Cut:
    """Stops after so many commits."""

    def __init__(self, after: int) -> None:
        self.stop, self.left = Signal(), after

    def __call__(self, found: object) -> None:
        self.left -= 1
        if self.left <= 0:
            self.stop.set()


def test_a_recording_leaves_persons_lines_and_doors(office_map, plan):
    done = ingest_recording(office_map, plan)
    rows = stored(office_map)
    assert done.is_whole
    assert done.resumed_at == 0
    assert done.left_out == {}
    assert (done.states, done.lines) == (len(rows["states"]), len(rows["lines"]))
    assert done.tracks == len(rows["tracks"])
    assert min(len(rows[name]) for name in ("states", "lines", "doors", "changes")) > 0
    assert not any("None)" in row for row in rows["tracks"]), "every track has ended"
    assert all("True, 0)" in row for row in rows["sources"]), "both have ended, and nothing came late"

    again = ingest_recording(office_map, plan)
    assert (again.records, again.states, again.is_whole) == (0, 0, True)
    assert stored(office_map) == rows


def test_how_exact_a_place_is_is_what_the_filter_says(office_map, plan):
    """The ellipse of each state is that of the covariance of the Kalman filter, to the digits that a state keeps."""
    told = {}

    def note(found):
        for each in (persons.states for persons in found.persons):
            for track, covariance in zip(each.track, each.covariance_m2, strict=True):
                told[f"person {track}", each.stamp_us] = covariance

    ingest_recording(office_map, plan, committed=note)
    with connect(office_map) as connection:
        rows = connection.execute(
            "select k.name, (extract(epoch from s.stamp) * 1000000)::bigint, s.std_m, s.std_across_m, s.std_yaw_rad"
            " from semap.stored_state s join semap.track k using (track_id)"
        ).fetchall()
    assert {row[:2] for row in rows} == told.keys()
    assert sum(across_m is not None for *_, across_m, _ in rows) > 20
    for name, stamp_us, std_m, across_m, yaw_rad in rows:
        covariance = told[name, stamp_us]
        lengths = np.linalg.eigvalsh(covariance)
        assert std_m == pytest.approx(np.sqrt(lengths[1]), rel=1e-6)
        assert (std_m if across_m is None else across_m) == pytest.approx(np.sqrt(lengths[0]), rel=1e-6)
        if yaw_rad is not None:
            turn = np.array([[np.cos(yaw_rad), -np.sin(yaw_rad)], [np.sin(yaw_rad), np.cos(yaw_rad)]])
            again = turn @ np.diag([std_m**2, across_m**2]) @ turn.T
            np.testing.assert_allclose(again, covariance, rtol=0, atol=1e-6 * std_m**2)


def test_pieces_make_the_same_whole(office_map, plan, at_once):
    dice = random.Random(7)
    resumed_at = []
    for round_number in range(20):
        cut = Cut(dice.randrange(20, 250))
        speed = 40.0 if round_number % 2 else None
        done = ingest_recording(office_map, replace(plan, speed=speed), stop=cut.stop, committed=cut)
        resumed_at.append(done.resumed_at)
        if done.is_whole:
            break
    assert done.is_whole
    assert len(resumed_at) >= 3
    assert resumed_at == sorted(resumed_at)
    assert stored(office_map) == at_once


def test_a_pace_and_lost_connections_change_nothing(office_map, plan, at_once, caplog):
    commits = 0
    with connect(office_map) as other:

        def break_now_and_then(found: object) -> None:
            nonlocal commits
            commits += 1
            if commits % 40 == 0:
                other.execute(BREAK)

        done = ingest_recording(office_map, replace(plan, speed=50.0), committed=break_now_and_then)
    assert done.is_whole
    assert any(" results wait: " in record.getMessage() for record in caplog.records)
    assert stored(office_map) == at_once


def test_a_process_that_was_overtaken_passes_over_what_the_other_wrote(
    office_map, plan, at_once, monkeypatch
):
    """It loses its connection, and so its hold on the source; another one goes on for a while meanwhile."""
    is_overtaken = False
    wait = delivery_module.connect

    def overtaken(*arguments, **options):
        nonlocal is_overtaken
        if commits > 30 and not is_overtaken:
            is_overtaken = True
            cut = Cut(60)
            ingest_recording(office_map, plan, stop=cut.stop, committed=cut)
        return wait(*arguments, **options)

    monkeypatch.setattr(delivery_module, "connect", overtaken)
    commits = 0
    with connect(office_map) as breaker:

        def break_once(found: object) -> None:
            nonlocal commits
            commits += 1
            if commits == 31:
                breaker.execute(BREAK)

        done = ingest_recording(office_map, replace(plan, speed=50.0), committed=break_once)
    assert is_overtaken
    assert done.is_whole
    assert stored(office_map) == at_once


def test_one_process_at_a_time(office_map, plan, monkeypatch):
    monkeypatch.setattr(registration, "TRIES", 2)
    holds, go_on = Signal(), Signal()

    def pause(found: object) -> None:
        holds.set()
        go_on.wait(30)

    first = Thread(target=ingest_recording, args=(office_map, plan), kwargs={"committed": pause})
    first.start()
    assert holds.wait(30)
    try:
        with pytest.raises(Conflict, match="Another process"):
            ingest_recording(office_map, plan)
    finally:
        go_on.set()
        first.join(30)


def test_another_recording_needs_a_source_of_its_own(office_map, plan):
    cut = Cut(20)
    ingest_recording(office_map, plan, stop=cut.stop, committed=cut)
    before = stored(office_map)
    with pytest.raises(Conflict, match="another recording") as caught:
        ingest_recording(office_map, replace(plan, floor_z_m=1.0))
    assert "--source" in caught.value.remedy
    assert stored(office_map) == before
    assert ingest_recording(office_map, replace(plan, floor_z_m=1.0, source="second")).is_whole


def test_a_map_that_is_not_there(office_map, plan):
    with pytest.raises(NotFound, match="nowhere"):
        ingest_recording(office_map, replace(plan, map_name="nowhere"))


def test_a_source_that_is_deleted_meanwhile(office_map, plan):
    def delete(found: object) -> None:
        with connect(office_map) as connection:
            connection.execute("delete from semap.source")

    with pytest.raises(NotFound, match="robot/persons any more"):
        ingest_recording(office_map, plan, committed=delete)


def test_a_frame_that_leads_nowhere_is_said_and_can_be_corrected(office_map, plan):
    with pytest.raises(InvalidInput, match="'earth'") as caught:
        ingest_recording(office_map, replace(plan, map_frame="earth"))
    assert "laser, map, odom" in caught.value.remedy
    with connect(office_map) as connection:
        assert connection.execute("select count(*) from semap.source").fetchone() == (0,)
        assert connection.execute("select count(*) from semap.recording").fetchone() == (0,)
    assert ingest_recording(office_map, plan).states > 0
