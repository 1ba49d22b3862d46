"""The runner of the pages: that it sees what is not so."""

from __future__ import annotations

from pathlib import Path

import pytest
from transcript import Session, blocks, commands, environment, matches

PAGE = """
Text.

```yaml title="a.yaml"
x: 1
```

```console
$ cat a.yaml
x: 1
$ echo one; echo two \\
    >&2; printf '%s' 'three   '
one
...
three
```

```console title="Another terminal"
$ sh -c 'echo ready; sleep 600'
ready
```

```pycon
>>> y = 2
```

```pycon
>>> y + 1
3
```
"""


def follow(page: str, folder: Path) -> None:
    (folder / "page.md").write_text(page)
    Session(folder, 1, environment(), patience_s=2.0).follow(folder / "page.md")


def test_a_page_that_is_true_is_followed_to_its_end(tmp_path: Path) -> None:
    follow(PAGE, tmp_path)
    assert [(each.kind, each.title, each.line) for each in blocks(PAGE)][:2] == [
        ("yaml", "a.yaml", 4),
        ("console", None, 8),
    ]
    assert [each.line for each in commands(list(blocks(PAGE))[1])] == [9, 11]


@pytest.mark.parametrize(
    ("right", "wrong"),
    [("x: 1\n$", "x: 2\n$"), ("one\n...", "one\ntwo\nthree\n..."), ("three   '", "three   '; false"),
     ("\nready", "\nsteady"), ("\n3\n", "\n4\n"), ("sleep 600", "exit 1"), ("...\nthree", "three")],
)  # fmt: skip
def test_what_is_not_so_is_seen(tmp_path: Path, right: str, wrong: str) -> None:
    assert right in PAGE
    if right == "sleep 600":
        follow(PAGE.replace(right, wrong), tmp_path)  # it said what is shown before it ended
        return
    with pytest.raises(AssertionError, match=r"page\.md|line"):
        follow(PAGE.replace(right, wrong), tmp_path)


@pytest.mark.parametrize(
    ("shown", "printed", "is_so"),
    [
        ("a...z", "abcz\n", True),
        ("a...z", "ab\ncz\n", False),
        ("a\n...\nz", "a\nz\n", True),
        ("a\n...\nz", "a\nb\nc\nz\n", True),
        ("a\n...", "a\n", True),
        ("a", "a\nb\n", False),
        ("a\nb", "a\n", False),
        ("", "", True),
        ("", "a\n", False),
        ("(a*) [b]", "(a*) [b]\n", True),
        ("a  b", "a b", False),
    ],
)
def test_what_is_shown_and_what_is_printed(shown: str, printed: str, is_so: bool) -> None:
    assert matches(shown, printed) is is_so
