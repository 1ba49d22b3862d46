"""What is wrong with a file in many places, told at once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from semap.errors import InvalidInput

LISTED_AT_MOST = 20


class Refusals:
    """Errors of a file's parts; a part that has one is passed over, and the file is refused in the end."""

    def __init__(self) -> None:
        self._by_place: list[tuple[int, InvalidInput]] = []

    @contextmanager
    def of_part(self, place: int) -> Iterator[None]:
        """Keep the InvalidInput that is raised within; they are told in the order of their places."""
        try:
            yield
        except InvalidInput as error:
            self.add(place, error)

    def add(self, place: int, error: InvalidInput) -> None:
        """Keep an error."""
        self._by_place.append((place, error))

    def raise_if_any(self, parts: str, where: str) -> None:
        """raises  InvalidInput that lists them, the first 20 of many

        parts  what they are errors of, such as 'features'
        """
        errors = [error for _, error in sorted(self._by_place, key=lambda each: each[0])]
        if len(errors) == 1:
            if errors[0].where.startswith(f"{where}:"):
                raise errors[0]
            raise InvalidInput(str(errors[0]), errors[0].remedy, where) from errors[0]
        if errors:
            lines = listed([str(error) for error in errors])
            remedies = dict.fromkeys(error.remedy for error in errors)
            raise InvalidInput(
                f"{len(errors)} {parts} are wrong:\n  {lines}", " ".join(list(remedies)[:3]), where
            )


def listed(texts: Sequence[str]) -> str:
    """The first 20 texts, each on a line, and how many more there are."""
    more = len(texts) - LISTED_AT_MOST
    return "\n  ".join([*texts[:LISTED_AT_MOST], *([f"and {more} more"] if more > 0 else [])])
