"""Which program a row pattern is given: where that can be, one that shares what is alike in its attempts."""

from __future__ import annotations

from collections.abc import Mapping

from semap.rules.bound import Condition
from semap.rules.declaration import AfterMatch, Windows
from semap.rules.matching.all_matches import AllMatchesProgram
from semap.rules.matching.automaton import Automaton
from semap.rules.matching.pattern_program import ALL_MATCHES, PatternProgram
from semap.rules.matching.telling import Teller
from semap.rules.pattern import Node
from semap.rules.program import LossyProgram


def compile_program(
    node: Node,
    conditions: Mapping[str, Condition],
    windows: Windows,
    after_match: AfterMatch,
    telling: Teller,
    *,
    times_out: bool = False,
    in_order: bool = False,
    shares: bool = True,
) -> LossyProgram:
    """The program of a pattern.

    conditions  by variable; a variable without one binds any row
    in_order    whether matches are told in the order in which they began
    shares      whether attempts may share what is alike in them; else each is known by itself
    raises      InvalidInput for a pattern that begins with an absence or ends in one without a window, or
                that `follow.positions` refuses
    """
    keep_all = after_match.skip in ALL_MATCHES
    automaton = Automaton(node, conditions, windows, keep_all=keep_all)
    by_rows_alone = automaton.by_first_row and not automaton.waits
    if shares and keep_all and by_rows_alone and not automaton.may_be_empty and not times_out:
        return AllMatchesProgram(
            automaton, telling, at_most=after_match.at_most, clears=after_match.skip == "clear"
        )
    return PatternProgram(
        automaton, after_match, telling, times_out=times_out, in_order=in_order, shares=shares
    )
