"""Foothold functions: processor times, their ratios, and fits of the test function of Walas & Belter (2011)."""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks.bench import Bench, best_of, goal, in_turns, seconds_of, table
from surefoot.arrays import Array
from surefoot.geometry.heightmap import HeightMap
from surefoot.papers.walas.evolution import evolve
from surefoot.papers.walas.searches import cost
from surefoot.papers.walas.swarm import swarm
from surefoot.papers.walas.varpro import RIDGE, Bounds, RefinedTerms, refine
from surefoot.robot.kinematics import foot_positions
from surefoot.robot.reader import load_robot
from surefoot.services.footholds.assess import assess, whole_map
from surefoot.services.footholds.config import FootholdsConfig
from surefoot.services.footholds.features import (
    coefficients,
    map_features,
    push_direction,
    window_features,
)
from surefoot.services.footholds.ground import FootholdGround, build_ground, updated_ground
from surefoot.services.footholds.learning.fit import fit_terms
from surefoot.services.footholds.learning.merge import candidate_of
from surefoot.services.footholds.learning.solve import weights
from surefoot.services.footholds.models.bases import Basis, Warp, warped
from surefoot.services.footholds.models.files import load, shipped
from surefoot.services.footholds.models.learned import LearnedModel
from surefoot.services.footholds.models.score import HandScore
from surefoot.services.footholds.select import Landing, SelectParams, TrunkPose, select
from surefoot.services.footholds.service import Footholds
from tests.services.footholds.learning.made import random_start
from tests.services.footholds.numpy_features import map_features_numpy

BENCH = Bench("footholds")

CELL = 0.005
"""Edge of a cell of the made-up map, m."""
STROKE = np.array([-0.05, 0.0, 0.0])
"""Movement of a foot relative to the body in its stance, map axes, (3,) m."""


class Ground:
    """A made-up map of n x n cells with a robot on it."""

    def __init__(self, n: int) -> None:
        rng, x = np.random.default_rng(0), CELL * np.arange(n)
        z = 0.01 * np.sin(x[None, :] / 0.07) * np.cos(x[:, None] / 0.05) + rng.normal(0.0, 0.002, (n, n))
        self.heights = HeightMap(z=z.astype(np.float32), cell=CELL, origin=(-0.5 * n * CELL, -0.5 * n * CELL))
        self.robot = load_robot("ragno")
        self.feet = feet = foot_positions(self.robot.model, self.robot.neutral)
        self.base = TrunkPose((0.0, 0.0, 0.008 - float(feet[0, 2]) + 0.005))
        self.landings = [
            Landing(leg, (float(feet[leg, 0]), float(feet[leg, 1]), 0.0), (-0.05, 0.0, 0.0)) for leg in range(6)
        ]
        self.ground = build_ground(self.heights, self.robot.foot_radius)
        self.push = np.array(push_direction(STROKE), dtype=np.float32)
        self.out = [np.empty_like(self.heights.z) for _ in range(3)]

    def coefficients(self) -> None:
        """Compute the ground coefficients K1, K2 and cos K3 of all cells by the product's kernel."""
        coefficients(self.heights.z, self.push, np.float32(CELL), *self.out)

    def slices(self) -> None:
        """Compute the ground coefficients K1, K2 and cos K3 of all cells by slices of numpy."""
        map_features_numpy(self.heights.z, STROKE, CELL)

    def copies(self) -> None:
        """Copy the map three times, which takes the least time that access to memory allows."""
        for layer in self.out:
            np.copyto(layer, self.heights.z)

    def filtered(self) -> None:
        """Filter the map by its median and dilate it by the foot."""
        self.heights.smoothed().dilated(self.robot.foot_radius)

    def build(self) -> None:
        """Filter the map, dilate it by the foot and fit its planes."""
        build_ground(self.heights, self.robot.foot_radius)

    def score(self) -> None:
        """Compute predicted slip and masks of all cells, without a leg's reach."""
        assess(self.ground, HandScore(), whole_map(self.ground), None, STROKE.tolist(), ("p", "mask"), SelectParams())


def _tile(ground: FootholdGround, heights: HeightMap, edge: int, full: Any) -> None:
    """Filter one tile of `edge` cells of a changed map and dilate it by the foot sphere."""
    heights.smooth_part(full, edge - 1, 2 * edge + 1, edge - 1, 2 * edge + 1)
    ground.surface.dilate_part(ground.foot_radius, full, edge - 2, 2 * edge + 2, edge - 2, 2 * edge + 2)


