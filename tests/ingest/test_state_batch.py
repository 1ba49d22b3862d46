"""States that are cut anywhere into transactions give what one row after the other gives, and none is late."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from semap_ingest.state_batch import MANY, state_writer
from world import SECOND_US, World

TRACKS, MOMENTS = MANY + 10, 8
FIRST_US = 1_800_000_000 * SECOND_US


@pytest.mark.parametrize(
    "cuts", [(), (130,), (30, 60), (1, 70, 140, 210, 460), tuple(range(60, 480, 60)), (479,)]
)
def test_moments_of_many_tracks_may_be_cut_anywhere(world: World, cuts: tuple[int, ...]) -> None:
    world.add_room("room", shapely.box(0, 0, 4, 4))
    dice = np.random.default_rng(len(cuts))
    places = dice.uniform(-2, 6, (MOMENTS, TRACKS, 2))
    found = []
    for pieces in (cuts, range(1, MOMENTS * TRACKS)):
        source_id = world.add_source(f"{len(found)}")
        ids = np.array([world.add_track(f"{len(found)} {n}", source_id) for n in range(TRACKS)])
        stamps = FIRST_US + SECOND_US * np.repeat(np.arange(MOMENTS), TRACKS)
        rows = np.arange(MOMENTS * TRACKS)
        for piece in np.split(rows, list(pieces)):
            x_m, y_m = places.reshape(-1, 2)[piece].T
            nothing = np.full(len(piece), np.nan)
            write = state_writer(
                source_id, ids[piece % TRACKS], stamps[piece], x_m, y_m, nothing,
                np.zeros(len(piece), dtype=np.bool_), std_m=nothing,
            )  # fmt: skip
            with world.connection.transaction(), world.connection.cursor() as cursor:
                write(cursor)
        assert world.one("select late_states from semap.source where source_id = %s", source_id) == 0
        changes = [each for each in world.changes() if each[0].startswith(f"{len(found)} ")]
        found.append({(track.split()[1], *rest) for track, *rest in changes})
        assert len(changes) == len(found[-1]) > TRACKS
    assert found[0] == found[1]
    assert world.one("select count(*) from semap.stored_state") == 2 * MOMENTS * TRACKS
