"""Time of the estimators: a step beside filterpy, a log, and the service over Zenoh beside a bare echo."""

import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from benchmarks.bench import Bench, goal, table, words_of
from surefoot.bus.frame import Frame
from surefoot.bus.zenoh import ZenohBus, ZenohOptions
from surefoot.lab.estimation.fuzz import feed, inputs_of
from surefoot.lab.estimation.log import Log
from surefoot.lab.estimation.track import LogRunner, default, track
from surefoot.lab.estimation.walks import walk
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.driver import Driver, DueSample
from surefoot.lockstep.join import TickInputs
from surefoot.lockstep.launch import main as serve
from surefoot.lockstep.service import Service
from surefoot.papers.wawrzynski.synthetic import WalkParams, synthesize
from surefoot.robot.reader import load_robot
from surefoot.schemas.hw import FootContacts, Imu, JointCommand, JointState
from surefoot.schemas.state import GaitState
from surefoot.schemas.topics import HW_CONTACTS, HW_IMU, HW_JOINTS, SIM_JOIN, STATE_GAIT, STATE_VELOCITY
from surefoot.services.estimator.stream import Estimator
from tests.ports import free_address

BENCH = Bench("estimator")

NAMESPACE = "surefoot/bench"
WARM = 400
"""Number of rows of a log that are processed before timing begins."""
REPEATS = 3


class Filterpy(ExtendedKalmanFilter):
    """Equations (24)-(37) of Wawrzynski et al. in matrices of NumPy, corrections by filterpy."""

    def __init__(self) -> None:
        super().__init__(dim_x=6, dim_z=3)
        self.x, self.P, self.R = np.array([0.0, 0.0, 9.81, 0.0, 0.0, 0.0]), np.eye(6) * 1e-4, np.eye(3) * 0.015**2

    def step(self, w: np.ndarray, q: np.ndarray, d: float) -> None:
        """Predict over d s with a sample: gyro w (3,) rad/s and accelerometer q (3,) m/s^2, IMU axes."""
        g, v, one, none = self.x[:3], self.x[3:], np.eye(3), np.zeros((3, 3))
        f = np.block([[one, none], [-d * one, one]])
        jg, jv = -_cross(g), -_cross(v)
        c = np.block([[jg * d * 0.0054, none], [jv * d * 0.0054 - jg * d * d * 0.0027, -d * 0.035 * one]])
        self.P = f @ self.P @ f.T + c @ c.T
        turn, half = _rotation(-w * d), _rotation(-w * d / 2)
        middle = half @ g
        self.x = np.concatenate([half @ middle, turn @ v + (q - middle) * d])

    def take(self, v: np.ndarray) -> None:
        """Correct by the velocity of the legs, v (3,) m/s, IMU axes."""
        self.update(v, HJacobian=lambda x: np.eye(6)[3:], Hx=lambda x: x[3:])


def _cross(x: np.ndarray) -> np.ndarray:
    return np.array([[0.0, -x[2], x[1]], [x[2], 0.0, -x[0]], [-x[1], x[0], 0.0]])


def _rotation(b: np.ndarray) -> np.ndarray:
    angle, k = float(np.linalg.norm(b)), _cross(b)
    if angle < 1e-9:
        return np.eye(3) + k
    return np.eye(3) + np.sin(angle) / angle * k + (1.0 - np.cos(angle)) / angle**2 * k @ k


def filterpy_step(log: Log) -> float:
    """Return the time of a step of filterpy's EKF over a log, us."""
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
    """Return the time per row of a log that an estimator needs, with the whole estimate, us."""
    began = time.thread_time()
    track(name, log)
    return 1e6 * (time.thread_time() - began) / len(log.stamp_ns)


def live_us(name: str, log: Log) -> float:
    """Return the time per row of a log given sample by sample from Python, with flags and reasons, us."""
    running, inputs = LogRunner(name, log, {}), list(inputs_of(log, range(len(log.stamp_ns))))
    began = 0.0
    for k, x in enumerate(inputs):
        if k == WARM:
            began = time.thread_time()
        feed(running, x)
        running.estimate()
    return 1e6 * (time.thread_time() - began) / (len(inputs) - WARM)