@BENCH.part("--cells 100 --rounds 2")
def ratios(*, cells: int = 1000, rounds: int = 30) -> None:
    """Print ratios of processor times of foothold functions, called in turn, beside the limits of this project.

    Args:
        cells: edge of the map in cells.
        rounds: number of rounds in which all functions are called in turn.
    """
    Footholds(FootholdsConfig()).rehearse()
    at = Ground(cells)
    shape = replace(candidate_of(whole := load(shipped("ragno") or "")), terms=15)
    learned: LearnedModel = replace(whole, terms=fit_terms(whole.lattice, whole.bins, shape, whole.seed))
    features, edge = map_features(at.heights.z, STROKE, CELL), cells // 10
    changed, full = at.heights.z.copy(), np.empty_like(at.heights.z)
    changed[edge : 2 * edge, edge : 2 * edge] += np.float32(0.01)
    versions = [at.heights, at.heights.with_z(changed)]
    updated = at.ground

    def update() -> None:
        nonlocal updated
        updated = updated_ground(updated, *versions)
        versions.reverse()

    best = in_turns(
        {
            "coefficients": at.coefficients, "slices": at.slices, "copies": at.copies, "build": at.build,
            "filtered": at.filtered, "scored": at.score, "predict": lambda: learned.predict(features, CELL),
            "update": update, "tile": partial(_tile, at.ground, versions[1], edge, full),
        },
        rounds,
    )  # fmt: skip
    one = in_turns(
        {
            name: partial(select, at.ground, at.robot, model, at.base, at.landings[:1])
            for name, model in (("hand", HandScore()), ("learned", learned))
        },
        50 * rounds,
    )
    unit = best["coefficients"]
    goal("numpy float32 slices / coefficients", best["slices"] / unit, ">=", 25)
    goal("coefficients / three copies of the map", unit / best["copies"], "<=", 3)
    goal("learned P, 15 terms / coefficients", best["predict"] / unit, "<=", 10)
    goal("decision, learned / hand-made", one["learned"] / one["hand"], "<=", 1.3)
    goal("layers of a changed tile of 1 % / new map", best["tile"] / best["build"], "<=", 0.05)
    goal("with the search for what changed / new map", best["update"] / best["build"])
    goal("median and dilation of a new map / coefficients", best["filtered"] / unit)
    goal("all layers of a new map, planes too / coefficients", best["build"] / unit)
    goal("P and masks of a map / coefficients", best["scored"] / unit)
    goal("largest error of the table of P, 15 terms", float(learned.table_error()))


def _loops(z: Any) -> None:
    """Compute K1 and K2 of 1600 cells one by one in plain Python."""
    part = z[:42, :42].tolist()
    for i in range(1, 41):
        for j in range(1, 41):
            ring = [part[i][j] - part[i + a][j + b] for a in (-1, 0, 1) for b in (-1, 0, 1)]
            _ = sum(ring), sum(map(abs, ring))


@BENCH.part("--cells 100")
def times(*, cells: int = 1000) -> None:
    """Print the least processor times of the ground coefficients of a map, of one window and of one foothold choice.

    Args:
        cells: edge of the map in cells.
    """
    Footholds(FootholdsConfig()).rehearse()
    at, model = Ground(cells), HandScore()
    fast, slices = best_of(at.coefficients), best_of(at.slices, 3)
    loops = seconds_of(lambda: _loops(at.heights.z)) / 1600
    ns = 1e9 / cells**2
    rows = [
        ("K1 K2 cosK3, row kernel", ns * fast),
        ("K1 K2 cosK3, numpy slices", ns * slices),
        ("three copies of the map (memory floor)", ns * best_of(at.copies)),
        ("median filter + foot dilation, per map version", ns * best_of(at.build, 3)),
        ("K1 K2 cosK3, P, masks without a leg", ns * best_of(at.score, 3)),
        ("K1 K2 only, plain Python loops", 1e9 * loops),
        ("numpy / kernel", slices / fast),
        ("loops / kernel", loops * cells**2 / fast),
    ]
    table(f"whole map, {cells} x {cells} cells", ("what", "ns per cell"), rows)
    x, y = float(at.feet[0, 0]), float(at.feet[0, 1])
    (row, col), patch, far = at.heights.index(x, y), at.heights.patch(x, y, 17), TrunkPose((0.0, 0.0, 1.0))
    chosen = partial(select, at.ground, at.robot, model)
    calls: dict[str, Callable[[], object]] = {
        "K1 K2 cosK3, kernel": lambda: window_features(at.heights.z, row - 7, col - 7, 15, 15, STROKE, CELL),
        "K1 K2 cosK3, numpy": lambda: map_features_numpy(patch, STROKE, CELL),
        "decision for one leg, all masks": lambda: chosen(at.base, at.landings[:1]),
        "decision for six legs": lambda: chosen(at.base, at.landings),
        "one leg, nothing in reach, all trunk heights tried": lambda: chosen(far, at.landings[:1], SelectParams()),
    }
    rows = [(name, 1e6 * best_of(call, 100, 10)) for name, call in calls.items()]
    table("one 15 x 15 window", ("what", "us"), rows)


