"""What reading recordings and looking at images needs beyond semap itself: the extra `perception`."""

from __future__ import annotations

from importlib.util import find_spec

from semap.errors import InvalidInput

PACKAGES = {"cv2": "OpenCV", "onnxruntime": "onnxruntime", "rosbags": "rosbags"}
"""By the module that each brings."""

REMEDY = "pip install 'semap[perception]'"


def missing_packages() -> list[str]:
    """What of it is not installed."""
    return [name for module, name in PACKAGES.items() if find_spec(module) is None]


def require_perception(what: str) -> None:
    """raises InvalidInput where something is missing that `what` needs"""
    missing = missing_packages()
    if missing:
        raise InvalidInput(f"{what} needs {', '.join(missing)}", REMEDY)
