"""Speed of the navigator: filter, environment, decisions, planner, training and routes, on one core unless stated."""

import importlib.util
import math
import time
from statistics import median
from typing import Any

import numpy as np
from filterpy.kalman import JulierSigmaPoints, UnscentedKalmanFilter
from numpy.typing import NDArray

from benchmarks.bench import Bench, best_of, goal, seconds_of, table
from surefoot.arrays import record
from surefoot.kernels.jit import free_kernel, row_kernel
from surefoot.lab.train.sarsa import Training
from surefoot.services.navigator.belief.ukf import LandmarkSighting, predict, update, work_space, wrap
from surefoot.services.navigator.environment.episodes import run_episodes
from surefoot.services.navigator.planning.costs import prepare
from surefoot.services.navigator.planning.grid import FloorGrid
from surefoot.services.navigator.planning.route import plan as plan_route
from surefoot.services.navigator.policy.arrays import NO_ACTION, STATUS, ModelTables, arrays
from surefoot.services.navigator.policy.choose import ChoiceRoom, PolicyTables, choose, room_to_choose
from surefoot.services.navigator.policy.library import find
from surefoot.services.navigator.policy.params import load
from surefoot.services.navigator.policy.planner import plan

BENCH = Bench("navigator")


@row_kernel
def _filter_steps(count: int, mean: Any, cov: Any, noise: Any, gain: Any, work: Any) -> None:
    for _ in range(count):
        predict(mean, cov, 0.1, 0.0, 0.0, 0.1, noise, work)
        seen = LandmarkSighting(mean[0] + 0.5, mean[1] + 0.1, 0.51, 0.2, 0.0225, 0.03)
        update(mean, cov, seen, gain, work)


@BENCH.part("")
def filters() -> None:
    """Print the time of a filter step (prediction and one landmark) by the kernel and by filterpy, and their ratio."""
    n, count = 4, 20_000
    mean, cov, noise, gain = np.zeros(n), np.eye(n) * 0.01, np.full(4, 1e-4), np.zeros((2, 0))
    ours = best_of(lambda: _filter_steps(count, mean, cov, noise, gain, work_space(n))) / count
    points = JulierSigmaPoints(n, kappa=0.0)
    f = UnscentedKalmanFilter(
        n, 2, 1.0,
        hx=lambda x: np.array([math.hypot(0.5 - x[0], 0.1 - x[1]), math.atan2(0.1 - x[1], 0.5 - x[0]) - x[2]]),
        fx=lambda x, dt: x + np.array([0.1 * math.cos(x[2] + 0.05 * x[3]), 0.1 * math.sin(x[2]), 0.1 * x[3], 0.0]),
        points=points, residual_z=lambda a, b: np.array([a[0] - b[0], wrap(a[1] - b[1])]),
    )  # fmt: skip

    def theirs() -> None:
        for _ in range(100):
            f.x, f.P, f.Q = np.zeros(n), np.eye(n) * 0.01, np.eye(n) * 1e-4
            f.predict()
            f.sigmas_f = points.sigma_points(f.x, f.P)
            f.update(np.array([0.41, 0.2]), R=np.diag([0.0225, 0.03]))

    other = best_of(theirs) / 100
    goal("filter step, kernel", ours * 1e6, unit="us")
    goal("filter step, filterpy", other * 1e6, unit="us")
    goal("  ratio", other / ours, ">=", 200)


@BENCH.part()
def decisions() -> None:
    """Print the time of simulated steps with policies of different cost, and of single decisions at many beliefs."""
    model = load("paper")
    world = arrays(model)
    for name in ("tuned", "planner"):
        policy = find(name, model)
        steps = run_episodes(world, policy, 0, 0, 300)["decisions"].sum()
        seconds = best_of(lambda policy=policy: run_episodes(world, policy, 0, 0, 300))
        goal(f"belief steps of {name}, one core", steps / seconds, ">=", 1e5, "1/s")
    means, cov = np.random.default_rng(0).normal(size=(2000, 4)), np.diag([0.01, 0.01, 0.02, 0.1])
    for use in ("four", "arcs"):
        model = load("paper", [f"use={use!r}"])
        world, policy = arrays(model), find("planner", model)
        status, room = record(STATUS), room_to_choose(4, len(world.names))
        status.last = NO_ACTION
        seconds = best_of(lambda c=(policy.tables, world.tables, status, room): _decide_all(means, cov, *c))
        goal(f"decision of the planner, {use}", 1e6 * seconds / len(means), "<=", 20, "us")


@free_kernel
def _decide_all(means: Any, cov: Any, policy: PolicyTables, model: ModelTables, status: Any, room: ChoiceRoom) -> int:
    total = 0
    for i in range(means.shape[0]):
        total += choose(policy, model, means[i], cov, model.scene[0].goal_x, model.scene[0].goal_y, status, room)
    return total


@BENCH.part()
def tables() -> None:
    """Print the wall time of the value iteration that computes each table of the planner, s."""
    for name, use in (("paper", "four"), ("paper", "arcs"), ("nao", "arcs")):
        world = arrays(load(name, [f"use={use!r}"]))
        goal(f"table of the planner, {name}, {use}", best_of(lambda world=world: plan(world), 2), "<=", 5.0, "s")


