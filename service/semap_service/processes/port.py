"""Ports of this machine."""

from __future__ import annotations

import socket

from semap.errors import Conflict


def require_free(host: str, port: int) -> None:
    """raises Conflict where something listens there already."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            raise Conflict(
                f"The address {host}:{port} is not to be had: {error.strerror}.",
                "Choose another one: --port NUMBER.",
            ) from error


def free_port() -> int:
    """A port of the loopback address that is free at this moment."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
