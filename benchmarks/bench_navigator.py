"""Speed of the navigator's filter, environment, planner and training, on one core unless said.

Targets: a UKF step (predict and one landmark) >= 200x filterpy; 1500 episodes of Sarsa < 2 s warm and >= 20x the steps
per s of PPO (Stable-Baselines3, where it is installed); vector environment >= 15x the steps of the single one, 150 000
a core; tables <= 5 s; a decision <= 20 us. The two environments are also compared by processor time, which a machine
that does other work leaves as it is.
"""

import importlib.util
import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from filterpy.kalman import JulierSigmaPoints, UnscentedKalmanFilter

from surefoot.kernels.jit import row_kernel
from surefoot.lab.train.sarsa import Training
from surefoot.services.navigator.belief.ukf import LandmarkSighting, predict, update, work_space, wrap
from surefoot.services.navigator.environment.episodes import DECISIONS, run_episodes
from surefoot.services.navigator.policy.arrays import GOAL_X, GOAL_Y, LAST, NO_ACTION, STATUS, ModelTables, arrays
from surefoot.services.navigator.policy.choose import ChoiceRoom, PolicyTables, choose, room_to_choose
from surefoot.services.navigator.policy.library import find
from surefoot.services.navigator.policy.params import load
from surefoot.services.navigator.policy.planner import plan

ROUNDS = 5


def best(call: Callable[[], Any], rounds: int = ROUNDS, clock: Callable[[], float] = time.perf_counter) -> float:
    """Return the shortest time of a call by a clock, s, after one to warm up."""
    call()
    times = []
    for _ in range(rounds):
        began = clock()
        call()
        times.append(clock() - began)
    return min(times)


def row(what: str, value: str, target: str = "", ok: bool | None = None) -> None:
    """Print one line of the table."""
    print(f"{what:58s} {value:>16s}  {target:18s} {'' if ok is None else 'ok' if ok else 'MISSED'}", flush=True)


@row_kernel
def _filter_steps(count: int, mean: Any, cov: Any, noise: Any, gain: Any, work: Any) -> None:
    for _ in range(count):
        predict(mean, cov, 0.1, 0.0, 0.0, 0.1, noise, work)
        seen = LandmarkSighting(mean[0] + 0.5, mean[1] + 0.1, 0.51, 0.2, 0.0225, 0.03)
        update(mean, cov, seen, gain, work)


def filters() -> None:
    """Time one step of the kernel and of filterpy."""
    n, count = 4, 20_000
    mean, cov, noise, gain = np.zeros(n), np.eye(n) * 0.01, np.full(4, 1e-4), np.zeros((2, 0))
    ours = best(lambda: _filter_steps(count, mean, cov, noise, gain, work_space(n))) / count
    points = JulierSigmaPoints(n, kappa=0.0)
    f = UnscentedKalmanFilter(
        n,
        2,
        1.0,
        hx=lambda x: np.array([math.hypot(0.5 - x[0], 0.1 - x[1]), math.atan2(0.1 - x[1], 0.5 - x[0]) - x[2]]),
        fx=lambda x, dt: x + np.array([0.1 * math.cos(x[2] + 0.05 * x[3]), 0.1 * math.sin(x[2]), 0.1 * x[3], 0.0]),
        points=points,
        residual_z=lambda a, b: np.array([a[0] - b[0], wrap(a[1] - b[1])]),
    )

    def theirs() -> None:
        for _ in range(100):
            f.x, f.P, f.Q = np.zeros(n), np.eye(n) * 0.01, np.eye(n) * 1e-4
            f.predict()
            f.sigmas_f = points.sigma_points(f.x, f.P)
            f.update(np.array([0.41, 0.2]), R=np.diag([0.0225, 0.03]))

    other = best(theirs) / 100
    row("UKF step, kernel / filterpy", f"{ours * 1e6:.2f} / {other * 1e6:.0f} us")
    row("  ratio", f"{other / ours:.0f}x", ">= 200x", other / ours >= 200)


def environment() -> None:
    """Time belief steps with policies of different cost, and the decision alone."""
    model = load("paper")
    world = arrays(model)
    for name in ("tuned", "planner"):
        policy = find(name, model)
        steps = run_episodes(world, policy, 0, 0, 300)[:, DECISIONS].sum()
        seconds = best(lambda policy=policy: run_episodes(world, policy, 0, 0, 300))
        row(
            f"belief steps of {name}, one core",
            f"{steps / seconds / 1e3:.0f} k/s",
            ">= 100 k/s",
            steps / seconds >= 1e5,
        )
    for use in ("four", "arcs"):
        decision(use)


