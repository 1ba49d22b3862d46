"""Which addresses a webhook may name, so that nobody makes the service ask inside its own network.

A name is looked up at each attempt, all its addresses must be public, and the connection goes to one of
just these: a name that answers otherwise the second time gains nothing.
"""

from __future__ import annotations

import ipaddress
import socket
from ipaddress import IPv4Address, IPv6Address
from urllib.parse import urlsplit

from semap.errors import InvalidInput
from semap_service.webhooks.special_purpose import is_public

LONGEST_URL = 2000
PUBLIC = "Give an address that is reachable from the internet, or serve with --allow-private-webhooks."


def require_url(url: str, *, allow_private: bool) -> str:
    """A URL that a webhook may have.

    raises  InvalidInput for another scheme, credentials, a fragment, or an address that is not public
    """
    try:
        parts = urlsplit(url)
        port = parts.port
        host = (parts.hostname or "").encode("idna").decode() if parts.hostname else ""
    except (ValueError, UnicodeError) as error:
        raise InvalidInput("it cannot be read", "Give an address as https://host/path.", "url") from error
    if parts.scheme not in ("http", "https") or not host or port == 0 or len(url) > LONGEST_URL:
        raise InvalidInput(f"{url[:100]!r} is no web address", "Give an address as https://host/path.", "url")
    if not url.isascii() or not url.isprintable() or " " in url or "\\" in url:
        raise InvalidInput("it has characters that no address has", "Percent-encode them.", "url")
    if parts.username is not None or parts.password is not None or parts.fragment:
        raise InvalidInput("it has credentials or a fragment", "Leave them out: messages are signed.", "url")
    literal = _literal(host)
    if not allow_private and (host == "localhost" or (literal is not None and not is_public(literal))):
        raise InvalidInput(f"{host} is an address of a private network", PUBLIC, "url")
    return url


def resolved(host: str, port: int, *, allow_private: bool) -> tuple[str, ...]:
    """The addresses of a host, each once, in the order in which to try them.

    raises  OSError if there are none; InvalidInput if one is not public
    """
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    except UnicodeError as error:
        raise OSError(f"{host} is no name of a host") from error
    addresses = tuple(dict.fromkeys(str(each[4][0]) for each in found))
    if not allow_private:
        for each in addresses:
            if not is_public(ipaddress.ip_address(each)):
                raise InvalidInput(f"{host} is an address of a private network", PUBLIC, "url")
    return addresses


def _literal(host: str) -> IPv4Address | IPv6Address | None:
    """The address that a host already is; also in the short and hexadecimal forms that systems accept."""
    try:
        return ipaddress.ip_address(host)
    except ValueError:
        pass
    try:
        return IPv4Address(socket.inet_aton(host))
    except (OSError, ValueError):
        return None
