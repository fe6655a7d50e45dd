"""A command reports that it compiles as soon as that takes long, and nothing where it does not."""

import threading

import pytest

from surefoot.kernels.compiling import COMPILING
from surefoot.lab.cli import compiling
from surefoot.lab.cli.compiling import compilation_reported


@pytest.fixture
def lines(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    monkeypatch.setattr(compiling, "EACH_S", 1e-3)
    return []


def test_a_long_compilation_is_reported_and_counted(lines, monkeypatch):
    monkeypatch.setattr(compiling, "FIRST_S", 1e-3)
    enough = threading.Event()

    def note(line: str) -> None:
        lines.append(line)
        if len(lines) == 3:
            enough.set()

    with compilation_reported(note):
        COMPILING.began("f")
        assert enough.wait(60.0)
        COMPILING.ended("f")
    assert lines[0].startswith("surefoot: compiling numeric kernels")
    assert "kernels after" in lines[1]
    count = len(lines)
    COMPILING.began("g")
    COMPILING.ended("g")
    assert len(lines) == count, "reported after the end"


def test_short_ones_and_none_are_not_reported(lines, monkeypatch):
    monkeypatch.setattr(compiling, "FIRST_S", 60.0)
    with compilation_reported(lines.append):
        COMPILING.began("f")
        COMPILING.ended("f")
    with compilation_reported(lines.append):
        pass
    with pytest.raises(KeyboardInterrupt), compilation_reported(lines.append):
        raise KeyboardInterrupt
    assert lines == []