def late_ms(name: str, log: Log, seconds: float = 0.3) -> tuple[float, float]:
    """Return median and largest time of a tick in which a foot sample comes `seconds` late, ms."""
    running, costs = LogRunner(name, log, {}), []
    late = replace(log, foot_ns=log.foot_ns + round(1e9 * seconds))
    for k, x in enumerate(inputs_of(late, range(len(log.stamp_ns)))):
        x.feet = [(stamp - round(1e9 * seconds), *rest) for stamp, *rest in x.feet]  # type: ignore
        began = time.thread_time()
        feed(running, x)
        running.estimate()
        if k > WARM and x.feet:
            costs.append(1e3 * (time.thread_time() - began))
    return float(np.median(costs)), max(costs)


def at_1_khz(log: Log) -> Log:
    """Return a log in which each inertial row is replaced by ten, as from a sensor of 1 kHz."""
    first = log.stamp_ns[0] - 10_000_000
    stamps = first + 1_000_000 * np.arange(1, 10 * len(log.stamp_ns) + 1)
    w, q = (np.repeat(x, 10, axis=0) for x in (log.w, log.q))
    return replace(
        log, stamp_ns=stamps, w=w, q=q, truth=None, sensors={**log.sensors, "imu_period_ns": 1_000_000}, order=None
    )  # fmt: skip


def tick_us() -> tuple[float, float]:
    """Return mean and median time of a control tick of the service's estimator with everything on, Ragno, us."""
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


@BENCH.part()
def speed(*, estimators: str = default()) -> None:
    """Processor time of estimators per inertial sample, over a whole log and sample by sample from Python.

    Beside the same step of filterpy's EKF with matrices of its own, the best of a few repeats in turn; then a whole log
    at 1 kHz, and the tick in which feet come 0.3 s late. Goals for `best`: of filterpy 0.3 with two feet, 0.7 with six.

    Args:
        estimators: names of estimators, comma-separated.
    """
    names = words_of(estimators)
    logs = {feet: synthesize(WalkParams(feet=feet, encoders=False), 0) for feet in (2, 6)}
    rows: list[tuple[object, ...]] = []
    for feet, log in logs.items():
        best = dict.fromkeys(("filterpy", *names, *(f"{name}, live" for name in names)), np.inf)
        for name in names:
            track(name, log)  # loads what is compiled
        for _ in range(REPEATS):
            best["filterpy"] = min(best["filterpy"], filterpy_step(log))
            for name in names:
                best[name] = min(best[name], step_us(name, log))
                best[f"{name}, live"] = min(best[f"{name}, live"], live_us(name, log))
        rows += [(f"{name}, {feet} feet", us, us / best["filterpy"]) for name, us in best.items()]
    table("a step", ("estimator", "us", "/ filterpy"), rows)
    for name in names:
        for feet, log in logs.items():
            fast = at_1_khz(log)
            factor = max(1e3 / step_us(name, fast) for _ in range(REPEATS))
            goal(f"{name}, {feet} feet: a log at 1 kHz, times real time", factor, ">=", 150)
        median, most = late_ms(name, logs[2])
        goal(f"{name}: a tick with feet 0.3 s late, median", median, unit="ms")
        goal(f"{name}: a tick with feet 0.3 s late, largest", most, "<=", 1.0, "ms")
    mean, median = tick_us()
    goal("service, all variants and odometry, 10 ms tick, mean", mean, unit="us")
    goal("service, all variants and odometry, 10 ms tick, median", median, unit="us")


SAMPLES, TIMES, TICKS = "SUREFOOT_BENCH_SAMPLES", "SUREFOOT_BENCH_TIMES", "SUREFOOT_BENCH_TICKS"
WARM_TICKS = 200
"""Number of ticks of the service before timing begins."""
ANSWER = GaitState(walk_id=1, state="walking", phase=0.0, stance=(), footholds=(), remaining=0.0)

