"""Every answer tells browsers what its content may do, whoever gives it: routes, files, refusals, streams."""

from __future__ import annotations

import base64
import re
from hashlib import sha256

import httpx
import pytest
from guarded import Guarded, guarded

PATHS = (
    "/", "/health", "/ready", "/docs", "/docs/files/swagger-ui.css", "/openapi.json", "/maps", "/maps/nowhere", "/nowhere",
    "/page/nothing.js", "/maps?limit=x", "/metrics", "/conformance", "/api", "/collections?f=html", "/events?wait=0",
    "/rule-templates", f"/maps?x={'x' * 20_000}", "/page/",
)  # fmt: skip


@pytest.fixture
def service(database: str):
    with guarded(database, without_tokens=True, allowed_origins=["https://maps.example"]) as running:
        yield running


def require_secure(answer: httpx.Response) -> str:
    said = answer.request.method, answer.request.url.path[:50], answer.status_code
    assert answer.headers.get_list("x-content-type-options") == ["nosniff"], said
    assert answer.headers.get_list("referrer-policy") == ["no-referrer"], said
    (policy,) = answer.headers.get_list("content-security-policy")
    assert "default-src 'none'" in policy or "default-src 'self'" in policy, said
    assert "frame-ancestors 'none'" in policy, said
    return policy


def test_every_answer_has_them(service: Guarded) -> None:
    with service.client() as client:
        for path in PATHS:
            for method in ("GET", "HEAD", "POST", "OPTIONS", "TRACE"):
                require_secure(client.request(method, path))
        require_secure(client.post("/maps", json={"nme": 1}))
        require_secure(client.get("/maps", headers={"Host": "evil.example"}))
        require_secure(client.post("/maps", headers={"Origin": "https://evil.example"}))
        made = client.post("/maps", json={"name": "office"})
        require_secure(made)
        again = client.get(
            "/maps/office", headers={"If-None-Match": client.get("/maps/office").headers["etag"]}
        )
        assert again.status_code == 304
        require_secure(again)
        with client.stream("GET", "/events/stream") as stream:
            require_secure(stream)


def test_without_a_token_too(database: str) -> None:
    with guarded(database) as service, service.client() as client:
        for path in ("/maps", "/events", "/events/stream", "/nowhere"):
            answer = client.get(path)
            assert answer.status_code == 401
            require_secure(answer)


def test_the_documentation_may_run_its_own_script_and_no_other(service: Guarded) -> None:
    with service.client() as client:
        page = client.get("/docs")
    scripts = re.findall(r"<script>(.*?)</script>", page.text, re.DOTALL)
    assert len(scripts) == 1
    digest = base64.b64encode(sha256(scripts[0].encode()).digest()).decode()
    (allowed,) = re.findall(r"script-src ([^;]*)", require_secure(page))
    assert allowed == f"'self' 'sha256-{digest}'"
    assert not re.search(r"""(src|href)=["']?(https?:)?//""", page.text)
