"""The wheel works away from the checkout: built, unpacked into a clean environment, used from another folder."""

import os
import subprocess
import sys
import venv
from pathlib import Path

import pytest

from tests.processes import run_process

ROOT = Path(__file__).parents[2]

pytestmark = pytest.mark.e2e


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment with the wheel; its dependencies are those of this one, found by a path file."""
    folder = tmp_path_factory.mktemp("wheel")
    build = "from setuptools.build_meta import build_wheel; import sys; build_wheel(sys.argv[1])"
    source = folder / "source"
    run_process(["git", "clone", "-q", "--depth", "1", f"file://{ROOT}", str(source)], check=True)
    run_process([sys.executable, "-c", build, str(folder)], cwd=source, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    environment = folder / "env"
    venv.create(environment, with_pip=False, symlinks=True)
    (site,) = environment.glob("lib/python*/site-packages")
    here = next(path for path in sys.path if path.endswith("site-packages"))
    install = "import sys, zipfile; zipfile.ZipFile(sys.argv[1]).extractall(sys.argv[2])"
    run_process([sys.executable, "-c", install, str(wheel), str(site)], check=True)
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
