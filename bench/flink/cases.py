"""Asks Flink what it finds, many patterns and streams in one JVM (FlinkCases.java)."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bench.flink.environment import Flink

Item = tuple[int, str, float | None]
"""A row: its stamp [ms], type, and occupants."""

# Most of the work is done once for each pattern, which the second compiler of the JVM makes no faster. Flink
# compiles each query, which needs room. What the JVM has to say would stand among the answers.
JVM = ("-Xmx2g", "-XX:TieredStopAtLevel=1", "-XX:ReservedCodeCacheSize=240m", "-Xlog:disable")

Found = Mapping[str, Sequence[int]]
"""The rows of a match by variable, counted from 1, ascending."""


@dataclass(frozen=True)
class Query:
    """A query with MATCH_RECOGNIZE over %s that gives the stream, and of each variable the rows as a text."""

    sql: str
    variables: tuple[str, ...]

    def as_json(self) -> Mapping[str, object]:
        return {"sql": self.sql, "variables": self.variables}


@dataclass(frozen=True)
class CepPattern:
    """A FlinkCEP pattern, as FlinkPattern.java reads it."""

    document: Mapping[str, object]

    def as_json(self) -> Mapping[str, object]:
        return {"pattern": self.document}


@dataclass(frozen=True)
class Answer:
    """What Flink found in one stream; of a query no timeouts. `error` is what it said instead."""

    matches: tuple[Found, ...] = ()
    timeouts: tuple[Found, ...] = ()
    error: str | None = None


@dataclass(frozen=True)
class Question:
    """A pattern, and streams of rows in each of which it is to be found.

    may_fail  it is asked apart from the others, which is slower
    """

    asked: Query | CepPattern
    streams: tuple[tuple[Item, ...], ...]
    may_fail: bool = False


def ask(flink: Flink, questions: Mapping[str, Question]) -> dict[str, tuple[Answer, ...]]:
    """The answers by the names of the questions, one for each stream.

    raises  RuntimeError with what the JVM said if it did not answer all
    """
    lines = [
        json.dumps(
            {
                "id": name,
                "streams": question.streams,
                "may_fail": question.may_fail,
                **question.asked.as_json(),
            }
        )
        for name, question in questions.items()
    ]
    command = flink.command("FlinkCases", options=JVM)
    done = subprocess.run(command, input="\n".join(lines), capture_output=True, text=True, check=False)
    answers: dict[str, tuple[Answer, ...]] = {}
    for line in done.stdout.splitlines():
        said = json.loads(line)
        name = said["id"]
        if "error" in said:
            answers[name] = (Answer(error=said["error"]),) * len(questions[name].streams)
        else:
            answers[name] = tuple(
                Answer(tuple(stream["matches"]), tuple(stream["timeouts"])) for stream in said["streams"]
            )
    if done.returncode or answers.keys() != questions.keys():
        raise RuntimeError(f"Flink answered {len(answers)} of {len(questions)}:\n{done.stderr[-3000:]}")
    return answers
