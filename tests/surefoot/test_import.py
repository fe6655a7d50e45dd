"""Packages that an import loads: ours beside folders of the same names, and of the wire the files of its own topics."""

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


def test_a_client_imports_the_messages_of_its_own_topics() -> None:
    code = (
        "import sys, surefoot.client as c; print(c.topic_named('state/gait').model.__module__);"
        "print(*sorted(name for name in sys.modules if name.startswith('surefoot.schemas.')))"
    )
    done = run_process([sys.executable, "-c", code], capture_output=True, text=True)
    module, loaded = done.stdout.splitlines()
    assert module == "surefoot.schemas.state"
    files = ("base", "hw", "rows", "state", "topics")  # hw: a landmark as seen stands in both
    assert loaded.split() == [f"surefoot.schemas.{file}" for file in files]
