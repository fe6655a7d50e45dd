"""Faults that are added to a log for tests: late, shuffled, lost and false inputs, other starts, a turned IMU."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from surefoot.geometry.rotations import matrix_from_quat, matrix_from_rotvec

from .log import Log


def delayed(log: Log, seconds: float) -> Log:
    """Return the log with every foot sample arriving `seconds` s after its stamp; the stamps are right."""
    n, m = len(log.stamp_ns), len(log.foot_ns)
    at = np.concatenate([log.stamp_ns, log.foot_ns + round(seconds * 1e9)])
    return replace(log, order=np.lexsort((np.repeat([0, 1], [n, m]), at)))


def shuffled(log: Log, seconds: float, seed: int) -> Log:
    """Return the log with every input arriving up to `seconds` s after its stamp; the last second is in order."""
    n, m = len(log.stamp_ns), len(log.foot_ns)
    stamps = np.concatenate([log.stamp_ns, log.foot_ns])
    late = np.random.default_rng(seed).uniform(0.0, seconds * 1e9, size=n + m).astype(np.int64)
    late[stamps > log.stamp_ns[-1] - 1_000_000_000] = 0
    return replace(log, order=np.lexsort((np.repeat([0, 1], [n, m]), stamps + late)))


def with_losses(log: Log, share: float, seed: int, hole_s: float = 1.0) -> Log:
    """Return the log without a share (0 to 1) of all samples, and without any feet for `hole_s` s in the middle."""
    rng = np.random.default_rng(seed)
    middle = log.stamp_ns[len(log.stamp_ns) // 2]
    hole = (log.foot_ns >= middle) & (log.foot_ns < middle + round(hole_s * 1e9))
    imu = rng.random(len(log.stamp_ns)) >= share
    imu[:: len(imu) - 1] = True
    imu[: log.rest[1]] = True
    return log.with_feet(~hole & (rng.random(len(log.foot_ns)) >= share)).with_imu(imu)


def with_outliers(log: Log, share: float, size: float, seed: int) -> Log:
    """Return the log with a share (0 to 1) of the foot positions moved by `size` m in random directions."""
    rng = np.random.default_rng(seed)
    m, feet = log.contact.shape
    off = rng.normal(size=(m, feet, 3))
    off *= size / np.linalg.norm(off, axis=2, keepdims=True)
    hit = rng.random((m, feet)) < share
    hit[log.foot_ns < log.stamp_ns[log.rest[1]]] = False
    return replace(log, foot_position=log.foot_position + np.where(hit[..., None], off, 0.0), order=log.order)


def with_false_contacts(log: Log, share: float, seconds: float, seed: int) -> Log:
    """Return the log with all contacts of a foot closed for `seconds` s in a share (0 to 1) of its swings."""
    rng = np.random.default_rng(seed)
    contact = log.contact.copy()
    touch = None if log.touch is None else log.touch.copy()
    for f in range(log.feet_count):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], ~log.contact[:, f], [False]]).astype(np.int8)))
        for first, end in zip(edges[::2], edges[1::2], strict=True):
            span = 1e-9 * float(log.foot_ns[end - 1] - log.foot_ns[first])
            if rng.random() >= share or span < 1.5 * seconds:
                continue
            begin = log.foot_ns[first] + round(1e9 * rng.uniform(0.2, 0.5) * span)
            hit = (log.foot_ns >= begin) & (log.foot_ns < begin + round(1e9 * seconds))
            contact[hit, f] = True
            if touch is not None:
                touch[hit, f] = True
    return replace(log, contact=contact, touch=touch)


def from_the_middle(log: Log, seconds: float) -> Log:
    """Return the log from `seconds` s after its start on, without a standstill."""
    first = int(np.searchsorted(log.seconds, seconds))
    begin = max(0.0, log.begin_s - seconds)
    cut = log.with_feet(log.foot_ns >= log.stamp_ns[first]).with_imu(np.arange(first, len(log.stamp_ns)))
    return replace(cut, rest=(0, 0), begin_s=begin)


def without_standstill(log: Log) -> Log:
    """Return the log from the end of its standstill on."""
    first = log.rest[1] + 1
    return from_the_middle(log, float(log.seconds[first]))


def with_wrong_start(log: Log, angle: float, seed: int) -> Log:
    """Return the log with an accelerometer whose tilt is wrong by `angle` rad until the robot walks."""
    axis = np.random.default_rng(seed).normal(size=3)
    rot = matrix_from_rotvec(angle * axis / np.linalg.norm(axis))
    q = log.q.copy()
    q[: log.rest[1]] = q[: log.rest[1]] @ rot.T
    return replace(log, q=q)


def turned(log: Log, seed: int) -> Log:
    """Return the log as recorded by an inertial unit that is mounted in another, random orientation."""
    quat = np.random.default_rng(seed).normal(size=4)
    rot = matrix_from_quat(quat / np.linalg.norm(quat))  # rot_new_from_old
    truth = log.truth
    if truth is not None:
        truth = replace(truth, rot=truth.rot @ rot.T)
    return replace(
        log, w=np.ascontiguousarray(log.w @ rot.T), q=np.ascontiguousarray(log.q @ rot.T), truth=truth,
        foot_position=np.ascontiguousarray(log.foot_position @ rot.T),
        foot_rot=np.ascontiguousarray(rot @ log.foot_rot),
        rot_base_from_imu=np.ascontiguousarray(log.rot_base_from_imu @ rot.T),
    )  # fmt: skip


LATE = {"late 50 ms": 0.05, "late 90 ms": 0.09, "late 250 ms": 0.25}
"""Delay of all foot samples after their stamps, s, by name of the fault."""
FAULTS: dict[str, Callable[[Log, int], Log]] = {
    **{name: lambda log, seed, late=late: delayed(log, late) for name, late in LATE.items()},
    "shuffled 100 ms": lambda log, seed: shuffled(log, 0.1, seed),
    "hole 1 s, 20 % lost": lambda log, seed: with_losses(log, 0.2, seed),
    "2 % outliers 2 cm": lambda log, seed: with_outliers(log, 0.02, 0.02, seed),
    "false contacts": lambda log, seed: with_false_contacts(log, 0.2, 0.13, seed),
}
"""Functions (log, seed) -> log with a fault, by name of the fault; the true motion is unchanged."""
STARTS: dict[str, Callable[[Log, int], Log]] = {
    "no standstill": lambda log, seed: without_standstill(log),
    "moving start": lambda log, seed: from_the_middle(log, 5.0 + 0.1 * (seed % 10)),
    "30 deg wrong": lambda log, seed: with_wrong_start(log, np.radians(30.0), seed),
    "IMU turned": turned,
}
"""Functions (log, seed) -> log with another start of the walk (moving, wrong tilt ...), by name."""
