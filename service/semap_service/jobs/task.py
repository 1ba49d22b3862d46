"""What the process of a job is told, in JSON by its standard input: no list of processes shows that."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

from semap.store.operate.jobs import Kind
from semap_service.context.caller import Caller


@dataclass(frozen=True)
class Task:
    """A job to be done, and for whom.

    file         as its sender calls it
    path         where it waits
    options      what else was said with it, by kind
    author       who signs in the history of the map, and why: `message`
    shard_dsn    the database where its map is, if that is another one
    service_pid  the process that the job ends with
    """

    dsn: str
    job_id: int
    kind: Kind
    file: str
    path: Path
    caller: Caller
    author: str
    message: str = ""
    if_match: str | None = None
    options: Mapping[str, object] = field(default_factory=dict)
    shard_dsn: str | None = None
    service_pid: int = field(default_factory=os.getpid)

    @classmethod
    def from_json(cls, text: str) -> Task:
        read = json.loads(text)
        whose = read["caller"]
        for part in ("scopes", "maps", "map_ids"):
            whose[part] = None if whose[part] is None else frozenset(whose[part])
        return cls(**{**read, "path": Path(read["path"]), "caller": Caller(**whose)})

    def to_json(self) -> str:
        whose = asdict(self.caller)
        for part in ("scopes", "maps", "map_ids"):
            whose[part] = None if whose[part] is None else sorted(whose[part])
        return json.dumps(
            {**vars(self), "path": str(self.path), "caller": whose, "options": dict(self.options)}
        )
