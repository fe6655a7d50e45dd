"""CPU time of the simulated world against a bare mj_step loop over the same robot, ground and commands.

    python benchmarks/bench_simulator.py [--seconds 10] [--rounds 5]

Both runs of a pair follow one another in one process; the table gives the median of the rounds. `bare` is
`mj_step(model, data, 10)` per control tick with the same commands on a model without any sensor; `world` adds sensors
with noise, truth, releases and the building of the truth record.
"""

import argparse
import statistics
import time
from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import NDArray

from services.simulator import world as w
from services.simulator.model import build_model
from services.simulator.terrain import make_terrain
from surefoot.robot import Robot, load_robot

Array = NDArray[np.float64]


def marching(robot: Robot, ticks: int) -> Array:
    """Joint commands of a tripod march on the spot, (ticks, nj), rad."""
    t = w.TICK_NS * 1e-9 * np.arange(ticks)
    q = np.tile(robot.neutral, (ticks, 1))
    for i, leg in enumerate(robot.legs):
        lift = np.clip(np.sin(2.0 * np.pi * t + np.pi * (i % 2)), 0.0, 1.0)
        coxa, femur, tibia = leg.joints
        q[:, coxa] += 0.1 * np.cos(2.0 * np.pi * t + np.pi * (i % 2)) * (1.0 if i < 3 else -1.0)
        q[:, femur] += 0.35 * lift
        q[:, tibia] -= 0.1 * lift
    return q


def cpu(run: Callable[[], None]) -> float:
    """CPU seconds of a call."""
    begin = time.process_time()
    run()
    return time.process_time() - begin


def pair(kind: str, seconds: float, rounds: int) -> tuple[float, float, float]:
    """Median us per tick: bare, world, bare over world."""
    robot = load_robot("ragno")
    terrain = make_terrain(kind, seed=1)
    world = w.World(robot, terrain)
    ticks = round(seconds * 1e9 / w.TICK_NS)
    commands = marching(robot, ticks)
    start = 0.5 if kind == "demo" else 0.0  # m, in the middle of the hills
    bare: list[float] = []
    ours: list[float] = []
    ratio: list[float] = []

    def run_world() -> None:
        for q in commands:
            world.step_tick(q)
            world.truth()

    model, _ = build_model(robot, terrain)
    data = mujoco.MjData(model)

    def run_bare() -> None:
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = world.data.qpos, world.data.qvel
        for q in commands:
            data.ctrl[:] = q
            mujoco.mj_step(model, data, w.TICK_STEPS)

    for k in range(rounds):
        for run, times in ((run_bare, bare), (run_world, ours))[:: 1 if k % 2 else -1]:
            world.reset(pose=(start, 0.0, 0.0))
            times.append(cpu(run) / ticks * 1e6)
        ratio.append(bare[-1] / ours[-1])
    return statistics.median(bare), statistics.median(ours), statistics.median(ratio)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--rounds", type=int, default=5)
    args = parser.parse_args()
    w.warm()
    print(f"{'terrain':10s} {'bare us/tick':>12s} {'world us/tick':>13s} {'bare/world':>10s} {'RTF':>7s}")
    for kind in ("flat", "demo"):
        bare, ours, ratio = pair(kind, args.seconds, args.rounds)
        print(f"{kind:10s} {bare:12.1f} {ours:13.1f} {ratio:10.2f} {1e4 / ours:7.1f}")


if __name__ == "__main__":
    main()
