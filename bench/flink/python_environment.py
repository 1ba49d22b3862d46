"""Finds or makes the Python in which Flink runs Python functions: an environment beside Flink's libraries.

python -m bench.flink.python_environment    make it, about 430 MB, unless it is there

It is apart from semap's own because PyFlink asks for older versions of packages that semap has, too.
"""

from __future__ import annotations

import hashlib
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from bench.flink.environment import HERE, HOME, FlinkMissing

PACKAGES = HERE / "python_packages.txt"
PYTHONS = ((3, 12), (3, 11), (3, 10))
"""Those for which there are wheels of PACKAGES."""


@dataclass(frozen=True)
class FlinkPython:
    """A Python for Flink.

    packages  where its packages lie, which an interpreter within the JVM does not find by itself
    library   what Flink needs to call it
    flink     what it takes for the folder of Flink
    """

    executable: Path
    packages: Path
    library: Path
    flink: Path


def find_python() -> FlinkPython:
    """raises FlinkMissing unless it has been made and Flink's library for it is there"""
    library = _library()
    home = _home()
    if not home.exists():
        raise FlinkMissing(f"Flink's Python is not in {HOME}: run ./dev flink once.")
    packages = next(home.glob("lib/python3.*/site-packages"))
    return FlinkPython(home / "bin" / "python", packages, library, library.parents[1])


def make_python() -> FlinkPython:
    """The same, made first where it is missing, which takes about a minute.

    raises  FlinkMissing with the reason if it cannot be made
    """
    _library()
    home = _home()
    if not home.exists():
        print(f"installing a Python for Flink in {HOME}, about 430 MB", file=sys.stderr, flush=True)
        unfinished = Path(tempfile.mkdtemp(dir=HOME, prefix="installing-"))
        try:
            _run(_interpreter(), "-m", "venv", str(unfinished))
            _run(
                str(unfinished / "bin" / "python"), "-m", "pip", "--disable-pip-version-check", "-q",
                "install", "--no-deps", "--no-compile", "-r", str(PACKAGES),
            )  # fmt: skip
            unfinished.rename(home)
        except OSError:
            # another run was first; it installed the same
            if not home.exists():
                raise
        finally:
            shutil.rmtree(unfinished, ignore_errors=True)
    return find_python()


def _library() -> Path:
    library = next((HOME / "pyflink" / "opt").glob("flink-python-*.jar"), None)
    if library is None:
        raise FlinkMissing(f"Flink's library for Python is not in {HOME}: run ./dev flink once.")
    return library


def _home() -> Path:
    """Named after what it has, so that a change makes a new one."""
    return HOME / f"python-{hashlib.sha256(PACKAGES.read_bytes()).hexdigest()[:16]}"


def _interpreter() -> str:
    if sys.version_info[:2] in PYTHONS:
        return sys.executable
    found = (shutil.which(f"python{major}.{minor}") for major, minor in PYTHONS)
    path = next(filter(None, found), None)
    if path is None:
        names = ", ".join(f"{major}.{minor}" for major, minor in PYTHONS)
        raise FlinkMissing(f"Flink's Python functions need one of Python {names}, and none was found.")
    return path


def _run(*command: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        said = (done.stderr.strip() or done.stdout.strip()).splitlines()
        raise FlinkMissing(f"Flink's Python could not be installed: {said[-1] if said else command[0]}")


if __name__ == "__main__":
    try:
        make_python()
    except FlinkMissing as missing:
        sys.exit(str(missing))
