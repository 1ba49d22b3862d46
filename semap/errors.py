"""Every error that semap raises on purpose, grouped by whose fault it is.

`str(error)` says what is wrong; `error.remedy` says what the reader can do about it. They are
translated once, at the boundary: to an exit status by the command line, to RFC 9457 by the service.
"""

from __future__ import annotations

from collections.abc import Sequence


class SemapError(Exception):
    """What is wrong, and what to do about it."""

    def __init__(self, message: str, remedy: str = "") -> None:
        super().__init__(message)
        self.remedy = remedy


class CallerError(SemapError):
    """The caller asked for something that cannot be."""


class NotFound(CallerError):
    """The thing that was named does not exist."""

    def __init__(self, kind: str, name: object, remedy: str = "") -> None:
        super().__init__(f"There is no {kind} {name}.", remedy)
        self.kind = kind
        self.name = name

    @classmethod
    def said(cls, message: str, remedy: str = "") -> NotFound:
        """As the database says it."""
        error = cls("thing", "of that name", remedy)
        error.args = (message,)
        return error


class Conflict(CallerError):
    """What was asked for contradicts what is already there."""


class InvalidInput(CallerError):
    """A value or a file that semap cannot use; `where` names the place in it."""

    def __init__(self, message: str, remedy: str = "", where: str = "") -> None:
        super().__init__(f"{where}: {message}" if where else message, remedy)
        self.where = where


class ChangedMeanwhile(CallerError):
    """What was to be changed is no longer what the caller saw."""


class TooLarge(CallerError):
    """An upload that exceeds a limit."""


class UntrustedBytes(SemapError):
    """Bytes from a peer that do not follow its protocol."""


class DatabaseError(SemapError):
    """The database cannot do what semap needs."""


class ServerMissing(DatabaseError):
    """No PostgreSQL server with PostGIS was found on this machine."""


class ServerUnavailable(DatabaseError):
    """The server does not answer, or went away; trying again later may help."""


class ServerUnfit(DatabaseError):
    """The server answers but lacks something; `findings` pairs what is missing with its remedy."""

    def __init__(self, findings: Sequence[tuple[str, str]]) -> None:
        super().__init__(
            "The server lacks what semap needs: " + "; ".join(lack for lack, _ in findings),
            "\n".join(remedy for _, remedy in findings),
        )
        self.findings = tuple(findings)


class SlotLost(DatabaseError):
    """A replication slot is gone, so that changes may have been missed."""
