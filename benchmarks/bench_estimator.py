"""What the estimators cost, and what they survive.

    python -m benchmarks.bench_estimator [--speed] [--fuzz] [--estimators NAME ...] [--trials 20000] [--seed 0]

--speed, in CPU time of the thread: a step (inertial sample, its share of the feet, the estimate) in a log and from
Python sample by sample, beside the same step of filterpy's EKF with matrices of its own; a whole log at 1 kHz; the tick
in which feet come 0.3 s late. --fuzz: random corruptions of walks, single and in pairs: never NaN, never above 2 m/s, P
positive, no error that matters without a word. With an option of `bench_estimator_accuracy` (--synthetic, --logs and so
on) that benchmark runs instead, with --service `bench_estimator_service`.
"""

import argparse
import os
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from benchmarks import bench_estimator_accuracy, bench_estimator_service
from surefoot.lab.estimation.fuzz import FuzzCounts, feed, fuzz, inputs_of
from surefoot.lab.estimation.log import Log
from surefoot.lab.estimation.track import LogRunner, default, names, track
from surefoot.papers.wawrzynski.synthetic import KINDS, WalkParams, synthesize
from surefoot.robot.reader import load_robot
from surefoot.services.estimator.stream import Estimator

WARM = 400  # rows before the clock counts
REPEATS = 3


class Filterpy(ExtendedKalmanFilter):
    """Equations (24)-(37) in matrices, corrections by filterpy: what a step costs who writes it in NumPy."""

    def __init__(self) -> None:
        super().__init__(dim_x=6, dim_z=3)
        self.x, self.P, self.R = np.array([0.0, 0.0, 9.81, 0.0, 0.0, 0.0]), np.eye(6) * 1e-4, np.eye(3) * 0.015**2

    def step(self, w: np.ndarray, q: np.ndarray, d: float) -> None:
        """Predict with a sample."""
        g, v, one, none = self.x[:3], self.x[3:], np.eye(3), np.zeros((3, 3))
        f = np.block([[one, none], [-d * one, one]])
        jg, jv = -_cross(g), -_cross(v)
        c = np.block([[jg * d * 0.0054, none], [jv * d * 0.0054 - jg * d * d * 0.0027, -d * 0.035 * one]])
        self.P = f @ self.P @ f.T + c @ c.T
        turn, half = _rotation(-w * d), _rotation(-w * d / 2)
        middle = half @ g
        self.x = np.concatenate([half @ middle, turn @ v + (q - middle) * d])

    def take(self, v: np.ndarray) -> None:
        """Correct by the velocity of the legs."""
        self.update(v, HJacobian=lambda x: np.eye(6)[3:], Hx=lambda x: x[3:])


def _cross(x: np.ndarray) -> np.ndarray:
    return np.array([[0.0, -x[2], x[1]], [x[2], 0.0, -x[0]], [-x[1], x[0], 0.0]])


def _rotation(b: np.ndarray) -> np.ndarray:
    angle, k = float(np.linalg.norm(b)), _cross(b)
    if angle < 1e-9:
        return np.eye(3) + k
    return np.eye(3) + np.sin(angle) / angle * k + (1.0 - np.cos(angle)) / angle**2 * k @ k


def filterpy_step(log: Log) -> float:
    """Time of a step of filterpy's EKF over a log, us."""
    it, inputs = Filterpy(), list(inputs_of(log, range(len(log.stamp_ns))))
    began, last = 0.0, None
    for k, x in enumerate(inputs):
        if k == WARM:
            began = time.thread_time()
        it.step(x.w, x.q, 0.01)
        for stamp, position, _, contact in x.feet:
            if last is not None and (contact & last[2]).any():
                d = 1e-9 * (stamp - last[0])
                seen = -(position - last[1]) / d - np.cross(x.w, 0.5 * (position + last[1]))
                it.take(seen[contact & last[2]].mean(axis=0))
            last = (stamp, position, contact)
    return 1e6 * (time.thread_time() - began) / (len(inputs) - WARM)


