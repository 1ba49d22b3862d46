"""A place in the log, and what intake knows there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from semap.intake.idleness import Heard
from semap.intake.intake import Intake
from semap.intake.map_facts import MapFacts


@dataclass
class Place:
    """Mutable.

    committed_at_us  when the last transaction before the place was committed, by the server's clock
    facts_at_us      when the last that edited a map was
    seams            where the past ended that each rule was run over, by its id
    heard            what each source has said last, by its id
    """

    lsn: int
    committed_at_us: int
    intake: Intake = field(default_factory=Intake)
    facts: MapFacts = field(default_factory=MapFacts)
    facts_at_us: int = 0
    seams: dict[int, Mapping[str, int]] = field(default_factory=dict)
    heard: Mapping[int, Heard] = field(default_factory=dict)
