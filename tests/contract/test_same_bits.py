"""Ticks of services compute with nothing whose last bit depends on the processor or on the version of Python."""

import ast
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("surefoot", "services")

ALLOWED = {
    "services/footholds/assess.py": "distances of cells in integers, on request",
    "services/footholds/learning/fit.py": "fits on request: a score of held-out samples",
    "services/footholds/learning/quality.py": "scores of a fit, on request",
    "services/footholds/learning/solve.py": "fits on request; re-learning in a run uses it, too: not equal everywhere",
    "services/footholds/models/files.py": "whether a file's terms predict its own bins, when it is read",
    "services/stability/programs/clarabel_tools.py": "sparse matrices for clarabel, only stored",
    "services/stability/programs/reduced.py": "singular values of sets with unlimited friction, which no service sends",
    "services/stability/regions/actuated.py": "requests with torque limits, which no service sends",
    "services/stability/regions/careful.py": "pseudoinverse for unlimited friction, which no service sends",
    "services/stability/regions/equilibrium.py": "stability/equilibrium, which no service requests",
    "services/stability/regions/robust.py": "requests with uncertainty or gradient, which no service sends",
    "services/stability/sensing/pressure.py": "line through a sensor's characteristic, for papers and plots",
    "surefoot/record/tables.py": "columns of a recording, after the run",
}
"""Files that may use BLAS, with the reason."""

CALLS = {
    "dot", "vdot", "inner", "matmul", "tensordot", "einsum", "convolve", "correlate", "cov", "corrcoef", "polyfit",
    "lstsq", "linalg",
}  # fmt: skip
"""Names of numpy that call BLAS or LAPACK, or sum in an order of their own."""


def blas_lines(text: str) -> Iterator[int]:
    """Lines of a module that multiply matrices, call `CALLS` of an array or of numpy, or import scipy."""
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.BinOp(op=ast.MatMult()) | ast.AugAssign(op=ast.MatMult()):
                yield node.lineno
            case ast.Attribute(value=ast.Name(id="np"), attr=name) if name in CALLS:
                yield node.lineno
            case ast.Call(func=ast.Attribute(attr="dot", value=value)) if not _is_numpy(value):
                yield node.lineno
            case ast.Import(names=names) if any(alias.name.split(".")[0] == "scipy" for alias in names):
                yield node.lineno
            case ast.ImportFrom(module=str(module)) if module.split(".")[0] == "scipy" or module == "numpy.linalg":
                yield node.lineno
            case _:
                pass


def _is_numpy(value: ast.expr) -> bool:
    return isinstance(value, ast.Name) and value.id == "np"


SUMS = {
    "surefoot/geometry/heightmap_files.py": "bytes",
    "surefoot/lockstep/intake.py": "parts of a message",
    "surefoot/lockstep/join.py": "bytes",
    "surefoot/record/check.py": "messages",
    "surefoot/record/chunks.py": "messages",
    "surefoot/record/recording.py": "messages",
    "services/footholds/learning/relearn.py": "samples",
    "services/navigator/belief/landmark_files.py": "bytes",
    "services/navigator/goals.py": "waypoints",
    "services/navigator/messages.py": "recoveries",
    "services/navigator/policy/files.py": "bytes",
    "services/navigator/results.py": "recoveries",
    "services/recorder/service.py": "messages",
    "services/simulator/sensors/floors.py": "arrays, which numpy adds one by one",
    "services/stability/regions/modes.py": "calls",
    "services/stability/requests.py": "contacts",
    "services/vision/eye.py": "matches",
}
"""Files that may use the built-in `sum`, with what it counts: from Python 3.12 on it adds floats with a compensation
that 3.11 does not have, and the last bit differs. `math.fsum` is exact."""


def sum_lines(text: str) -> Iterator[int]:
    """Lines of a module that call the built-in `sum`."""
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.Call(func=ast.Name(id="sum")):
                yield node.lineno
            case _:
                pass


def users(lines_of: Callable[[str], Iterator[int]]) -> dict[str, list[int]]:
    """Lines that a rule finds, by file."""
    found = {}
    for folder in FOLDERS:
        for path in (ROOT / folder).rglob("*.py"):
            name = path.relative_to(ROOT).as_posix()
            if "surefoot/services" in name or "surefoot/lab" in name or "surefoot/schemas" in name:
                continue  # links to the folders beside
            if lines := sorted(lines_of(path.read_text(encoding="utf-8"))):
                found[name] = lines
    return found


@pytest.mark.parametrize(("rule", "allowed"), [(blas_lines, ALLOWED), (sum_lines, SUMS)], ids=["blas", "sum"])
def test_ticks_use_neither_and_the_exceptions_still_need_their_place(
    rule: Callable[[str], Iterator[int]], allowed: dict[str, str]
) -> None:
    found = users(rule)
    assert {name: lines for name, lines in found.items() if name not in allowed} == {}
    assert set(allowed) == set(found)


@pytest.mark.parametrize(
    "text",
    [
        "a @ b",
        "a @= b",
        "np.dot(a, b)",
        "a.dot(b)",
        "np.linalg.norm(a)",
        "np.einsum('i,i', a, b)",
        "import scipy.optimize",
        "from scipy import linalg",
        "from numpy.linalg import norm",
    ],
)
def test_each_way_to_blas_is_seen(text: str) -> None:
    assert list(blas_lines(text)) == [1]
    assert list(blas_lines("product(a, b) + norm(a) + np.add.reduce(a * b)")) == []
