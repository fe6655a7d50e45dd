"""How well the families of slip models fit the test function of Kosinski & Weigl, and how fast the searches do.

    y = (1 + sqrt(x1) + 1 / x2 + x3^-1.5)^2,   APE = 100 / N sum |y - fit| / |y|     (Walas & Belter 2011, Eqs. 16, 17)

Grid protocol: train {1..6}^3, test {1.5..5.5}^3. Random protocol: as many points evenly drawn from [1, 6]^3 and
[1.5, 5.5]^3, five sets. Variable projection starts at random, and the start of the smallest cost on the TRAINING set
is kept; the warp of the inputs is chosen by six folds of the training set. Test sets are only measured.

    python -m benchmarks.bench_fit            # all of it
    python -m benchmarks.bench_fit --quick    # one random set, no searches
"""

import argparse
import time
from collections.abc import Callable

import numpy as np

from surefoot.services.footholds.learning.evolution import evolve
from surefoot.services.footholds.learning.solve import cost, weights
from surefoot.services.footholds.learning.swarm import swarm
from surefoot.services.footholds.learning.varpro import RIDGE, Bounds, RefinedTerms, random_start, refine
from surefoot.services.footholds.models.bases import Basis, Warp, warped

Array = np.ndarray
STARTS = {"identity": ((-2.0, 8.0), (0.0, 0.1)), "log": ((-2.0, 3.0), (0.0, 0.5))}
"""Centres and widths at the start, by warp."""
BOUNDS = {"identity": Bounds(-20.0, 20.0, 1.0), "log": Bounds(-20.0, 20.0, 2.0)}
WARPS: tuple[Warp, ...] = ("identity", "log")


def function(x: Array) -> Array:
    """Equation (16), (n,)."""
    return (1.0 + np.sqrt(x[:, 0]) + 1.0 / x[:, 1] + x[:, 2] ** -1.5) ** 2


def grid(values: Array) -> Array:
    """All triples, (n^3, 3)."""
    return np.stack(np.meshgrid(values, values, values, indexing="ij"), axis=-1).reshape(-1, 3)


def ape(columns: Array, c: Array, y: Array) -> float:
    """Equation (17), %."""
    return float(100.0 * np.mean(np.abs(y - columns @ c) / np.abs(y)))


def scaled(x: Array, warp: Warp) -> Array:
    """Inputs after a warp."""
    return warped(x, (warp,) * 3, np.ones(3))


def best_start(u: Array, y: Array, warp: Warp, m: int, starts: int, seed: int, evaluations: int = 300) -> RefinedTerms:
    """The Gaussians of the smallest cost on these points, of several starts."""
    rng = np.random.default_rng(seed)
    centres, widths = STARTS[warp]
    found = [
        refine(random_start(rng, m, 3, centres, widths), u, y, 1.0 / y, BOUNDS[warp], RIDGE, evaluations)
        for _ in range(starts)
    ]
    return min(found, key=lambda each: each.cost)


def folds_error(x: Array, warp: Warp, m: int, starts: int, folds: int = 6) -> float:
    """APE of points that were not fitted, %, over folds of the training set."""
    y, fold = function(x), np.random.default_rng(0).permutation(len(x)) % folds
    u, total = scaled(x, warp), 0.0
    for f in range(folds):
        held = fold == f
        found = best_start(u[~held], y[~held], warp, m, starts, f, 100)
        total += ape(found.basis.columns(u[held]), found.weights, y[held]) * held.sum()
    return total / len(x)