def step_us(name: str, log: Log) -> float:
    """Time of a row of a log by an estimator, with the whole estimate, us."""
    began = time.thread_time()
    track(name, log)
    return 1e6 * (time.thread_time() - began) / len(log.stamp_ns)


def live_us(name: str, log: Log) -> float:
    """The same, sample by sample from Python, with flags and reasons, us."""
    running, inputs = LogRunner(name, log, {}), list(inputs_of(log, range(len(log.stamp_ns))))
    began = 0.0
    for k, x in enumerate(inputs):
        if k == WARM:
            began = time.thread_time()
        feed(running, x)
        running.estimate()
    return 1e6 * (time.thread_time() - began) / (len(inputs) - WARM)


def late_ms(name: str, log: Log, seconds: float = 0.3) -> tuple[float, float]:
    """Median and largest time of a tick in which a foot sample comes so much late, ms."""
    running, costs = LogRunner(name, log, {}), []
    late = replace(log, foot_ns=log.foot_ns + round(1e9 * seconds))
    for k, x in enumerate(inputs_of(late, range(len(log.stamp_ns)))):
        x.feet = [(stamp - round(1e9 * seconds), *rest) for stamp, *rest in x.feet]
        began = time.thread_time()
        feed(running, x)
        running.estimate()
        if k > WARM and x.feet:
            costs.append(1e3 * (time.thread_time() - began))
    return float(np.median(costs)), max(costs)


def at_1_khz(log: Log) -> Log:
    """The log with ten inertial rows for each."""
    first = log.stamp_ns[0] - 10_000_000
    stamps = first + 1_000_000 * np.arange(1, 10 * len(log.stamp_ns) + 1)
    w, q = (np.repeat(x, 10, axis=0) for x in (log.w, log.q))
    return replace(
        log, stamp_ns=stamps, w=w, q=q, truth=None, sensors={**log.sensors, "imu_period_ns": 1_000_000}, order=None
    )  # fmt: skip


