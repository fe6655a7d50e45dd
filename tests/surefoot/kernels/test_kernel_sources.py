"""Compiled code does not outlive what it was compiled from."""

import os
import sys
from pathlib import Path

from tests.processes import run_process

INNER = "from surefoot.kernels.jit import kernel\n\n\n@kernel\ndef twice(x):\n    return 2.0 * x\n"
OUTER = """
from .bones import inner
from limbs.size import SIZE
from surefoot.kernels.jit import kernel


@kernel
def outer(x):
    return inner.twice(x) + SIZE
"""
PROGRAM = """
from limbs.outer import outer
from surefoot.kernels.compiling import COMPILING

print(outer(10.0), COMPILING.done)
"""


def test_code_is_compiled_anew_when_what_it_calls_changes(tmp_path: Path) -> None:
    """Machine code of `outer` holds `twice` and SIZE, of other files, one of them reached as a module's attribute."""
    bones, size, outer = tmp_path / "limbs/bones/inner.py", tmp_path / "limbs/size.py", tmp_path / "limbs/outer.py"
    bones.parent.mkdir(parents=True)
    for path, text in ((bones, INNER), (size, "SIZE = 1.0\n"), (outer, OUTER)):
        path.write_text(text)
    environment = os.environ | {"PYTHONPATH": f"{tmp_path}:{Path(__file__).parents[3]}"}

    def run() -> tuple[float, int]:
        command = [sys.executable, "-c", PROGRAM]
        told = run_process(command, env=environment, capture_output=True, text=True, check=True).stdout.split()
        return float(told[0]), int(told[1])

    assert run() == (21.0, 2)
    assert run() == (21.0, 0)
    bones.write_text(INNER.replace("2.0", "3.0"))
    assert run() == (31.0, 2)
    size.write_text("SIZE = 2.0\n")
    assert run() == (32.0, 1)
    assert run() == (32.0, 0)
