import os
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import psycopg
import pytest

CHECKOUT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    build = [
        sys.executable,
        "-m",
        "build",
        "--wheel",
        "--no-isolation",
        "--outdir",
        str(folder),
        str(CHECKOUT),
    ]
    subprocess.run(build, check=True, capture_output=True, text=True)
    [built] = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Python of an environment that holds the wheel and borrows everything else from this one."""
    environment = tmp_path_factory.mktemp("installed") / "venv"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(environment)], check=True)
    python = environment / "bin" / "python"
    uv = Path(sys.executable).parent / "uv"
    command = [uv, "pip", "install", "--offline", "--no-deps", "--python", python, wheel]
    subprocess.run(command, check=True, capture_output=True, text=True)
    # Only the folder is borrowed: its own .pth files, which lead to the checkout, are not read from here.
    [packages] = (environment / "lib").glob("python*/site-packages")
    (packages / "borrowed.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return python


def run(installed: Path, cwd: Path, *command: str, **variables: str) -> subprocess.CompletedProcess[str]:
    environment = {
        name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "SEMAP"))
    }
    return subprocess.run(
        [str(installed.parent / command[0]), *command[1:]],
        cwd=cwd,
        env=environment | variables,
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_wheel_holds_the_schema(wheel: Path) -> None:
    held = set(zipfile.ZipFile(wheel).namelist())
    behaviour = {f"semap/schema/{file.relative_to(CHECKOUT)}" for file in (CHECKOUT / "sql").rglob("*.sql")}
    state = {
        f"semap/schema/migrations/{file.relative_to(CHECKOUT / 'migrations')}"
        for file in (CHECKOUT / "migrations").rglob("*.*")
        if file.suffix in {".py", ".sql"}
    }
    assert behaviour
    assert state
    assert behaviour | state <= held
    tops = {name.split("/")[0] for name in held if ".dist-info/" not in name}
    assert tops == {"semap", "semap_ingest", "semap_bridge", "semap_service"}


def test_the_wheel_holds_what_perception_reads(wheel: Path) -> None:
    held = set(zipfile.ZipFile(wheel).namelist())
    ingest, service = CHECKOUT / "ingest", CHECKOUT / "service"
    for root, pattern, count in ((ingest, "semap_ingest/models/*.onnx", 2),
                                 (ingest, "semap_ingest/models/*.jpg", 1),
                                 (ingest, "semap_ingest/simulation/office.yaml", 1),
                                 (service, "semap_service/evaluation/office_rules/*.yaml", 7),
                                 (service, "semap_service/demo/*.csv", 2)):  # fmt: skip
        wanted = {str(file.relative_to(root)) for file in root.glob(pattern)}
        assert len(wanted) == count
        assert wanted <= held


def test_it_runs_outside_of_the_checkout(installed: Path, tmp_path: Path) -> None:
    outcome = run(installed, tmp_path, "python", "-c", "import semap; print(semap.__file__)")
    assert Path(outcome.stdout.strip()).is_relative_to(installed.parents[1])
    helped = run(installed, tmp_path, "semap", "--help")
    assert helped.returncode == 0, helped.stderr
    assert "migrate" in run(installed, tmp_path, "semap", "db", "--help").stdout


def test_it_makes_its_schema(installed: Path, tmp_path: Path, empty_database: str) -> None:
    for _ in ("once", "and again without a change"):
        outcome = run(installed, tmp_path, "semap", "db", "migrate", SEMAP_DSN=empty_database)
        assert outcome.returncode == 0, outcome.stderr
    with psycopg.connect(empty_database) as session:
        tables = session.execute("select to_regclass('semap.map'), to_regclass('semap.track_now')").fetchone()
    assert tables is not None
    assert None not in tables


def test_the_wheel_holds_the_page_where_it_is_built(wheel: Path) -> None:
    files = CHECKOUT / "service" / "semap_service" / "page_files"
    if not (files / "index.html").is_file():
        pytest.skip("there is no built page: ./dev page, with Node.js 20.19 or newer")
    held = set(zipfile.ZipFile(wheel).namelist())
    wanted = {
        str(file.relative_to(CHECKOUT / "service"))
        for file in files.rglob("*")
        if file.suffix in (".html", ".js", ".css")
    }
    assert len(wanted) > 2
    assert wanted <= held
    assert not [name for name in held if "node_modules" in name or name.endswith((".ts", ".tsx"))]
