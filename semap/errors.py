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
        super().__init__(f"There is no {kind} {name if name != '' else '(an empty name)'}.", remedy)
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


class AccessRefused(CallerError):
    """The token is missing, unknown or expired, or does not allow what was asked for."""


class TooManyRequests(CallerError):
    """The caller asks more often than it may; `retry_after_s` is when it may again."""

    def __init__(self, message: str, remedy: str = "", retry_after_s: float = 1.0) -> None:
        super().__init__(message, remedy)
        self.retry_after_s = retry_after_s


class NoLongerKept(CallerError):
    """Events after the cursor have been deleted meanwhile; `oldest` is the first that is left."""

    def __init__(self, after: int, oldest: int | None) -> None:
        kept = "none is left" if oldest is None else f"the oldest that is kept is {oldest}"
        super().__init__(
            f"Events after number {after} are no longer kept; {kept}.",
            "Read again what was built from the events, and go on from there.",
        )
        self.after = after
        self.oldest = oldest


class ServiceUnreachable(SemapError):
    """The service does not answer, or the connection to it was lost."""


class UntrustedBytes(SemapError):
    """Bytes from a peer that do not follow its protocol."""


class DatabaseError(SemapError):
    """The database cannot do what semap needs."""


class NotPermitted(DatabaseError):
    """The role that is used may not do this."""


class StatementTooLong(DatabaseError):
    """A statement took longer than it may, and was cancelled."""


class ServerMissing(DatabaseError):
    """No PostgreSQL server with PostGIS was found on this machine."""


class ServerUnavailable(DatabaseError):
    """The server does not answer, or went away; trying again later may help."""


class InUse(ServerUnavailable):
    """Others use what is needed, or changed it meanwhile; trying again helps."""


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
