"""Where the layout for the app is, which shows each topic in its place."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

LAYOUT = Path(str(files("semap_bridge.adapters.foxglove") / "layout.json"))
