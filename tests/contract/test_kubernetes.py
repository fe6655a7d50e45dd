"""The manifest for Kubernetes is made from the compose file, and `kubectl` knows each of its fields."""

import shutil
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from surefoot.services.supervisor.processes.compose import load_compose
from tests.processes import run_process

ROOT = Path(__file__).parents[2]
MANIFEST = ROOT / "compose" / "kubernetes" / "ragno.yaml"


def manifest() -> Any:
    return yaml.safe_load(MANIFEST.read_text(encoding="utf-8"))


def test_the_manifest_for_kubernetes_is_that_of_the_compose_file() -> None:
    made = run_process([sys.executable, ROOT / "scripts" / "kubernetes.py"], capture_output=True, text=True, check=True)
    assert made.stdout == MANIFEST.read_text(encoding="utf-8")
    names = [one["name"] for one in manifest()["spec"]["template"]["spec"]["containers"]]
    assert names == list(load_compose(ROOT / "compose" / "ragno.yaml").services)


def test_kubectl_knows_every_field_of_the_manifest() -> None:
    """Offline: `--local` reads the file into the types of the interface, and writes what these hold."""
    kubectl = shutil.which("kubectl")
    if kubectl is None:
        pytest.skip("no kubectl: apt install kubectl, or https://kubernetes.io/docs/tasks/tools")
    words = ["set", "image", "--local", "-f", str(MANIFEST), "supervisor=surefoot:other", "-o", "yaml"]
    done = run_process([kubectl, *words], capture_output=True, text=True, check=True)
    ours, known = manifest(), yaml.safe_load(done.stdout)
    ours["spec"]["template"]["spec"]["containers"][0]["image"] = "surefoot:other"
    assert lost(ours, known) == []


def lost(ours: Any, known: Any, at: str = "") -> list[str]:
    """Return the places of values that another document does not hold."""
    if isinstance(ours, dict) and isinstance(known, dict):
        return [place for key, value in ours.items() for place in lost(value, known.get(key), f"{at}.{key}")]
    if isinstance(ours, list) and isinstance(known, list) and len(ours) == len(known):
        return [place for n, (a, b) in enumerate(zip(ours, known, strict=True)) for place in lost(a, b, f"{at}[{n}]")]
    return [] if ours == known else [at]
