"""Kernels that call kernels: one specialisation, exceptions, arrays, from the cache until a source changes."""

import os
import sys
from pathlib import Path

import pytest

from tests.processes import run_process

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

INNER = "from surefoot.kernels.jit import kernel\n\n\n@kernel\ndef twice(x):\n    return 2.0 * x\n"
OUTER = """
from .bones import inner
from limbs.size import SIZE
from surefoot.kernels.jit import kernel


@kernel
def outer(x):
    return inner.twice(x) + SIZE
"""
CHANGING = """
from limbs.outer import outer
from surefoot.kernels.compiling import COMPILING

print(outer(10.0), COMPILING.done)
"""

LOOPS = """
from surefoot.kernels.jit import kernel, row_kernel


@kernel
def plain(x, y):
    for i in range(x.size):
        y[i] = 3.0 * x[i] + 1.0
    y[:2] = x[1:3]


@row_kernel
def rows(x, y):
    for i in range(x.size):
        y[i] = 3.0 * x[i] + 1.0
    y[:2] = x[1:3]
"""
LOOPED = """
import numpy as np, limbs

for each in (limbs.plain, limbs.rows):
    x, y = np.arange(9.0) / 7.0, np.zeros(9)
    each(x, y)
    (code,) = (found.library.get_llvm_str() for found in each.overloads.values())
    print(y.tobytes().hex(), "x double>" in code)
try:
    limbs.plain(np.zeros(1), y)
except ValueError as error:
    print(error)
"""


@pytest.fixture
def limbs(tmp_path: Path) -> Path:
    """A folder with kernels."""
    (tmp_path / "limbs.py").write_text(SOURCE)
    return tmp_path


def run(folder: Path, program: str, **settings: str) -> str:
    # No bytecode is kept: Python would take that of a file of equal size that was written in the same second.
    paths = f"{folder}:{Path(__file__).parents[3]}"
    environment = {**os.environ, "PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1", **settings}
    command = [sys.executable, "-c", program]
    return run_process(command, env=environment, capture_output=True, text=True, check=True).stdout.strip()


def test_calls_with_constants_and_with_variables_share_the_code(limbs: Path) -> None:
    cold, warm = run(limbs, PROGRAM), run(limbs, PROGRAM)
    answers = "('negative', -1) [10.0, 15.0, 25.0] [10.0, 15.0, 25.0] 5.0"
    assert cold.startswith(answers)
    assert cold.endswith(" 1 1")
    assert warm == f"{answers} 0 0 1"  # nothing compiled, nothing linked, the wrapper loaded


def test_loops_of_rows_alone_become_vectors_with_the_same_bits(tmp_path: Path) -> None:
    (tmp_path / "limbs.py").write_text(LOOPS)
    plain, rows, refused = run(tmp_path, LOOPED).splitlines()
    assert plain.endswith(" False")
    assert rows.endswith(" True")
    assert plain.split()[0] == rows.split()[0]
    assert refused == "cannot assign slice from input of different size"


def test_no_loop_becomes_vectors_where_numba_is_set_so(tmp_path: Path) -> None:
    (tmp_path / "limbs.py").write_text(LOOPS)
    plain, rows, _ = run(tmp_path, LOOPED, NUMBA_LOOP_VECTORIZE="0").splitlines()
    assert plain.endswith(" False")
    assert rows.endswith(" False")


def test_another_numba_compiles_in_its_own_way(limbs: Path) -> None:
    calls = "limbs.stacked(5.0).tolist(), limbs.again(5.0)[0].tolist(), len(limbs.scaled.signatures)"
    done = run(limbs, f"import limbs; print({calls})", SUREFOOT_KERNELS="plain")
    assert done == "[10.0, 15.0, 25.0] [10.0, 15.0, 25.0] 1"


def test_code_is_compiled_anew_when_what_it_calls_changes(tmp_path: Path) -> None:
    """Machine code of `outer` holds `twice` and SIZE, of other files, one of them reached as a module's attribute."""
    bones, size, outer = tmp_path / "limbs/bones/inner.py", tmp_path / "limbs/size.py", tmp_path / "limbs/outer.py"
    bones.parent.mkdir(parents=True)
    for path, text in ((bones, INNER), (size, "SIZE = 1.0\n"), (outer, OUTER)):
        path.write_text(text)

    def found() -> tuple[float, int]:
        out, compiled = run(tmp_path, CHANGING).split()
        return float(out), int(compiled)

    assert found() == (21.0, 2)
    assert found() == (21.0, 0)
    bones.write_text(INNER.replace("2.0", "3.0"))
    assert found() == (31.0, 2)
    size.write_text("SIZE = 2.0\n")
    assert found() == (32.0, 1)
    assert found() == (32.0, 0)
