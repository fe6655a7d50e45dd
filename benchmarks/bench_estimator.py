"""What the estimators cost: `python -m benchmarks.bench_estimator`. Accuracy: `bench_estimator_accuracy`."""

import time

import numpy as np

from surefoot.robot.reader import load_robot
from surefoot.services.estimator.stream import Estimator


def speed() -> None:
    """Time of a control tick with everything on."""
    robot, rng, ticks = load_robot("ragno"), np.random.default_rng(0), 3000
    w, q = 0.01 * rng.normal(size=(ticks, 3)), [0.0, 0.0, 9.81] + 0.05 * rng.normal(size=(ticks, 3))
    joints, touch = robot.neutral + 1e-3 * rng.normal(size=(ticks, robot.nj)), np.ones(6, dtype=bool)
    estimator, costs = Estimator.for_robot(robot), []
    for k in range(ticks):
        stamp, began = (k + 1) * 10_000_000, time.perf_counter()
        estimator.imu(stamp, w[k], q[k])
        if stamp // 33_000_000 > (stamp - 10_000_000) // 33_000_000:
            estimator.joints(stamp // 33_000_000 * 33_000_000, joints[k], touch)
        estimator.estimate()
        estimator.pose()
        costs.append(time.perf_counter() - began)
    mean, median = 1e6 * np.mean(costs[200:]), 1e6 * np.median(costs[200:])
    print(f"all four estimators and odometry, a 10 ms tick: {mean:.0f} us mean, {median:.0f} us median")


def main() -> None:
    """Print the times."""
    speed()


if __name__ == "__main__":
    main()