def protocol(name: str, train: Array, test: Array, sizes: tuple[int, ...], starts: int) -> None:
    """Print train and test APE of both warps, the chosen one marked."""
    y, y_test = function(train), function(test)
    for m in sizes:
        folded = {warp: folds_error(train, warp, m, 1) for warp in WARPS}
        chosen = min(WARPS, key=lambda warp: folded[warp])
        for warp in WARPS:
            began = time.perf_counter()
            found = best_start(scaled(train, warp), y, warp, m, starts, 0)
            seconds = time.perf_counter() - began
            columns = (found.basis.columns(scaled(part, warp)) for part in (train, test))
            errors = [ape(v, found.weights, values) for v, values in zip(columns, (y, y_test), strict=True)]
            mark = "  <- chosen by six folds" if warp == chosen else ""
            print(
                f"  {name:<9} m = {m:<3} {warp:<9} train {errors[0]:.4f} %  test {errors[1]:.4f} %  "
                f"(six folds {folded[warp]:.4f} %, {seconds:.1f} s for {starts} starts){mark}",
                flush=True,
            )


def searches(m: int, evaluations: int) -> None:
    """Print what EA, PSO and variable projection reach on the grid: equal evaluations, and equal time."""
    train, test = grid(np.arange(1.0, 7.0)), grid(np.arange(1.5, 6.0))
    y, y_test = function(train), function(test)
    w = 1.0 / y

    def objective(basis: Basis) -> float:
        return cost(basis.columns(train), y, w, RIDGE)

    def show(name: str, basis: Basis, used: int, seconds: float) -> None:
        c = weights(basis.columns(train), y, w, RIDGE)
        a, b = ape(basis.columns(train), c, y), ape(basis.columns(test), c, y_test)
        print(f"  {name:<36} train {a:.4f} %  test {b:.4f} %   {used} evaluations, {seconds:.1f} s", flush=True)

    runs: dict[str, Callable[[], tuple[Basis, int]]] = {
        "PSO, Gaussians": lambda: _of(swarm(objective, m, 3, (-2.0, 8.0), (0.0, 0.5), evaluations, 0)),
        "EA, Gaussians": lambda: _of(evolve(objective, "gaussian", m, 3, (-2.0, 8.0), (0.0, 0.5), evaluations, 0)),
        "EA, elementary": lambda: _of(evolve(objective, "elementary", m, 3, (-1.0, 6.0), (0.0, 1.0), evaluations, 0)),
    }
    longest = 0.0
    for name, run in runs.items():
        began = time.perf_counter()
        basis, used = run()
        seconds = time.perf_counter() - began
        longest = max(longest, seconds)
        show(name, basis, used, seconds)
    for name, limit_n, limit_s in (
        ("varpro, as many evaluations", evaluations, np.inf),
        ("varpro, as long", np.inf, longest),
    ):
        began, used, rng, best = time.perf_counter(), 0, np.random.default_rng(0), None
        while used < limit_n and time.perf_counter() - began < limit_s:
            start = random_start(rng, m, 3, *STARTS["identity"])
            found = refine(start, train, y, w, BOUNDS["identity"], RIDGE, int(min(300, max(1, limit_n - used))))
            used += found.evaluations
            best = found if best is None or found.cost < best.cost else best
        assert best is not None
        show(name, best.basis, used, time.perf_counter() - began)


def _of(found: object) -> tuple[Basis, int]:
    return found.basis, found.evaluations  # type: ignore[attr-defined]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--evaluations", type=int, default=6000, help="budget of the searches")
    args = parser.parse_args()
    print("grid protocol (paper .069 / .079 %, its sets are not stated)")
    protocol("grid", grid(np.arange(1.0, 7.0)), grid(np.arange(1.5, 6.0)), (10, 12), 2 if args.quick else 8)
    print("random protocol")
    for seed in range(1 if args.quick else 5):
        rng = np.random.default_rng(100 + seed)
        train, test = rng.uniform(1.0, 6.0, (216, 3)), rng.uniform(1.5, 5.5, (125, 3))
        protocol(f"set {seed}", train, test, (10,), 2 if args.quick else 4)
    if not args.quick:
        print(f"searches on the grid, m = 10, plain inputs, {args.evaluations} evaluations each")
        searches(10, args.evaluations)


if __name__ == "__main__":
    main()
