"""CPU time of the simulator against a bare mj_step loop."""

# mujoco has no type stubs for its compiled modules:
# pyright: reportAttributeAccessIssue=false
import json
import os
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import mujoco
import numpy as np

from benchmarks.bench import Bench, seconds_of, table
from surefoot.arrays import Array
from surefoot.bus.codec import decode
from surefoot.client import connect
from surefoot.errors import SurefootError
from surefoot.files import find
from surefoot.lockstep.launch import main as serve
from surefoot.record.recording import read_recording
from surefoot.robot.description import Robot
from surefoot.robot.reader import load_robot
from surefoot.schemas.base import Message
from surefoot.schemas.hw import JointCommand
from surefoot.schemas.status import SimStatus
from surefoot.schemas.system import Health
from surefoot.schemas.topics import CMD_JOINTS, HEALTH, SIM_STATUS
from surefoot.services.simulator import world as w
from surefoot.services.simulator.ground.terrain import make_terrain
from surefoot.services.simulator.physics.model import build_model
from surefoot.services.simulator.service import Simulator
from surefoot.services.supervisor.processes.compose import ComposeError
from surefoot.services.supervisor.scenarios.scenario import find_scenario
from tests.ports import free_address

BENCH = Bench("simulator")

ROOT = Path(__file__).parents[1]


def marching(robot: Robot, ticks: int) -> Array:
    """Return the joint commands of a tripod march on the spot, (ticks, nj), rad."""
    t = w.TICK_NS * 1e-9 * np.arange(ticks)
    q = np.tile(robot.neutral, (ticks, 1))
    for i, leg in enumerate(robot.legs):
        lift = np.clip(np.sin(2.0 * np.pi * t + np.pi * (i % 2)), 0.0, 1.0)
        coxa, femur, tibia = leg.joints
        q[:, coxa] += 0.1 * np.cos(2.0 * np.pi * t + np.pi * (i % 2)) * (1.0 if i < 3 else -1.0)
        q[:, femur] += 0.35 * lift
        q[:, tibia] -= 0.1 * lift
    return q


def pair(kind: str, seconds: float, rounds: int) -> tuple[float, float, float]:
    """Return the median processor time per tick of bare steps, us, of the simulated world, us, and world over bare."""
    robot = load_robot("ragno")
    terrain = make_terrain(kind, seed=1)
    world = w.PhysicsWorld(robot, terrain)
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
            times.append(1e6 * seconds_of(run, time.process_time) / ticks)
        ratio.append(bare[-1] / ours[-1])
    return statistics.median(bare), statistics.median(ours), statistics.median(ratio)


def bare_replay(commands: Array, seed: int) -> float:
    """Return the median processor time per tick of bare steps over a run's commands on the demo's terrain, us.

    `commands`: joint angles of each tick, (ticks, nj) rad; `seed`: of the terrain.
    """
    robot, terrain = load_robot("ragno"), make_terrain("demo", seed)
    world = w.PhysicsWorld(robot, terrain, seed)
    model, _ = build_model(robot, terrain)
    times: list[float] = []
    for _ in range(3):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = world.data.qpos, world.data.qvel

        def run(data: mujoco.MjData = data) -> None:
            for q in commands:
                data.ctrl[:] = q
                mujoco.mj_step(model, data, w.TICK_STEPS)

        times.append(1e6 * seconds_of(run, time.process_time) / len(commands))
    return statistics.median(times)