# Test function of Kosinski & Weigl, (16) and (17) of Walas & Belter 2011:
#     y = (1 + sqrt(x1) + 1 / x2 + x3^-1.5)^2,   APE = 100 / N sum |y - fit| / |y|
STARTS = {"identity": ((-2.0, 8.0), (0.0, 0.1)), "log": ((-2.0, 3.0), (0.0, 0.5))}
"""Ranges (low, high) of the random initial centres and widths of Gaussians, by warp of the inputs, no unit."""
BOUNDS = {"identity": Bounds(-20.0, 20.0, 1.0), "log": Bounds(-20.0, 20.0, 2.0)}
WARPS: tuple[Warp, ...] = ("identity", "log")


def function(x: Array) -> Array:
    """Return (1 + sqrt(x_1) + 1 / x_2 + x_3^-1.5)^2, (n,), of points x (n, 3), no unit.

    It is the test function of Kosinski & Weigl, (16) of Walas & Belter 2011.
    """
    return (1.0 + np.sqrt(x[:, 0]) + 1.0 / x[:, 1] + x[:, 2] ** -1.5) ** 2


def grid(values: Array) -> Array:
    """Return all triples of some values (n,), (n^3, 3), in their unit."""
    return np.stack(np.meshgrid(values, values, values, indexing="ij"), axis=-1).reshape(-1, 3)


def ape(columns: Array, c: Array, y: Array) -> float:
    """Return the mean absolute error of a fit in % of the target: 100 mean |y - columns c| / |y|.

    `columns`: terms, (n, m); `c`: weights, (m,); `y`: target, (n,); no unit.
    """
    return float(100.0 * np.mean(np.abs(y - columns @ c) / np.abs(y)))


def scaled(x: Array, warp: Warp) -> Array:
    """Return inputs (n, 3) of a slip model, no unit, after the same warp on all three."""
    return warped(x, (warp,) * 3, np.ones(3))


def best_start(x: Array, warp: Warp, m: int, starts: int, seed: int, evaluations: int = 300) -> RefinedTerms:
    """Return the m Gaussians of the smallest cost on points x (n, 3), no unit, of several random starts."""
    rng, u, y = np.random.default_rng(seed), scaled(x, warp), function(x)
    found = [
        refine(random_start(rng, m, 3, *STARTS[warp]), u, y, 1.0 / y, BOUNDS[warp], RIDGE, evaluations)
        for _ in range(starts)
    ]
    return min(found, key=lambda each: each.cost)


def error_of(found: RefinedTerms, x: Array, warp: Warp) -> float:
    """Return the mean absolute error of a fit on points x (n, 3), no unit, in %."""
    return ape(found.basis.columns(scaled(x, warp)), found.weights, function(x))


def folds_error(x: Array, warp: Warp, m: int, folds: int = 6) -> float:
    """Return the mean absolute error of points that were not fitted, in %, over folds of the training set x (n, 3).

    `warp`: of the inputs; `m`: number of Gaussians; one start each.
    """
    fold, total = np.random.default_rng(0).permutation(len(x)) % folds, 0.0
    for f in range(folds):
        held = fold == f
        total += error_of(best_start(x[~held], warp, m, 1, f, 100), x[held], warp) * held.sum()
    return total / len(x)


