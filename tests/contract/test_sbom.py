"""The bill of materials names each pinned package with its sums, and licences of all that are installed."""

import json
import re
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest

from surefoot import __version__
from tests.processes import run_process

ROOT = Path(__file__).parents[2]
LOCK = ROOT / "requirements.lock"


@pytest.fixture(scope="module")
def bill() -> dict[str, Any]:
    command = [sys.executable, ROOT / "scripts" / "sbom.py"]
    return json.loads(run_process(command, capture_output=True, text=True, check=True).stdout)


def test_it_has_the_form_of_cyclonedx(bill: dict[str, Any]) -> None:
    assert (bill["bomFormat"], bill["specVersion"], bill["version"]) == ("CycloneDX", "1.6", 1)
    assert bill["metadata"]["component"]["version"] == __version__
    assert bill["metadata"]["component"]["licenses"] == [{"expression": "Apache-2.0"}]
    references = [one["bom-ref"] for one in bill["components"]]
    assert len(set(references)) == len(references)
    assert bill["dependencies"] == [{"ref": "surefoot", "dependsOn": references}]
    for one in bill["components"]:
        assert one["type"] == "library"
        assert re.fullmatch(r"pkg:pypi/[a-z0-9-]+@[0-9][^@]*", one["purl"]), one["purl"]


def test_it_is_the_lock_file(bill: dict[str, Any]) -> None:
    text = LOCK.read_text(encoding="utf-8")
    pinned = re.findall(r"^([\w.-]+)==([^\s;]+)", text, re.MULTILINE)
    assert [(one["name"], one["version"]) for one in bill["components"]] == pinned
    sums = [each["content"] for one in bill["components"] for each in one["hashes"]]
    assert sums == re.findall(r"--hash=sha256:([0-9a-f]{64})", text)
    assert all(one["hashes"] for one in bill["components"])


def test_every_installed_package_has_a_licence(bill: dict[str, Any]) -> None:
    here = {dist.metadata["Name"].lower().replace("_", "-"): dist.version for dist in metadata.distributions()}
    without = [
        one["name"] for one in bill["components"] if here.get(one["name"]) == one["version"] and not one.get("licenses")
    ]
    assert without == []