def in_demo(seed: int = 0) -> tuple[float, float, float]:
    """Return processor times per tick, us: of a bare replay, of the simulator's physics in the demo, of its process."""
    endpoint = free_address()
    with tempfile.TemporaryDirectory() as folder:
        compose, scenario, booked = (Path(folder) / name for name in ("timed.yaml", "timed.toml", "physics.json"))
        timed = f"command: {sys.executable} -m benchmarks.simulator\n"
        ours = find("compose", "ragno", ".yaml", ComposeError).read_text()
        compose.write_text(ours.replace("command: surefoot-service simulator\n", timed))
        text = find_scenario("rough-terrain").read_text()
        scenario.write_text(text.replace('compose = "ragno"', f'compose = "{compose}"'))
        environment = dict(
            os.environ, SUREFOOT_LISTEN=endpoint, XDG_STATE_HOME=f"{folder}/state", SUREFOOT_BENCH_FILE=str(booked),
            PYTHONPATH=os.pathsep.join((str(ROOT), os.environ.get("PYTHONPATH", ""))),
        )  # fmt: skip
        command = ["-m", "surefoot.lab.cli.main", "run", str(scenario), "--seed", str(seed), "--json"]
        run = subprocess.Popen(
            [sys.executable, *command], cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )
        seen: list[tuple[int, float]] = []
        threading.Thread(target=_watch, args=(endpoint, seen, run), daemon=True).start()
        out, _ = run.communicate()
        found = json.loads(out)
        recording = Path(folder) / found["recording"]
        messages = read_recording(recording, (CMD_JOINTS.key,))
        commands = np.array([decode(JointCommand, message.data).position for message in messages])
        physics, ticks = json.loads(booked.read_text())
    (first, cpu_first), (last, cpu_last) = seen[0], seen[-1]
    return bare_replay(commands, seed), physics / ticks * 1e6, (cpu_last - cpu_first) / (last - first) * 1e6


def _watch(endpoint: str, seen: list[tuple[int, float]], run: "subprocess.Popen[bytes]") -> None:
    """Collect ticks and CPU seconds of the simulator's process, every 100 ticks until the run ends."""
    pids: list[int] = []

    def take(message: Message) -> None:
        if isinstance(message, Health):
            pids.append(message.pid)
        elif isinstance(message, SimStatus) and pids:
            fields = Path(f"/proc/{pids[-1]}/stat").read_text().rsplit(")", 1)[1].split()
            seen.append((message.ticks, (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")))

    while run.poll() is None:
        try:
            with connect(endpoint=endpoint) as client:
                client.subscribe(HEALTH.of("simulator"), take)
                client.subscribe(SIM_STATUS, take)
                run.wait()
        except SurefootError:
            time.sleep(0.05)


@BENCH.part("--seconds 0.5 --rounds 1 --no-service")
def steps(*, seconds: float = 10.0, rounds: int = 5, no_service: bool = False) -> None:
    """CPU time of the simulator against a bare mj_step loop over the same robot, ground and commands.

    World: both runs of a pair follow one another in one process, median of the rounds. `bare` is `mj_step(model, data,
    10)` per control tick on a model without any sensor; `world` adds sensors with noise, truth, releases. Service: the
    simulator's process in a run of the demo over Zenoh with every service (CPU of all its threads), against the
    `mj_step` calls of that very process, and against a bare loop over the commands of that run's recording with the
    machine to itself. The same calls take more CPU in place: seven processes share the caches of the cores.

    Args:
        seconds: simulated time of a run.
        rounds: pairs of runs.
        no_service: leave out the run over Zenoh.
    """
    w.rehearse()
    rows: list[tuple[object, ...]] = [
        (f"world, {kind}", *pair(kind, seconds, rounds), goal) for kind, goal in (("flat", ""), ("demo", ">= .60"))
    ]
    if not no_service:
        alone, in_place, ours = in_demo()
        rows.append(("service, bare steps in place", in_place, ours, in_place / ours, ">= .60"))
        rows.append(("service, bare steps alone", alone, ours, alone / ours, ""))
    table("CPU us a tick", ("run", "bare", "ours", "bare / ours", "goal"), rows)


class TimedSimulator(Simulator):
    """Simulator that writes the processor time of its physics, s, and its number of ticks to a file at its end."""

    spent = 0.0

    def on_stop(self) -> None:
        """Write the processor time of the physics, s, and the number of ticks to the file of the benchmark."""
        Path(os.environ["SUREFOOT_BENCH_FILE"]).write_text(json.dumps([self.spent, self.world.tick]))


if __name__ == "__main__":
    _run_to = w.PhysicsWorld._run_to

    def timed(self: w.PhysicsWorld, step: int) -> None:
        TimedSimulator.spent += seconds_of(lambda: _run_to(self, step), time.thread_time)

    w.PhysicsWorld._run_to = timed
    serve(TimedSimulator)
