"""Pages of the documentation as sessions: their files are written, their commands run, their output compared.

Of a page in Markdown the fenced blocks count, in their order:

- a block with `title="NAME"` that is no session is the file NAME, as the reader would save it;
- `console`: lines that begin with `$ ` are commands for a shell, continued after a backslash; what follows is
  what they print, both streams together, and they have to succeed unless an error of semap is shown. `...` stands for anything in a line, and a line of `...` for any lines;
- `console title="..."`: another terminal, in which the command keeps running; it has to print what is shown, and a
  service has to answer, before the reader goes on;
- `pycon`: a session of Python, compared as doctest does it.

Where a command only reads, it is run again until it prints what is shown: the reader is slower than semap.
"""

from __future__ import annotations

import doctest
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import httpx
from patience import moment

PATIENCE_S = 30.0
FENCE = re.compile(
    r"^(?P<indent> *)```(?P<kind>\w+)(?P<info>[^\n]*)\n(?P<body>.*?)^(?P=indent)```", re.M | re.S
)
PROGRESS = re.compile(r"^[\d,]+ of [\d,]+ .*\(\d+ %\)\n", re.MULTILINE)
TITLE = re.compile(r'title="([^"]+)"')
READS = re.compile(
    r"semap (events|query now|query list|door list|track list|job|doctor)|curl -s[^d]* 'http|mosquitto_sub"
)
PORT = "8000"
UP = "semap up"


@dataclass(frozen=True)
class Block:
    """A fenced block, and the line of the page on which it begins."""

    kind: str
    title: str | None
    body: str
    line: int


@dataclass(frozen=True)
class Command:
    """What is typed, and what it prints."""

    typed: str
    shown: str
    line: int


def blocks(page: str) -> Iterator[Block]:
    for found in FENCE.finditer(page):
        indent = found["indent"]
        body = "".join(line.removeprefix(indent) for line in found["body"].splitlines(keepends=True))
        title = TITLE.search(found["info"])
        yield Block(found["kind"], title and title[1], body, page.count("\n", 0, found.start()) + 1)


def commands(block: Block) -> Iterator[Command]:
    typed: list[str] = []
    shown: list[str] = []
    begun = block.line
    for number, line in enumerate(block.body.splitlines(), block.line + 1):
        if line.startswith("$ "):
            if typed:
                yield Command("\n".join(typed), "\n".join(shown), begun)
            typed, shown, begun = [line[2:]], [], number
        elif typed and typed[-1].endswith("\\") and not shown:
            typed.append(line)
        else:
            assert typed, f"line {number}: output of no command"
            shown.append(line)
    if typed:
        yield Command("\n".join(typed), "\n".join(shown), begun)


def matches(shown: str, printed: str) -> bool:
    """Whether what is shown of an output is true of it, but for spaces at the ends of lines and how far long work was."""
    printed = PROGRESS.sub("", printed)
    wanted = [line.rstrip() for line in shown.strip("\n").splitlines()]
    parts = []
    for line in wanted:
        if line.strip() == "...":
            parts.append(r"(?:[^\n]*\n)*?")
        else:
            parts.append(r"[^\n]*?".join(re.escape(piece) for piece in line.split("...")) + r"[ \t]*\n")
    return (
        re.fullmatch(
            "".join(parts), "".join(f"{line.rstrip()}\n" for line in printed.strip("\n").splitlines())
        )
        is not None
    )


@dataclass
class Session:
    """A reader who follows a page in a folder, with a service on a port of its own."""

    folder: Path
    port: int
    environment: Mapping[str, str]
    patience_s: float = 4 * PATIENCE_S

    def follow(self, page: Path) -> None:
        """Do all that a page says.

        raises  AssertionError where something prints what the page does not show
        """
        with self.following(page):
            pass

    @contextmanager
    def following(self, page: Path) -> Iterator[None]:
        """The same; its other terminals stay open meanwhile."""
        names: dict[str, object] = {}
        with ExitStack() as terminals:
            for block in blocks(page.read_text()):
                where = f"{page.name}, line {block.line}"
                if block.kind == "pycon":
                    self._python(block, where, names)
                elif block.kind == "console" and block.title is not None:
                    for command in commands(block):
                        self._keep_running(command, page.name, terminals)
                elif block.kind == "console":
                    for command in commands(block):
                        self._run(command, page.name)
                elif block.title is not None:
                    (self.folder / block.title).write_text(block.body)
            yield

    def _run(self, command: Command, page: str) -> None:
        deadline_s = time.monotonic() + self.patience_s
        while True:
            ran = subprocess.run(
                ["bash", "-c", self._with_port(command.typed)], cwd=self.folder, env=dict(self.environment),
                stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=10 * PATIENCE_S, check=False,
            )  # fmt: skip
            is_told = ran.returncode == 0 or "semap: " in command.shown
            if is_told and matches(self._with_port(command.shown), ran.stdout):
                return
            if not READS.match(command.typed) or time.monotonic() > deadline_s:
                break
            moment()
        raise AssertionError(_difference(page, command, ran.stdout))

    def _keep_running(self, command: Command, page: str, terminals: ExitStack) -> None:
        printed = terminals.enter_context(tempfile.TemporaryFile("w+"))  # noqa: SIM115  (it is entered)
        process = subprocess.Popen(
            ["bash", "-c", f"exec {self._with_port(command.typed)}"], cwd=self.folder, env=dict(self.environment),
            stdout=printed, stderr=subprocess.STDOUT, text=True, start_new_session=True,
        )  # fmt: skip
        terminals.callback(_end, process)
        deadline_s = time.monotonic() + self.patience_s
        while True:
            is_over = process.poll() is not None
            printed.seek(0)
            said = printed.read()
            is_told = matches(self._with_port(command.shown) + "\n...", said)
            if is_told and (not command.typed.startswith(UP) or self._answers()):
                return
            if is_over or time.monotonic() > deadline_s:
                raise AssertionError(_difference(page, command, said))
            moment()

    def _answers(self) -> bool:
        try:
            return httpx.get(f"http://127.0.0.1:{self.port}/health", timeout=self.patience_s).is_success
        except httpx.TransportError:
            return False

    def _python(self, block: Block, where: str, names: dict[str, object]) -> None:
        flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE | doctest.IGNORE_EXCEPTION_DETAIL
        test = doctest.DocTestParser().get_doctest(
            self._with_port(block.body), names, where, where, block.line
        )
        said: list[str] = []
        before = Path.cwd()
        os.chdir(self.folder)
        try:
            runner = doctest.DocTestRunner(optionflags=flags, verbose=False)
            runner.run(test, out=said.append, clear_globs=False)
        finally:
            os.chdir(before)
        names.update(test.globs)
        assert runner.failures == 0, "".join(said)

    def _with_port(self, text: str) -> str:
        return text.replace(f":{PORT}", f":{self.port}")


def environment(**more: str) -> dict[str, str]:
    """As a reader has it: `semap` among the programs, a terminal of the usual width, no colours."""
    programs = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    kept = {name: value for name, value in os.environ.items() if not name.startswith("SEMAP_")}
    return {**kept, "PATH": programs, "COLUMNS": "110", "NO_COLOR": "1", **more}


def _end(process: subprocess.Popen[str]) -> None:
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGTERM)
        try:
            process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def _difference(page: str, command: Command, printed: str) -> str:
    return f"{page}, line {command.line}: {command.typed}\n--- shown\n{command.shown}\n--- printed\n{printed}"
