"""Whether a request was meant for this machine by its name (header Host).

A page of any site can have its own name point to 127.0.0.1 (DNS rebinding); a browser then takes the answers
of a service on this machine for that site's own. Only the Host header still tells.
"""

from __future__ import annotations

import ipaddress
from urllib.parse import urlsplit


def is_loopback(host: str) -> bool:
    """Whether a host, with or without a port, is this machine itself."""
    try:
        name = urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return False
    if name == "localhost" or name.endswith(".localhost"):
        return True
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False
