"""The service as a process of its own, which can be killed."""

from __future__ import annotations

import os
import subprocess
import sys

import httpx
from patience import PATIENCE_S, until
from semap_service.processes.port import free_port


class Serving:
    """`semap serve` on a port that stays the same."""

    def __init__(self, dsn: str) -> None:
        self.dsn = dsn
        self.port = free_port()
        self.url = f"http://127.0.0.1:{self.port}"
        self.process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "semap_service", "serve", "--port", str(self.port), "--without-tokens"],
            env={**os.environ, "SEMAP_DSN": self.dsn},
        )
        until(lambda: self._answers() or self.process.poll() is not None)
        assert self.process.poll() is None

    def kill(self) -> None:
        """As a crash does."""
        assert self.process is not None
        self.process.kill()
        self.process.wait()

    def _answers(self) -> bool:
        try:
            return httpx.get(f"{self.url}/health", timeout=PATIENCE_S).status_code == 200
        except httpx.TransportError:
            return False
