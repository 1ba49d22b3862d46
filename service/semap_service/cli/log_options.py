"""The options of commands that run for long and are looked after by their log."""

from __future__ import annotations

from typing import Annotated

import typer

from semap_service.operations.log_lines import LogFormat, LogLevel

LogFormatOption = Annotated[
    LogFormat,
    typer.Option("--log-format", envvar="SEMAP_LOG_FORMAT", help="Lines of the log for people or programs."),
]
LogLevelOption = Annotated[
    LogLevel | None,
    typer.Option(
        "--log-level",
        envvar="SEMAP_LOG_LEVEL",
        show_default=False,
        help="Write lines from this level on. [default: info with --log-format json, else warning]",
    ),
]
