"""Trots by the controller `examples/trot`, observed by this project's services: recorded, scored against truth."""

import runpy
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from surefoot.lab.estimation.recorded import log_of_columns, published
from surefoot.lab.estimation.referees import gyro_yaw
from surefoot.lab.estimation.scores import base_pose, score
from surefoot.lab.report.traces import traces_of
from surefoot.lockstep.config import load_config
from surefoot.lockstep.discover import service_class
from surefoot.lockstep.driver import DriverNode
from surefoot.lockstep.local import LocalSystem
from surefoot.record.columns import recorded_columns
from surefoot.record.recording import read_recording
from surefoot.robot.reader import load_robot
from surefoot.schemas.sim import ResetRequest, World
from surefoot.schemas.topics import SIM_RESET, STATE_ODOMETRY, STATE_STABILITY, STATE_VELOCITY, TICK_S

DRIVER = Path(__file__).parents[1] / "examples" / "trot" / "driver.py"
WATCHERS = ("estimator", "stability", "recorder")
GAITS: dict[str, dict[str, Any]] = {"trot": {}, "flying": {"duty": 0.4, "leap_m": 0.03, "speed": 0.68}}
"""Settings of the example's gait by name: in `trot` two feet stand at all times, in `flying` there are moments without
any."""
SETTLED_S = 2.0
"""Time after the start of the motion before the speed is measured, s."""


class Watched(NamedTuple):
    """Figures of one trot: errors of the estimates and what the stability service published."""

    speed: float  # m/s, true, forward, mean
    velocity: float  # m/s, error of the published velocity, rms
    nees: float  # of it, per degree of freedom
    heading: float  # deg, error of the change of heading, rms
    gyro: float  # deg, the same of the gyro alone
    odometry: float  # share of the way
    airborne: float  # share of the states of stability without a foot on the ground
    held: float  # share of them with a support region that has an area
    slip: float  # m per stance, measured
    true_slip: float  # m per stance
    stances: int
    false_falls: int  # estimates that report a fall of a robot that did not fall
    fell: bool


def watch(robot: str, seed: int, out: Path, seconds: float, perturbation: float = 0.0, **gait: Any) -> None:
    """Record a trot with the services beside it.

    Args:
        robot: name or folder.
        seed: seed of sensors and perturbation.
        out: recording to write.
        seconds: length of the run.
        perturbation: level of the differences between the simulated robot and its description.
        gait: settings of the example.
    """
    services: list[Any] = []
    for name in WATCHERS:
        more = [f"path={str(out)!r}"] if name == "recorder" else []
        config = load_config(service_class(name).Config, name, None, {}, [f"robot={robot!r}", *more])
        services.append(service_class(name)(config))
    driver = runpy.run_path(str(DRIVER))["TrottingRobot"]
    services.append(driver(driver.Config(robot=robot, autostart=False, **gait)))
    system = LocalSystem(services)
    try:
        world, ticks = World(perturbation=perturbation, map_profile="exact"), round(seconds / TICK_S)
        system.bus.call(SIM_RESET, ResetRequest(seed=seed, world=world, expect=WATCHERS, max_ticks=ticks))
        leader = next(node.leader for node in system.nodes if isinstance(node, DriverNode))
        system.run_until(lambda: leader.state == "ended" and leader.all_done())
    finally:
        system.close()


def measured(robot: str, recording: Path) -> Watched:
    """Return the figures of a recorded trot."""
    columns, _ = recorded_columns(recording)
    log = log_of_columns(recording.stem, columns, known := load_robot(robot))
    found = published(columns, known)
    scores, traces = score(log, found), traces_of(recording)
    truth, stances, support, falls = traces.series("sim/truth"), [], [], 0
    for item in read_recording(recording, (STATE_VELOCITY.key, STATE_STABILITY.key, STATE_ODOMETRY.key)):
        message: Any = item.message()
        if item.key == STATE_ODOMETRY.key:
            stances += [stance.slip for stance in message.stances if stance.healthy]
        elif item.key == STATE_STABILITY.key and message.fresh:
            support.append((any(message.stance), message.status == "ok"))
        elif item.key == STATE_VELOCITY.key and traces.fallen_at is None:
            falls += any("fall" in reason for reason in message.reasons)
    stood, held = np.array(support).T
    moving = truth[:, 0] - truth[0, 0] > SETTLED_S
    return Watched(
        speed=float(truth[moving, 4].mean()), velocity=scores.rmse, nees=scores.nees / 3.0,
        heading=_turned(log, found.yaw), gyro=_turned(log, gyro_yaw(log)), odometry=scores.odometry,
        airborne=float(np.mean(~stood)), held=float(np.mean(held)), slip=float(np.mean(stances)),
        true_slip=float(np.mean([stance.sliding for stance in traces.stances])), stances=len(stances),
        false_falls=falls, fell=traces.fallen_at is not None,
    )  # fmt: skip


def _turned(log: Any, yaw: Any) -> float:
    """Return the rms error of the heading `yaw`, relative to the first scored row of a log, deg."""
    error = np.degrees(yaw - base_pose(log)[1])[log.scored]
    return float(np.sqrt(np.mean((error - error[0]) ** 2)))
