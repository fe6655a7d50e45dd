"""Bill of materials of the pinned packages, CycloneDX 1.6 as JSON: `python scripts/sbom.py [LOCK FILE]` prints it.

Names, versions and sha256 sums are those of the lock file; licences those that the installed packages declare. A
package that this machine does not need (another system, another Python) has no licence here.
"""

import json
import re
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

from surefoot.version import VERSION

ROOT = Path(__file__).parents[1]
_ENTRY = re.compile(r"^(?P<name>[A-Za-z0-9._-]+)==(?P<version>[^ ;\\]+)(?: ; (?P<marker>[^\\]+?))? ?\\?$")
_SUM = re.compile(r"^ +--hash=sha256:([0-9a-f]{64})")
_LONGEST_NAME = 60
"""Longest text that is taken as the name of a licence; some packages put the whole licence there."""
_CLASSIFIER = "License :: OSI Approved :: "


def components(lock: Path) -> list[dict[str, Any]]:
    """Return the packages of a lock file with hashes."""
    found: list[dict[str, Any]] = []
    for line in lock.read_text(encoding="utf-8").splitlines():
        if match := _ENTRY.match(line):
            name, version, marker = match["name"], match["version"], match["marker"]
            purl = f"pkg:pypi/{name}@{version}"
            one: dict[str, Any] = {"type": "library", "bom-ref": purl, "name": name, "version": version, "purl": purl}
            if licences := licences_of(name, version):
                one["licenses"] = licences
            if marker:
                one["properties"] = [{"name": "surefoot:marker", "value": marker}]
            found.append(one | {"hashes": []})
        elif match := _SUM.match(line):
            found[-1]["hashes"].append({"alg": "SHA-256", "content": match[1]})
    return found


def licences_of(name: str, version: str) -> list[dict[str, Any]]:
    """Return the licences that an installed package declares, none where this version is not installed."""
    try:
        about: Any = metadata.metadata(name)
    except metadata.PackageNotFoundError:
        return []
    if about["Version"] != version:
        return []
    if expression := about.get("License-Expression"):
        return [{"expression": expression}]
    classified = [text for text in about.get_all("Classifier", []) if text.startswith(_CLASSIFIER)]
    names = [text.removeprefix(_CLASSIFIER) for text in classified] or [(about.get("License") or "").strip()]
    return [{"license": {"name": one}} for one in names if 0 < len(one) <= _LONGEST_NAME]


def bill(lock: Path) -> dict[str, Any]:
    """Return the bill of materials of a lock file."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    licence = re.search(r'^license = "(.+)"$', text, re.MULTILINE)
    ours: dict[str, Any] = {"type": "application", "bom-ref": "surefoot", "name": "surefoot", "version": VERSION}
    ours |= {"licenses": [{"expression": licence[1]}]} if licence else {}
    parts = components(lock)
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": ours},
        "components": parts,
        "dependencies": [{"ref": "surefoot", "dependsOn": [one["bom-ref"] for one in parts]}],
    }


if __name__ == "__main__":
    given = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "requirements.lock"
    sys.stdout.write(json.dumps(bill(given), indent=2) + "\n")