TICK_CODE = """
import json, sys, time
import numpy as np
from surefoot.bus.codec import decode, encode
from surefoot.lockstep.join import TickInputs
from surefoot.lockstep.launch import spare_collector
from surefoot.schemas.hw import FootContacts, Imu, JointState, Tick
from surefoot.services.estimator.service import SERVICE
with np.load(sys.argv[1]) as file:
    log = {key: file[key] for key in file.files}
class Desk:
    def publish(self, topic, message, stamp_ns): encode(message)
    def log(self, level, text): pass
service = SERVICE(SERVICE.Config())
service.attach(Desk()); service.on_start(); service.rehearse(); service.on_reset(); spare_collector()
costs, next_foot = [], 0
for k, stamp in enumerate(log["stamp_ns"].tolist()):
    sent = {"hw/imu": Imu(stamp_ns=stamp, gyro=tuple(log["w"][k]), acc=tuple(log["q"][k]))}
    if next_foot < len(log["foot_ns"]) and log["foot_ns"][next_foot] <= stamp:
        at = int(log["foot_ns"][next_foot])
        touch = tuple((bool(x),) for x in log["contact"][next_foot])
        sent["hw/joints"] = JointState(stamp_ns=at, position=tuple(log["joints"][next_foot]))
        sent["hw/contacts"] = FootContacts(stamp_ns=at, touch=touch, normal_force_n=(None,) * len(touch))
        next_foot += 1
    coded = {key: (type(m), encode(m)[0]) for key, m in sent.items()}
    manifest = Tick(tick=k, roster=("estimator",), roster_version=1, due=(), mode="lockstep")
    began = time.thread_time()
    service.on_tick(TickInputs(manifest, {key: decode(*value) for key, value in coded.items()}))
    costs.append(1e6 * (time.thread_time() - began))
print(json.dumps(costs[200:]))
"""


def samples() -> dict[str, np.ndarray]:
    """Return the sensor samples of Ragno in a recorded walk as arrays of a `Log` by name, a row per sample, SI."""
    log = walk("ragno-flat", 40).log
    assert log.joints is not None
    return {name: getattr(log, name) for name in ("stamp_ns", "w", "q", "foot_ns", "joints", "contact")}


class Recorded(Driver[ServiceConfig]):
    """Driver that plays the samples of a walk and measures the times of the answers."""

    name = "simulator"
    outputs, serves = (HW_IMU, HW_JOINTS, HW_CONTACTS), (SIM_JOIN,)

    def on_start(self) -> None:
        with np.load(os.environ[SAMPLES]) as file:
            self.log_of = {key: file[key] for key in file.files}
        self.last = min(int(os.environ[TICKS]), len(self.log_of["stamp_ns"])) - 1
        self.sent: dict[int, float] = {}
        self.seen: dict[str, dict[int, float]] = {STATE_VELOCITY.key: {}, STATE_GAIT.key: {}}
        self._foot, self._first = 0, int(self.log_of["stamp_ns"][0])

    def on_begin(self) -> None:
        self.node.bus.take((STATE_VELOCITY, STATE_GAIT), self._take)
        self.node.begin(("estimator", "walker"), "paced", rtf=1.0, delay=1, policy="degrade", seed=0)

    def _take(self, item: Any) -> None:
        now = time.perf_counter()
        for delivery in item.deliveries() if isinstance(item, Frame) else ():
            if not delivery.prime:
                self.seen[delivery.topic.key].setdefault(delivery.header().tick, now)

    def release(self, tick: int) -> list[DueSample]:
        log = self.log_of
        if tick == self.last:
            found = {
                key: [t - self.sent[k] for k, t in seen.items() if k >= WARM_TICKS] for key, seen in self.seen.items()
            }
            Path(os.environ[TIMES]).write_text(json.dumps(found))
        k = min(tick, self.last)
        stamp = int(log["stamp_ns"][k])
        out = [DueSample(HW_IMU, Imu(gyro=tuple(log["w"][k]), acc=tuple(log["q"][k])), stamp, tick)]
        if self._foot < len(log["foot_ns"]) and log["foot_ns"][self._foot] <= stamp:
            f, at = self._foot, int(log["foot_ns"][self._foot])
            touch = tuple((bool(x),) for x in log["contact"][f])
            feet = FootContacts(touch=touch, normal_force_n=(None,) * len(touch))
            out += [DueSample(HW_JOINTS, JointState(position=tuple(log["joints"][f])), at, f)]
            out += [DueSample(HW_CONTACTS, feet, at, f)]
            self._foot += 1
        self.sent[tick] = time.perf_counter()
        return out

    def actuate(self, tick: int, command: JointCommand | None) -> None:
        """Ignore the command: a recorded walk cannot obey."""


class Echo(Service[ServiceConfig]):
    """Service that answers the samples of every tick with a message of fixed content."""

    name = "walker"
    inputs, outputs = (HW_IMU, HW_JOINTS, HW_CONTACTS), (STATE_GAIT,)

    def on_tick(self, inputs: TickInputs) -> None:
        self.publish(STATE_GAIT, ANSWER)


