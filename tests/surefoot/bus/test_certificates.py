"""Certificates: an authority that cannot sign is refused in words."""

from pathlib import Path

import pytest

from surefoot.bus.certificates import AUTHORITY, issue, make_authority
from surefoot.errors import SurefootError

pytest.importorskip("cryptography")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "robot"
    made.mkdir()
    make_authority(made, "robot", 1)
    return made


def test_a_damaged_or_ended_authority_is_named(folder: Path) -> None:
    (folder / f"{AUTHORITY}.key").write_text("no key")
    with pytest.raises(SurefootError, match=r"ca\.key is no key"):
        issue(folder, "walker", 1)
    make_authority(folder, "robot", 0)
    with pytest.raises(SurefootError, match="has ended"):
        issue(folder, "walker", 1)
