"""A broker that wants a password over TLS: both are of files, read again at each try, and in no log."""

from __future__ import annotations

import json
import logging
import shutil
import subprocess
from pathlib import Path

import pytest
from bridging import report, running
from making import make_events
from patience import until
from semap_service.processes.port import free_port
from topics import Topics, entry
from world import World

from bench.kafka.broker import KafkaMissing, running_broker

SECRET, STALE = "hush-1234", "stale-9876"
PLAIN = "org.apache.kafka.common.security.plain.PlainLoginModule required"


def certificate(folder: Path) -> None:
    """Of 127.0.0.1, signed by itself, with its key, as PEM."""
    if shutil.which("openssl") is None:
        pytest.skip("there is no openssl: apt-get install openssl")
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-keyout", "key.pem",
         "-out", "ca.pem", "-subj", "/CN=127.0.0.1", "-addext", "subjectAltName=IP:127.0.0.1"],
        cwd=folder, check=True, stderr=subprocess.PIPE,
    )  # fmt: skip
    (folder / "both.pem").write_text((folder / "key.pem").read_text() + (folder / "ca.pem").read_text())


def test_passwords_and_certificates_are_of_files_and_in_no_log(
    world: World, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    certificate(tmp_path)
    port = free_port()
    more = {
        "ssl.keystore.type": "PEM",
        "ssl.keystore.location": str(tmp_path / "both.pem"),
        "listener.name.sasl_ssl.sasl.enabled.mechanisms": "PLAIN",
        "listener.name.sasl_ssl.plain.sasl.jaas.config": f'{PLAIN} user_semap="{SECRET}";',
    }
    try:
        with running_broker(tmp_path, until, more, {"SASL_SSL": port}) as broker:
            topics = Topics(broker)
            out = topics.name("events")
            (tmp_path / "password").write_text(STALE)
            login = {"user": "semap", "password_file": "password", "mechanism": "PLAIN"}
            one = entry(
                tmp_path, broker, servers=f"127.0.0.1:{port}", events=out, from_start=True, login=login,
                tls={"ca_file": "trusted.pem"},
            )  # fmt: skip
            made = make_events(world, 3)
            with running(world, one):
                until(lambda: "trusted.pem" in told(world), lambda: told(world))
                subprocess.run(
                    ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-keyout",
                     "other.pem", "-out", "trusted.pem", "-subj", "/CN=other"],
                    cwd=tmp_path, check=True, stderr=subprocess.PIPE,
                )  # fmt: skip
                until(lambda: "certificate" in told(world), lambda: told(world))
                shutil.copy(tmp_path / "ca.pem", tmp_path / "trusted.pem")
                until(lambda: "uthentication" in told(world), lambda: told(world))
                (tmp_path / "password").write_text(f"{SECRET}\n")
                until(lambda: topics.count(out) == 3, lambda: told(world))
            assert [each["id"] for each in topics.events(out)] == made
    except KafkaMissing as missing:
        pytest.skip(str(missing))
    said = caplog.text + json.dumps(report(world))
    assert SECRET not in said
    assert STALE not in said


def told(world: World) -> str:
    return world.one("select coalesce(max(trouble), '') from semap.bridge where name = 'lines'")
