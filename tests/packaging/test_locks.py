"""locks/: what `./dev` and the image install is always the same, and fits the least Python that is promised."""

from __future__ import annotations

import base64
import hashlib
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).parents[2]
LOCKS = CHECKOUT / "locks"
UV = Path(sys.executable).parent / "uv"


def pins(text: str) -> dict[str, str]:
    """The version of each package."""
    return dict(re.findall(r"^([a-z0-9-]+)==(\S+)", text, re.MULTILINE))


def test_what_the_demo_needs_is_part_of_the_whole_lock() -> None:
    whole, demo = (pins((LOCKS / name).read_text()) for name in ("all.txt", "demo.txt"))
    assert demo.items() < whole.items()
    assert "opencv-python" not in whole
    assert not demo.keys() & {"pytest", "mkdocs", "mypy", "uv"}


def test_every_package_has_hashes_and_no_host() -> None:
    text = (LOCKS / "all.txt").read_text()
    for entry in re.split(r"\n(?=[a-z])", text.strip()):
        assert re.fullmatch(r"[a-z0-9-]+==\S+( ; [^\\\n]+)?( \\\n    --hash=sha256:[0-9a-f]{64})+", entry), (
            entry
        )
    assert "://" not in text + (LOCKS / "demo.txt").read_text()


