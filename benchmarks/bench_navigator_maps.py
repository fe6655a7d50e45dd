"""Times of maps: association of a frame, relocalisation, routes over 2000 x 2000 cells.

python -m benchmarks.bench_navigator_maps
"""

import argparse
import math
import sys
import time
from collections.abc import Callable
from statistics import median

import numpy as np
from numpy.typing import NDArray

from benchmarks.bench_navigator_lost import EASY, ROUGH, Robot, corridor
from surefoot.services.navigator.belief.landmarks import FloorLandmarks
from surefoot.services.navigator.belief.matching import Detections, known_elsewhere, match
from surefoot.services.navigator.belief.relocalise import Glance, relocalise
from surefoot.services.navigator.planning.costs import prepare
from surefoot.services.navigator.planning.grid import FloorGrid
from surefoot.services.navigator.planning.route import plan

CELLS = 2000
CELL = 0.05
"""m."""


def timed(function: Callable[[], object], times: int) -> float:
    """Return the median s of a call, after a first one that does not count; time of this process, not of others."""
    function()
    found: list[float] = []
    for _ in range(times):
        began = time.process_time_ns()
        function()
        found.append(1e-9 * (time.process_time_ns() - began))
    return median(found)


def boxes(seed: int) -> NDArray[np.int8]:
    """3000 boxes at random."""
    rng = np.random.default_rng(seed)
    cells = np.zeros((CELLS, CELLS), dtype=np.int8)
    for _ in range(3000):
        r, c, h, w = *rng.integers(0, CELLS, 2), *rng.integers(4, 40, 2)
        cells[r : r + h, c : c + w] = 100
    cells[:60, :60] = cells[-60:, -60:] = 0
    return cells


def meander(pitch: int) -> NDArray[np.int8]:
    """One way up and down through the whole map."""
    cells = np.zeros((CELLS, CELLS), dtype=np.int8)
    for i, r in enumerate(range(pitch, CELLS - pitch, pitch)):
        cells[r : r + 2] = 100
        cells[r : r + 2, slice(2, pitch) if i % 2 else slice(-pitch, -2)] = 0
    return cells


def maze(pitch: int, seed: int) -> NDArray[np.int8]:
    """A maze without loops, by a random walk that turns back where it cannot go on."""
    rng, n = np.random.default_rng(seed), CELLS // pitch
    cells, seen, way = np.zeros((CELLS, CELLS), dtype=np.int8), np.zeros((n, n), dtype=bool), [(0, 0)]
    cells[pitch - 1 :: pitch] = 100
    cells[:, pitch - 1 :: pitch] = 100
    seen[0, 0] = True
    while way:
        r, c = way[-1]
        near = [(r + i, c + j) for i, j in ((0, 1), (1, 0), (0, -1), (-1, 0))]
        near = [(i, j) for i, j in near if 0 <= i < n and 0 <= j < n and not seen[i, j]]
        if not near:
            way.pop()
            continue
        i, j = near[rng.integers(len(near))]
        top, side = max(r, i) * pitch, max(c, j) * pitch
        if i == r:
            cells[r * pitch : (r + 1) * pitch - 1, side - 1] = 0
        else:
            cells[top - 1, c * pitch : (c + 1) * pitch - 1] = 0
        seen[i, j] = True
        way.append((i, j))
    return cells


def trap() -> NDArray[np.int8]:
    """A room with its door on the far side, the goal behind its wall."""
    cells = np.zeros((CELLS, CELLS), dtype=np.int8)
    cells[100:1900, 1900:1904] = cells[100:104, 100:1904] = cells[1896:1900, 100:1904] = 100
    return cells


def routes(times: int) -> None:
    """Print the times of routes."""
    print(f"{'map':12} {'prepare s':>10} {'route ms':>10} {'length m':>10} {'waypoints':>10}")
    for name, cells, start, goal in (
        ("empty", np.zeros((CELLS, CELLS), dtype=np.int8), (1.0, 1.0), (98.0, 99.0)),
        ("boxes", boxes(1), (0.8, 0.8), (98.9, 98.9)),
        ("maze 1 m", maze(20, 1), (0.5, 0.5), (99.45, 99.45)),
        ("maze 2.5 m", maze(50, 1), (1.2, 1.2), (98.8, 98.8)),
        ("meander 3 m", meander(60), (1.5, 1.5), (98.0, 98.5)),
        ("trap", trap(), (50.0, 50.0), (99.0, 50.0)),
    ):
        grid = FloorGrid(cells, CELL)
        prepared = timed(lambda grid=grid: prepare(grid), 1)
        costs = prepare(grid)
        found = plan(costs, start, goal)
        spent = timed(lambda costs=costs, start=start, goal=goal: plan(costs, start, goal), times)
        print(f"{name:12} {prepared:10.2f} {1e3 * spent:10.1f} {found.length:10.1f} {len(found.waypoints):10}")


def frames(times: int) -> None:
    """Print the times of a frame of 20 detections against 6000 landmarks, and of a relocalisation from ten frames."""
    rng = np.random.default_rng(1)
    looks = rng.standard_normal((6000, 8))
    world = FloorLandmarks(rng.uniform(-5, 5, (6000, 2)), looks / np.linalg.norm(looks, axis=1, keepdims=True))
    cov = np.diag([0.03**2, 0.03**2, math.radians(3) ** 2])
    for name, noise in (("easy", EASY), ("rough", ROUGH)):
        robot = Robot(world, noise, 1)
        robot.mode = "stand"
        seen = Detections(np.zeros(0), np.zeros(0), np.zeros((0, 8)))
        while len(seen) < 20:
            more = robot.look()
            seen = Detections(
                np.append(seen.ranges, more.ranges)[:20], np.append(seen.bearings, more.bearings)[:20],
                np.vstack((seen.looks, more.looks))[:20],
            )  # fmt: skip
        here, away = robot.truth, robot.truth + np.array([0.7, 0.0, 0.5 * math.pi])
        found, lost = match(here, cov, seen, world, noise), match(away, cov, seen, world, noise)
        for what, function in (
            ("match 20 detections", lambda noise=noise, seen=seen, here=here: match(here, cov, seen, world, noise)),
            ("look up those not matched", lambda f=found, s=seen, n=noise: known_elsewhere(f, s, world, n)),
            ("the same, displaced", lambda f=lost, s=seen, n=noise: known_elsewhere(f, s, world, n)),
        ):
            print(f"{name:6} {what:28} {1e6 * timed(function, times):8.0f} us")
        standing = Robot(corridor(1, 40.0, 0.5), noise, 1)
        standing.mode = "stand"
        glances = [Glance(standing.look()) for _ in range(10)]
        spent = timed(lambda g=glances, w=standing.world, n=noise: relocalise(g, w, n), 5)
        print(f"{name:6} {'relocalise from 10 frames':28} {1e3 * spent:8.1f} ms")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=5, help="calls of each route; frames 100 times as many")
    args = parser.parse_args()
    frames(100 * args.times)
    sys.stdout.flush()
    routes(args.times)


if __name__ == "__main__":
    main()
