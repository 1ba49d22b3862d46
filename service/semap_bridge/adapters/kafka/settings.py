"""What the config says of Kafka."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from semap_bridge import adapter
from semap_bridge.secret import Login, Tls

Topic = Annotated[str, Field(pattern=r"^[A-Za-z0-9._-]{1,249}$")]


class KafkaLogin(Login):
    """How semap logs in (SASL)."""

    mechanism: Literal["PLAIN", "SCRAM-SHA-256", "SCRAM-SHA-512"] = Field(
        default="SCRAM-SHA-512", description="As the broker expects it."
    )


class KafkaSettings(adapter.Settings):
    """Which topics, and how the brokers are reached."""

    servers: str = Field(
        pattern=r"^[^\s,]+:[0-9]{1,5}(,[^\s,]+:[0-9]{1,5})*$",
        description="Addresses of brokers, such as broker1:9092,broker2:9092.",
    )
    states: Topic | None = Field(default=None, description="Topic that states are read from.")
    begin: Literal["oldest", "newest"] = Field(
        default="oldest", description="Where to begin in it when the bridge runs for the first time."
    )
    events: Topic | None = Field(default=None, description="Topic that events are written to.")
    changes: Topic | None = Field(default=None, description="Topic that changes of relations are written to.")
    cursors: Topic | None = Field(
        default=None,
        description="Topic of cursors, which is compacted. [default: the events' or changes' with .cursor]",
    )
    transactional_id: str | None = Field(
        default=None,
        min_length=1,
        max_length=200,
        description="One for each bridge that writes. [default: semap.MAP.NAME]",
    )
    login: KafkaLogin | None = Field(default=None, description="User, password_file and mechanism (SASL).")
    tls: Tls | None = Field(default=None, description="ca_file, certificate_file, key_file; {} for defaults.")

    @model_validator(mode="after")
    def _require_something(self) -> KafkaSettings:
        if not any((self.states, self.events, self.changes)):
            raise ValueError("give states, events or changes: the names of topics")
        given = [each for each in (self.states, self.events, self.changes, self.cursors) if each is not None]
        if len(set(given)) < len(given):
            raise ValueError("give each of states, events, changes and cursors a topic of its own")
        return self