def wheel(folder: Path, name: str, version: str, *metadata: str) -> str:
    """A wheel without modules; returns its hash."""
    path = folder / f"{name}-{version}-py3-none-any.whl"
    about = f"{name}-{version}.dist-info"
    files = {
        f"{about}/METADATA": "\n".join(
            ["Metadata-Version: 2.1", f"Name: {name}", f"Version: {version}", *metadata, ""]
        ),
        f"{about}/WHEEL": "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    }
    digests = {
        file: base64.urlsafe_b64encode(hashlib.sha256(text.encode()).digest()).rstrip(b"=").decode()
        for file, text in files.items()
    }
    record = "".join(f"{file},sha256={digests[file]},{len(text)}\n" for file, text in files.items())
    with zipfile.ZipFile(path, "w") as archive:
        for file, text in (*files.items(), (f"{about}/RECORD", record + f"{about}/RECORD,,\n")):
            archive.writestr(file, text)
    return hashlib.sha256(path.read_bytes()).hexdigest()


PROJECT = """
[project]
name = "semap"
version = "0"
requires-python = ">=3.11"
dependencies = ["core"]
[project.optional-dependencies]
perception = ["sight>=1"]
docs = ["pymdown-extensions{wanted}"]
[dependency-groups]
build = ["builder"]
dev = ["checker"]
[tool.uv]
no-index = true
find-links = ["packages"]
"""


class Checkout:
    """One with a project of its own, whose packages are in a folder and nowhere else."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.packages = folder / "packages"
        self.packages.mkdir()
        shutil.copytree(LOCKS, folder / "locks", ignore=shutil.ignore_patterns("*.txt"))
        self.want("")
        for name in ("core", "sight", "builder", "checker"):
            wheel(self.packages, name, "1.0")
        wheel(self.packages, "markdown", "3.0")
        needs = "Requires-Dist: markdown>=3"
        wheel(self.packages, "pymdown_extensions", "12.3", "Requires-Python: >=3.9", needs)
        locked = self.lock()
        assert locked.returncode == 0, locked.stderr

    def want(self, version: str) -> None:
        (self.folder / "pyproject.toml").write_text(PROJECT.format(wanted=version))

    def read(self, name: str = "all.txt") -> dict[str, str]:
        return pins((self.folder / "locks" / name).read_text())

    def replace(self, old: str, new: str) -> None:
        path = self.folder / "locks" / "all.txt"
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new))

    def uv(self, *command: object) -> subprocess.CompletedProcess[str]:
        known = {"UV": str(UV), "UV_NO_CACHE": "1"}
        return subprocess.run(list(map(str, command)), env=os.environ | known, cwd=self.folder, text=True,
                              capture_output=True, check=False)  # fmt: skip

    def lock(self, *options: str) -> subprocess.CompletedProcess[str]:
        return self.uv(self.folder / "locks" / "lock.sh", *options)


@pytest.fixture
def checkout(tmp_path: Path) -> Checkout:
    return Checkout(tmp_path)


def refusal(checkout: Checkout) -> str:
    checked = checkout.lock("--check")
    assert checked.returncode == 1
    assert "./dev lock" in checked.stderr.splitlines()[-1]
    return checked.stdout + checked.stderr


def test_a_fresh_lock_passes_and_stays_as_it_is(checkout: Checkout) -> None:
    whole = {
        "builder": "1.0",
        "checker": "1.0",
        "core": "1.0",
        "markdown": "3.0",
        "pymdown-extensions": "12.3",
        "sight": "1.0",
    }
    assert checkout.read() == whole
    assert checkout.read("demo.txt") == {"builder": "1.0", "core": "1.0", "sight": "1.0"}
    wheel(checkout.packages, "core", "2.0")
    assert checkout.lock("--check").returncode == 0
    assert checkout.read() == whole
    assert checkout.lock("--upgrade").returncode == 0
    assert checkout.read() == whole | {"core": "2.0"}
    assert checkout.lock("--check").returncode == 0


def test_a_lock_that_the_least_python_cannot_have_fails(checkout: Checkout) -> None:
    """As pymdown-extensions 13.1 was in it, which wants 3.11.5, while 3.11.0 is promised."""
    digest = wheel(
        checkout.packages,
        "pymdown_extensions",
        "13.1",
        "Requires-Python: >=3.11.5",
        "Requires-Dist: markdown>=3",
    )
    checkout.replace("pymdown-extensions==12.3", "pymdown-extensions==13.1")
    (checkout.folder / "locks" / "all.txt").write_text(
        re.sub(r"(pymdown-extensions==13\.1 \\\n    --hash=sha256:)\w+", rf"\g<1>{digest}",
               (checkout.folder / "locks" / "all.txt").read_text())
    )  # fmt: skip
    told = refusal(checkout)
    assert "Python 3.11, which pyproject.toml promises, cannot have locks/all.txt" in told
    assert "pymdown-extensions==13.1" in told
    assert ">=3.11.5" in told


def test_a_lock_that_lacks_what_its_packages_need_fails(checkout: Checkout) -> None:
    checkout.replace("markdown==3.0", "gone==3.0")
    refusal(checkout)


@pytest.mark.parametrize("wanted", [">=13", "<12"])
def test_a_lock_that_pyproject_has_left_behind_fails(checkout: Checkout, wanted: str) -> None:
    wheel(checkout.packages, "pymdown_extensions", "13.0", "Requires-Dist: markdown>=3")
    wheel(checkout.packages, "pymdown_extensions", "11.0")
    checkout.want(wanted)
    assert "-pymdown-extensions==12.3" in refusal(checkout)
    assert checkout.lock().returncode == 0
    assert checkout.lock("--check").returncode == 0
    assert checkout.read()["pymdown-extensions"] == {">=13": "13.0", "<12": "11.0"}[wanted]


def test_what_has_another_hash_is_not_installed(checkout: Checkout) -> None:
    """As `./dev` installs: the versions of demo.txt, the hashes of all.txt, and nothing is resolved."""
    target = checkout.folder / "target"
    install = (UV, "pip", "install", "--target", target, "--no-deps", "--require-hashes",
               "-c", "locks/all.txt", "-r", "locks/demo.txt")  # fmt: skip
    path = checkout.packages / "sight-1.0-py3-none-any.whl"
    original = path.read_bytes()
    wheel(checkout.packages, "sight", "1.0", "Summary: another")
    refused = checkout.uv(*install)
    assert refused.returncode != 0
    assert "Hash mismatch for `sight==1.0`" in refused.stderr
    path.write_bytes(original)
    assert checkout.uv(*install).returncode == 0
    assert {each.name for each in target.glob("*.dist-info")} == {
        f"{name}-1.0.dist-info" for name in ("builder", "core", "sight")
    }


@pytest.mark.slow
def test_the_lock_of_this_checkout_is_fresh() -> None:
    """As `./dev check` asks; it needs a network."""
    checked = subprocess.run([LOCKS / "lock.sh", "--check"], env=os.environ | {"UV": str(UV)}, text=True,
                             capture_output=True, check=False)  # fmt: skip
    assert checked.returncode == 0, checked.stdout + checked.stderr
