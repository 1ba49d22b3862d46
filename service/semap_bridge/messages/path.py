"""Where a value is in JSON (singular queries of RFC 9535), and which topics are meant, with named parts.

$.position.x    $.tags[0]['my tag']    $
uwb/{site}/{tag}/position              uwb/#
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TypeAlias

Path: TypeAlias = tuple[str | int, ...]

STEP = re.compile(r"""\.([^.\[\]'"*?@{}]+)|\[(-?[0-9]{1,9})\]|\['([^']*)'\]|\["([^"]*)"\]""")
PART = re.compile(r"\{([^{}]*)\}")


def read_path(text: str) -> Path:
    """raises  ValueError"""
    if not text.startswith("$"):
        raise ValueError(f"{text!r} is no path: write it as $.position.x")
    steps: list[str | int] = []
    at = 1
    while at < len(text):
        found = STEP.match(text, at)
        if found is None:
            raise ValueError(f"{text!r} is no path from {text[at:]!r} on: write it as $.position[0].x")
        name, index, single, double = found.groups()
        steps.append(
            int(index) if index is not None else next(n for n in (name, single, double) if n is not None)
        )
        at = found.end()
    return tuple(steps)


def find(value: object, path: Path) -> object:
    """What is there; None where nothing is."""
    for step in path:
        if isinstance(value, Mapping) and isinstance(step, str):
            value = value.get(step)
        elif isinstance(value, Sequence) and not isinstance(value, str) and isinstance(step, int):
            value = value[step] if -len(value) <= step < len(value) else None
        else:
            return None
    return value


class TopicPattern:
    """A topic with named parts, each a level of its own.

    wanted  as a broker knows it: with + in their place
    parts   their names
    """

    def __init__(self, text: str) -> None:
        """raises  ValueError"""
        levels = text.split("/")
        self.parts = tuple(PART.findall(text))
        for place, level in enumerate(levels):
            is_part = PART.fullmatch(level) is not None
            if not is_part and ("{" in level or "}" in level):
                raise ValueError(f"{level!r}: a named part is a whole level of a topic, such as {{tag}}")
            if (level == "#" and place < len(levels) - 1) or (
                level not in ("#", "+") and set(level) & set("#+")
            ):
                raise ValueError(f"{text!r}: + is a whole level of a topic, and # the last one")
        if "" in self.parts or len(set(self.parts)) < len(self.parts) or not text or "\0" in text:
            raise ValueError(f"{text!r}: each named part needs a name of its own")
        self.wanted = PART.sub("+", text)
        tail = levels[-1] == "#"
        middle = [_level(level) for level in (levels[:-1] if tail else levels)]
        self._pattern = re.compile(
            "/".join(middle) + ("(?:/.*)?" if tail and middle else ".*" if tail else ""), re.DOTALL
        )

    def match(self, topic: str) -> Mapping[str, str] | None:
        """Its named parts; None where it is another topic."""
        found = self._pattern.fullmatch(topic)
        return None if found is None else dict(zip(self.parts, found.groups(), strict=True))


def _level(level: str) -> str:
    if level == "+":
        return "[^/]*"
    return "([^/]*)" if PART.fullmatch(level) else re.escape(level)
