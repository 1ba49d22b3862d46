"""A webhook cannot be made to ask inside the service's own network."""

import ipaddress
import socket

import pytest
from semap_service.webhooks.address import is_public, require_url, resolved

from semap.errors import InvalidInput

PRIVATE = (
    "http://localhost/",
    "http://127.0.0.1:8000/",
    "http://127.1/",
    "http://2130706433/",
    "http://0x7f000001/",
    "http://0/",
    "http://10.1.2.3/",
    "http://169.254.169.254/latest/meta-data",
    "http://[::1]/",
    "http://[::ffff:10.0.0.1]/",
    "http://[64:ff9b::a00:1]/",
    "http://[2002:7f00:1::]/",
    "http://[fe80::1]/",
    "http://[fd00::1]/",
    "http://[fec0::1]/",
    "http://224.0.0.1/",
)
BROKEN = (
    "",
    "example.org",
    "ftp://example.org/",
    "file:///etc/passwd",
    "https://",
    "https://user:word@example.org/",
    "https://user@example.org/",
    "https://example.org/#part",
    "https://example.org:99999/",
    "https://example.org:0/",
    "https://exa mple.org/",
    "https://example.org/\r\nHost: other",
    "https://[::1/",
    "https://" + "a" * 64 + ".org/",
    "https://example.org/" + "a" * 2000,
    "https://example.org\\@10.0.0.1/",
    "gopher://example.org:25/",
)


@pytest.mark.parametrize("url", PRIVATE)
def test_a_private_address_is_refused_where_it_is_not_allowed(url: str) -> None:
    with pytest.raises(InvalidInput, match="private"):
        require_url(url, allow_private=False)
    assert require_url(url, allow_private=True) == url


@pytest.mark.parametrize("url", BROKEN)
@pytest.mark.parametrize("allow_private", [True, False])
def test_what_is_no_web_address_is_refused(url: str, allow_private: bool) -> None:
    with pytest.raises(InvalidInput) as refused:
        require_url(url, allow_private=allow_private)
    assert refused.value.remedy


def test_public_addresses() -> None:
    for url in ("https://example.org/hook?a=b", "http://8.8.8.8:8080/", "https://[2606:4700::1111]/"):
        assert require_url(url, allow_private=False) == url
    assert is_public(ipaddress.ip_address("8.8.8.8"))
    assert not is_public(ipaddress.ip_address("100.64.0.1"))
    assert not is_public(ipaddress.ip_address("fe80::1%eth0"))


def test_a_name_with_one_private_address_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def found(host: str, port: int, **_: object) -> list[tuple]:
        return [(2, 1, 6, "", ("93.184.215.14", port)), (2, 1, 6, "", ("10.0.0.1", port))]

    monkeypatch.setattr(socket, "getaddrinfo", found)
    with pytest.raises(InvalidInput, match="private"):
        resolved("rebinding.example", 80, allow_private=False)
    assert resolved("rebinding.example", 80, allow_private=True) == ("93.184.215.14", "10.0.0.1")
