"""The server's settings, as semap.conf says them."""

from collections.abc import Mapping
from pathlib import Path

SETTINGS = {
    "cluster_name": "semap",
    "listen_addresses": "",
    "port": "5432",
    "unix_socket_permissions": "0700",
    "wal_level": "logical",
    "max_replication_slots": "32",
    "max_wal_senders": "32",
    # A consumer that never comes back must not fill the disk.
    "max_slot_wal_keep_size": "16GB",
    "max_wal_size": "4GB",
    "shared_buffers": "256MB",
    # Compiling costs more than it saves for the short statements that arrive all the time.
    "jit": "off",
    "timezone": "UTC",
    "log_timezone": "UTC",
    "lc_messages": "C",
    "logging_collector": "off",
    "log_destination": "stderr",
    "log_line_prefix": "%m [%p] %q%u@%d %a ",
}


def settings_file(socket_folder: Path, extra: Mapping[str, str]) -> str:
    """`extra` wins over semap's own; values are quoted here."""
    # The server reads a list of folders, in which only a quoted name may hold a comma.
    quoted_folder = '"' + str(socket_folder).replace('"', '""') + '"'
    settings = {**SETTINGS, "unix_socket_directories": quoted_folder, **extra}
    lines = [f"{name} = {_quoted(value)}" for name, value in settings.items()]
    return "\n".join(["# Written by semap at each start: a change made here is lost.", *lines, ""])


def _quoted(value: str) -> str:
    return "'" + value.replace("\\", "\\\\").replace("'", "''") + "'"