def decision(use: str) -> None:
    """Time a decision of the planner in the kernel, by many of them at different beliefs."""
    model = load("paper", [f"use={use!r}"])
    world, policy = arrays(model), find("planner", model)
    rng, status, room = np.random.default_rng(0), np.zeros(STATUS), room_to_choose(4, len(world.names))
    status[LAST] = NO_ACTION
    means, cov = rng.normal(size=(2000, 4)), np.diag([0.01, 0.01, 0.02, 0.1])
    seconds = best(lambda: _decide_all(policy.tables, world.tables, means, cov, status, room))
    one = seconds / len(means)
    row(f"decision of the planner, {use}", f"{one * 1e6:.1f} us", "<= 20 us", one <= 20e-6)


@row_kernel
def _decide_all(policy: PolicyTables, model: ModelTables, means: Any, cov: Any, status: Any, room: ChoiceRoom) -> int:
    total = 0
    for i in range(means.shape[0]):
        total += choose(policy, model, means[i], cov, model.scene[GOAL_X], model.scene[GOAL_Y], status, room)
    return total


def tables() -> None:
    """Time value iteration."""
    for name, use in (("paper", "four"), ("paper", "arcs"), ("nao", "arcs")):
        world = arrays(load(name, [f"use={use!r}"]))
        seconds = best(lambda world=world: plan(world), 2)
        row(f"table of the planner, {name}, {use}", f"{seconds:.2f} s", "<= 5 s", seconds <= 5.0)


def training() -> float:
    """Time a training; return its steps per s of processor time."""
    model, steps = load("paper"), 0.0

    def one() -> None:
        nonlocal steps
        t = Training(model, 0)
        t.advance(t.schedule.episodes)
        steps = float(np.nansum(t.seconds)) / 1.75  # nearly all actions take 1.75 s: a lower bound of their number

    seconds = best(one, 3, time.process_time)
    row("1500 episodes of Sarsa, processor time", f"{seconds:.2f} s", "< 2 s", seconds < 2.0)
    row("  decisions learned from", f"{steps / seconds / 1e3:.0f} k/s")
    return steps / seconds


def batches() -> None:
    """Time the single and the vector environment with random actions, episodes that end begun anew."""
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

    single, vector = best(alone) / 2000, best(together) / steps / count
    row("single environment", f"{1e-3 / single:.1f} k steps/s")
    row(f"vector environment of {count}, all cores", f"{1e-3 / vector:.0f} k steps/s")
    row("  ratio", f"{single / vector:.1f}x", ">= 15x", single / vector >= 15)
    one, each = (best(call, clock=time.process_time) for call in (alone, together))
    one, each = one / 2000, each / steps / count
    row("processor time of a step, single / vector", f"{1e6 * one:.1f} / {1e6 * each:.1f} us")
    row("vector environment, steps a core", f"{1e-3 / each:.0f} k/s", ">= 150 k/s", each <= 1.0 / 150e3)
    row("  ratio, a core", f"{one / each:.1f}x")


def peer(ours: float) -> None:
    """Time PPO of Stable-Baselines3 on the same environment, where it is installed; processor time, one thread."""
    if importlib.util.find_spec("stable_baselines3") is None or importlib.util.find_spec("gymnasium") is None:
        print("stable_baselines3 is not installed: no comparison with PPO")
        return
    import torch
    from stable_baselines3 import PPO

    from surefoot.lab.train.gym import NavigatorEnv

    torch.set_num_threads(1)
    learner, steps = PPO("MlpPolicy", NavigatorEnv("paper"), n_steps=1024, device="cpu", verbose=0), 4096
    began = time.process_time()
    learner.learn(steps)
    theirs = steps / (time.process_time() - began)
    row("PPO (Stable-Baselines3), the same environment", f"{theirs / 1e3:.2f} k/s")
    row("  ratio", f"{ours / theirs:.0f}x", ">= 20x", ours / theirs >= 20)


def main() -> None:
    """Run all of it."""
    filters()
    environment()
    tables()
    ours = training()
    batches()
    peer(ours)


if __name__ == "__main__":
    main()
