"""Finds Java and Flink's libraries, and compiles the programs of this folder once."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent
HOME = Path(os.environ.get("SEMAP_FLINK", HERE.parent.parent / ".flink"))
LIBRARIES = (
    "flink-dist-", "flink-cep-", "flink-table-api-java-uber-", "flink-table-planner-loader-",
    "flink-table-runtime-", "log4j-api-", "log4j-core-", "log4j-slf4j-impl-",
)  # fmt: skip
LEAST_JAVA = 17
# Flink's own start script opens these to its serializers.
OPENED = ("java.base/java.lang", "java.base/java.util", "java.base/java.time")


class FlinkMissing(Exception):
    """Java or Flink is not there; the message says which, and what to do."""


@dataclass(frozen=True)
class Flink:
    """Flink, ready to run.

    version   of Flink, such as 2.3.0
    classes   where the compiled programs of this folder lie
    """

    version: str
    java: str
    libraries: tuple[Path, ...]
    classes: Path

    def command(
        self, program: str, *arguments: str, options: Sequence[str] = (), libraries: Sequence[Path] = ()
    ) -> list[str]:
        """What starts a program of this folder; options are the JVM's; libraries, what else it needs."""
        path = os.pathsep.join(map(str, (self.classes, *self.libraries, *libraries)))
        opened = [f"--add-opens={package}=ALL-UNNAMED" for package in OPENED]
        quiet = "-Dlog4j2.level=OFF"
        return [self.java, *options, *opened, quiet, "-cp", path, program, *arguments]


def find() -> Flink:
    """raises FlinkMissing unless a JDK of LEAST_JAVA or newer and Flink's libraries are there"""
    java, javac = shutil.which("java"), shutil.which("javac")
    if java is None or javac is None:
        raise FlinkMissing(f"No JDK was found: install Java {LEAST_JAVA} or newer with its compiler, javac.")
    said = subprocess.run([javac, "-version"], capture_output=True, text=True, check=False)
    number = re.search(r"javac (\d+)", said.stdout + said.stderr)
    if number is None or int(number[1]) < LEAST_JAVA:
        raise FlinkMissing(f"The JDK is older than Java {LEAST_JAVA}: {(said.stdout + said.stderr).strip()}.")
    jars = sorted((HOME / "pyflink" / "lib").glob("*.jar"))
    libraries = tuple(jar for jar in jars if jar.name.startswith(LIBRARIES))
    if len(libraries) < len(LIBRARIES):
        raise FlinkMissing(f"Flink's libraries are not in {HOME}: run ./dev flink once.")
    version = next(jar.stem for jar in libraries if jar.name.startswith("flink-dist-")).rpartition("-")[2]
    return Flink(version, java, libraries, _compiled(javac, libraries))


def _compiled(javac: str, libraries: tuple[Path, ...]) -> Path:
    """Where the classes are; the folder is named after the sources, so that a change makes a new one."""
    sources = sorted(HERE.glob("*.java"))
    digest = hashlib.sha256(b"\0".join(source.read_bytes() for source in sources)).hexdigest()[:16]
    classes = HOME / f"classes-{digest}"
    if not classes.exists():
        unfinished = Path(tempfile.mkdtemp(dir=HOME, prefix="compiling-"))
        path = os.pathsep.join(map(str, libraries))
        command = [
            javac,
            "--release",
            str(LEAST_JAVA),
            "-cp",
            path,
            "-d",
            str(unfinished),
            *map(str, sources),
        ]
        subprocess.run(command, check=True, stderr=subprocess.PIPE)
        try:
            unfinished.rename(classes)
        except OSError:
            # another run was first; it compiled the same
            shutil.rmtree(unfinished)
    return classes
