"""The notebook of the documentation, run from its first cell to its last against a service of its own."""

from __future__ import annotations

import json
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient
from transcript import Session

NOTEBOOK = Path(__file__).parents[2] / "docs/notebook/office.ipynb"


def text_of(cell: nbformat.NotebookNode) -> str:
    return "\n".join(
        output.get("text") or output.get("data", {}).get("text/plain", "")
        for output in cell.get("outputs", ())
    )


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_the_notebook_runs_and_finds_what_is_known_of_the_walk(
    reader: Session, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "page.md").write_text('```console title="up"\n$ semap up --without-tokens\n...\n```\n')
    for name, value in reader.environment.items():
        monkeypatch.setenv(name, value)
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    assert all(not cell.get("outputs") for cell in notebook.cells), "outputs are not kept in the repository"
    with reader.following(tmp_path / "page.md"):
        NotebookClient(notebook, timeout=120, kernel_name="python3").execute(cwd=str(tmp_path))
    said = {cell.id: text_of(cell) for cell in notebook.cells if cell.cell_type == "code"}
    joined = "\n".join(said.values())
    assert "{'Door': 7, 'Room': 6, 'Storey': 1}" in joined
    assert "2015 states of 3 tracks written" in joined
    images = [
        o for cell in notebook.cells for o in cell.get("outputs", ()) if "image/png" in o.get("data", {})
    ]
    assert len(images) == 3
    assert "meeting_room" in joined
    assert json.dumps(joined).count("Error") == 0
