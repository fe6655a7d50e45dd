"""Processor time per tick of the lockstep core without the work of services, compared with another checkout."""

import os
import statistics
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

from benchmarks.bench import Bench, goal
from benchmarks.core_system import TICKS

BENCH = Bench("core")

HERE = Path(__file__).resolve().parents[1]
WAYS = ("memory", "frames")


class Other:
    """Process that runs blocks of ticks with the code of one checkout."""

    def __init__(self, checkout: Path, way: str, stack: ExitStack) -> None:
        command = [sys.executable, "-P", str(HERE / "benchmarks/core_system.py"), way]
        environment = os.environ | {"PYTHONPATH": str(checkout)}
        self._process = stack.enter_context(
            subprocess.Popen(
                command, env=environment, cwd=checkout, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
            )
        )

    def block(self) -> float:
        """Return the processor time of one block, s."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        return float(self._process.stdout.readline())


@BENCH.part("--blocks 2")
def ticks(*, against: Path = HERE, blocks: int = 30) -> None:
    """Processor time per tick of the lockstep core alone, beside that of another checkout, in turns.

    A driver, an estimator, a walker, a stability service and a recorder with the topics of the real ones run in one
    process. They publish messages made beforehand, so what is measured is the core: join, ages, bindings, inbox, codec
    and frames. Two ways: `memory` is the in-memory bus; `frames` encodes and frames each message and takes it apart in
    the reader, as over Zenoh, but hands the bytes over by calls. Ratios compare neighbours.

    Args:
        against: another checkout; default: this one, which shows the noise.
        blocks: number of blocks of 100 ticks each.
    """
    if not (against / "surefoot" / "lockstep").is_dir():
        raise SystemExit(f"--against must be a checkout of surefoot, got {against}")
    for way in WAYS:
        with ExitStack() as stack:
            ours, theirs = Other(HERE, way, stack), Other(against.resolve(), way, stack)
            for other in (ours, theirs):
                other.block()  # everything is imported and every validator built
            mine: list[float] = []
            base: list[float] = []
            for i in range(blocks):
                pair = ((ours, mine), (theirs, base)) if i % 2 == 0 else ((theirs, base), (ours, mine))
                for other, times in pair:
                    times.append(other.block())
        for name, times in (("here", mine), ("there", base)):
            goal(f"{way}, {name}", 1e6 * statistics.median(times) / TICKS, unit="us of processor time per tick")
        goal(f"{way}, here / there", statistics.median(a / b for a, b in zip(mine, base, strict=True)), "<=", 1.03)
