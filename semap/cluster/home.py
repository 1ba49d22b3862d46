"""Where semap keeps its own cluster."""

import os
from pathlib import Path


def default_home() -> Path:
    """SEMAP_HOME; else /var/lib/semap for root; else below the user's XDG data folder. Not created here."""
    chosen = os.environ.get("SEMAP_HOME")
    if chosen:
        return Path(chosen).expanduser().absolute()
    if os.geteuid() == 0:
        return Path("/var/lib/semap")
    # The XDG specification has relative paths ignored.
    shared = Path(os.environ.get("XDG_DATA_HOME", ""))
    return (shared if shared.is_absolute() else Path.home() / ".local" / "share") / "semap"