def tick_us() -> tuple[float, float]:
    """Mean and median time of a control tick of the service's estimator with everything on, Ragno, us."""
    robot, rng, ticks = load_robot("ragno"), np.random.default_rng(0), 3000
    w, q = 0.01 * rng.normal(size=(ticks, 3)), [0.0, 0.0, 9.81] + 0.05 * rng.normal(size=(ticks, 3))
    joints, touch = robot.neutral + 1e-3 * rng.normal(size=(ticks, robot.nj)), np.ones(6, dtype=bool)
    estimator, costs = Estimator.for_robot(robot), []
    for k in range(ticks):
        stamp, began = (k + 1) * 10_000_000, time.thread_time()
        estimator.imu(stamp, w[k], q[k])
        if stamp // 33_000_000 > (stamp - 10_000_000) // 33_000_000:
            estimator.joints(stamp // 33_000_000 * 33_000_000, joints[k], touch)
        estimator.estimate()
        estimator.pose()
        costs.append(time.thread_time() - began)
    return 1e6 * float(np.mean(costs[200:])), 1e6 * float(np.median(costs[200:]))


def speed(names: list[str]) -> None:
    """Print the times; the best of a few repeats, in turn with the reference."""
    logs = {feet: synthesize(WalkParams(feet=feet, encoders=False), 0) for feet in (2, 6)}
    print(f"{'':18}{'feet':>6}{'us a step':>12}{'/ filterpy':>12}   (goal for `best`: two feet 0.3, six 0.7)")
    for feet, log in logs.items():
        best = dict.fromkeys(("filterpy", *names, *(f"{name}, live" for name in names)), np.inf)
        for name in names:
            track(name, log)  # loads what is compiled
        for _ in range(REPEATS):
            best["filterpy"] = min(best["filterpy"], filterpy_step(log))
            for name in names:
                best[name] = min(best[name], step_us(name, log))
                best[f"{name}, live"] = min(best[f"{name}, live"], live_us(name, log))
        for name, us in best.items():
            print(f"{name:18}{feet:6d}{us:12.1f}{us / best['filterpy']:12.2f}")
    for name in names:
        for feet, log in logs.items():
            fast = at_1_khz(log)
            factor = max(1e3 / step_us(name, fast) for _ in range(REPEATS))
            print(
                f"{name}, {feet} feet: a log at 1 kHz with estimates at every row: {factor:.0f} x real time (goal 150)"
            )
        median, most = late_ms(name, logs[2])
        print(f"{name}: a tick with feet 0.3 s late: {median:.3f} ms median, {most:.3f} ms at most (goal 1)")
    mean, median = tick_us()
    print(f"all variants and odometry in the service, a 10 ms tick: {mean:.0f} us mean, {median:.0f} us median")


def _trials(name: str, kind: str, trials: int, seed: int) -> FuzzCounts:
    return fuzz(name, synthesize(KINDS[kind], seed), trials, seed)


def merged(parts: list[FuzzCounts]) -> FuzzCounts:
    """All trials together."""
    out = FuzzCounts()
    for part in parts:
        out.trials, out.samples = out.trials + part.trials, out.samples + part.samples
        out.fastest = max(out.fastest, part.fastest)
        for name in ("broken", "silent", "flagged", "by_kind"):
            getattr(out, name).update(getattr(part, name))
    return out


def fuzzed(name: str, trials: int, seed: int) -> None:
    """Print what corruptions did to an estimator."""
    each, kinds = 250, ("twist", "slip", "edges")
    jobs = [(kinds[i % len(kinds)], seed + i) for i in range(max(1, trials // each))]
    with ProcessPoolExecutor(max(1, (os.cpu_count() or 1) // 2)) as pool:
        done = [pool.submit(partial(_trials, name, kind, min(each, trials), number)) for kind, number in jobs]
        parts = [job.result() for job in done]
    found = merged(parts)
    print(f"{name}: {found.trials} trials, {found.samples} corrupted inputs; fastest {found.fastest:.2f} m/s")
    failed = Counter({text.rpartition(": ")[2]: 0 for text in found.broken})
    for text, count in found.broken.items():
        failed[text.rpartition(": ")[2]] += count
    print(f"  never allowed: {sum(failed.values())}" + "".join(f", {text} {n}" for text, n in failed.most_common()))
    for text, count in found.broken.most_common(12):
        print(f"    {count:5d} {text}")
    lies = Counter({label: n for label, n in found.silent.items() if n})
    print(f"  errors over 15 cm/s for 0.2 s with no flag and no counter: {sum(lies.values())}")
    for label, count in lies.most_common(12):
        print(f"    {count:5d} of {found.by_kind[label]} {label}")
    single = [label for label in found.by_kind if " + " not in label]
    print("  share of trials with a flag, a counter or a slipping foot, single kinds:")
    print("    " + ", ".join(f"{k} {found.flagged[k] / found.by_kind[k]:.2f}" for k in sorted(single)))


def main(arguments: list[str] | None = None) -> None:
    """Print times and what was survived."""
    words = sys.argv[1:] if arguments is None else arguments
    if any(word.removeprefix("--") in bench_estimator_accuracy.PARTS for word in words if word.startswith("--")):
        bench_estimator_accuracy.main(words)
        return
    if "--service" in words:
        bench_estimator_service.main([word for word in words if word != "--service"])
        return
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--speed", action="store_true")
    parser.add_argument("--fuzz", action="store_true")
    parser.add_argument("--estimators", nargs="+", metavar="NAME", choices=names(), default=[default()])
    parser.add_argument("--trials", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args(arguments)
    if args.speed or not args.fuzz:
        speed(args.estimators)
    if args.fuzz:
        for name in args.estimators:
            fuzzed(name, args.trials, args.seed)


if __name__ == "__main__":
    main(sys.argv[1:])
