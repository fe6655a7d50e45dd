"""Certificates: names that would leave the folder, and an authority that cannot sign, are refused in words."""

from pathlib import Path

import pytest

from surefoot.bus.certificates import AUTHORITY, held, issue, make_authority
from surefoot.errors import SurefootError

pytest.importorskip("cryptography")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "robot"
    made.mkdir()
    make_authority(made, "robot", 1)
    return made


@pytest.mark.parametrize("identity", ["../operator", "a/b", "*", "", "x" * 65, "a\nb"])
def test_a_name_that_is_no_word_is_refused_and_nothing_is_written(folder: Path, identity: str) -> None:
    before = sorted(folder.parent.rglob("*"))
    with pytest.raises(SurefootError, match="letters, digits"):
        issue(folder, identity, 1)
    assert sorted(folder.parent.rglob("*")) == before


def test_a_host_that_is_no_name_is_refused(folder: Path) -> None:
    with pytest.raises(SurefootError, match="host name"):
        issue(folder, "walker", 1, ("räuber",))
    issue(folder, "walker", 1, ("robot.local", "10.0.0.7", "::7"))
    assert {one.identity for one in held(folder)} == {AUTHORITY, "walker"}


def test_a_damaged_or_ended_authority_is_named(folder: Path) -> None:
    (folder / f"{AUTHORITY}.key").write_text("no key")
    with pytest.raises(SurefootError, match=r"ca\.key is no key"):
        issue(folder, "walker", 1)
    make_authority(folder, "robot", 0)
    with pytest.raises(SurefootError, match="has ended"):
        issue(folder, "walker", 1)
