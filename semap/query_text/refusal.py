"""A text is refused at a place of it, for one of the reasons there are."""

from __future__ import annotations

from semap.query_text.reasons import REASONS


class Refusal(Exception):
    """What a continuous query cannot say; `at` is where that begins [characters], if it is known."""

    def __init__(self, reason: str, at: int | None, **words: object) -> None:
        message, remedy = REASONS[reason]
        self.reason = reason
        self.message = message.format(**words)
        self.remedy = remedy.format(**words)
        self.at = at
        super().__init__(self.message)
