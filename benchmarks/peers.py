"""Support regions beside those of other packages, side by side in one run: time and error.

No peer is needed by the product; one that is not installed is reported as absent and skipped: hpp-centroidal-dynamics
with its dual LP (a shim in C++ is compiled against it: a compiler and Eigen are needed), cvxpy with clarabel, and
pypoman; `pip install hpp-centroidal-dynamics cmeel-eigen cvxpy pypoman` brings them. They know one friction coefficient
for all contacts and replace each cone by a pyramid of k edges (cvxpy: exact cones). All get the same stances: 20 cm
wide, slopes to 11.5 degrees, mu 0.5.
"""

import ctypes
import importlib.metadata
import subprocess
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.bench import Bench, best_of, table
from benchmarks.stability import SIXTEEN, stance
from surefoot.robot.reader import load_robot
from surefoot.services.stability.programs.contacts import ContactSet
from surefoot.services.stability.programs.reduced import reduce
from surefoot.services.stability.regions.careful import Oracle
from surefoot.services.stability.regions.margin import extent
from surefoot.services.stability.regions.region import region
from surefoot.services.stability.rehearsal import rehearse
from surefoot.services.stability.sensing.state import WatchParams
from tests.services.stability.oracles import literal_matrices

BENCH = Bench("peers")

MU, SLOPE_DEG = 0.5, 11.5
SHIM = Path(__file__).parent / "hpp_rays.cpp"
TARGETS = {3: {"hpp k=4": 0.66, "hpp k=16": 0.35}, 6: {"hpp k=4": 0.60, "hpp k=16": 0.20}}
"""Largest ratio of this project's time to that of a peer, by number of contacts and name of the peer."""

Call = Callable[[ContactSet], Any]


class Hpp:
    """Rays of a support region by hpp-centroidal-dynamics; `reason`: why it cannot be used, empty = it can."""

    def __init__(self) -> None:
        self.reason, self._library = "", None
        try:
            files = importlib.metadata.files("hpp-centroidal-dynamics") or []
        except importlib.metadata.PackageNotFoundError:
            self.reason = "not installed"
            return
        library = next((f for f in files if f.name == "libhpp-centroidal-dynamics.so"), None)
        if library is None:
            self.reason = "has no library for C++"
            return
        prefix = Path(str(library.locate())).resolve().parents[1]
        out = Path(tempfile.mkdtemp(prefix="hpp-rays-")) / "hpp_rays.so"
        include = [f"-I{prefix / 'include' / name}" for name in ("", "eigen3", "cddlib")]
        link = [f"-L{prefix / 'lib'}", "-lhpp-centroidal-dynamics", f"-Wl,--disable-new-dtags,-rpath,{prefix / 'lib'}"]
        command = ["g++", "-O3", "-march=native", "-shared", "-fPIC", "-o", str(out), str(SHIM), *include, *link]
        try:
            subprocess.run([*command, "-Wl,--allow-shlib-undefined"], check=True, capture_output=True, text=True)
        except (OSError, subprocess.CalledProcessError) as error:
            words = getattr(error, "stderr", "") or str(error)
            self.reason = "the shim does not compile: " + next(
                (line for line in words.splitlines() if "error" in line), words.strip()[:100]
            )
            return
        self._library = ctypes.CDLL(str(out))
        self._library.hpp_new.restype = ctypes.c_void_p
        self._library.hpp_region.argtypes = [ctypes.c_void_p, ctypes.c_int] + [ctypes.c_void_p] * 2 + [
            ctypes.c_double, ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p,
        ]  # fmt: skip

    def solver(self, generators: int) -> Call:
        """Return a function of a contact set that computes the reach of its support region in 16 directions, (16,) m.

        The reach is the distance from the mean of the contacts to the edge of the region, NaN = not found; the friction
        cones, all of coefficient `MU`, are replaced by pyramids of `generators` edges.
        """
        assert self._library is not None
        function, handle = self._library.hpp_region, self._library.hpp_new(generators)
        rays = np.ascontiguousarray(SIXTEEN)

        def rays_of(s: ContactSet) -> np.ndarray:
            start, out = s.position.mean(axis=0), np.empty(len(rays))
            function(
                handle, len(s), s.position.ctypes.data, s.normal.ctypes.data, MU, start.ctypes.data, len(rays),
                rays.ctypes.data, out.ctypes.data,
            )  # fmt: skip
            return out

        return rays_of


def cvxpy_region() -> tuple[Call | None, str]:
    """Return a solver of the support function of a contact set by clarabel through cvxpy, or the reason for none.

    It solves (23) of Walas & Belter with one cone a contact, compiled once per set; the direction is a parameter.
    """
    try:
        import cvxpy as cp  # pyright: ignore[reportMissingImports] - optional
    except ImportError:
        return None, "not installed"

    def solve(s: ContactSet) -> np.ndarray:
        n = len(s)
        a1, a2, t = literal_matrices(s)
        f, y, a = cp.Variable(3 * n), cp.Variable(2), cp.Parameter(2)
        rules = [a1 @ f + a2 @ y == t]
        for i in range(n):
            v, fi = s.normal[i], f[3 * i : 3 * i + 3]
            rules.append(cp.norm((np.eye(3) - np.outer(v, v)) @ fi) <= s.mu[i] * (v @ fi))
        problem = cp.Problem(cp.Maximize(a @ y), rules)
        values = []
        for direction in SIXTEEN:
            a.value = direction
            values.append(problem.solve(solver=cp.CLARABEL))
        return np.array(values)

    return solve, ""


