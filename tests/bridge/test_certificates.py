"""A client's certificate that a broker does not take: the bridge says so, waits, and takes a new one."""

from __future__ import annotations

import json
import logging
import re
import shutil
import ssl
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml
from bridging import config, report, running
from making import make_events
from mosquitto import broker, needs_mosquitto
from nats_server import serving
from patience import until
from semap_bridge.config import read_config
from semap_service.processes.port import free_port
from world import World

from bench.kafka.broker import KafkaMissing, running_broker

TLS = {"ca_file": "ca.pem", "certificate_file": "client.pem", "key_file": "client.key"}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """With an authority, a server's certificate, and a client's: expired, renewed, and of nobody known."""
    if shutil.which("openssl") is None:
        pytest.skip("there is no openssl: apt-get install openssl")
    _openssl(tmp_path, "req", "-x509", *NEW_KEY, "-keyout", "ca.key", "-out", "ca.pem", "-subj", "/CN=ca")
    (tmp_path / "names").write_text("subjectAltName=IP:127.0.0.1,DNS:localhost\n")
    for name in ("server", "client"):
        _openssl(
            tmp_path, "req", *NEW_KEY, "-keyout", f"{name}.key", "-out", f"{name}.csr", "-subj", f"/CN={name}"
        )
    _openssl(
        tmp_path, "req", "-x509", *NEW_KEY, "-keyout", "other.key", "-out", "other.pem", "-subj", "/CN=client"
    )
    (tmp_path / "ca.conf").write_text(AUTHORITY)
    (tmp_path / "issued").touch()
    for csr, out, dates in (
        ("server", "server", NOW),
        ("client", "client", PAST),
        ("client", "renewed", NOW),
    ):
        _openssl(
            tmp_path, "ca", "-batch", "-notext", "-config", "ca.conf", "-extfile", "names", *dates,
            "-in", f"{csr}.csr", "-out", f"{out}.pem",
        )  # fmt: skip
    return tmp_path


NEW_KEY = ("-newkey", "rsa:2048", "-nodes")
AUTHORITY = """
[ca]
default_ca = own
[own]
certificate = ca.pem
private_key = ca.key
database = issued
unique_subject = no
new_certs_dir = .
rand_serial = yes
default_md = sha256
policy = any
[any]
commonName = supplied
"""
NOW, PAST = ("-days", "2"), ("-startdate", "20200101000000Z", "-enddate", "20200102000000Z")


def _openssl(folder: Path, *arguments: str) -> None:
    subprocess.run(["openssl", *arguments], cwd=folder, check=True, capture_output=True)


@contextmanager
def mqtt(folder: Path) -> Iterator[dict[str, Any]]:
    files = "".join(
        f"{name} {folder}/{file}\n"
        for name, file in (("cafile", "ca.pem"), ("certfile", "server.pem"), ("keyfile", "server.key"))
    )
    with broker(folder, f"allow_anonymous true\nrequire_certificate true\n{files}") as made:
        at = {"host": "localhost", "port": made.port, "tls": TLS}
        yield {"kind": "mqtt", "broker": at, "write": "events"}


@contextmanager
def nats(folder: Path) -> Iterator[dict[str, Any]]:
    files = f'cert_file: "{folder}/server.pem", key_file: "{folder}/server.key", ca_file: "{folder}/ca.pem"'
    shown = ssl.create_default_context(cafile=folder / "ca.pem")
    shown.load_cert_chain(folder / "renewed.pem", folder / "client.key")
    with serving(folder, f"tls {{ {files}, verify: true }}\n", tls=shown) as server:
        yield {"kind": "nats", "servers": server.url, "events": "events", "tls": TLS}


@contextmanager
def kafka(folder: Path) -> Iterator[dict[str, Any]]:
    (folder / "both.pem").write_text(
        (folder / "server.key").read_text() + (folder / "server.pem").read_text()
    )
    port = free_port()
    more = {
        "ssl.keystore.type": "PEM",
        "ssl.keystore.location": str(folder / "both.pem"),
        "ssl.truststore.type": "PEM",
        "ssl.truststore.location": str(folder / "ca.pem"),
        "ssl.client.auth": "required",
    }
    try:
        with running_broker(folder, until, more, {"SSL": port}):
            yield {"kind": "kafka", "servers": f"127.0.0.1:{port}", "events": "events", "tls": TLS}
    except KafkaMissing as missing:
        pytest.skip(str(missing))


# paho leaves the socket of a handshake that failed to the garbage collector
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("peer", [pytest.param(mqtt, marks=needs_mosquitto), nats, kafka])
def test_a_certificate_that_is_not_taken_is_told_and_a_new_one_is_taken(
    world: World, folder: Path, peer: Any, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    key = (folder / "client.key").read_text()
    with peer(folder) as settings:
        said = {"name": "lines", "from_start": True, **settings}
        one = read_config(config(folder, yaml.safe_dump([said]))).bridges[0]
        make_events(world, 3)
        with running(world, one):
            until(lambda: "client.pem is valid from" in trouble(world), lambda: trouble(world))
            for kind in ("key", "pem"):
                shutil.copy(folder / f"other.{kind}", folder / f"client.{kind}")
            until(lambda: re.search("ssl|certificate unknown", trouble(world), re.I), lambda: trouble(world))
            assert report(world)["delivered"] == 0
            (folder / "client.key").write_text(key)
            shutil.copy(folder / "renewed.pem", folder / "client.pem")
            until(lambda: report(world)["delivered"] == 3, lambda: trouble(world))
    told = caplog.text + json.dumps(report(world))
    assert not [each for each in key.splitlines()[1:-1] if each in told]


def trouble(world: World) -> str:
    return str(report(world)["trouble"])
