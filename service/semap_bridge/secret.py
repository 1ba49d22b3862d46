"""Secrets and certificates, from files: what a config names, and no log shows."""

from __future__ import annotations

import ssl
from datetime import UTC, datetime
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from semap.errors import ServiceUnreachable
from semap_bridge.certificate import validity
from semap_bridge.config import ConfigPath


def read_secret(path: Path) -> str:
    """The first line of a file; read for each connection, so that a new one is taken without a restart.

    raises  ServiceUnreachable where it cannot be read or is empty: the bridge waits until it can
    """
    try:
        lines = path.read_text().splitlines()
    except (OSError, UnicodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is no text"
        raise ServiceUnreachable(
            f"The secret in {path} cannot be read: {why}.", "Write it there, for the user that runs semap."
        ) from error
    if not lines or not lines[0]:
        raise ServiceUnreachable(f"{path} has no secret in it.", "Write it in the first line.")
    return lines[0]


class Login(BaseModel):
    """A user name, and the file with its password."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    user: str = Field(description="User name.")
    password_file: ConfigPath = Field(description="File with the password in its first line.")

    def password(self) -> str:
        """raises ServiceUnreachable"""
        return read_secret(self.password_file)


class Tls(BaseModel):
    """How a connection is encrypted, and whom it trusts."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    ca_file: ConfigPath | None = Field(default=None, description="Whom to trust. [default: the system's]")
    certificate_file: ConfigPath | None = Field(default=None, description="Certificate of this client.")
    key_file: ConfigPath | None = Field(default=None, description="Its key.")

    def context(self) -> ssl.SSLContext:
        """raises ServiceUnreachable where a file cannot be used: the bridge waits until it can"""
        try:
            context = ssl.create_default_context(cafile=self.ca_file)
            if self.certificate_file is not None:
                context.load_cert_chain(self.certificate_file, self.key_file)
                _require_valid(self.certificate_file)
        except (OSError, ssl.SSLError) as error:
            files = ", ".join(
                str(each) for each in (self.ca_file, self.certificate_file, self.key_file) if each is not None
            )
            raise ServiceUnreachable(
                f"{files}: {error.strerror or error}", "Give files in PEM that this user can read."
            ) from error
        return context


def _require_valid(path: Path) -> None:
    """A peer that is shown an old certificate may just hang up, and say nothing."""
    since, until = validity(path.read_text())
    if not since <= datetime.now(UTC) <= until:
        span = f"from {since:%Y-%m-%d %H:%M} to {until:%Y-%m-%d %H:%M} UTC"
        raise ServiceUnreachable(
            f"The certificate in {path} is valid {span} only.",
            "Renew it, or set this machine's clock; a new file is taken at the next try.",
        )
