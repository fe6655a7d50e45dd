"""Folders of a user's project that are called like ours hide nothing of surefoot."""

import os
import sys
from pathlib import Path

from tests.processes import run_process

ROOT = Path(__file__).parents[2]
CODE = "import services, schemas, surefoot.services.walker.service as w, surefoot.schemas.topics; print(w.SERVICE.name)"


def test_packages_of_the_same_names_live_beside_ours(tmp_path: Path) -> None:
    for name in ("services", "schemas", "lab"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").touch()
    environment = {**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}
    done = run_process([sys.executable, "-c", CODE], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.stdout == "walker\n", done.stderr
