"""Where compiled kernels are kept when the installation cannot be written, and when nothing can."""

import os
import shutil
import sys
from pathlib import Path

import pytest

import surefoot
from tests.processes import run_process

PROGRAM = """
import numpy as np
from surefoot.geometry import polygon
from surefoot.kernels.compiling import COMPILING
print(polygon.area(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])), COMPILING.done)
"""


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """A copy of the package that cannot be written, not even by root: files stand where folders are wanted."""
    site = tmp_path / "site"
    source = Path(str(surefoot.__file__)).parent
    shutil.copytree(source, site / source.name, ignore=shutil.ignore_patterns("__pycache__"))
    for folder in [p for p in site.rglob("*") if p.is_dir()]:
        (folder / "__pycache__").write_text("")
        folder.chmod(0o555)
    return site


def run(site: Path, home: Path) -> list[str]:
    env = {k: v for k, v in os.environ.items() if k not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")}
    env |= {"PYTHONPATH": str(site), "HOME": str(home)}
    done = run_process([sys.executable, "-c", PROGRAM], env=env, cwd=home.parent, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_a_read_only_installation_uses_the_users_cache(site: Path, tmp_path: Path) -> None:
    home = tmp_path / "home"
    home.mkdir()
    area, compiled = run(site, home)
    assert float(area) == pytest.approx(0.5)
    assert int(compiled) > 0
    assert any("polygon" in p.name for p in (home / ".cache").rglob("*.nbi"))
    assert run(site, home)[1] == "0", "the second process finds the kernels there"


def test_without_any_place_to_write_kernels_are_compiled_anew(site: Path, tmp_path: Path) -> None:
    home = tmp_path / "home"
    home.write_text("no folder")
    for _ in range(2):
        area, compiled = run(site, home)
        assert float(area) == pytest.approx(0.5)
        assert int(compiled) > 0
