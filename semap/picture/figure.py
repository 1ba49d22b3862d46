"""What all pictures have in common: their files, their colours, and that they need matplotlib."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from semap.errors import InvalidInput

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS = (".svg", ".png", ".pdf")
INK, FAINT, OPEN = "#1f2328", "#d0d7de", "#bf8700"
TRACKS = ("#0969da", "#1a7f37", "#8250df", "#cf222e", "#0a7ea4", "#953800", "#bf3989", "#57606a")


def new_figure(width_in: float, height_in: float, path: Path) -> Figure:
    """A figure that is drawn without a screen.

    raises  InvalidInput for another format, or without matplotlib
    """
    if path.suffix.lower() not in FORMATS:
        raise InvalidInput("a picture is .svg, .png or .pdf", "Name the file so.", path.name)
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
        from matplotlib.figure import Figure  # noqa: PLC0415
    except ImportError as error:
        raise InvalidInput("drawing needs matplotlib", "pip install 'semap[plot]'", path.name) from error
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, path: Path) -> None:
    """The same picture gives the same bytes, whenever it is drawn."""
    from matplotlib import rc_context  # noqa: PLC0415

    dated = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    with rc_context({"svg.hashsalt": "semap"}):
        figure.savefig(path, dpi=120, metadata=dated.get(path.suffix.lower()))


def color_of(who: str) -> str:
    """The same colour for the same name in every picture."""
    return TRACKS[sum(who.encode()) % len(TRACKS)]
