"""Kernels that call kernels: one specialisation, exceptions, arrays, all again from the cache."""

import os
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import kernel

SOURCE = """
import numpy as np
from surefoot.kernels.jit import kernel


@kernel
def scaled(x, by):
    if by < 0:
        raise ValueError("negative", by)
    return x * by


@kernel
def stacked(x):
    return np.array([scaled(x, 2), scaled(x, 3), scaled(x, int(x))])


@kernel
def again(x):
    return stacked(x), scaled(x, -1 if x > 9.0 else 1)
"""
PROGRAM = """
import limbs
from surefoot.kernels.compiling import COMPILING

try:
    limbs.again(10.0)
except ValueError as error:
    print(error.args, end=" ")
print(limbs.stacked(5.0).tolist(), limbs.again(5.0)[0].tolist(), limbs.scaled(5.0, 1), COMPILING.done, end=" ")
print(len(limbs.scaled.linked.signatures), len(limbs.scaled.signatures))
"""


def test_calls_with_constants_and_with_variables_share_the_code(tmp_path: Path) -> None:
    (tmp_path / "limbs.py").write_text(SOURCE)
    environment = os.environ | {"PYTHONPATH": f"{tmp_path}:{Path(__file__).parents[3]}"}

    def run() -> str:
        command = [sys.executable, "-c", PROGRAM]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=True, timeout=240).stdout

    cold, warm = run().strip(), run().strip()
    answers = "('negative', -1) [10.0, 15.0, 25.0] [10.0, 15.0, 25.0] 5.0"
    assert cold.startswith(answers)
    assert cold.endswith(" 1 1")
    assert warm == f"{answers} 0 0 1"  # nothing compiled, nothing linked, the wrapper loaded


def test_another_numba_compiles_in_its_own_way(tmp_path: Path) -> None:
    (tmp_path / "limbs.py").write_text(SOURCE)
    environment = os.environ | {"PYTHONPATH": f"{tmp_path}:{Path(__file__).parents[3]}", "SUREFOOT_KERNELS": "plain"}
    code = (
        "import limbs; print(limbs.stacked(5.0).tolist(), limbs.again(5.0)[0].tolist(), len(limbs.scaled.signatures))"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True, timeout=240)
    assert done.stdout.strip() == "[10.0, 15.0, 25.0] [10.0, 15.0, 25.0] 1"


@kernel
def _rows(n: int, count: int) -> NDArray[np.float64]:
    """Make arrays of many sizes, one in the place of the other, and return the last."""
    out = np.zeros(n)
    for i in range(count):
        other = np.arange(1.0 + i % n)
        out = other if other.size > 1 else out
    return out


def test_arrays_of_kernels_are_aligned_and_outlive_the_call() -> None:
    kept = [_rows(n, n) for n in range(2, 300)]
    for n, array in enumerate(kept, 2):
        assert array.ctypes.data % 32 == 0
        np.testing.assert_array_equal(array, np.arange(float(n)))
    view = kept[-1][5:]
    kept.clear()
    np.testing.assert_array_equal(view, np.arange(5.0, 299.0))


def test_arrays_without_references_are_freed() -> None:
    _rows(200, 1000)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(20):
        _rows(200, 20_000)  # 400 000 arrays of 0.8 kB
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 20_000  # kB
