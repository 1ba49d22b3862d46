"""The service as a process of its own, which can be killed."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import httpx
from semap_service.port import free_port

PATIENCE_S = 60.0


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
        deadline_s = time.monotonic() + PATIENCE_S
        while not self._answers():
            assert self.process.poll() is None
            assert time.monotonic() < deadline_s
            time.sleep(0.02)

    def kill(self) -> None:
        """As a crash does."""
        assert self.process is not None
        self.process.kill()
        self.process.wait()

    def _answers(self) -> bool:
        try:
            return httpx.get(f"{self.url}/health", timeout=5).status_code == 200
        except httpx.TransportError:
            return False