@BENCH.part()
def training() -> None:
    """Print the processor time of 1500 episodes of Sarsa, and of PPO of Stable-Baselines3 if installed, one thread."""
    model, steps = load("paper"), 0.0

    def one() -> None:
        nonlocal steps
        t = Training(model, 0)
        t.advance(t.schedule.episodes)
        steps = float(np.nansum(t.seconds)) / 1.75  # nearly all actions take 1.75 s: a lower bound of their number

    seconds = best_of(one, 3, clock=time.process_time)
    goal("1500 episodes of Sarsa", seconds, "<=", 2.0, "s")
    goal("  decisions learned from", steps / seconds, unit="1/s")
    if importlib.util.find_spec("stable_baselines3") is None or importlib.util.find_spec("gymnasium") is None:
        print("stable_baselines3 is not installed: no comparison with PPO")
        return
    import torch  # pyright: ignore[reportMissingImports] - optional
    from stable_baselines3 import PPO  # pyright: ignore[reportMissingImports] - optional

    from surefoot.lab.train.gym import NavigatorEnv

    torch.set_num_threads(1)
    learner, count = PPO("MlpPolicy", NavigatorEnv("paper"), n_steps=1024, device="cpu", verbose=0), 4096
    theirs = count / seconds_of(lambda: learner.learn(count), time.process_time)
    goal("PPO (Stable-Baselines3), the same environment", theirs, unit="1/s")
    goal("  ratio", steps / seconds / theirs, ">=", 20)


@BENCH.part()
def environments() -> None:
    """Print the time of a step of the single and of the vector environment with random actions, us.

    Ended episodes begin anew. Wall and processor time are printed; only the latter is independent of other load.
    """
    if importlib.util.find_spec("gymnasium") is None:
        print("gymnasium is not installed: no environments to time")
        return
    from surefoot.lab.train.gym import NavigatorEnv, NavigatorVectorEnv

    model, count, steps, rng = load("paper"), 4096, 20, np.random.default_rng(0)
    actions = rng.integers(0, 4, size=(steps, count))
    env, batch = NavigatorEnv(model), NavigatorVectorEnv(count, model)
    env.reset(seed=0)
    batch.reset(seed=0)

    def alone() -> None:
        for action in actions[0, :2000]:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()

    def together() -> None:
        for row in actions:
            batch.step(row)

    for clock, what, least in ((time.perf_counter, "all cores", 15.0), (time.process_time, "a core", None)):
        single, vector = best_of(alone, clock=clock) / 2000, best_of(together, clock=clock) / steps / count
        goal(f"single environment, {what}", 1e6 * single, unit="us a step")
        goal(f"vector environment of {count}, {what}", 1e6 * vector, unit="us a step")
        goal(f"  ratio, {what}", single / vector, ">=", least)
    goal("vector environment, steps a core", 1.0 / vector, ">=", 150e3, "1/s")


CELLS, CELL = 2000, 0.05
"""`CELLS`: number of cells along each edge of a map; `CELL`: edge of a cell, m."""


def boxes(seed: int) -> NDArray[np.int8]:
    """Return the occupancy of 3000 boxes at random, (2000, 2000): 0 free, 100 occupied."""
    rng = np.random.default_rng(seed)
    cells = np.zeros((CELLS, CELLS), dtype=np.int8)
    for _ in range(3000):
        r, c, h, w = *rng.integers(0, CELLS, 2), *rng.integers(4, 40, 2)
        cells[r : r + h, c : c + w] = 100
    cells[:60, :60] = cells[-60:, -60:] = 0
    return cells


def meander(pitch: int) -> NDArray[np.int8]:
    """Return the occupancy of one corridor up and down through the whole map, (2000, 2000): 0 free, 100 occupied.

    `pitch`: distance of its walls, cells.
    """
    cells = np.zeros((CELLS, CELLS), dtype=np.int8)
    for i, r in enumerate(range(pitch, CELLS - pitch, pitch)):
        cells[r : r + 2] = 100
        cells[r : r + 2, slice(2, pitch) if i % 2 else slice(-pitch, -2)] = 0
    return cells


def maze(pitch: int, seed: int) -> NDArray[np.int8]:
    """Return the occupancy of a maze without loops, (2000, 2000): 0 free, 100 occupied.

    It is drawn by a random walk that turns back where it cannot continue. `pitch`: distance of its walls, cells.
    """
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
    """Return the occupancy of a room that is open on one side, (2000, 2000): 0 free, 100 occupied."""
    cells = np.zeros((CELLS, CELLS), dtype=np.int8)
    cells[100:1900, 1900:1904] = cells[100:104, 100:1904] = cells[1896:1900, 100:1904] = 100
    return cells


@BENCH.part()
def routes(*, times: int = 5) -> None:
    """Print the median processor time of route searches over maps of 2000 x 2000 cells.

    Args:
        times: number of searches for each route.
    """
    rows: list[tuple[object, ...]] = []
    for name, cells, start, end in (
        ("empty", np.zeros((CELLS, CELLS), dtype=np.int8), (1.0, 1.0), (98.0, 99.0)),
        ("boxes", boxes(1), (0.8, 0.8), (98.9, 98.9)),
        ("maze 1 m", maze(20, 1), (0.5, 0.5), (99.45, 99.45)),
        ("maze 2.5 m", maze(50, 1), (1.2, 1.2), (98.8, 98.8)),
        ("meander 3 m", meander(60), (1.5, 1.5), (98.0, 98.5)),
        ("trap", trap(), (50.0, 50.0), (99.0, 50.0)),
    ):
        grid = FloorGrid(cells, CELL)
        costs = prepare(grid)
        prepared = seconds_of(lambda grid=grid: prepare(grid), time.process_time)
        found = plan_route(costs, start, end)
        spent = median(
            seconds_of(lambda c=costs, a=start, b=end: plan_route(c, a, b), time.process_time) for _ in range(times)
        )
        rows.append((name, prepared, 1e3 * spent, found.length, len(found.waypoints)))
    table("routes", ("map", "prepare s", "route ms", "length m", "waypoints"), rows)
