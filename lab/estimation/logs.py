"""Logs recorded by others: humanoids with soles and quadrupeds with point feet, real and simulated.

`FOREIGN` is the table of what is known of each: truth, noise, feet, standstill, contacts. Files stay where they are:
some have no licence, and nothing of them is kept here.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.errors import SurefootError

from .contacts import by_force, by_height, mean_up
from .files import open_log
from .go1 import IMU_IN_TRUNK, RADIUS, go1_bag, go1_feet, go1_forces
from .log import Log, TrueMotion
from .truth import slopes

Contacts = Literal["given", "force", "torque", "none"]

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
SENSORS: dict[str, float | int] = {
    "sigma_w": 0.01, "sigma_q": 0.09, "standstill_samples": 30, "standstill_gyro_sd": 0.05, "standstill_acc_sd": 0.5,
    "acc_bias_sd": 0.05,
}  # fmt: skip
"""Estimator parameters for the IMUs of both iCub humanoids; noise per sample, rad/s and m/s^2."""
SOLE = np.array([[0.07, 0.03, 0.0], [0.07, -0.03, 0.0], [-0.04, 0.0, 0.0]])
"""Three contact points of a sole, foot axes, (3, 3) m, inside the outline of the humanoids' soles."""
EXACT_ROWS = 7
"""Length of the window, rows, over which exact (simulated) positions are fitted to get the true velocity."""


@dataclass(frozen=True)
class ForeignLog:
    """Log recorded by others, as a row of the table `FOREIGN`: file, reader, and treatment of its feet."""

    name: str
    file: str
    make: Callable[["ForeignLog", Path], Log]
    sensors: Mapping[str, float | int]  # noise of a row; empty = found in the quiet part of the log
    feet: Literal["point", "ball", "sole", "found"]
    rest: int  # rows of the standstill at the beginning
    begin_s: float  # s, scored from
    way: float  # m, over which relative pose errors are taken
    levels: tuple[float, float] | None = None  # N, force from which a foot stands and below which it lifts
    every: int = 1  # rows that are averaged to one
    contacts: Contacts = "given"

    def read(self, data: Path = DATA) -> Log:
        """Return the log of this row, read from the folder `data`.

        Raises:
            FileNotFoundError: the file is not there.
            SurefootError: the package that reads it is not installed.
        """
        log = self.make(self, data / self.file)
        sensors = {**log.sensors, **self.sensors}
        return replace(log, name=self.name, rest=(0, self.rest), begin_s=self.begin_s, sensors=sensors)


def humanoid(name: str) -> Log:
    """Return the log of a humanoid: inertial samples of every row, feet of every third.

    Args:
        name: `icub3_gazebo_walk` or `icub_real_com`.

    Raises:
        SurefootError: the log is not on this machine.
    """
    window, begin_s = HUMANOIDS[name]
    log = open_log(DATA / f"{name}.npz").log
    period = float(np.median(np.diff(log.seconds)))
    log = replace(log, stamp_ns=1 + log.stamp_ns, foot_ns=1 + log.foot_ns)  # filters of the paper skip feet at 0 ns
    return replace(
        log.with_feet(np.arange(0, len(log.foot_ns), 3)), sensors=SENSORS, rest=(0, 30),
        truth=replace(log.known(), v_world=slopes(log.position, window, period), window_s=(window - 1) * period),
        points=np.repeat(SOLE[None], log.feet_count, axis=0), begin_s=begin_s,
    )  # fmt: skip


HUMANOIDS = {"icub3_gazebo_walk": (15, 16.2), "icub_real_com": (61, 0.5)}
"""Length of the window of the true velocity, rows, and time after the start from which errors are scored, s, by name of
a humanoid's log."""


def _stamps(t: Array) -> NDArray[np.int64]:
    return 1 + np.round((t - t[0]) * 1e9).astype(np.int64)


