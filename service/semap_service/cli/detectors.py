"""semap detector"""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from semap_service.cli.output import counted, print_json, print_rows, say
from semap_service.cli.session import AsJson

if TYPE_CHECKING:
    from semap_ingest.image.detector import ImageDetector
    from semap_ingest.image.trial import Picture, Trial

MOST_SHOWN = 20


def commands() -> typer.Typer:
    app = typer.Typer(no_args_is_help=True, help="Detectors of persons in images (ONNX), kept by name.")
    app.command("add")(add)
    app.command("list")(list_all)
    app.command("remove")(remove)
    return app


def add(
    file: Annotated[Path, typer.Argument(help="ONNX file of a detector.")],
    name: Annotated[str | None, typer.Option(help="Its name. [default: the file's]")] = None,
    layout: Annotated[
        str | None, typer.Option(help="The layout of its outputs, if the file is ambiguous: yolox, ...")
    ] = None,
    classes: Annotated[
        Path | None, typer.Option(help="Its classes, one in each line, where the file has none.")
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(help="JPEG or PNG that shows persons, best of your camera. [default: semap's own]"),
    ] = None,
    anyway: Annotated[bool, typer.Option("--anyway", help="Add it though it is suspicious.")] = False,
    as_json: AsJson = False,
) -> None:
    """Recognise a detector, try it on a picture, show the boxes, and keep it by its name.

    Afterwards --camera-model NAME and `detector: NAME` of a rig stand for it. If its layout is ambiguous, you
    are asked on a terminal. Else, and if it finds nobody in a picture of persons, it is not added, and what
    is printed says which command settles it.
    """
    from semap_service.cli.perception_extra import require_perception  # noqa: PLC0415

    require_perception("trying a detector")
    from semap_ingest.image import added  # noqa: PLC0415
    from semap_ingest.image.trial import drawn, own_picture, picture_of  # noqa: PLC0415

    name = _own_name(file) if name is None else name
    added.require_free(name)
    shown = own_picture() if picture is None else picture_of(picture)
    said = {"--name": name if name != _own_name(file) else None, "--classes": classes, "--picture": picture}
    detector, trial = _tried(file, layout, classes, shown, said)
    if not as_json:
        _print_trial(file, detector, shown, trial)
    if trial.suspicion and not anyway:
        raise _suspicious(file, detector, classes, shown, trial, said)
    with added.draft(file, classes) as folder:
        (folder / added.BOXES).write_bytes(drawn(trial.boxes, shown.image).tobytes())
        _opened(folder / file.name, detector.layout.name, classes)
        kept = added.keep(folder, name, file, detector.layout.name, classes)
    if as_json:
        print_json(_row(kept) | {"drawn": str(kept.boxes), "suspicion": trial.suspicion or None,
                                 "boxes": [_box(trial, row) for row in range(len(trial.boxes))]})  # fmt: skip
        return
    say(f"The boxes are drawn in {kept.boxes}")
    say(f"Added as {name}: --camera-model {name}, or detector: {name} in a rig.")


def list_all(as_json: AsJson = False) -> None:
    """List the detectors that were added."""
    from semap_ingest.image.added import added_detectors  # noqa: PLC0415

    print_rows([_row(each) for each in added_detectors()], as_json, "None: semap detector add FILE.onnx")


def remove(name: Annotated[str, typer.Argument(help="Its name.")]) -> None:
    """Remove a detector that was added; the file that it was added from stays."""
    from semap_ingest.image import added  # noqa: PLC0415

    added.remove(name)
    say(f"{name} is removed.")


def _own_name(file: Path) -> str:
    return re.sub(r"[^A-Za-z0-9._-]", "_", file.stem)


def _row(kept: Any) -> dict[str, str | None]:
    return {"name": kept.name, "layout": kept.layout, "model": str(kept.model)}


def _box(trial: Trial, row: int) -> dict[str, object]:
    corners = [round(float(number), 1) for number in trial.boxes.corners_px[row]]
    return {"score": round(float(trial.boxes.score[row]), 3), "corners_px": corners}


def _opened(file: Path, layout: str | None, classes: Path | None) -> ImageDetector:
    from semap_ingest.image.detector import ImageDetector  # noqa: PLC0415

    return ImageDetector.open(file, layout=layout, class_names=classes)


