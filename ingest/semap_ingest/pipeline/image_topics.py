"""Which image topics are taken where one camera has several: of an RGB-D camera the colour; else one.

An RGB-D camera is told by images of distances beside which there are images in colour: its folder is the one
above theirs (/camera/depth/image_raw and /camera/color/image_raw are of /camera).
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable
from typing import Literal

import numpy as np

from semap_ingest.image.decoding import decode
from semap_ingest.sensing.image import CompressedImage, Image

Looks = Literal["colour", "grey", "depth", ""]
BY_NAME: tuple[tuple[re.Pattern[str], Looks], ...] = (
    (re.compile(r"depth|disparity"), "depth"),
    (re.compile(r"(^|[/_])(infra\d?|ir|mono|grey|gray)([/_]|$)"), "grey"),
    (re.compile(r"(^|[/_])(colou?r|rgb)([/_]|$)"), "colour"),
)


def looks_by_name(topic: str) -> Looks:
    """What a topic is called; empty: nothing that tells."""
    return next((looks for words, looks in BY_NAME if words.search(topic.lower())), "")


def looks_of(value: object) -> Looks:
    """What an image shows; empty for what is none, or is broken."""
    if isinstance(value, CompressedImage):
        value = decode(value)
    if not isinstance(value, Image):
        return ""
    return "colour" if np.ptp(value.pixels.astype(np.int16), axis=2).any() else "grey"


def is_rectified(topic: str) -> bool:
    """As image_proc calls it: image_rect, image_rect_color, image_rect_raw."""
    return any("rect" in re.split(r"[_]", part) for part in camera_path(topic).split("/"))


def camera_path(topic: str) -> str:
    """Without what image_transport appends."""
    return topic.removesuffix("/compressed")


def superfluous(
    usable: Collection[str],
    distances: Iterable[str],
    looks: Callable[[str], Looks],
    frame_of: Callable[[str], str],
) -> dict[str, str]:
    """Topics of images that are not needed beside others, and why.

    distances  topics of images of depth
    """
    found: dict[str, str] = {}
    shown = {name: looks(name) for name in usable}
    cameras = {_device(name) for name in (*distances, *(n for n in usable if shown[n] == "depth"))}
    for name in usable:
        colour = next((n for n in usable if shown[n] == "colour" and _device(n) == _device(name)), None)
        if shown[name] == "depth":
            found[name] = "it shows distances"
        elif shown[name] != "colour" and colour is not None and _device(name) in cameras:
            found[name] = f"{colour} of the same RGB-D camera shows colours"
    twins = defaultdict(list)
    for name in usable:
        if name not in found and (frame := frame_of(name)):
            twins[_folder(name), frame].append(name)
    for names in twins.values():
        best = min(names, key=lambda n: (shown[n] != "colour", not is_rectified(n), len(n), n))
        for name in names:
            if name != best:
                found[name] = f"{best} of the same camera {_better(name, best, shown[name] != shown[best])}"
    return found


def _better(name: str, best: str, is_by_colour: bool) -> str:
    if is_by_colour:
        return "shows colours"
    return "is rectified" if is_rectified(best) and not is_rectified(name) else "shows the same"


def _folder(topic: str) -> str:
    return camera_path(topic).rpartition("/")[0]


def _device(topic: str) -> str:
    return _folder(topic).rpartition("/")[0]
