"""Every compose file names services that exist, and can be started by `surefoot up` and by a container engine alike."""

import os
import shutil
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

from surefoot.lockstep.discover import service_names
from surefoot.robot.reader import robot_names
from surefoot.services.supervisor.processes.compose import ComposeError, load_compose
from surefoot.services.supervisor.processes.extends import extended
from tests.processes import run_process

ROOT = Path(__file__).parents[2]
FILES = sorted((ROOT / "compose").glob("*.yaml"))


def read(path: Path) -> Any:
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def test_there_are_some() -> None:
    assert FILES


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_names_services_that_exist(path: Path) -> None:
    compose = load_compose(path)
    assert compose.name == path.stem
    assert set(compose.services) <= set(service_names())
    assert "supervisor" in compose.services
    for service in compose.services.values():
        if service.name != "supervisor":
            assert service.command == ("surefoot-service", service.name)
            assert ("supervisor", "service_healthy") in service.depends_on
            assert service.healthcheck is not None
            assert service.restart != "no"
        assert service.environment["SUREFOOT_ROBOT"] in robot_names()


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_containers_share_the_network_of_the_host(path: Path) -> None:
    """The router listens on loopback only, so every container has to be there."""
    for service in extended(read(path), path, read, ComposeError)["services"].values():
        assert service["network_mode"] == "host"
        assert (ROOT / "compose" / service["build"]["context"] / service["build"]["dockerfile"]).is_file()


def test_every_service_is_in_a_system() -> None:
    assert set(service_names()) == {name for path in FILES for name in load_compose(path).services}


@pytest.mark.parametrize("name", ["up", "down"])
def test_scripts_hand_over_to_the_command(name: str, tmp_path: Path) -> None:
    script = ROOT / "compose" / name
    assert os.access(script, os.X_OK)
    fake = tmp_path / "surefoot"
    fake.write_text('#!/bin/sh\necho "$@"\n')
    fake.chmod(0o755)
    environment = {"PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}
    for given, said in (([], f"{name} ragno"), (["other", "-d"], f"{name} other -d")):
        done = run_process([script, *given], env=environment, capture_output=True, text=True, check=True)
        assert done.stdout.strip() == said


def test_a_script_without_the_environment_says_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "sh").symlink_to(shutil.which("sh") or "/bin/sh")
    for name in ("up", "down"):
        done = run_process([ROOT / "compose" / name], env={"PATH": str(tmp_path)}, capture_output=True, text=True)
        assert done.returncode != 0
        assert "make setup" in done.stderr


def test_scripts_are_plain_shell() -> None:
    if shutil.which("sh") is None:
        pytest.skip("no shell here")
    for name in ("up", "down"):
        run_process(["sh", "-n", ROOT / "compose" / name], check=True)


def test_the_image_holds_what_its_commands_import(tmp_path: Path) -> None:
    lines = (ROOT / "compose" / "Containerfile").read_text(encoding="utf-8").splitlines()
    copied = [name for line in lines if line.startswith("COPY ") for name in line.split()[1:-1]]
    for name in copied:
        if (ROOT / name).is_dir():
            ignored = shutil.ignore_patterns("__pycache__")
            shutil.copytree(ROOT / name, tmp_path / name, symlinks=True, ignore=ignored)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for place in project["scripts"].values():
        module = tmp_path / (place.partition(":")[0].replace(".", "/") + ".py")
        assert module.exists(), place
    for service in service_names():
        assert (tmp_path / "surefoot" / "services" / service / "__init__.py").exists(), service


def test_the_unit_is_one_for_systemd(tmp_path: Path) -> None:
    verify = shutil.which("systemd-analyze")
    if verify is None:
        pytest.skip("no systemd-analyze: apt install systemd")
    text = (ROOT / "compose" / "surefoot@.service").read_text(encoding="utf-8")
    command = tmp_path / "surefoot"
    command.write_text("#!/bin/sh\n")
    command.chmod(0o755)
    assert "ExecStart=%h/.local/bin/surefoot up %i" in text
    unit = tmp_path / "surefoot@ragno.service"
    unit.write_text(text.replace("%h/.local/bin/surefoot", str(command)))
    done = run_process([verify, "verify", "--man=no", str(unit)], capture_output=True, text=True)
    assert "surefoot" not in done.stderr, done.stderr
