"""Work that makes millions of values and keeps them, while nobody looks which of them cannot be reached."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def uncollected() -> Iterator[None]:
    """No unreachable objects are sought meanwhile, which may take twice the time of the work."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()
