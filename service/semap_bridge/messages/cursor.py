"""How far a file, a subject or a topic is: a number in the JSON that was written last."""

from __future__ import annotations

import json


def number_in(data: bytes, name: str) -> int:
    """The whole number of this name in an object; raises ValueError for whatever is none."""
    try:
        return int(json.loads(data)[name])
    except (KeyError, TypeError, OverflowError, RecursionError) as error:
        raise ValueError(f"there is no number {name} in it") from error
