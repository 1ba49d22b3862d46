"""Equal findings of an import are told once."""

from __future__ import annotations

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from semap.model.building import Finding
from semap.model.folding import folded


def test_a_hundred_equal_notes_become_one_and_others_stay() -> None:
    many = [Finding("note", f"Window {n}", f"its name 'Window {n}' is not the only one") for n in range(100)]
    same = [Finding("skipped", f"f{n}", "it has no geometry") for n in range(6)]
    few = [Finding("repaired", f"r{n}", "a ring is not closed") for n in range(5)]
    lone = Finding("note", "units", "the file names no unit")
    assert folded([*many[:50], lone, *same, *few, *many[50:]]) == (
        Finding(
            "note",
            "Window 0, Window 1, Window 2 and 97 more",
            "its name 'Window 0' is not the only one; the others likewise",
        ),
        lone,
        Finding("skipped", "f0, f1, f2 and 3 more", "it has no geometry"),
        *few,
    )


FINDINGS = st.builds(
    Finding,
    st.sampled_from(["note", "skipped"]),
    st.text("abc", min_size=1),
    st.sampled_from(["r 1", "r 2", "s"]),
)


@given(st.lists(FINDINGS, max_size=40))
def test_none_is_lost_and_no_kind_takes_more_than_five_lines(findings: list[Finding]) -> None:
    told = folded(findings)
    counts = Counter((each.action, each.reason[0]) for each in findings)
    lines = Counter((each.action, each.reason[0]) for each in told)
    assert lines.keys() == counts.keys()
    for kind, count in counts.items():
        assert lines[kind] == (count if count <= 5 else 1)
        if count > 5:
            (line,) = (each for each in told if (each.action, each.reason[0]) == kind)
            assert line.subject.endswith(f" and {count - 3} more")
