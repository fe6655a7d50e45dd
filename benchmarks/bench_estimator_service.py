"""The estimator as a process over Zenoh beside a bare echo, and its tick beside that of another checkout.

    python -m benchmarks.bench_estimator_service [--ticks 3000] [--against DIR] [--rounds 3]

Driver, estimator and echo are processes of their own on loopback, joined by a router, paced in real time. The driver
sends the samples of a recorded walk of Ragno, and takes the time from a tick's release to the arrival of
`state/velocity` and of the echo, a service that answers the same samples with a message of fixed content. Target: the
99th percentile of the estimator at most 2 ms beyond that of the echo. --against: processor time of a whole tick
(messages decoded and encoded) here and in DIR, in turn in processes of their own. Target: not slower.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.bus.frame import Frame
from surefoot.bus.zenoh import ZenohBus, ZenohOptions
from surefoot.lab.estimation.walks import walk
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.driver import Driver, DueSample
from surefoot.lockstep.join import TickInputs
from surefoot.lockstep.launch import main as serve
from surefoot.lockstep.service import Service
from surefoot.schemas.hw import FootContacts, Imu, JointCommand, JointState
from surefoot.schemas.state import GaitState
from surefoot.schemas.topics import HW_CONTACTS, HW_IMU, HW_JOINTS, SIM_JOIN, STATE_GAIT, STATE_VELOCITY

PORT, NAMESPACE = "tcp/127.0.0.1:17467", "surefoot/bench"
SAMPLES, TIMES, TICKS = "SUREFOOT_BENCH_SAMPLES", "SUREFOOT_BENCH_TIMES", "SUREFOOT_BENCH_TICKS"
WARM = 200  # ticks before the clock counts
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
    """What Ragno sensed in a recorded walk."""
    log = walk("ragno-flat", 40).log
    assert log.joints is not None
    return {name: getattr(log, name) for name in ("stamp_ns", "w", "q", "foot_ns", "joints", "contact")}


class Recorded(Driver[ServiceConfig]):
    """Plays the samples of a walk and takes the times of the answers."""

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
            found = {key: [t - self.sent[k] for k, t in seen.items() if k >= WARM] for key, seen in self.seen.items()}
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
        """Nothing moves."""


class Echo(Service[ServiceConfig]):
    """Answers every tick with the same message."""

    name = "walker"
    inputs, outputs = (HW_IMU, HW_JOINTS, HW_CONTACTS), (STATE_GAIT,)

    def on_tick(self, inputs: TickInputs) -> None:
        self.publish(STATE_GAIT, ANSWER)


def latency(ticks: int, folder: Path) -> dict[str, list[float]]:
    """Times from release to arrival, s, by topic."""
    np.savez(folder / "samples.npz", **samples())
    here = [sys.executable, "-m", "benchmarks.bench_estimator_service"]
    link = ["--connect", PORT, "--namespace", NAMESPACE]
    environment = os.environ | {
        SAMPLES: str(folder / "samples.npz"), TIMES: str(folder / "times.json"), TICKS: str(ticks),
        "OPENBLAS_NUM_THREADS": "1",
    }  # fmt: skip
    router = ZenohBus(ZenohOptions("router", (), (PORT,), NAMESPACE))
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
    """Processor time of each tick, us, here and in another checkout, in turn."""
    costs: dict[str, list[float]] = {"here": [], str(tree): []}
    for i in range(rounds):
        order = (Path.cwd(), tree) if i % 2 == 0 else (tree, Path.cwd())
        for place in order:
            environment = os.environ | {"PYTHONPATH": str(place), "OPENBLAS_NUM_THREADS": "1"}
            done = subprocess.run(
                [sys.executable, "-c", TICK_CODE, str(folder / "samples.npz")], env=environment, cwd=place,
                capture_output=True, text=True, check=False,
            )  # fmt: skip
            if done.returncode:
                raise RuntimeError(done.stderr[-2000:])
            costs["here" if place == Path.cwd() else str(tree)] += json.loads(done.stdout.splitlines()[-1])
    return costs


def line(name: str, values: list[float], unit: str) -> str:
    """Row of a table: mean and percentiles."""
    at = np.percentile(values, (50, 90, 99))
    return f"{name:32}{np.mean(values):9.3f}" + "".join(f"{x:9.3f}" for x in at) + f"  {unit}, {len(values)} ticks"


def main(arguments: list[str] | None = None) -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ticks", type=int, default=3000)
    parser.add_argument("--against", type=Path)
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        found = {key: [1e3 * t for t in times] for key, times in latency(args.ticks, folder).items()}
        print(f"{'':32}{'mean':>9}{'p50':>9}{'p90':>9}{'p99':>9}")
        for key, label in ((STATE_GAIT.key, "echo"), (STATE_VELOCITY.key, "estimator")):
            print(line(label, found[key], "ms"))
        echo, ours = (np.percentile(found[key], (50, 99)) for key in (STATE_GAIT.key, STATE_VELOCITY.key))
        print(f"estimator beyond echo: {ours[0] - echo[0]:.3f} ms at p50, {ours[1] - echo[1]:.3f} ms at p99 (goal 2)")
        if args.against is not None:
            costs = tick_costs(folder, args.against.resolve(), args.rounds)
            for label, values in costs.items():
                print(line(f"tick, {label}"[:31], values, "us of processor time"))
            here, there = (np.median(values) for values in costs.values())
            print(f"tick here / there: {here / there:.2f} in the median (goal 1)")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--as"]:
        serve({"driver": Recorded, "echo": Echo}[sys.argv[2]], sys.argv[3:])
    main(sys.argv[1:])
