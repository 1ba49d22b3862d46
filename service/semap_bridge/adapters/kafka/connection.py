"""How brokers are reached, and what their errors mean to the user."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, TypeAlias

from confluent_kafka import KafkaError, KafkaException
from confluent_kafka.admin import AdminClient

from semap.errors import ServiceUnreachable
from semap_bridge.adapters.kafka.settings import KafkaSettings

ANSWER_S = 10.0
"""So long a broker may take to answer."""
GROUP = "semap"
"""Consumers have to name one; none joins it, since offsets are in the database."""
LARGEST_BYTES = 16 << 20
"""Of a record; the broker's own limit is a megabyte, if it says nothing else."""
Value: TypeAlias = str | int | bool

LOGIN_REMEDY = "Correct `login`; a new password in its file is taken at the next try."
REMEDIES: Mapping[int, str] = {
    KafkaError._AUTHENTICATION: LOGIN_REMEDY,
    KafkaError.SASL_AUTHENTICATION_FAILED: LOGIN_REMEDY,
    KafkaError._SSL: "Correct `tls`: whom to trust (ca_file), and what this client shows.",
    KafkaError.TOPIC_AUTHORIZATION_FAILED: "Let the user read states, write the others, describe all.",
    KafkaError.TRANSACTIONAL_ID_AUTHORIZATION_FAILED: "Let the user write with this transactional id.",
    KafkaError.CLUSTER_AUTHORIZATION_FAILED: "Let the user make topics, or make them.",
    KafkaError.UNKNOWN_TOPIC_OR_PART: "Make the topic, or correct its name.",
    KafkaError._UNKNOWN_TOPIC: "Make the topic, or correct its name.",
    KafkaError.MSG_SIZE_TOO_LARGE: "Raise max.message.bytes of the topic.",
    KafkaError.POLICY_VIOLATION: "Make the topic as your cluster wants it.",
    KafkaError.KAFKA_STORAGE_ERROR: "See that the broker's disk has room.",
}
TELLING = (KafkaError._AUTHENTICATION, KafkaError._SSL, KafkaError.SASL_AUTHENTICATION_FAILED)
"""What says more than that all brokers are away."""
AFTER = re.compile(r" \(after .*")
"""What differs from one try to the next."""
AWAY = "See that the brokers run, that their disks have room, and that `servers` is right."


class Connection:
    """Mutable: what librdkafka said of itself last, in whichever thread.

    raises  ServiceUnreachable where a secret or a certificate cannot be read
    """

    def __init__(self, settings: KafkaSettings) -> None:
        self._servers = settings.servers
        self._config = _config(settings)
        self._told: KafkaError | None = None
        self.admin = AdminClient(self.config())

    def config(self, more: Mapping[str, Value] | None = None) -> dict[str, Any]:
        """Of a client of librdkafka, which says nothing by itself."""
        return {**self._config, **(more or {}), "error_cb": self._hear}

    def topics(self) -> Mapping[str, int]:
        """How many partitions each topic has; raises ServiceUnreachable."""
        try:
            found = self.admin.list_topics(timeout=ANSWER_S).topics
        except KafkaException as error:
            self.admin.poll(0)
            raise self.unreachable(error.args[0]) from error
        return {name: len(topic.partitions) for name, topic in found.items()}

    def is_lost(self) -> bool:
        """Whether all brokers were away, or refused this client, since it was asked last."""
        told, self._told = self._told, None
        return told is not None

    def unreachable(self, error: KafkaError, about: str = "") -> ServiceUnreachable:
        """What to raise for an error, or for what is behind it."""
        told = self._told if self._told is not None and _is_telling(self._told) else error
        where = about or f"Kafka at {self._servers}"
        said = AFTER.sub("", told.str())
        remedy = REMEDIES[KafkaError._SSL] if _is_of_tls(told) else REMEDIES.get(told.code(), AWAY)
        return ServiceUnreachable(f"{where}: {said}.", remedy)

    def _hear(self, error: KafkaError) -> None:
        if error.code() == KafkaError._ALL_BROKERS_DOWN and self._told is not None:
            return
        if error.code() == KafkaError._ALL_BROKERS_DOWN or _is_telling(error):
            self._told = error


def _is_telling(error: KafkaError) -> bool:
    return error.code() in TELLING or _is_of_tls(error)


def _is_of_tls(error: KafkaError) -> bool:
    """Also where a broker hangs up on what it was shown, which librdkafka takes for a lost connection."""
    return error.code() == KafkaError._SSL or (error.code() == KafkaError._TRANSPORT and "SSL" in error.str())


def _config(settings: KafkaSettings) -> dict[str, Value]:
    config: dict[str, Value] = {
        "bootstrap.servers": settings.servers,
        "client.id": f"semap {settings.name}",
        "log_level": 0,
        "reconnect.backoff.max.ms": 2000,
        "message.max.bytes": LARGEST_BYTES,
        "security.protocol": ("SASL_" if settings.login else "") + ("SSL" if settings.tls else "PLAINTEXT"),
    }
    if settings.login is not None:
        config |= {
            "sasl.mechanism": settings.login.mechanism,
            "sasl.username": settings.login.user,
            "sasl.password": settings.login.password(),
        }
    if settings.tls is not None:
        settings.tls.context()  # says which file cannot be used
        files = {
            "ssl.ca.location": settings.tls.ca_file,
            "ssl.certificate.location": settings.tls.certificate_file,
            "ssl.key.location": settings.tls.key_file,
        }
        config |= {name: str(path) for name, path in files.items() if path is not None}
    return config
