"""Kernels that are not compiled yet: health reports it, no query compiles silently, a cache that cannot be written."""

import importlib.util
import sys
import time
from contextlib import nullcontext
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from surefoot.bus.memory import MemoryBus
from surefoot.errors import CallError
from surefoot.kernels import compiling, kept
from surefoot.kernels.compiling import COMPILING
from surefoot.kernels.jit import kernel
from surefoot.lockstep.node import Node
from surefoot.schemas.stability import RegionReply, RegionRequest
from surefoot.schemas.topics import HEALTH_GET, STABILITY_REGION
from tests.surefoot.lockstep.node_bench import Subject

SOURCE = """
from surefoot.kernels.jit import kernel

@kernel
def double(x: float) -> float:
    return 2.0 * x

@kernel
def triple(x: float) -> float:
    return 3.0 * x
"""


@pytest.fixture
def fresh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[ModuleType, Path]:
    """A kernel of an installation that cannot be written, and the user's cache folder."""
    package, cache = tmp_path / "installed", tmp_path / "cache"
    package.mkdir()
    (package / "kernels.py").write_text(SOURCE)
    (package / "__pycache__").write_text("a file where a folder is wanted: stops even the superuser")
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    spec = importlib.util.spec_from_file_location("fresh_kernels", package / "kernels.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module, cache


class Cold(Subject):
    """Compiles while it prepares, and asks itself how it does."""

    def __init__(self, bus: MemoryBus, work: Any) -> None:
        super().__init__()
        self.bus, self.work = bus, work
        self.seen_health: list[Any] = []
        self.refusal = ""

    def on_start(self) -> None:
        with COMPILING.reporting(self._look):
            self.work(1.0)
        super().on_start()

    def _look(self, name: str) -> None:
        self.seen_health.append(self.bus.call(HEALTH_GET.of("estimator"), HEALTH_GET.request()).health)
        try:
            self.bus.call(STABILITY_REGION, RegionRequest(contacts=()))
        except CallError as error:
            self.refusal = error.code


def started(work: Any) -> tuple[Cold, Node]:
    bus = MemoryBus()
    service = Cold(bus, work)
    node = Node(service, bus)
    node.start()
    bus.pump_with(STABILITY_REGION, node.pump)
    return service, node


def test_cold_service_says_that_it_compiles(fresh: tuple[ModuleType, Path], capsys: pytest.CaptureFixture) -> None:
    service, node = started(fresh[0].double)
    (health,) = service.seen_health
    assert (health.state, health.kernels) == ("compiling", "compiling")
    assert service.refusal  # no other question is taken before the kernels are there
    assert (node.state, node.health().kernels) == ("joining", "warm")
    told = capsys.readouterr().err
    assert "compiling kernels, double first" in told
    assert "1 kernels compiled in" in told


def test_warm_service_never_says_so(fresh: tuple[ModuleType, Path], capsys: pytest.CaptureFixture) -> None:
    fresh[0].double(1.0)
    service, node = started(fresh[0].double)
    assert service.seen_health == []
    assert node.health().kernels == "warm"
    assert "compil" not in capsys.readouterr().err


def test_query_that_compiles_says_so(fresh: tuple[ModuleType, Path], capsys: pytest.CaptureFixture) -> None:
    service, node = started(lambda x: x)

    def answer(request: Any) -> RegionReply:
        fresh[0].double(1.0)
        return RegionReply(status="infeasible", inner=(), outer=(), support=())

    service.answer = answer
    for _ in range(2):
        node.bus.call(STABILITY_REGION, RegionRequest(contacts=()), instance=node.instance)
    assert capsys.readouterr().err.count("had to compile double") == 1


def test_unwritable_installation_uses_the_users_cache(fresh: tuple[ModuleType, Path]) -> None:
    module, cache = fresh
    before = COMPILING.done
    assert module.double(2.0) == 4.0
    assert COMPILING.done == before + 1
    assert Path(module.double.stats.cache_path).is_relative_to(cache / "numba")
    kept = sorted(path.suffix for path in (cache / "numba").rglob("*.nb*"))
    assert kept == [".nbc", ".nbc", ".nbi", ".nbi"]  # machine code for Python, and code that other kernels link
    assert kernel(module.double.py_func)(2.0) == 4.0
    assert COMPILING.done == before + 1  # from the cache


@pytest.mark.parametrize("listened", [False, True])
def test_a_program_without_listeners_gets_one_line_on_a_long_compilation(caplog, monkeypatch, listened):
    monkeypatch.setattr(compiling, "NOTICE_S", 0.01)
    record = compiling.Compiling()
    with record.reporting(lambda name: None) if listened else nullcontext():
        for _ in range(2):
            record.began("f")
            time.sleep(0.2)
            record.ended("f")
    lines = [each.getMessage() for each in caplog.records if each.name == "surefoot"]
    text = "surefoot: compiling numeric kernels, half a minute or more, only this once (surefoot warm)"
    assert lines == ([] if listened else [text])


def test_a_short_compilation_gets_no_line_and_a_long_one_after_it_does(caplog, monkeypatch):
    monkeypatch.setattr(compiling, "NOTICE_S", 0.01)
    record = compiling.Compiling()
    record.began("short")
    record.ended("short")
    time.sleep(0.1)
    assert caplog.records == []
    record.began("long")
    time.sleep(0.2)
    record.ended("long")
    assert len(caplog.records) == 1


@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", ["flipped", "hash", "cut", "empty", "other"])
def test_a_damaged_file_of_the_cache_is_named_and_compiled_anew(fresh, monkeypatch, caplog, suffix, damage):
    """Before, flipped bytes of machine code were executed, and those of an index ended the program with a traceback."""
    module, cache = fresh
    function = module.double.py_func
    assert module.double(2.0) == 4.0
    for path in (cache / "numba").rglob(f"*.{suffix}"):
        content = path.read_bytes()
        half = len(content) // 2
        changed = {
            "flipped": content[:half] + bytes(255 - byte for byte in content[half : half + 9]) + content[half + 9 :],
            "hash": content[:-1] + bytes([255 - content[-1]]),
            "cut": content[:half],
            "empty": b"",
            "other": content.replace(b"double", b"triple"),
        }
        path.write_bytes(changed[damage])
    for again in (1, 0):
        monkeypatch.setattr(kept._Checked, "_named", False)
        caplog.clear()
        before = COMPILING.done
        assert kernel(function)(2.0) == 4.0
        assert COMPILING.done == before + again, "the files were not renewed"
        lines = [each.getMessage() for each in caplog.records]
        assert len(lines) == again
        assert all(line.endswith("is damaged: it is not used, and its kernel is compiled anew") for line in lines)


def test_code_of_another_kernel_or_of_other_sources_under_the_name_of_this_one_is_not_used(fresh, monkeypatch, caplog):
    module, cache = fresh
    assert (module.double(2.0), module.triple(2.0)) == (4.0, 6.0)
    for path in (cache / "numba").rglob("*double*.nbc"):
        path.write_bytes(next(path.parent.glob(f"*triple*{'.link' * ('.link' in path.name)}.*1.nbc")).read_bytes())
    before = COMPILING.done
    assert kernel(module.double.py_func)(2.0) == 4.0
    assert COMPILING.done == before + 1
    assert caplog.records == []
