"""What a check says."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum

from sqlalchemy import Connection


class Level(StrEnum):
    """ok; warn: it works, and may not for long or not as wished; wrong: it does not work."""

    OK = "ok"
    WARN = "warn"
    WRONG = "wrong"


@dataclass(frozen=True)
class Finding:
    """One line of the doctor."""

    check: str
    level: Level
    message: str
    remedy: str = ""


@dataclass(frozen=True)
class Trouble:
    """What a check has found; the check that found it is added by `examination`."""

    level: Level
    message: str
    remedy: str


def warn(message: str, remedy: str) -> Trouble:
    return Trouble(Level.WARN, message, remedy)


def wrong(message: str, remedy: str) -> Trouble:
    return Trouble(Level.WRONG, message, remedy)


@dataclass(frozen=True)
class DatabaseCheck:
    """A look into the database; `fine` is said where nothing is found."""

    name: str
    fine: str
    look: Callable[[Connection], Iterator[Trouble]]


@dataclass(frozen=True)
class MachineCheck:
    """A look at this machine and what is installed on it."""

    name: str
    fine: str
    look: Callable[[], Iterator[Trouble]]


def listed(names: Sequence[str], most: int = 5) -> str:
    """The first of many names."""
    rest = len(names) - most
    return ", ".join(names[:most]) + (f" and {rest} more" if rest > 0 else "")


def mebibytes(size: int) -> str:
    return f"{size / 1024**2:,.0f} MiB".replace(",", " ")
