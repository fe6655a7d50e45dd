"""Import of a log as a recording: its samples pass through the services as they would on the live robot."""

import json
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from surefoot.errors import SurefootError
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.driver import Driver, DueSample
from surefoot.lockstep.intake import Intake
from surefoot.lockstep.local import LocalSystem
from surefoot.lockstep.service import Service
from surefoot.robot.reader import ROBOT_FILE, load_robot, robot_file
from surefoot.schemas.hw import JointCommand
from surefoot.schemas.topics import HW_CONTACTS, HW_IMU, HW_JOINTS, HW_TICK, SIM_JOIN, TICK_NS
from surefoot.services.estimator.service import EstimatorService
from surefoot.services.recorder.service import Recorder, RecorderConfig
from surefoot.services.stability.service import Stability
from surefoot.services.supervisor.scenarios.recorded import present_versions

from .fit import RobotLog

FEWEST_ROWS = 50
"""Least number of inertial samples in a log to import; shorter logs are refused."""
SERVICES: tuple[type[Service[Any]], ...] = (EstimatorService, Stability)
"""Services that compute from the sensor samples of a log alone, in the order of their ticks."""
IMPORTED = "imported"
"""Mode of a run that was imported, in the metadata of its recording."""


class Player(Driver[ServiceConfig]):
    """Driver service that publishes the samples of a log tick by tick, and ignores commands."""

    name = "player"
    outputs = (HW_IMU, HW_JOINTS, HW_CONTACTS)
    serves = (SIM_JOIN,)

    def __init__(self, config: ServiceConfig, log: RobotLog) -> None:
        super().__init__(config)
        self.log_rows, self.at = _merged(log), 0
        self.intake = Intake(load_robot(config.robot), log.contact)
        first, last = log.imu.stamp_ns[0], log.imu.stamp_ns[-1]
        self.last_tick = int(-(-(last - first) // TICK_NS))
        self.first_ns = int(first)
        self.fitted = log

    def release(self, tick: int) -> list[DueSample]:
        """Return the samples of the log that are due in a tick."""
        rows, log, intake = self.log_rows, self.fitted, self.intake
        while self.at < len(rows) and rows[self.at][0] - self.first_ns <= tick * TICK_NS:
            stamp, kind, row = rows[self.at]
            self.at += 1
            if kind == 0:
                values = log.imu.values[row].tolist()
                intake.imu(stamp, values[:3], values[3:])
            elif kind == 1:
                assert log.feet is not None
                intake.feet(stamp, log.feet.values[row].tolist())
            else:
                more = (None if part is None else part[row].tolist() for part in (log.velocity, log.torque))
                intake.joints(stamp, log.joints.values[row].tolist(), *more)
        return intake.release(tick)

    def actuate(self, tick: int, command: JointCommand | None) -> None:
        """Ignore a joint command, since a log has no actuators."""


def _merged(log: RobotLog) -> list[tuple[int, int, int]]:
    """Return (stamp, ns; kind: 0 inertial, 1 feet, 2 joints; row index) of all rows of a log, sorted by stamp."""
    streams = (log.imu, log.feet, log.joints)
    return sorted(
        (stamp, kind, row)
        for kind, stream in enumerate(streams)
        if stream is not None
        for row, stamp in enumerate(stream.stamp_ns.tolist())
    )


def play(
    player: Driver[Any],
    recorder: RecorderConfig,
    services: Sequence[str],
    last_tick: int,
    progress: Callable[[float], None] = lambda share: None,
) -> None:
    """Pass the samples of a driver through services in lockstep and in this process, and record what they publish.

    Args:
        player: driver that publishes the samples.
        recorder: configuration of the recorder, with the robot of all.
        services: names of the services, of those in `SERVICES`.
        last_tick: last control tick.
        progress: called with the share that is done, 0 to 1.
    """
    others = [kind(kind.Config(robot=recorder.robot)) for kind in SERVICES if kind.name in services]
    writer = Recorder(recorder)
    writer.timed = False
    system = LocalSystem([player, *others, writer])
    try:
        player.node.begin(tuple(one.name for one in (*others, writer)), "lockstep", 0.0, 1, "fail", 0)
        leader = player.node.leader
        leader.end_tick = last_tick
        system.bus.subscribe(HW_TICK, lambda delivery: progress(delivery.header().tick / max(1, last_tick)))
        system.run_until(lambda: leader.state == "ended" and leader.all_done())
    finally:
        system.close()


def check_out(out: Path) -> None:
    """Raise SurefootError if the recording of a log cannot be written to `out`: a name without .mcap, or one taken."""
    if out.suffix.lower() != ".mcap":
        raise SurefootError("invalid", f"got {str(out)!r}, allowed is a file *.mcap", "out")
    if out.exists():
        raise SurefootError("invalid", f"{out} exists; allowed is a new file (--out)", "out")


def record(log: RobotLog, robot: str, out: Path, progress: Callable[[float], None] = lambda share: None) -> Player:
    """Write a log as a recording, with the estimates and margins of the services, completely or not at all.

    Args:
        log: log in the joint order and frames of the robot.
        robot: name of a description, or path of its folder.
        out: MCAP file, which must not exist.
        progress: called with the share that is done, 0 to 1.

    Returns:
        The driver that played the log, with the number of samples it refused.

    Raises:
        SurefootError: `out` exists or is no *.mcap, or the log has fewer than `FEWEST_ROWS` inertial samples.
    """
    check_out(out)
    if len(log.imu.stamp_ns) < FEWEST_ROWS:
        text = f"got {len(log.imu.stamp_ns)} inertial rows, wanted are {FEWEST_ROWS} or more"
        raise SurefootError("invalid", text, "imu")
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=out.parent) as folder:
        part = Path(folder) / out.name
        player = Player(ServiceConfig(robot=robot), log)
        others = tuple(one.name for one in SERVICES)
        run = {"mode": IMPORTED, "services": " ".join(others), "robot_hash": player.intake.robot.hash}
        files = {ROBOT_FILE: str(robot_file(robot))}
        about = json.dumps({"run": run, "versions": present_versions(), "files": files})
        play(player, RecorderConfig(robot=robot, path=str(part), about=about), others, player.last_tick, progress)
        part.replace(out)
    return player
