"""In which rooms a place is: a function of Flink's SQL.

Flink runs it in the Python of bench/flink/python_environment.py. The rooms are in the file that the job's
parameter `rooms` names: WKB in hexadecimal digits, one a line. A room is told by its number, from 0. The
boundary of a room is not in it, as with ST_Contains.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import shapely
from pyflink.table import DataTypes, FunctionContext
from pyflink.table.udf import ScalarFunction, udf


class RoomsAt(ScalarFunction):
    """Asked place by place."""

    def open(self, context: FunctionContext) -> None:
        text = Path(context.get_job_parameter("rooms", "")).read_text()
        self.rooms = np.array(shapely.from_wkb(text.split()))
        shapely.prepare(self.rooms)
        self.tree = shapely.STRtree(self.rooms)

    def eval(self, x_m: float, y_m: float) -> list[int]:
        return self.tree.query(shapely.Point(x_m, y_m), predicate="within").tolist()


class RoomsAtMany(RoomsAt):
    """Asked for a batch of places at once, as columns."""

    def eval(self, x_m: pd.Series, y_m: pd.Series) -> pd.Series:
        x, y = x_m.to_numpy(), y_m.to_numpy()
        place, room = self.tree.query(shapely.points(x, y))
        holds = shapely.contains_xy(self.rooms[room], x[place], y[place])
        place, numbers = place[holds], room[holds].tolist()
        ends = np.searchsorted(place, np.arange(len(x) + 1)).tolist()
        return pd.Series([numbers[start:end] for start, end in pairwise(ends)])


rooms_at = udf(RoomsAt(), result_type=DataTypes.ARRAY(DataTypes.INT()))
rooms_at_many = udf(RoomsAtMany(), result_type=DataTypes.ARRAY(DataTypes.INT()), func_type="pandas")
