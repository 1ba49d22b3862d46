"""States that come in live, written batch by batch: tracks by name, made when new; duplicates are harmless.

A batch that cannot be written as it is, since a state of it is stored already, or a track was deleted or
handed over, is looked at again: what is stored is passed over, and what the database refuses is found by
halves and refused alone. So no record keeps others from being written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from uuid import UUID

import numpy as np
import psycopg
from numpy.typing import NDArray
from sqlalchemy import Connection, text

from semap.errors import Conflict, InvalidInput, NotFound
from semap.model.object_state import NewObjectState
from semap.model.track_state import MEASURES
from semap.store.database.connection import translated
from semap.store.database.name import require_plain_name
from semap.store.motion.object_states import add_object_states
from semap.timeline.stamp import DAY_US, day_of, to_datetime
from semap_ingest.named_states import REPEATED, NamedStates, Refused
from semap_ingest.standing import track_uid
from semap_ingest.state_batch import state_writer

FIND_MAP = text("select map_id, uid from semap.map where name = :map")
MAKE_SOURCE = text("""
    insert into semap.source (map_id, name) values (:map_id, :name) on conflict (map_id, name) do nothing
""")
FIND_SOURCE = text("select source_id from semap.source where map_id = :map_id and name = :name")
FIND_CONCEPT = text("select concept_id from semap.concept where name = :concept")
MAKE_TRACKS = text("""
    insert into semap.track (uid, source_id, map_id, name, concept_id)
    select uid, :source_id, :map_id, name, cast(:concept_id as integer)
    from unnest(cast(:uids as uuid[]), cast(:names as text[])) t (uid, name) on conflict do nothing
""")
FIND_TRACKS = text(
    "select name, track_id from semap.track where source_id = :source_id and name = any (:names)"
)
MAKE_PARTITIONS = text("select semap.ensure_partitions(cast(:days as date[]))")
LOCK = text("select semap.lock_regions_shared()")
LOCK_SOURCE = text("select semap.lock_source(:source_id)")
FIND_LATE = text("""
    select track_id, (extract(epoch from stamp) * 1000000)::bigint from semap.late_state
    where source_id = :source_id and not of_pairs and stamp between :first and :last
""")
FIND_STORED = text("""
    select s.track_id, (extract(epoch from s.stamp) * 1000000)::bigint
    from semap.states(cast(:track_ids as bigint[]), :first, :last) s where s.stamp = any (:stamps)
""")
FIND_INSTANCES = text("select name from semap.instance where map_id = :map_id and name = any (:names)")
END_TRACKS = text(
    "select semap.end_tracks(:source_id, cast(:ids as bigint[]), cast(:stamps as timestamptz[]))"
)
MOVE_WATERMARK = text("""
    update semap.source set watermark = greatest(watermark, :stamp) where source_id = :source_id
