"""The wheel works away from the checkout: built, unpacked into a clean environment, used from another folder."""

import json
import os
import subprocess
import sys
import venv
from pathlib import Path

import pytest

from tests.processes import run_process

ROOT = Path(__file__).parents[2]

pytestmark = pytest.mark.e2e


BUILD = "from setuptools.build_meta import build_wheel; import sys; build_wheel(sys.argv[1])"
UNPACK = "import sys, zipfile; zipfile.ZipFile(sys.argv[1]).extractall(sys.argv[2])"


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clone of the checkout."""
    folder = tmp_path_factory.mktemp("wheel") / "source"
    run_process(["git", "clone", "-q", "--depth", "1", f"file://{ROOT}", str(folder)], check=True)
    return folder


def install(source: Path, wheels: Path, site: Path) -> None:
    """Build the wheel of a folder and unpack it where Python finds it."""
    run_process([sys.executable, "-c", BUILD, str(wheels)], cwd=source, check=True, capture_output=True)
    (wheel,) = wheels.glob("*.whl")
    run_process([sys.executable, "-c", UNPACK, str(wheel), str(site)], check=True)


@pytest.fixture(scope="module")
def installed(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment with the wheel; its dependencies are those of this one, found by a path file."""
    environment = tmp_path_factory.mktemp("installed") / "env"
    venv.create(environment, with_pip=False, symlinks=True)
    (site,) = environment.glob("lib/python*/site-packages")
    here = next(path for path in sys.path if path.endswith("site-packages"))
    install(source, tmp_path_factory.mktemp("core"), site)
    for data in site.glob("surefoot-*.data/data/*"):
        data.rename(environment / data.name)
    (site / "dependencies.pth").write_text(here + "\n")
    return environment


def run(environment: Path, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Runs Python of the environment in an empty folder, away from the checkout."""
    clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    python = environment / "bin" / "python"
    return run_process([str(python), *words], cwd=folder, env=clean, capture_output=True, text=True)


def test_packages_and_data_come_from_the_wheel(installed: Path, tmp_path: Path) -> None:
    code = (
        "import surefoot.schemas.topics, surefoot.robot.reader, surefoot.lab.cli.main as c;"
        "print(surefoot.robot.reader.load_robot('ragno').nj, c.__file__)"
    )
    done = run(installed, tmp_path, "-c", code)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("18 ")
    assert str(installed) in done.stdout


def test_command_line_finds_scenarios_and_systems(installed: Path, tmp_path: Path) -> None:
    done = run(installed, tmp_path, "-m", "surefoot.lab.cli.main", "list")
    assert done.returncode == 0, done.stderr
    assert "rough-terrain" in done.stdout
    assert "ragno" in done.stdout


def test_papers_are_a_distribution_of_their_own(
    installed: Path, source: Path, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    words = ("-m", "surefoot.lab.cli.main", "reproduce", "walas")
    done = run(installed, tmp_path, *words)
    assert done.returncode == 2
    assert done.stderr == "surefoot: the papers are not installed; in a checkout of surefoot: pip install ./papers\n"
    done = run(installed, tmp_path, *words, "--json")
    assert json.loads(done.stdout)["error"]["code"] == "not_installed"
    (site,) = installed.glob("lib/python*/site-packages")
    install(source / "papers", tmp_path_factory.mktemp("papers"), site)
    done = run(installed, tmp_path, *words)
    assert done.returncode == 2
    assert "walas-stability" in done.stderr
