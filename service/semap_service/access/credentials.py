"""What a request shows of who it is from: a bearer token (RFC 6750), an address.

A browser cannot set headers on a WebSocket, so there the token comes as a subprotocol, `bearer.<token>`
beside `semap`. A token in a URL is not looked at: URLs end up in logs and histories.
"""

from __future__ import annotations

import ipaddress

from starlette.types import Scope as Connection

SUBPROTOCOL = "semap"
BEARER_SUBPROTOCOL = "bearer."
IPV6_NETWORK_BITS = 64


def shown_token(connection: Connection) -> str | None:
    """The token that a request shows, as it is; None if it shows none, "" for credentials of another kind."""
    headers = [value for name, value in connection["headers"] if name == b"authorization"]
    if headers:
        scheme, _, value = headers[0].decode("latin-1").partition(" ")
        return value.strip() if scheme.lower() == "bearer" and len(headers) == 1 else ""
    for offered in connection.get("subprotocols", ()):
        if offered.startswith(BEARER_SUBPROTOCOL):
            return str(offered).removeprefix(BEARER_SUBPROTOCOL)
    return None


def without_token(connection: Connection) -> Connection:
    """The same request for those further in, who need no token and should not log one."""
    if "subprotocols" not in connection:
        return connection
    kept = [each for each in connection["subprotocols"] if not each.startswith(BEARER_SUBPROTOCOL)]
    headers = [(name, value) for name, value in connection["headers"] if name != b"sec-websocket-protocol"]
    if kept:
        headers.append((b"sec-websocket-protocol", ", ".join(kept).encode("latin-1")))
    return {**connection, "subprotocols": kept, "headers": headers}


def address_of(connection: Connection) -> str:
    """Where a request comes from; of IPv6 the network, of which one machine has many addresses."""
    client = connection.get("client")
    if client is None:
        return "unknown"
    try:
        address = ipaddress.ip_address(client[0])
    except ValueError:
        return str(client[0])
    if address.version == 6:
        return str(ipaddress.ip_network((address, IPV6_NETWORK_BITS), strict=False))
    return str(address)