def latencies(ticks: int, folder: Path) -> dict[str, list[float]]:
    """Return the times from the release of a tick to the arrival of each answer, s, by topic."""
    port = free_address()
    np.savez(folder / "samples.npz", **samples())  # pyright: ignore[reportArgumentType] - names of arrays
    here = [sys.executable, "-m", "benchmarks.estimator"]
    link = ["--connect", port, "--namespace", NAMESPACE]
    environment = os.environ | {
        SAMPLES: str(folder / "samples.npz"), TIMES: str(folder / "times.json"), TICKS: str(ticks),
        "OPENBLAS_NUM_THREADS": "1",
    }  # fmt: skip
    router = ZenohBus(ZenohOptions("router", (), (port,), NAMESPACE))
    commands = ([*here, "--as", "driver"], [sys.executable, "-m", "surefoot.lockstep.discover", "estimator"],
                [*here, "--as", "echo"])  # fmt: skip
    running = [subprocess.Popen([*command, *link], env=environment) for command in commands]
    try:
        deadline = time.monotonic() + 300.0 + 0.02 * ticks
        while not (folder / "times.json").exists() and time.monotonic() < deadline:
            time.sleep(0.5)
        time.sleep(0.5)
        return json.loads((folder / "times.json").read_text())
    finally:
        for one in running:
            one.terminate()
        for one in running:
            one.wait(20)
        router.close()


def tick_costs(folder: Path, tree: Path, rounds: int) -> dict[str, list[float]]:
    """Return the processor time of each tick, us, here and in another checkout, in turn."""
    costs: dict[str, list[float]] = {"here": [], str(tree): []}
    for i in range(rounds):
        for name in list(costs)[:: 1 if i % 2 == 0 else -1]:
            place = Path.cwd() if name == "here" else tree
            environment = os.environ | {"PYTHONPATH": str(place), "OPENBLAS_NUM_THREADS": "1"}
            done = subprocess.run(
                [sys.executable, "-c", TICK_CODE, str(folder / "samples.npz")], env=environment, cwd=place,
                capture_output=True, text=True, check=False,
            )  # fmt: skip
            if done.returncode:
                raise RuntimeError(done.stderr[-2000:])
            costs[name] += json.loads(done.stdout.splitlines()[-1])
    return costs


def _row(name: str, values: list[float]) -> tuple[object, ...]:
    return name, float(np.mean(values)), *(float(x) for x in np.percentile(values, (50, 90, 99))), len(values)


@BENCH.part()
def service(*, ticks: int = 3000, against: Path | None = None, rounds: int = 3) -> None:
    """Estimator as a process over Zenoh beside a bare echo, and its tick beside that of another checkout.

    Driver, estimator and echo are processes of their own on loopback, joined by a router, paced in real time. The
    driver sends the samples of a recorded walk of Ragno, and takes the time from a tick's release to the arrival of
    `state/velocity` and of the echo, a service that answers the same samples with a message of fixed content. Goal: the
    99th percentile of the estimator at most 2 ms beyond that of the echo.

    Args:
        ticks: number of control ticks of the walk.
        against: another checkout; processor time of a whole tick (messages decoded and encoded) here and there, in
            turn in processes of their own. Goal: not slower.
        rounds: number of rounds of the comparison with the other checkout.
    """
    with tempfile.TemporaryDirectory() as name:
        folder, header = Path(name), ("process", "mean", "p50", "p90", "p99", "ticks")
        found = {key: [1e3 * t for t in times] for key, times in latencies(ticks, folder).items()}
        echo, ours = found[STATE_GAIT.key], found[STATE_VELOCITY.key]
        table("from release to arrival, ms", header, [_row("echo", echo), _row("estimator", ours)])
        beyond = np.percentile(ours, (50, 99)) - np.percentile(echo, (50, 99))
        goal("estimator beyond echo at p50", float(beyond[0]), unit="ms")
        goal("estimator beyond echo at p99", float(beyond[1]), "<=", 2.0, "ms")
        if against is not None:
            costs = tick_costs(folder, against.resolve(), rounds)
            table("a tick, us of processor time", header, [_row(label, values) for label, values in costs.items()])
            here, there = (float(np.median(values)) for values in costs.values())
            goal("tick here / there, median", here / there, "<=", 1.0)


if __name__ == "__main__":
    serve({"driver": Recorded, "echo": Echo}[sys.argv[2]], sys.argv[3:])
