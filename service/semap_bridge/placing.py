"""From what messages say to a batch: positions come into the map frame, reports of cameras go along."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from semap_ingest.named_states import NamedStates, Refused
from sqlalchemy import Connection, text

from semap.errors import NotFound, ServiceUnreachable
from semap.store.database.connection import translated
from semap.store.map.frames import frame_named, transform
from semap.store.map.maps import map_id_of
from semap.store.map.placement import ROOT_FRAME
from semap_bridge.adapter import Batch
from semap_bridge.context import Context
from semap_bridge.messages.template import Reading
from semap_bridge.messages.told import CameraReport, Located, Told, Unusable

FROM_EARTH = text("""
    select public.st_x(p), public.st_y(p)
    from unnest(cast(:x as float8[]), cast(:y as float8[])) with ordinality as g (x, y, place)
    cross join lateral semap.from_earth(public.st_setsrid(public.st_makepoint(g.x, g.y), 4326), :map_id) p
    order by place
""")
ADD_REPORTS = text("""
    insert into semap.camera_report (map_id, source, camera, object, stamp, document)
    select :map_id, :source, r.camera, r.object, timestamptz 'epoch' + r.stamp_us * interval '1 microsecond',
           r.document
    from jsonb_to_recordset(cast(:reports as jsonb))
      as r (camera text, object text, stamp_us bigint, document jsonb)
    on conflict do nothing
""")
MEASURES = ("z_m", "std_m", "heading_rad", "speed_mps")


@dataclass(frozen=True)
class Placement:
    """map_T_sender, (4, 4), and how it is turned about z [rad]."""

    matrix: NDArray[np.float64]

    @property
    def yaw_rad(self) -> float:
        return math.atan2(self.matrix[1, 0], self.matrix[0, 0])

    def place(self, told: Located) -> Located:
        """In the map frame, of what is in metres."""
        x, y, z, _ = self.matrix @ (told.x, told.y, told.z_m or 0.0, 1.0)
        heading = told.heading_rad
        return replace(
            told,
            x=float(x),
            y=float(y),
            z_m=None if told.z_m is None else float(z),
            heading_rad=None if heading is None else math.remainder(heading + self.yaw_rad, math.tau),
        )


async def placement_of(context: Context, reading: Reading) -> Placement:
    """Where a sender's coordinates lie on the map; raises ServiceUnreachable where its frame has no place."""

    def look(connection: Connection) -> NDArray[np.float64]:
        if reading.frame == ROOT_FRAME:
            return reading.origin.pose().matrix()
        try:
            root, frame = (
                frame_named(connection, context.map_name, name) for name in (ROOT_FRAME, reading.frame)
            )
        except NotFound as error:
            raise ServiceUnreachable(
                f"The map {context.map_name} has no frame {reading.frame}.",
                "Make it: semap frame add, or correct `frame`.",
            ) from error
        pose = transform(connection, root.frame_id, frame.frame_id)
        return pose.matrix() @ reading.origin.pose().matrix()

    return Placement(await context.ask(look))


async def batch_of(context: Context, told: Sequence[tuple[Told, Placement]]) -> Batch:
    """What messages say, as a batch; what cannot be used is among the refused."""
    flawed = [each for one, _ in told for each in one.unusable]
    located = [
        each if each.on_earth else placement.place(each) for one, placement in told for each in one.located
    ]
    located, astray = await _from_earth(context, located)
    reports = [each for one, _ in told for each in one.reports]
    return Batch(
        states=states_of(located),
        objects=[each for one, _ in told for each in one.objects],
        ended=[each for one, _ in told for each in one.ended],
        refused=[Refused(place, each.reason, each.detail) for place, each in enumerate([*flawed, *astray])],
        also=partial(_write, context.map_name, context.source, reports) if reports else None,
    )


def states_of(located: Sequence[Located]) -> NamedStates:
    """Of positions in the map frame."""
    values = {
        name: [math.nan if (value := getattr(each, name)) is None else value for each in located]
        for name in MEASURES
    }
    return NamedStates.of_columns(
        [each.track for each in located],
        np.array([each.stamp_us for each in located], dtype=np.int64),
        x_m=[each.x for each in located],
        y_m=[each.y for each in located],
        **values,
    )


async def _from_earth(context: Context, located: Sequence[Located]) -> tuple[list[Located], list[Unusable]]:
    """Those on earth in the map frame, by the anchor of the map; of those that have no place there, why."""
    here = [each for each in located if not each.on_earth]
    there = [each for each in located if each.on_earth]
    if not there:
        return here, []
    on_earth = [each for each in there if abs(each.x) <= 180 and abs(each.y) < 90]
    beyond = Unusable("not on earth", "give longitude and latitude in degrees")
    astray = [beyond] * (len(there) - len(on_earth))
    rows = await context.ask(partial(_placed, map_name=context.map_name, located=on_earth))
    for each, row in zip(on_earth, rows, strict=True):
        if row is None:
            astray.append(Unusable("map without anchor", f"give it one: semap map anchor {context.map_name}"))
        else:
            here.append(replace(each, x=row[0], y=row[1], on_earth=False))
    return here, astray


def _placed(
    connection: Connection, *, map_name: str, located: Sequence[Located]
) -> list[tuple[float, float] | None]:
    wanted = {
        "map_id": map_id_of(connection, map_name),
        "x": [each.x for each in located],
        "y": [each.y for each in located],
    }
    with translated():
        rows = [(row[0], row[1]) for row in connection.execute(FROM_EARTH, wanted)]
    return list(rows) if len(rows) == len(located) else [None] * len(located)


def _write(map_name: str, source: str, reports: Sequence[CameraReport], connection: Connection) -> None:
    """Keep what cameras' programs say, as it came; what was told already is passed over."""
    document = [
        {"camera": each.camera, "object": each.object, "stamp_us": each.stamp_us, "document": each.document}
        for each in reports
    ]
    wanted = {"map_id": map_id_of(connection, map_name), "source": source, "reports": json.dumps(document)}
    with translated():
        connection.execute(ADD_REPORTS, wanted)
