"""What maps, concepts and grids may be called: their names are parts of URLs and files."""

from __future__ import annotations

from semap.errors import InvalidInput

LONGEST_NAME = 200


def require_name(name: str) -> None:
    """raises InvalidInput for a name that no URL can say: with a slash, only dots, empty or very long"""
    if not name.strip() or len(name) > LONGEST_NAME or name in (".", "..") or "/" in name or "\0" in name:
        raise InvalidInput(
            f"the name {name[:LONGEST_NAME]!r}",
            f"Choose one of at most {LONGEST_NAME} characters, without a slash.",
            "name",
        )


def require_plain_name(name: str, where: str) -> None:
    """raises InvalidInput for a name that is empty, very long, or no text"""
    if not name.strip() or len(name) > LONGEST_NAME or "\0" in name:
        raise InvalidInput(
            f"the name {name[:LONGEST_NAME]!r}", f"Choose one of 1 to {LONGEST_NAME} characters.", where
        )