def pypoman_region(method: str, edges: int = 8) -> tuple[Call | None, str]:
    """Return a function that projects contact constraints onto the CoM plane by pypoman, or the reason for none.

    `method`: of pypoman's projection; `edges`: of the pyramid inside each friction cone.
    """
    try:
        import pypoman  # pyright: ignore[reportMissingImports] - optional
    except ImportError:
        return None, "not installed"
    angle = 2.0 * np.pi * np.arange(edges) / edges

    def solve(s: ContactSet) -> Any:
        n = len(s)
        a1, a2, t = literal_matrices(s)
        rows = []
        for i in range(n):
            v = s.normal[i]
            e1 = np.cross(v, [1.0, 0.0, 0.0] if abs(v[0]) < 0.8 else [0.0, 1.0, 0.0])
            e1 /= np.linalg.norm(e1)
            e2 = np.cross(v, e1)
            block = np.zeros((edges, 3 * n))
            inside = MU * np.cos(np.pi / edges)  # the pyramid lies inside the cone
            block[:, 3 * i : 3 * i + 3] = np.outer(np.cos(angle), e1) + np.outer(np.sin(angle), e2) - inside * v
            rows.append(block)
        cone = np.vstack(rows)
        a = np.hstack((cone, np.zeros((len(cone), 2))))
        c, d = np.hstack((a1, a2)), t
        keep = np.abs(np.hstack((c, d[:, None]))).max(axis=1) > 0.0
        e, f = np.hstack((np.zeros((2, 3 * n)), np.eye(2))), np.zeros(2)
        return pypoman.project_polytope(
            (e, f), (a, np.zeros(len(a))), eq=(c[keep], d[keep]), method=method, **({"max_radius": 10.0})
        )

    return solve, ""


def peers() -> tuple[dict[str, tuple[Call, int]], dict[str, str]]:
    """Return the installed peers with their calls per block, and the reasons why others are absent."""
    here: dict[str, tuple[Call, int]] = {}
    absent: dict[str, str] = {}
    hpp = Hpp()
    for k in (4, 8, 16):
        if hpp.reason:
            absent["hpp-centroidal-dynamics"] = hpp.reason
        else:
            here[f"hpp k={k}"] = (hpp.solver(k), 5)
    for name, (call, reason) in {"cvxpy": cvxpy_region(), "pypoman bretl k=8": pypoman_region("bretl")}.items():
        if call is None:
            absent[name] = reason
        else:
            here[name] = (call, 1)
    return here, absent


MINE: dict[str, tuple[Call, int]] = {
    "region, 16 directions": (lambda s: region(s, SIXTEEN), 5),
    "  kernel alone": (lambda s: Oracle(s, *reduce(s)).fan(SIXTEEN, 16), 5),
    "one direction": (lambda s: Oracle(s, *reduce(s)).fan(SIXTEEN[1:2], 1), 5),
}


def times_of(s: ContactSet, others: dict[str, tuple[Call, int]]) -> dict[str, float]:
    """Return the smallest mean time of each function over interleaved blocks, us; the first block only warms up."""
    best = dict.fromkeys((*MINE, *others), np.inf)
    for block in range(4):
        for name, (call, calls) in (MINE | others).items():
            if calls > 1 or block < 2:
                best[name] = min(best[name], 1e6 * best_of(partial(call, s), 1, calls))
    return best


def error_of(name: str, call: Call, s: ContactSet) -> float | None:
    """Return the largest difference of a peer's region from this project's exact one, m; None where a ray misses it."""
    whole, found = region(s, SIXTEEN), call(s)
    if name.startswith("hpp"):
        centre = s.position[:, :2].mean(axis=0)
        exact = np.array([extent(whole, centre, a).value for a in SIXTEEN], dtype=float)
    else:
        exact = whole.support.value
        found = found if name == "cvxpy" else (SIXTEEN @ np.array(found).T).max(axis=1)
    return float(np.nanmax(np.abs(found - exact))) if np.isfinite(exact).all() else None


@BENCH.part("--repeats 1")
def regions(*, repeats: int = 40) -> None:
    """Times and errors for stances of 3 and 6 contacts: medians over stances.

    Args:
        repeats: stances of each size.
    """
    rehearse(load_robot("ragno"), WatchParams())
    others, absent = peers()
    for name, reason in absent.items():
        print(f"{name}: absent ({reason}), skipped")
    for n in (3, 6):
        rng = np.random.default_rng(n)
        stances = [stance(rng, n, SLOPE_DEG, MU) for _ in range(repeats)]
        times = [times_of(s, others) for s in stances]
        rows: list[tuple[object, ...]] = [(name, float(np.median([t[name] for t in times]))) for name in MINE]
        for name, (call, _) in others.items():
            ratio = float(np.median([t["region, 16 directions"] / t[name] for t in times]))
            errors = [error for s in stances if (error := error_of(name, call, s)) is not None]
            wrong = 1e3 * float(np.median(errors)) if errors else np.nan
            limit = TARGETS[n].get(name)
            most = "" if limit is None else f"<= {limit}"
            rows.append((name, float(np.median([t[name] for t in times])), ratio, most, wrong))
        header = ("function", "us", "ours / peer", "goal", "largest error, mm")
        table(f"{n} contacts, {repeats} stances", header, rows)
