"""Kernels that call kernels: one specialisation, exceptions, arrays, all again from the cache."""

import os
import subprocess
import sys
from pathlib import Path

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