""")
END_SOURCE = text("update semap.source set ended = true where map_id = :map_id and name = :name")


@dataclass(frozen=True)
class Said:
    """What one source says at a time.

    states        in the map frame, sifted
    objects       states of objects, such as doors
    ended         tracks that ended without a last state, each with when [us since 1970]
    watermark_us  no state up to it is to come after these; None: the source says none
    also          write what else belongs to it, in the same transaction, once the source is locked
    """

    source: str
    states: NamedStates
    objects: Sequence[NewObjectState] = ()
    ended: Sequence[tuple[str, int]] = ()
    watermark_us: int | None = None
    also: Sequence[Callable[[Connection], None]] = ()


@dataclass
class Taken:
    """What came of a batch: how many states were stored, and by index those that were late or refused."""

    stored: int = 0
    late: list[int] = field(default_factory=list)
    refused: list[Refused] = field(default_factory=list)


@dataclass(frozen=True)
class _Batch:
    """States of one source.

    track_id  of each state
    """

    source_id: int
    states: NamedStates
    track_id: NDArray[np.int64]

    def take(self, rows: NDArray[np.int64]) -> _Batch:
        return replace(self, states=self.states.take(rows), track_id=self.track_id[rows])


class StateIntake:
    """Mutable: ids of sources and tracks that are known, and days that have their tables, of one map.

    concept  what kind of thing new tracks are; None: that is not said
    """

    def __init__(self, connection: Connection, map_name: str, concept: str | None = None) -> None:
        """raises NotFound where there is no such map, or no such concept"""
        with translated():
            row = connection.execute(FIND_MAP, {"map": map_name}).one_or_none()
            if row is None:
                raise NotFound("map", map_name, "List them: semap map list")
            self.map_id: int = row[0]
            self._map_uid: UUID = row[1]
            self._concept_id: int | None = None
            if concept is not None:
                self._concept_id = connection.scalar(FIND_CONCEPT, {"concept": concept})
                if self._concept_id is None:
                    raise NotFound("concept", concept, "List them: semap concept list")
        self._map_name = map_name
        self._sources: dict[str, int] = {}
        self._tracks: dict[str, dict[str, int]] = {}
        self._days: set[int] = set()

    def forget(self) -> None:
        """Look everything up again: sources or tracks may have been deleted."""
        self._sources.clear()
        self._tracks.clear()

    def is_prepared(self, said: Said) -> bool:
        """Whether all is there, as far as is known."""
        known = self._tracks.get(said.source)
        return (
            known is not None
            and known.keys() >= {*said.states.names, *(name for name, _ in said.ended)}
            and self._days.issuperset((said.states.stamp_us // DAY_US).tolist())
        )

    def prepare(self, connection: Connection, said: Said) -> None:
        """Make what is not there yet, which by itself tells nothing: a source, tracks, tables of days.

        raises  InvalidInput for a name that no source can have
        """
        names = dict.fromkeys([*said.states.names, *(name for name, _ in said.ended)])
        days = {int(day) for day in np.unique(said.states.stamp_us // DAY_US)} - self._days
        if said.watermark_us is not None:  # of what else is written with it
            days |= {said.watermark_us // DAY_US} - self._days
        with translated():
            if days:
                connection.execute(MAKE_PARTITIONS, {"days": [day_of(day * DAY_US) for day in sorted(days)]})
            source_id = self._source_id(connection, said.source)
            known = self._tracks.setdefault(said.source, {})
            new = sorted(names.keys() - known.keys())
            if new:
                wanted = {"source_id": source_id, "names": new}
                uids = [track_uid(self._map_uid, said.source, name) for name in new]
                made = {**wanted, "map_id": self.map_id, "uids": uids, "concept_id": self._concept_id}
                connection.execute(MAKE_TRACKS, made)
                known.update((name, id_) for name, id_ in connection.execute(FIND_TRACKS, wanted))
        self._days |= days

    def write(self, connection: Connection, said: Sequence[Said]) -> list[Taken]:
        """Write what was prepared, within a transaction.

        raises  Conflict, InvalidInput where something of it cannot be written: `write_some` finds what
        """
        return self._write(connection, said, self._all)

    def write_some(self, connection: Connection, said: Sequence[Said]) -> list[Taken]:
        """The same, slower, without what is stored already or what the database refuses."""
        return self._write(connection, said, self._usable)

    def end(self, connection: Connection, source: str) -> None:
        """Nothing more is to come of a source for now: rules do not wait for it."""
        with translated():
            connection.execute(END_SOURCE, {"map_id": self.map_id, "name": source})

    def _write(self, connection: Connection, said: Sequence[Said], put: Put) -> list[Taken]:
        with translated():
            # states lock their source themselves
            if len(said) > 1 or said[0].objects or said[0].ended or said[0].also:
                connection.execute(LOCK)
                for source_id in sorted({self._sources[each.source] for each in said}):
                    connection.execute(LOCK_SOURCE, {"source_id": source_id})
            return [self._write_one(connection, each, put) for each in said]

    def _write_one(self, connection: Connection, said: Said, put: Put) -> Taken:
        source_id = self._sources[said.source]
        taken = Taken()
        batch = self._known(said, taken)
        if len(batch.states):
            put(connection, batch, taken)
            self._note_late(connection, batch, taken)
        self._end_tracks(connection, said, source_id)
        if said.objects:
            self._write_objects(connection, said, taken)
        for each in said.also:
            each(connection)
        if said.watermark_us is not None:
            connection.execute(
                MOVE_WATERMARK, {"source_id": source_id, "stamp": to_datetime(said.watermark_us)}
            )
        return taken

    def _known(self, said: Said, taken: Taken) -> _Batch:
        """The states of those tracks that the source still has."""
        ids = self._tracks[said.source]
        track_id = np.array([ids.get(name, 0) for name in said.states.names], dtype=np.int64)
        batch = _Batch(self._sources[said.source], said.states, track_id)
        if (track_id > 0).all():
            return batch
        for row in np.flatnonzero(track_id == 0):
            name = said.states.names[int(row)]
            taken.refused.append(
                Refused(int(said.states.index[row]), "track of another source", f"{name} was handed over")
            )
        return batch.take(np.flatnonzero(track_id > 0))

    def _all(self, connection: Connection, batch: _Batch, taken: Taken) -> None:
        states = batch.states
        measured = {name: states.values[name] for name in MEASURES if name in states.values}
        write = state_writer(
            batch.source_id,
            batch.track_id,
            states.stamp_us,
            states.value("x_m"),
            states.value("y_m"),
            states.value("z_m"),
            states.is_last,
            **{"std_m": states.value("std_m"), **measured},
        )
        with _cursor(connection) as cursor:
            write(cursor)
        taken.stored += len(states)

    def _usable(self, connection: Connection, batch: _Batch, taken: Taken) -> None:
        states = batch.states
        stamps = [to_datetime(each) for each in np.unique(states.stamp_us).tolist()]
        wanted = {"track_ids": np.unique(batch.track_id).tolist(), "stamps": stamps}
        rows = connection.execute(FIND_STORED, {**wanted, "first": stamps[0], "last": stamps[-1]})
        stored = {(id_, stamp_us) for id_, stamp_us in rows}
        keys = list(zip(batch.track_id.tolist(), states.stamp_us.tolist(), strict=True))
        for row, key in enumerate(keys):
            if key in stored:
                detail = f"{states.names[row]} has a state at {to_datetime(key[1]).isoformat()} already"
                taken.refused.append(Refused(int(states.index[row]), REPEATED, detail))
        fresh = np.array([row for row, key in enumerate(keys) if key not in stored], dtype=np.int64)
        self._by_halves(connection, batch.take(fresh), taken)

    def _by_halves(self, connection: Connection, batch: _Batch, taken: Taken) -> None:
        count = len(batch.states)
        if not count:
            return
        try:
            with translated(), connection.begin_nested():
                self._all(connection, batch, taken)
        except (Conflict, InvalidInput) as error:
            if count == 1:
                index = int(batch.states.index[0])
                taken.refused.append(Refused(index, "refused by the database", str(error)))
                return
            for rows in (np.arange(count // 2), np.arange(count // 2, count)):
                self._by_halves(connection, batch.take(rows), taken)

    def _note_late(self, connection: Connection, batch: _Batch, taken: Taken) -> None:
        refused = {each.index for each in taken.refused}
        states = batch.states
        first, last = to_datetime(int(states.stamp_us.min())), to_datetime(int(states.stamp_us.max()))
        found = connection.execute(FIND_LATE, {"source_id": batch.source_id, "first": first, "last": last})
        late = {(id_, stamp_us) for id_, stamp_us in found}
        if late:
            keys = zip(batch.track_id.tolist(), states.stamp_us.tolist(), states.index.tolist(), strict=True)
            taken.late += [index for id_, us, index in keys if (id_, us) in late and index not in refused]

    def _end_tracks(self, connection: Connection, said: Said, source_id: int) -> None:
        ids = self._tracks[said.source]
        ended = [(ids[name], to_datetime(stamp_us)) for name, stamp_us in said.ended if name in ids]
        if ended:
            values: dict[str, list[int] | list[datetime]] = {
                "ids": [id_ for id_, _ in ended],
                "stamps": [stamp for _, stamp in ended],
            }
            connection.execute(END_TRACKS, {"source_id": source_id, **values})

    def _write_objects(self, connection: Connection, said: Said, taken: Taken) -> None:
        names = {each.instance for each in said.objects}
        there = set(connection.scalars(FIND_INSTANCES, {"map_id": self.map_id, "names": sorted(names)}))
        taken.refused += [
            Refused(index, "no such instance", f"There is no instance {each.instance} on the map")
            for index, each in enumerate(said.objects)
            if each.instance not in there
        ]
        usable = [each for each in said.objects if each.instance in there]
        if usable:
            taken.stored += len(add_object_states(connection, self._map_name, said.source, usable))

    def _source_id(self, connection: Connection, name: str) -> int:
        if name not in self._sources:
            require_plain_name(name, "source")
            wanted = {"map_id": self.map_id, "name": name}
            connection.execute(MAKE_SOURCE, wanted)
            found = connection.scalar(FIND_SOURCE, wanted)
            if found is None:
                raise NotFound("map", self._map_name, "List them: semap map list")
            self._sources[name] = found
        return self._sources[name]


Put = Callable[[Connection, _Batch, Taken], None]


def _cursor(connection: Connection) -> psycopg.Cursor:
    driver = connection.connection.driver_connection
    assert isinstance(driver, psycopg.Connection)  # noqa: S101  (as open_engine makes it)
    return driver.cursor()


def refusals(taken: Iterable[Taken]) -> list[Refused]:
    """All that was refused."""
    return [each for one in taken for each in one.refused]