def _truth(t: Array, position: Array, rot: Array) -> TrueMotion:
    """Return the true motion of a simulated log without velocities, from exact positions over seven rows.

    `t` (n,) s; `position` (n, 3) m and `rot` (n, 3, 3) of the IMU in the world.
    """
    period = float(t[1] - t[0])
    return TrueMotion(position, rot, slopes(position, EXACT_ROWS, period), (EXACT_ROWS - 1) * period)


def _command(row: ForeignLog, path: Path) -> Log:
    """Return the log of a file that `surefoot estimate` reads, with the sole points of the table row if it has any."""
    log = open_log(path).log
    return replace(log, points=np.repeat(SOLE[None], log.feet_count, axis=0)) if row.feet == "sole" else log


def _generated(row: ForeignLog, path: Path) -> Log:
    """Return the log of a file whose feet have positions but no orientation."""
    columns = np.load(path)
    contact, stamp = columns["contact"].astype(np.bool_), _stamps(columns["t"])
    w, a, feet, position, turned = (np.asarray(columns[k], dtype=np.float64) for k in ("w", "a", "pf", "p", "R"))
    period = int(np.median(np.diff(stamp)))
    return Log(
        row.name, stamp, w, a, stamp.copy(), feet, np.broadcast_to(np.eye(3), (*contact.shape, 3, 3)).copy(),
        contact, _truth(columns["t"], position, turned), rot_base_from_imu=np.ascontiguousarray(turned[0]),
        sensors={"imu_period_ns": period, "kinematics_period_ns": period},
    )  # fmt: skip


def _go1(row: ForeignLog, path: Path) -> Log:
    """Return the log of a trot of a Go1: means of `every` rows, stamped at their end; feet and truth are of that time.

    A contact flag does not mean a resting foot here: feet slide at 1 m/s for a tenth of a second after touch-down.
    """
    columns, every = np.load(path), row.every
    n = len(columns["t"]) // every * every
    wide = {key: np.asarray(columns[key][:n], dtype=np.float64) for key in ("w", "a", "p", "R", "q", "tau", "force")}
    truth = _truth(columns["t"], wide["p"], wide["R"])
    w, a = (np.ascontiguousarray(wide[key].reshape(-1, every, 3).mean(axis=1)) for key in ("w", "a"))
    last = slice(every - 1, n, every)
    position, calf = go1_feet(wide["q"][last])
    pushed = np.linalg.norm(wide["force"][last], axis=2)
    force = go1_forces(wide["q"][last], wide["tau"][last]) if row.contacts == "torque" else pushed
    truth = replace(truth, position=truth.position[last], rot=truth.rot[last], v_world=truth.v_world[last])
    stamp, period = _stamps(columns["t"])[last], round(1e6 * every)
    log = Log(
        row.name, stamp, w, a, stamp.copy(), position - IMU_IN_TRUNK, calf, columns["contact"][last],
        truth, force=force, radius=np.full(4, RADIUS),
        imu_position=IMU_IN_TRUNK, sensors={"imu_period_ns": period, "kinematics_period_ns": period},
    )  # fmt: skip
    if row.levels is not None:
        return replace(log, contact=by_force(force, *row.levels)[0])
    if row.contacts == "none":
        low = by_height(log.foot_position, mean_up(log.stamp_ns, log.q, log.foot_ns))
        return replace(log, contact=low, force=None, chance=np.full(low.shape, np.nan))
    return log


def _spot(row: ForeignLog, path: Path) -> Log:
    """Return the log of a Spot on stairs: rows at the mean period, as their stamps jitter; feet at event stamps."""
    columns = np.load(path)
    t = columns["t"]
    even = (t[-1] - t[0]) / (len(t) - 1) * np.arange(len(t))
    lever, contact = columns["imu_in_body"], columns["contact"]
    position = np.asarray(columns["pf_body"], dtype=np.float64) - lever
    rot = np.broadcast_to(np.eye(3), (*contact.shape, 3, 3)).copy()
    at = 1 + np.round(1e9 * (columns["t_event"] - t[0])).astype(np.int64)
    order = np.argsort(at, kind="stable")
    w, a = (np.asarray(columns[key], dtype=np.float64) for key in ("w", "a"))
    return Log(
        row.name, _stamps(even), w, a, at[order],
        position[order], rot, contact[order], imu_position=lever, sensors={"kinematics_period_ns": 100_000_000},
    )  # fmt: skip


