"""semap: a semantic map with continuous queries, on PostGIS."""

from __future__ import annotations

from typing import TYPE_CHECKING

from semap.version import VERSION

if TYPE_CHECKING:
    from semap.client import AsyncClient, Client

__version__ = VERSION
__all__ = ["AsyncClient", "Client", "__version__"]


def __getattr__(name: str) -> object:
    """The clients, imported when they are first named, so that `import semap` stays quick."""
    if name in ("AsyncClient", "Client"):
        import semap.client  # noqa: PLC0415

        return getattr(semap.client, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