def protocol(name: str, train: Array, test: Array, sizes: tuple[int, ...], starts: int) -> None:
    """Print the mean absolute error, in %, on training and test points with both warps of the inputs.

    The warp that six folds of the training set choose is marked. train, test: points, (n, 3) and (k, 3), no unit;
    `sizes`: numbers of Gaussians.
    """
    rows: list[tuple[object, ...]] = []
    for m in sizes:
        folded = {warp: folds_error(train, warp, m) for warp in WARPS}
        for warp in WARPS:
            began = time.perf_counter()
            found = best_start(train, warp, m, starts, 0)
            seconds = time.perf_counter() - began
            mark = "chosen" if folded[warp] == min(folded.values()) else ""
            errors = (error_of(found, part, warp) for part in (train, test))
            rows.append((f"{m} Gaussians, {warp}", *errors, folded[warp], seconds, mark))
    table(f"{name}, {starts} starts, APE in %", ("fit", "train", "test", "six folds", "s", ""), rows)


def searches(m: int, evaluations: int) -> None:
    """Print errors of fits by particle swarm (PSO), evolution (EA) and variable projection to the test function.

    Variable projection is run with as many evaluations as the others, and with as much time as the slowest of them.

    Args:
        m: number of terms of a fit.
        evaluations: number of evaluations of the cost by each search.
    """
    train, test = grid(np.arange(1.0, 7.0)), grid(np.arange(1.5, 6.0))
    y, y_test, rows = function(train), function(test), list[tuple[object, ...]]()
    w, centres, widths = 1.0 / y, (-2.0, 8.0), (0.0, 0.5)

    def objective(basis: Basis) -> float:
        return cost(basis.columns(train), y, w, RIDGE)

    def note(name: str, basis: Basis, used: int, began: float) -> float:
        seconds, c = time.perf_counter() - began, weights(basis.columns(train), y, w, RIDGE)
        rows.append((name, ape(basis.columns(train), c, y), ape(basis.columns(test), c, y_test), used, seconds))
        return seconds

    runs: dict[str, Callable[[], Any]] = {
        "PSO, Gaussians": lambda: swarm(objective, m, 3, centres, widths, evaluations, 0),
        "EA, Gaussians": lambda: evolve(objective, "gaussian", m, 3, centres, widths, evaluations, 0),
        "EA, elementary": lambda: evolve(objective, "elementary", m, 3, (-1.0, 6.0), (0.0, 1.0), evaluations, 0),
    }
    longest = 0.0
    for name, run in runs.items():
        began = time.perf_counter()
        found = run()
        longest = max(longest, note(name, found.basis, found.evaluations, began))
    for name, limit_n, limit_s in (("varpro, as many", evaluations, np.inf), ("varpro, as long", np.inf, longest)):
        began, used, rng, tried = time.perf_counter(), 0, np.random.default_rng(0), list[RefinedTerms]()
        while used < limit_n and time.perf_counter() - began < limit_s:
            start = random_start(rng, m, 3, *STARTS["identity"])
            most = int(min(300, max(1, limit_n - used)))
            tried.append(refine(start, train, y, w, BOUNDS["identity"], RIDGE, most))
            used += tried[-1].evaluations
        note(name, min(tried, key=lambda each: each.cost).basis, used, began)
    table(
        f"searches on the grid, m = {m}, plain inputs, APE in %", ("search", "train", "test", "evaluations", "s"), rows
    )


@BENCH.part()
def fit(*, small: bool = False, evaluations: int = 6000) -> None:
    """Fit the test function of Kosinski & Weigl (Walas & Belter: .069 / .079 %, with sets that they do not state).

    Grid protocol: train {1..6}^3, test {1.5..5.5}^3. Random protocol: as many points evenly drawn from [1, 6]^3 and
    [1.5, 5.5]^3, five sets. Variable projection starts at random, and the start of the smallest cost on the training
    set is kept; the warp of the inputs is chosen by six folds of the training set. Test sets are only measured.

    Args:
        small: one random set, two starts, no searches.
        evaluations: budget of the searches.
    """
    protocol("grid", grid(np.arange(1.0, 7.0)), grid(np.arange(1.5, 6.0)), (10, 12), 2 if small else 8)
    for seed in range(1 if small else 5):
        rng = np.random.default_rng(100 + seed)
        train, test = rng.uniform(1.0, 6.0, (216, 3)), rng.uniform(1.5, 5.5, (125, 3))
        protocol(f"random set {seed}", train, test, (10,), 2 if small else 4)
    if not small:
        searches(10, evaluations)
