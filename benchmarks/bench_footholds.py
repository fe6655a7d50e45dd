"""Speed of the foothold functions: ground coefficients of a map, one decision, the whole map scored; ratios in one run.

    python -m benchmarks.bench_footholds [--cells 1000]

Calls that are compared take turns, and each counts with its best time: a busy machine makes single times worthless.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from surefoot.geometry.heightmap import HeightMap
from surefoot.robot.kinematics import foot_positions
from surefoot.robot.reader import load_robot
from surefoot.services.footholds.assess import assess, whole_map
from surefoot.services.footholds.config import FootholdsConfig
from surefoot.services.footholds.features import (
    coefficients,
    map_features,
    map_features_numpy,
    push_direction,
    window_features,
)
from surefoot.services.footholds.ground import FootholdGround, build_ground, updated_ground
from surefoot.services.footholds.learning.fit import fit_terms
from surefoot.services.footholds.learning.merge import candidate_of
from surefoot.services.footholds.models import score
from surefoot.services.footholds.models.files import load, shipped
from surefoot.services.footholds.models.learned import LearnedModel
from surefoot.services.footholds.select import Landing, SelectParams, TrunkPose, select
from surefoot.services.footholds.service import Footholds

CELL = 0.005
STROKE = np.array([-0.05, 0.0, 0.0])


def best_of(function: Callable[[], object], repeats: int = 5, calls: int = 1) -> float:
    """Smallest mean time of one call over blocks of calls, s: short blocks see through a loaded machine."""
    function()
    times: list[float] = []
    for _ in range(repeats):
        began = time.perf_counter()
        for _ in range(calls):
            function()
        times.append((time.perf_counter() - began) / calls)
    return min(times)


_LAYER: dict[tuple[int, int], np.ndarray] = {}
"""Scratch layers by shape."""


def in_turns(functions: dict[str, Callable[[], object]], rounds: int = 30) -> dict[str, float]:
    """Smallest time of each call, s, over rounds in which all take turns."""
    best = dict.fromkeys(functions, float("inf"))
    for function in functions.values():
        function()
    for _ in range(rounds):
        for name, function in functions.items():
            began = time.perf_counter()
            function()
            best[name] = min(best[name], time.perf_counter() - began)
    return best


def ratios(heights: HeightMap, landings: list[Landing], base: TrunkPose, rounds: int) -> None:
    """Print what costs how many times what, beside the limits of the project."""
    robot = load_robot("ragno")
    out = [np.empty_like(heights.z) for _ in range(3)]
    push = np.array(push_direction(STROKE), dtype=np.float32)
    hand, learned = score.HandScore(), _small(load(shipped("ragno") or ""), 15)
    features = map_features(heights.z, STROKE, CELL)
    ground = build_ground(heights, robot.foot_radius)
    edge = heights.shape[0] // 10
    tile = heights.z.copy()
    tile[edge : 2 * edge, edge : 2 * edge] += np.float32(0.01)
    versions = [heights, heights.with_z(tile)]
    state = {"ground": build_ground(heights, robot.foot_radius), "now": 0}

    def update() -> None:
        now = state["now"]
        state["ground"] = updated_ground(state["ground"], versions[now], versions[1 - now])
        state["now"] = 1 - now

    best = in_turns(
        {
            "coefficients": lambda: coefficients(heights.z, push, np.float32(CELL), *out),
            "slices": lambda: map_features_numpy(heights.z, STROKE, CELL),
            "copies": lambda: [np.copyto(layer, heights.z) for layer in out],
            "predict": lambda: learned.predict(features, CELL),
            "build": lambda: build_ground(heights, robot.foot_radius),
            "update": update,
            "tile": lambda: tile_alone(versions[1], state["ground"], edge),
            "scored": lambda: assess(ground, hand, whole_map(ground), None, STROKE, ("p", "mask"), SelectParams()),
        },
        rounds,
    )
    one = in_turns(
        {
            "hand": lambda: select(ground, robot, hand, base, landings[:1]),
            "learned": lambda: select(ground, robot, learned, base, landings[:1]),
        },
        50 * rounds,
    )
    rows = (
        ("numpy float32 slices / coefficients", best["slices"] / best["coefficients"], ">= 25"),
        ("coefficients / three copies of the map", best["coefficients"] / best["copies"], "<= 3"),
        ("learned P, 15 terms / coefficients", best["predict"] / best["coefficients"], "<= 10"),
        ("decision, learned / hand-made", one["learned"] / one["hand"], "<= 1.3"),
        ("layers of a changed tile of 1 % / new map", best["tile"] / best["build"], "<= .05"),
        ("the same with the search for what changed", best["update"] / best["build"], ""),
        ("median and dilation of a new map / coefficients", best["build"] / best["coefficients"], ""),
        ("P and masks of a map / coefficients", best["scored"] / best["coefficients"], ""),
    )
    print("ratios")
    for name, value, limit in rows:
        print(f"  {name:<50}{value:10.3f}   {limit}")
    print(f"  {'largest error of the table of P, 15 terms':<50}{learned.table_error():10.4f}")


def tile_alone(heights: HeightMap, ground: FootholdGround, edge: int) -> None:
    """Filter and dilate one tile of a map."""
    full = _LAYER.setdefault(heights.shape, np.empty_like(heights.z))
    heights.smooth_part(full, edge - 1, 2 * edge + 1, edge - 1, 2 * edge + 1)
    ground.surface.dilate_part(ground.foot_radius, full, edge - 2, 2 * edge + 2, edge - 2, 2 * edge + 2)


def _small(model: LearnedModel, terms: int) -> LearnedModel:
    """The model with fewer terms, fitted to the same bins."""
    shape = replace(candidate_of(model), terms=terms)
    return replace(model, terms=fit_terms(model.lattice, model.bins, shape, model.seed))


def python_loops(z: np.ndarray) -> float:
    """K1 and K2 cell by cell in plain Python on a small part; s per cell."""
    part = z[:42, :42].tolist()
    began = time.perf_counter()
    for i in range(1, 41):
        for j in range(1, 41):
            ring = [part[i][j] - part[i + a][j + b] for a in (-1, 0, 1) for b in (-1, 0, 1)]
            sum(ring), sum(map(abs, ring))
    return (time.perf_counter() - began) / 1600


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cells", type=int, default=1000, help="edge of the map in cells")
    parser.add_argument("--ratios", action="store_true", help="the ratios alone")
    parser.add_argument("--rounds", type=int, default=30, help="of calls that take turns")
    args = parser.parse_args()
    n = args.cells
    Footholds(FootholdsConfig()).rehearse()
    robot = load_robot("ragno")
    rng = np.random.default_rng(0)
    x = CELL * np.arange(n)
    z = 0.01 * np.sin(x[None, :] / 0.07) * np.cos(x[:, None] / 0.05) + rng.normal(0.0, 0.002, (n, n))
    heights = HeightMap(z=z.astype(np.float32), cell=CELL, origin=(-0.5 * n * CELL, -0.5 * n * CELL))
    feet = foot_positions(robot.model, robot.neutral)
    base = TrunkPose((0.0, 0.0, 0.008 - float(feet[0, 2]) + 0.005))
    landings = [Landing(leg, (float(feet[leg, 0]), float(feet[leg, 1]), 0.0), (-0.05, 0.0, 0.0)) for leg in range(6)]
    ratios(heights, landings, base, args.rounds)
    if args.ratios:
        return
    out = [np.empty_like(heights.z) for _ in range(3)]
    push = np.array(push_direction(STROKE), dtype=np.float32)
    model = score.HandScore()

    print(f"whole map, {n} x {n} cells, ns per cell (best of 5)")
    fast = best_of(lambda: coefficients(heights.z, push, np.float32(CELL), *out))
    slices = best_of(lambda: map_features_numpy(heights.z, STROKE, CELL), repeats=3)
    copy = best_of(lambda: [np.copyto(layer, heights.z) for layer in out])
    loops = python_loops(heights.z)
    ground = build_ground(heights, robot.foot_radius)
    built = best_of(lambda: build_ground(heights, robot.foot_radius), repeats=3)
    scored = best_of(
        lambda: assess(ground, model, whole_map(ground), None, STROKE, ("p", "mask"), SelectParams()), repeats=3
    )
    for name, seconds in (
        ("K1 K2 cosK3, row kernel", fast),
        ("K1 K2 cosK3, numpy slices", slices),
        ("three copies of the map (memory floor)", copy),
        ("median filter + foot dilation, per map version", built),
        ("K1 K2 cosK3, P, masks without a leg", scored),
    ):
        print(f"  {name:<50}{seconds * 1e9 / n**2:10.2f}")
    print(f"  {'K1 K2 only, plain Python loops':<50}{loops * 1e9:10.0f}")
    print(f"  numpy / kernel {slices / fast:.0f}x, loops / kernel {loops * n**2 / fast:.0f}x")

    row, col = heights.index(float(feet[0, 0]), float(feet[0, 1]))
    print("one 15 x 15 window, us (best of 100 blocks of 10)")
    window = best_of(lambda: window_features(heights.z, row - 7, col - 7, 15, 15, STROKE, CELL), repeats=100, calls=10)
    patch = heights.patch(float(feet[0, 0]), float(feet[0, 1]), 17)
    window_numpy = best_of(lambda: map_features_numpy(patch, STROKE, CELL), repeats=100, calls=10)
    leg = best_of(lambda: select(ground, robot, model, base, landings[:1]), repeats=100, calls=10)
    six = best_of(lambda: select(ground, robot, model, base, landings), repeats=100, calls=10)
    far = TrunkPose((0.0, 0.0, 1.0))
    worst = best_of(lambda: select(ground, robot, model, far, landings[:1], SelectParams()), repeats=100, calls=10)
    for name, seconds in (
        ("K1 K2 cosK3, kernel", window),
        ("K1 K2 cosK3, numpy", window_numpy),
        ("decision for one leg, all masks", leg),
        ("decision for six legs", six),
        ("one leg, nothing in reach, all trunk heights tried", worst),
    ):
        print(f"  {name:<50}{seconds * 1e6:10.1f}")


if __name__ == "__main__":
    main()
