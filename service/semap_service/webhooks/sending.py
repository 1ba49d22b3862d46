"""One attempt to deliver one message over HTTP."""

from __future__ import annotations

import asyncio
import ssl
import time
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache, partial

import httpx

from semap import __version__
from semap.errors import InvalidInput
from semap_service.webhooks.address import resolved
from semap_service.webhooks.retry import asked_wait_s

GONE = 410
MOST_ANSWER_BYTES = 65_536
LONGEST_BODY_S = 1.0
LONGEST_ERROR = 500
MEDIA_TYPE = "application/cloudevents+json; charset=utf-8"


@dataclass(frozen=True)
class Answer:
    """What came of an attempt.

    status   None where there was no answer
    error    why it counts as not taken; empty where it was taken
    asked_s  how long the receiver asks to wait
    """

    status: int | None
    error: str
    took_s: float
    asked_s: float | None = None

    @property
    def taken(self) -> bool:
        return not self.error


class Sending:
    """Connections to one receiver, as a kept connection belongs to the name that it was made for."""

    def __init__(self, lookups: Executor, *, allow_private: bool, timeout_s: float) -> None:
        self._lookups = lookups
        self._allow_private = allow_private
        self._timeout_s = timeout_s
        self._client = httpx.AsyncClient(
            verify=_trusted(),
            timeout=timeout_s,
            follow_redirects=False,
            trust_env=False,
            limits=httpx.Limits(max_connections=1),
            headers={"User-Agent": f"semap/{__version__}"},
        )

    async def close(self) -> None:
        await self._client.aclose()

    async def post(self, url: str, headers: dict[str, str], body: bytes) -> Answer:
        """Send, and say what came of it; nothing that the receiver does raises."""
        began_s = time.monotonic()
        try:
            async with asyncio.timeout(self._timeout_s):
                status, asked_s, said = await self._post(httpx.URL(url), headers, body)
        except TimeoutError:
            return Answer(None, f"no answer within {self._timeout_s:g} s", time.monotonic() - began_s)
        except InvalidInput as error:
            return Answer(None, str(error), time.monotonic() - began_s)
        except (httpx.HTTPError, httpx.InvalidURL, OSError, ValueError) as error:
            told = f"{type(error).__name__}: {error}"[:LONGEST_ERROR]
            return Answer(None, told, time.monotonic() - began_s)
        refusal = "" if 200 <= status < 300 else _refusal(status, said)
        return Answer(status, refusal, time.monotonic() - began_s, asked_s)

    async def _post(
        self, url: httpx.URL, headers: dict[str, str], body: bytes
    ) -> tuple[int, float | None, bytes]:
        port = url.port or (443 if url.scheme == "https" else 80)
        look_up = partial(resolved, url.host, port, allow_private=self._allow_private)
        addresses = await asyncio.get_running_loop().run_in_executor(self._lookups, look_up)
        for number, address in enumerate(addresses, 1):
            request = self._client.build_request(
                "POST",
                url.copy_with(host=address),
                content=body,
                headers={**headers, "Host": url.netloc.decode(), "Content-Type": MEDIA_TYPE},
                extensions={"sni_hostname": url.host, "timeout": self._client.timeout.as_dict()},
            )
            try:
                response = await self._client.send(request, stream=True)
            except httpx.ConnectError:
                if number == len(addresses):
                    raise
                continue
            try:
                said = await _beginning(response)
            finally:
                await response.aclose()
            return (
                response.status_code,
                asked_wait_s(response.headers.get("Retry-After"), datetime.now(UTC)),
                said,
            )
        raise OSError(f"{url.host} has no address")


async def _beginning(response: httpx.Response) -> bytes:
    """How the body begins; what counts is the status, so a body that does not end is not waited for."""
    said = b""
    with suppress(TimeoutError, httpx.HTTPError):
        async with asyncio.timeout(LONGEST_BODY_S):
            async for piece in response.aiter_raw():
                said += piece
                if len(said) > MOST_ANSWER_BYTES:
                    break
    return said


def _refusal(status: int, said: bytes) -> str:
    if 300 <= status < 400:
        return f"answered {status}; redirects are not followed"
    text = " ".join(said.decode(errors="replace").replace("\x00", "").split())
    return f"answered {status}" + (f": {text}"[:LONGEST_ERROR] if text else "")


@cache
def _trusted() -> ssl.SSLContext:
    return httpx.create_ssl_context(trust_env=False)