def _tried(
    file: Path,
    layout: str | None,
    classes: Path | None,
    picture: Picture,
    said: Mapping[str, object],
) -> tuple[ImageDetector, Trial]:
    """Of an ambiguous layout the one that is chosen on the terminal; raises InvalidInput without one."""
    from semap_ingest.image.recognition import Ambiguous  # noqa: PLC0415
    from semap_ingest.image.trial import try_on  # noqa: PLC0415

    from semap.errors import InvalidInput  # noqa: PLC0415

    try:
        detector = _opened(file, layout, classes)
    except Ambiguous as error:
        found = _persons_by_layout(file, error.layouts, classes, picture)
        best = max(found, key=lambda each: found[each] or 0.0)
        if not sys.stdin.isatty():
            raise InvalidInput(
                f"{str(error).removeprefix(f'{file.name}: ')}\n  {_told(found, picture)}",
                f"Say which: {_command(file, best, said)}",
                file.name,
            ) from error
        say(f"{file.name} may be of several layouts. {_told(found, picture)}")
        chosen = typer.prompt("Which layout was it exported with?", best)
        while chosen not in found:
            chosen = typer.prompt(f"One of {', '.join(found)}", best)
        detector = _opened(file, chosen, classes)
    except InvalidInput as error:
        remedy = error.remedy.replace("--camera-layout", "--layout").replace("--camera-classes", "--classes")
        raise InvalidInput(str(error).removeprefix(f"{file.name}: "), remedy, error.where) from error
    return detector, try_on(detector, picture)


def _persons_by_layout(
    file: Path, layouts: tuple[str, ...], classes: Path | None, picture: Picture
) -> dict[str, float | None]:
    """The score of the best person that each layout finds; None: nobody, or nothing that can be."""
    from semap_ingest.image.trial import try_on  # noqa: PLC0415

    from semap.errors import InvalidInput  # noqa: PLC0415

    found: dict[str, float | None] = {}
    for layout in layouts:
        try:
            trial = try_on(_opened(file, layout, classes), picture)
            found[layout] = None if trial.suspicion else float(trial.boxes.score[0])
        except InvalidInput:
            found[layout] = None
    return found


def _told(found: dict[str, float | None], picture: Picture) -> str:
    said = ", ".join(
        f"{name} {'nobody' if best is None else f'a person at {best:.2f}'}" for name, best in found.items()
    )
    return f"In {picture.name} each finds: {said}."


def _command(file: Path, layout: str, said: Mapping[str, object]) -> str:
    named = [word for option, value in said.items() if value is not None for word in (option, str(value))]
    return shlex.join(["semap", "detector", "add", str(file), "--layout", layout, *named])


def _suspicious(
    file: Path,
    detector: ImageDetector,
    classes: Path | None,
    picture: Picture,
    trial: Trial,
    said: Mapping[str, object],
) -> Exception:
    from semap.errors import InvalidInput  # noqa: PLC0415

    others = tuple(name for name in detector.fitting if name != detector.layout.name)
    found = _persons_by_layout(file, others, classes, picture)
    better = sorted(
        (name for name, best in found.items() if best is not None), key=lambda name: -(found[name] or 0)
    )
    remedies = [f"By another layout it finds somebody: {_command(file, better[0], said)}"] if better else []
    remedies += [
        "See that its class 'person' is the right one: --classes FILE; try a picture of your camera:"
        " --picture FILE; or add it as it is: --anyway"
    ]
    return InvalidInput(f"suspicious: {trial.suspicion}", ". ".join(remedies), file.name)


def _print_trial(file: Path, detector: ImageDetector, picture: Picture, trial: Trial) -> None:
    width, height = detector.input.size_px
    image_height, image_width = picture.image.pixels.shape[:2]
    form = f"{detector.form.colours.upper()}, {width} x {height} px"
    names = detector.names.names
    many = (
        "classes without names"
        if names is None
        else counted(len(names), "class").replace("classs", "classes")
    )
    say(f"{file.name}: layout {detector.layout.name}, input {form}, {many}.")
    say(
        f"{picture.name}, {image_width} x {image_height} px: {counted(len(trial.boxes), 'person')} in"
        f" {trial.duration_s * 1000:.0f} ms"
    )
    for row in range(min(len(trial.boxes), MOST_SHOWN)):
        left, top, right, bottom = trial.boxes.corners_px[row]
        say(f"  {trial.boxes.score[row]:.2f}  x {left:.0f} to {right:.0f}, y {top:.0f} to {bottom:.0f}")
    if len(trial.boxes) > MOST_SHOWN:
        say(f"  and {len(trial.boxes) - MOST_SHOWN} more")
