"""Log lines: as text for people, or one JSON object each for programs. No secret gets into either.

A line of JSON has `time` (RFC 3339, UTC), `level`, `logger`, `message`, within a request `request_id`, what
the caller of the logger gave as `extra`, and `error` with the stack where there was one.
"""

from __future__ import annotations

import json
import logging
import sys
from datetime import UTC, datetime
from enum import StrEnum

from semap_service.context.request_id import current_request_id
from semap_service.operations.redaction import redacted

SEMAP_LOGGERS = ("semap", "semap_ingest", "semap_bridge", "semap_service")
CONTROL = {code: f"\\x{code:02x}" for code in (*range(32), 127, 0x85, 0x2028, 0x2029)} | {10: "\\n", 9: "\\t"}
"""What a caller could forge a line of the log with."""

LINE_ENDS = {code: f"\\u{code:04x}" for code in (127, 0x85, 0x2028, 0x2029)}
"""What JSON lets stand in a string though some take it for the end of a line."""

ALWAYS_THERE = {*vars(logging.LogRecord("", 0, "", 0, "", (), None)), "message", "asctime", "taskName"}


class LogFormat(StrEnum):
    """What lines of the log look like."""

    TEXT = "text"
    JSON = "json"


class LogLevel(StrEnum):
    """From which level on lines are written."""

    DEBUG = "debug"
    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


class TextLines(logging.Formatter):
    """Time, logger, message, and the id of the request; a stack follows on lines of its own."""

    def format(self, record: logging.LogRecord) -> str:
        time = datetime.fromtimestamp(record.created, UTC)
        request = current_request_id()
        parts = [
            f"{time:%H:%M:%S}",
            f"{record.name}:",
            record.getMessage().translate(CONTROL),
            f"[{request}]" if request else "",
        ]
        line = " ".join(part for part in parts if part)
        stack = _stack(self, record)
        return redacted(f"{line}\n{stack}" if stack else line)


class JsonLines(logging.Formatter):
    """One JSON object a line."""

    def format(self, record: logging.LogRecord) -> str:
        time = datetime.fromtimestamp(record.created, UTC)
        line: dict[str, object] = {
            "time": time.isoformat(timespec="milliseconds").replace("+00:00", "Z"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": redacted(record.getMessage()),
        }
        if request := current_request_id():
            line["request_id"] = request
        for name, value in vars(record).items():
            if name not in ALWAYS_THERE and name not in line:
                line[name] = redacted(value) if isinstance(value, str) else value
        if stack := _stack(self, record):
            line["error"] = redacted(stack)
        written = json.dumps(line, default=lambda value: redacted(str(value)), ensure_ascii=False)
        return written.translate(LINE_ENDS)


def write_log(form: LogFormat, level: LogLevel | None) -> None:
    """Let all loggers of this process write such lines to its standard error.

    level  of semap's own; None: info for programs, and as it is for people. Others' say warnings and worse.
    """
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(JsonLines() if form == LogFormat.JSON else TextLines())
    logging.root.handlers[:] = [handler]
    logging.root.setLevel(logging.WARNING)
    if level is None and form == LogFormat.TEXT:
        return
    for name in SEMAP_LOGGERS:
        logging.getLogger(name).setLevel((level or LogLevel.INFO).upper())


def _stack(formatter: logging.Formatter, record: logging.LogRecord) -> str:
    parts = []
    if record.exc_info:
        parts.append(formatter.formatException(record.exc_info))
    if record.stack_info:
        parts.append(formatter.formatStack(record.stack_info))
    return "\n".join(parts)
