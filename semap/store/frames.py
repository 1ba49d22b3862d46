"""Where the frames of a map stand."""

from __future__ import annotations

import numpy as np
import psycopg
from numpy.typing import NDArray

from semap.errors import NotFound
from semap.model.pose import Pose
from semap.store.database import translated

CHAIN = """
    with recursive chain (frame_id, parent_id, depth) as (
      select f.frame_id, f.parent_id, 0
      from semap.frame f join semap.map m using (map_id) where m.name = %s and f.name = %s
      union all
      select f.frame_id, f.parent_id, c.depth + 1 from semap.frame f join chain c on f.frame_id = c.parent_id
    )
    select p.x_m, p.y_m, p.z_m, p.qx, p.qy, p.qz, p.qw
    from chain c
    cross join lateral (
      select * from semap.frame_pose p where p.frame_id = c.frame_id order by stamp desc limit 1
    ) p
    order by c.depth
"""


def map_from_frame(connection: psycopg.Connection, map_name: str, frame: str) -> NDArray[np.float64]:
    """map_T_frame by the newest poses, (4, 4) float64.

    raises NotFound
    """
    with translated():
        rows = connection.execute(CHAIN, [map_name, frame]).fetchall()
    if not rows:
        raise NotFound("frame", frame, f"Frames belong to a map; this one was looked for on {map_name}.")
    matrix = np.eye(4)
    for row in rows:
        matrix = Pose(*row).matrix() @ matrix
    return matrix
