"""Which sources have fallen silent, by the worker's own clock, which is passed in.

A source is silent if it has said nothing for a while, although another one of its map has since, be that one
ended by now or not. Where all say nothing, the last that spoke is not silent: nothing would be gained.

The worker notes in the database that a silent source is idle, and leaves it out once the log brings that. So
rules leave it out when triggers do, and not before.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from semap.intake.inputs import SourceChange

IDLE_AFTER_S = 10.0


@dataclass(frozen=True, slots=True)
class Heard:
    """What a source has said last.

    at_us  when, by the server's clock, which tells who spoke after whom
    """

    map_id: int
    said_us: int
    at_us: int
    is_awaited: bool = True


class Idleness:
    """Mutable: what each source has said last, and since when it says nothing."""

    def __init__(self, heard: Mapping[int, Heard], now_s: float, idle_after_s: float) -> None:
        """What was heard before now; all get their time anew."""
        self._idle_after_s = idle_after_s
        self._heard = dict(heard)
        self._since_s = dict.fromkeys(heard, now_s)

    @property
    def heard(self) -> Mapping[int, Heard]:
        """What each source has said last, by its id."""
        return self._heard

    def hear(self, source: SourceChange, at_us: int, now_s: float) -> None:
        """A source is this now; that it is idle, has ended, or is whole is nothing that it says."""
        known = self._heard.get(source.source_id)
        if known is None or known.said_us != source.said_us:
            known = Heard(source.map_id, source.said_us, at_us)
            self._since_s[source.source_id] = now_s
        elif source.is_awaited and not known.is_awaited:
            self._since_s[source.source_id] = now_s
        self._heard[source.source_id] = replace(known, is_awaited=source.is_awaited)

    def forget(self, source_id: int) -> None:
        """A source is gone."""
        self._heard.pop(source_id, None)

    def forget_map(self, map_id: int) -> None:
        """A map is gone with its sources."""
        self._heard = {source_id: each for source_id, each in self._heard.items() if each.map_id != map_id}

    def silent(self, now_s: float) -> Mapping[int, int]:
        """The sources that are awaited although they are silent, with what they said last."""
        newest_us: dict[int, int] = {}
        for each in self._heard.values():
            newest_us[each.map_id] = max(each.at_us, newest_us.get(each.map_id, each.at_us))
        return {
            source_id: each.said_us
            for source_id, each in self._heard.items()
            if each.is_awaited
            and now_s - self._since_s[source_id] >= self._idle_after_s
            and newest_us[each.map_id] > each.at_us
        }
