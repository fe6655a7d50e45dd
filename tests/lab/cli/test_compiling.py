"""A command reports that it compiles as soon as that takes long, and nothing where it does not."""

import re
import threading
import time
from importlib import import_module

import pytest

from surefoot.kernels.compiling import COMPILING
from surefoot.lab.cli import compiling
from surefoot.lab.cli.compiling import COSTS, CompiledShare, compilation_reported, costs_of


@pytest.fixture
def lines(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    for name in ("SECOND_S", "EACH_S"):
        monkeypatch.setattr(compiling, name, 1e-3)
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


def test_the_share_is_that_of_the_kernels_processor_time_from_the_first_that_is_compiled():
    now = 0.0
    share = CompiledShare([{"z": 9.0, "c": 1.0}, {"a": 4.0, "b": 4.0, "c": 16.0}], lambda: now)
    share.began("helper")
    assert share.now() == 0.0
    share.began("b")  # a was kept
    now = 1.0
    assert share.now() == pytest.approx(0.05)
    now = 8.0  # a machine that takes twice as long
    share.began("c")
    assert share.now() == pytest.approx(0.2)
    now = 24.0
    assert share.now() == pytest.approx(0.6)
    assert not share.late
    now = 1000.0
    assert share.late
    assert share.now() == pytest.approx((4.0 + 0.95 * 16.0) / 20.0)


def test_the_chain_that_begins_with_the_first_kernel_holds():
    share = CompiledShare([{"a": 9.0, "c": 1.0}, {"b": 4.0, "c": 16.0}], lambda: 0.0)
    share.began("a")
    share.began("c")
    assert share.now() == pytest.approx(0.9)


@pytest.mark.parametrize(
    ("cost", "word", "form"),
    [
        (2.0, "left", r"  compiling: \d+ %, about \d+ s left"),
        (
            1e-3,
            "longer",
            r"  compiling for \d+ s, longer than usual",
        ),  # the estimate was too low: no share stands still
    ],
)
def test_a_command_whose_kernels_are_known_states_share_and_time_left(lines, monkeypatch, cost, word, form):
    monkeypatch.setattr(compiling, "FIRST_S", 1e-3)
    stated = threading.Event()

    def note(line: str) -> None:
        lines.append(line)
        if word in line:
            stated.set()

    with compilation_reported(note, [{"f": cost}]):
        COMPILING.began("f")
        end = time.monotonic() + 60.0
        while not stated.wait(1e-3) and time.monotonic() < end:
            sum(range(10_000))  # processor time of this process
        COMPILING.ended("f")
    assert re.fullmatch(form, next(line for line in lines if word in line))


def test_kernels_with_a_cost_exist():
    from surefoot.kernels import jit

    for module in (
        "services.estimator.service", "services.stability.service", "services.footholds.service",
        "services.estimator.filter.log", "lab.estimation.calibrate", "lab.estimation.stances",
        "lab.fit.estimate", "lab.train.sarsa", "lab.audit.walk", "services.walker.service",
        "services.simulator.service", "robot.leg_tree",
    ):  # fmt: skip
        import_module(f"surefoot.{module}")
    known = {each.__qualname__ for each in jit._KERNELS}
    assert {"audit", "bag import", "estimate", "evaluate", "fit", "report", "train"} <= set(COSTS)
    assert [name for chains in COSTS.values() for chain in chains for name in chain if name not in known] == []


@pytest.mark.parametrize(
    ("words", "first"),
    [
        ("bag import walk.bag --robot go2", "matrix_from_quat"), ("footholds gather run.mcap", "median3"),
        ("report run.mcap", "matrix_from_quat"), ("footholds collect -o s.jsonl", "foot_positions"),
        ("robot import go1.xml", "forward"), ("robot check ragno", "foot_positions"), ("bag info run.mcap", None),
        ("robot", None), ("", None),
    ],
)  # fmt: skip
def test_a_command_of_a_group_has_kernels_of_its_own(words, first):
    """Before, only the first word counted: a cold `bag import` had no share or time left for minutes."""
    assert next((next(iter(chain)) for chain in costs_of(words.split())), None) == first


@pytest.mark.parametrize("cached", [("foot_positions", "clear"), ()])
def test_an_import_whose_kernels_are_compiled_in_their_order_goes_from_none_to_all(cached):
    now, shares = 0.0, list[float]()
    (chain,) = costs_of(["bag", "import"])
    share = CompiledShare([chain], lambda: now)
    for name, cost in chain.items():
        if name not in cached:
            share.began(name)
            shares.append(share.now())
            now += cost
    assert shares[0] == 0.0
    assert shares == sorted(shares)
    assert shares[-1] > 0.9