def _bag(row: ForeignLog, path: Path) -> Log:
    if not path.exists():
        raise FileNotFoundError(path)
    return replace(go1_bag(path)[0], sensors={"imu_period_ns": 18_200_000, "kinematics_period_ns": 18_200_000})


def _go1_rows() -> list[ForeignLog]:
    """Return the table rows of the trot of a Go1: at 1 kHz and averaged to 200 Hz, with contacts from four sources."""
    rows: list[ForeignLog] = []
    known: tuple[Contacts, ...] = ("given", "force", "torque", "none")
    for every, rate in ((1, ""), (5, "_200")):
        noise = {"sigma_w": 0.0027 / every**0.5, "sigma_q": 0.1}
        for contacts in known:
            name = f"go1_trot{rate}" + ("" if contacts == "given" else f"_{contacts}")
            levels = (20.0, 10.0) if contacts in ("force", "torque") else None
            rows.append(ForeignLog(name, "go1_trot_sim.npz", _go1, noise, "ball", 0, 0.5, 1.0, levels, every, contacts))
    return rows


_KINDYN, _ICUB3, _COM = "icub_kindyn_walk.npz", "icub3_gazebo_walk.npz", "icub_real_com.npz"
_CASBOT = {"sigma_w": 0.003, "sigma_q": 0.05}
FOREIGN: dict[str, ForeignLog] = {row.name: row for row in (
    ForeignLog("icub_kindyn_walk", _KINDYN, _command, {}, "found", 500, 5.5, 0.5, (150.0, 120.0)),
    ForeignLog("icub_kindyn_sole", _KINDYN, _command, {}, "sole", 500, 5.5, 0.5, (150.0, 120.0)),
    ForeignLog("icub3_gazebo_walk", _ICUB3, _command, {}, "found", 1600, 16.2, 1.0, (240.0, 180.0)),
    ForeignLog("icub3_gazebo_sole", _ICUB3, _command, SENSORS, "sole", 1600, 16.2, 1.0, (240.0, 180.0)),
    ForeignLog("icub_real_com", _COM, _command, SENSORS, "sole", 200, 2.4, 0.1, (150.0, 120.0)),
    *_go1_rows(),
    ForeignLog("casbot_walk_a", "casbot_walk_a.npz", _generated, _CASBOT, "point", 380, 2.0, 1.0),
    ForeignLog("casbot_walk_b", "casbot_walk_b.npz", _generated, _CASBOT, "point", 380, 2.0, 1.0),
    ForeignLog("spot_staircase", "spot_staircase.npz", _spot, {"sigma_w": 0.01, "sigma_q": 0.1}, "point", 0, 0.5,
               1.0),
    ForeignLog("go1_bag_a", "go1_bag_a.bag", _bag, {"sigma_w": 0.01, "sigma_q": 0.1}, "ball", 0, 0.5, 1.0),
)}  # fmt: skip
"""Logs recorded by others, by name: file, reader, noise and feet of each. Feet are those of the robot, or if `found`,
what `surefoot estimate` assumes of a file that states nothing about them."""


def foreign(name: str, data: Path = DATA) -> Log:
    """Return a log recorded by others, by its name in the table `FOREIGN`.

    Raises:
        SurefootError: the name is not there, or the package that reads the log is not installed.
        FileNotFoundError: the file is not there.
    """
    if name not in FOREIGN:
        raise SurefootError("invalid", f"got {name!r}; known are {', '.join(FOREIGN)}", "log")
    return FOREIGN[name].read(data)
