"""Which addresses are of the internet: by IANA's registries, whatever a version of Python knows of them.

https://www.iana.org/assignments/iana-ipv4-special-registry, .../iana-ipv6-special-registry and
.../ipv6-address-space, as of 2026-01. Every block of the registries counts, also those that are reachable
from everywhere: relays and servers of the network's own, where no webhook is.
"""

from __future__ import annotations

from ipaddress import IPv4Address, IPv4Network, IPv6Address, IPv6Network

SPECIAL_V4 = tuple(
    IPv4Network(each)
    for each in (
        "0.0.0.0/8", "10.0.0.0/8", "100.64.0.0/10", "127.0.0.0/8", "169.254.0.0/16", "172.16.0.0/12",
        "192.0.0.0/24", "192.0.2.0/24", "192.31.196.0/24", "192.52.193.0/24", "192.88.99.0/24",
        "192.168.0.0/16", "192.175.48.0/24", "198.18.0.0/15", "198.51.100.0/24", "203.0.113.0/24",
        "224.0.0.0/4",  # multicast
        "240.0.0.0/4",
    )
)  # fmt: skip

GLOBAL_V6 = IPv6Network("2000::/3")
"""All that is given out for unicast; what is outside is local, multicast, or of no use yet."""

SPECIAL_V6 = tuple(
    IPv6Network(each)
    for each in ("2001::/23", "2001:db8::/32", "2002::/16", "2620:4f:8000::/48", "3fff::/20")
)  # fmt: skip

WRAPPING = {
    IPv6Network("::ffff:0:0/96"): 0,  # mapped
    IPv6Network("64:ff9b::/96"): 0,  # translated (NAT64)
    IPv6Network("2002::/16"): 80,  # 6to4
}
"""Blocks with an IPv4 address inside, and how many bits follow it."""


def is_public(address: IPv4Address | IPv6Address) -> bool:
    """Whether it is a unicast address of the internet; one that wraps another is what that is."""
    if isinstance(address, IPv4Address):
        return not any(address in block for block in SPECIAL_V4)
    if address.scope_id is not None:
        return False
    for block, shift in WRAPPING.items():
        if address in block:
            return is_public(IPv4Address(int(address) >> shift & 0xFFFFFFFF))
    return address in GLOBAL_V6 and not any(address in block for block in SPECIAL_V6)
