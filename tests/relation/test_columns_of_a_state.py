"""Each column of a state, on all ways in, compacted, and on all ways out: a new one is in all of these lists."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields

import numpy as np
import pytest
from semap_ingest.state_copy import copy_rows, copy_statement, pack_states
from semap_ingest.track_batch import pack_batch, send_batch
from semap_service.routes.tracks import PastStateDocument, TrackStateDocument
from world import SECOND_US, World

from semap.client import TrackState as ClientState
from semap.model.track_state import MEASURES, STATE_COLUMNS
from semap.store.database.connection import connect
from semap.store.database.tables import TABLES

VALUES = {name: 8.0 if name == "std_m" else (place + 1) / 4 for place, name in enumerate(MEASURES)}


def by_batch(world: World, dsn: str, track_id: int) -> None:
    arrays = {name: np.array([value]) for name, value in VALUES.items()}
    batch = pack_batch(
        world.source_id, SECOND_US, np.array([track_id]), *np.array([[1.0], [2.0], [3.0]]), **arrays
    )
    with connect(dsn) as connection, connection.cursor() as cursor:
        send_batch(cursor, batch)


def by_copy(world: World, dsn: str, track_id: int) -> None:
    arrays = {name: np.array([value]) for name, value in VALUES.items()}
    data = pack_states(
        np.array([track_id]), np.array([SECOND_US]), *np.array([[1.0], [2.0], [3.0]]),
        is_last=np.array([False]), **arrays,
    )  # fmt: skip
    more = [name for name in MEASURES if name != "std_m"]
    with connect(dsn) as connection, connection.cursor() as cursor:
        copy_rows(copy_statement(*more), cursor, data)


@pytest.mark.parametrize("write", [by_batch, by_copy])
def test_what_was_written_is_read(
    world: World, database: str, write: Callable[[World, str, int], None]
) -> None:
    track_id = world.add_track("ann")
    write(world, database, track_id)
    names = ", ".join(MEASURES)
    wanted = [tuple(VALUES.values())]
    assert (
        world.rows(f"select {names} from semap.states(array[{track_id}], '-infinity', 'infinity')") == wanted
    )
    assert world.rows(f"select {names} from semap.track_place") == wanted
    world.run("select semap.flush_maps(array(select map_id from semap.map))")
    assert world.rows(f"select {names} from semap.track_now") == wanted
    assert world.rows("select p.* from semap.track_now n, semap.present_state(n) p") == world.rows(
        "select * from semap.stored_state"
    )
    world.run("select semap.compact_all(array(select source_id from semap.source))")
    assert world.one("select count(*) from semap.state_chunk where track_id is null") == 0
    assert (
        world.rows(f"select {names} from semap.states(array[{track_id}], '-infinity', 'infinity')") == wanted
    )


def test_tables_and_documents_have_the_columns_of_a_state() -> None:
    assert {each.name for each in TABLES["track_state"].columns} == {"track_id", *STATE_COLUMNS}
    assert {"is_last", *(each.name for each in TABLES["state_chunk"].columns)} >= set(STATE_COLUMNS) - {
        "stamp"
    }
    assert set(PastStateDocument.model_fields) == set(STATE_COLUMNS)
    assert set(TrackStateDocument.model_fields) == {*STATE_COLUMNS, "footprint"} - {"is_last"}
    assert {each.name for each in fields(ClientState)} == set(STATE_COLUMNS) - {"is_last"}
