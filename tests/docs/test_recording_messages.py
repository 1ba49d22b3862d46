"""The page on recordings ends with every message that reading one can give, and with no other."""

from __future__ import annotations

from pathlib import Path

from recording_messages import told

PAGE = Path(__file__).parents[2] / "docs" / "recordings.md"
OF_PROGRAMS = {
    "... has the shape ... instead of ...",
    "... threads cannot work",
    "an image of shape ... and type ...",
    "boxes of the camera ... came to the tracker of ...",
    "detections at ... us came with those at ... us",
    "detections in ... came to the tracker of ...",
    "max_jump_us is ... us, not more than the minimum periods.",
    "min_score ... and max_overlap ...",
}
"""Only a program that calls semap_ingest can be told these."""
OF_SEVERAL_PARTS = {"...; it has ..."}


def documented() -> dict[str, str]:
    """By message, what to do."""
    _, heading, messages = PAGE.read_text(encoding="utf-8").partition("\n## Messages and what to do\n")
    assert heading
    assert "\n## " not in messages
    rows = [line.strip("|").split(" | ") for line in messages.splitlines() if line.startswith("| ")]
    return {row[0].strip(): row[1].strip() for row in rows if not set(row[0]) <= set("- ") and row[1:]}


def test_every_message_is_there_with_its_remedy_and_no_other() -> None:
    page = documented()
    del page["message"]
    assert page.keys() == told() - OF_PROGRAMS - OF_SEVERAL_PARTS
    assert all(page.values())


def test_what_the_source_says_is_found_in_all_its_forms() -> None:
    """An f-string, a text of two lines, one of two, a table, and a reason that a function returns."""
    assert told() >= {
        "there is no such recording",
        "ranges from ... m to ... m, in which nothing lies",
        "neither JPEG nor PNG",
        "an encrypted bag",
        "its outputs have an ambiguous layout, which may be ...; it has ...",
        "where it was seen from is not known: ...",
        "its stamp is no time",
    }
