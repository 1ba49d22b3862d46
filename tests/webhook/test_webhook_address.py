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
    "http://192.88.99.1/",
    "http://192.0.0.8/",
    "http://[3fff:1::1]/",
    "http://[::ffff:192.88.99.1]/",
    "http://[64:ff9b::192.0.0.8]/",
    "http://[64:ff9b:1::8.8.8.8]/",
    "http://[2002:c058:6301::1]/",
    "http://[2001:0:808:808::1]/",
    "http://[::8.8.8.8]/",
    "http://[::ffff:0:8.8.8.8]/",
    "http://[100::1]/",
    "http://[100:0:0:1::1]/",
    "http://[5f00::1]/",
    "http://[ff0e::1]/",
    "http://[4000::1]/",
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


RESERVED = (
    "0.0.0.0/8", "10.0.0.0/8", "100.64.0.0/10", "127.0.0.0/8", "169.254.0.0/16", "172.16.0.0/12",
    "192.0.0.0/24", "192.0.2.0/24", "192.31.196.0/24", "192.52.193.0/24", "192.88.99.0/24",
    "192.168.0.0/16", "192.175.48.0/24", "198.18.0.0/15", "198.51.100.0/24", "203.0.113.0/24",
    "224.0.0.0/4", "240.0.0.0/4", "::/128", "::1/128", "64:ff9b:1::/48", "100::/64", "100:0:0:1::/64",
    "2001::/23", "2001::/32", "2001:2::/48", "2001:10::/28", "2001:20::/28", "2001:30::/28",
    "2001:db8::/32", "2620:4f:8000::/48", "3fff::/20", "5f00::/16", "fc00::/7", "fe80::/10", "fec0::/10",
    "ff00::/8",
)  # fmt: skip


@pytest.mark.parametrize("block", RESERVED)
def test_a_block_of_the_registries_is_public_neither_by_itself_nor_wrapped(block: str) -> None:
    network = ipaddress.ip_network(block)
    for address in {network[0], network[-1], network[network.num_addresses // 2]}:
        assert not is_public(address)
        if isinstance(address, ipaddress.IPv4Address):
            number = int(address)
            for wrapped in (0xFFFF << 32 | number, 0x64FF9B << 96 | number, 0x2002 << 112 | number << 80):
                assert not is_public(ipaddress.IPv6Address(wrapped))


@pytest.mark.parametrize(
    "text",
    ["1.1.1.1", "9.255.255.255", "11.0.0.0", "192.0.1.0", "192.88.98.255", "192.88.100.0", "223.255.255.255",
     "2a00::1", "2001:200::1", "2001:db9::1", "3ffe:ffff::1", "::ffff:8.8.8.8", "64:ff9b::8.8.8.8", "2002:808:808::1"],
)  # fmt: skip
def test_what_is_beside_the_blocks_is_public(text: str) -> None:
    assert is_public(ipaddress.ip_address(text))


def test_a_name_with_one_private_address_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def found(host: str, port: int, **_: object) -> list[tuple]:
        return [(2, 1, 6, "", ("93.184.215.14", port)), (2, 1, 6, "", ("10.0.0.1", port))]

    monkeypatch.setattr(socket, "getaddrinfo", found)
    with pytest.raises(InvalidInput, match="private"):
        resolved("rebinding.example", 80, allow_private=False)
    assert resolved("rebinding.example", 80, allow_private=True) == ("93.184.215.14", "10.0.0.1")
