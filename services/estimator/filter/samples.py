"""Samples of the last seconds sorted by their stamps, whatever their order of arrival; L feet, K contact points."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.kernels.jit import kernel

Stamps = NDArray[np.int64]

CAPACITY = 4096
"""Largest number of stored samples of the inertial unit, and of the feet; at 1 kHz 4 s."""
KEPT = CAPACITY // 2
"""Number of newest samples of the inertial unit or the feet that stay when `CAPACITY` is reached."""
ROW_W, ROW_Q = 0, 3
"""`ROW_W`, `ROW_Q`: first columns of gyro (3) rad/s and accelerometer (3) m/s^2 in an inertial row (6,)."""


EXTERNAL_CAPACITY = 256
"""Largest number of stored samples of another source (camera, GNSS); at 100 Hz 2 s."""


class ExternalLayout(NamedTuple):
    """First index of each part of a sample of another source, such as a camera, (26,); NaN: the part is missing."""

    position: int = 0
    """Index: position of the IMU in the frame of the source, z up, (3,) m."""
    yaw: int = 3
    """Index: heading of base_link in the frame of the source, rad."""
    velocity: int = 4
    """Index: velocity of the IMU, IMU axes, (3,) m/s."""
    position_covariance: int = 7
    """Index: covariance of the position by rows, frame of the source, (9,) m^2."""
    yaw_variance: int = 16
    """Index: variance of the heading, rad^2."""
    velocity_covariance: int = 17
    """Index: covariance of the velocity by rows, IMU axes, (9,) (m/s)^2."""


EX = ExternalLayout()
EXTERNAL_WIDTH = EX.velocity_covariance + 9
"""Length of a sample of another source (26,), see `ExternalLayout`."""


class SampleStore(NamedTuple):
    """Samples of the inertial unit, the feet and other sources by rising stamps, in the first rows of the arrays.

    N rows of inertial unit and feet, M of other sources, L feet, K contact points.
    """

    imu_stamps: Stamps
    """Stamps of the inertial samples, rising, (N,) ns."""
    imu: Array
    """Gyro rad/s and accelerometer m/s^2, IMU axes, means up to their stamps, (N, 6)."""
    feet_stamps: Stamps
    """Stamps of the samples of the feet, rising, (N,) ns."""
    feet: Array
    """Positions of the feet from the IMU, IMU axes, (N, L, 3) m; zeros where unknown."""
    foot_rots: Array
    """Rotations rot_imu_from_foot of the feet, (N, L, 3, 3)."""
    contact: Array
    """Probability of contact of each contact point, (N, K); NaN: unknown."""
    closed: Stamps
    """Closed switches of each foot, (N, L), bit s for switch s."""
    external_stamps: Stamps = np.zeros(0, dtype=np.int64)
    """Stamps of the samples of other sources, rising, (M,) ns."""
    external: Array = np.zeros((0, EXTERNAL_WIDTH))
    """Samples of other sources (camera, GNSS), (M, 26), columns as in `ExternalLayout`."""


def new_samples(feet: int, points: int) -> SampleStore:
    """Return an empty store for samples of `feet` feet and `points` contact points."""
    n = CAPACITY
    return SampleStore(
        np.zeros(n, dtype=np.int64), np.zeros((n, 6)), np.zeros(n, dtype=np.int64), np.zeros((n, feet, 3)),
        np.zeros((n, feet, 3, 3)), np.zeros((n, points)), np.zeros((n, feet), dtype=np.int64),
        np.zeros(EXTERNAL_CAPACITY, dtype=np.int64), np.zeros((EXTERNAL_CAPACITY, EXTERNAL_WIDTH)),
    )  # fmt: skip


@kernel
def after(stamps: Stamps, stamp_ns: int) -> int:
    """Return the index of the first of rising stamps (n,), ns, that is later than `stamp_ns`; n if none is."""
    low, high = 0, stamps.size
    while low < high:
        middle = (low + high) // 2
        if stamps[middle] <= stamp_ns:
            low = middle + 1
        else:
            high = middle
    return low


@kernel
def place_of(stamps: Stamps, stamp_ns: int) -> int:
    """Return the index at which `stamp_ns` belongs among rising stamps (n,), ns; -1: a sample has this stamp."""
    n = stamps.size
    if n == 0 or stamp_ns > stamps[n - 1]:
        return n
    at = after(stamps, stamp_ns)
    return -1 if at > 0 and stamps[at - 1] == stamp_ns else at


@kernel
def make_room(column: np.ndarray, at: int, end: int) -> None:
    """Move rows `at` to `end` - 1 of a column (N, ...) back by one, in place, so that row `at` is free."""
    for i in range(end, at, -1):
        column[i] = column[i - 1]


@kernel
def keep_newest(column: np.ndarray, keep: int) -> None:
    """Move the last `keep` rows of a full column (N, ...) to its first rows, in place, in their order."""
    first = column.shape[0] - keep
    for i in range(keep):
        column[i] = column[first + i]


@kernel
def insert_imu(samples: SampleStore, end: int, stamp_ns: int, w: Array, q: Array) -> int:
    """Insert an inertial sample among the first `end` rows by its stamp, in place.

    Args:
        samples: store of samples; changed. When it is full, the newest half stays.
        end: number of inertial rows in it.
        stamp_ns: time of the sample, ns.
        w: gyro, IMU axes, (3,) rad/s.
        q: accelerometer, IMU axes, (3,) m/s^2.

    Returns:
        The number of rows after that; -1: there is a sample of this stamp, which stays.
    """
    stamps, rows = samples.imu_stamps, samples.imu
    at = place_of(stamps[:end], stamp_ns)
    if at < 0:
        return -1
    if end == CAPACITY:
        keep_newest(stamps, KEPT)
        keep_newest(rows, KEPT)
        at, end = max(at - KEPT, 0), KEPT
    make_room(stamps, at, end)
    make_room(rows, at, end)
    stamps[at] = stamp_ns
    for i in range(3):
        rows[at, ROW_W + i], rows[at, ROW_Q + i] = w[i], q[i]
    return end + 1


@kernel
def insert_feet(
    samples: SampleStore, end: int, stamp_ns: int, position: Array, rot: Array, contact: Array, closed: Stamps
) -> int:
    """Insert a sample of the feet among the first `end` rows by its stamp, in place.

    Args:
        samples: store of samples; changed. When it is full, the newest half stays.
        end: number of rows of the feet in it.
        stamp_ns: time of the sample, ns.
        position: foot centres from the IMU, IMU axes, (L, 3) m.
        rot: rot_imu_from_foot, (L, 3, 3).
        contact: probability of contact of each point, (K,), NaN = unknown.
        closed: closed switches of each foot, (L,), bit s for switch s.

    Returns:
        The number of rows after that; -1: there is a sample of this stamp, which stays.
    """
    stamps = samples.feet_stamps
    at = place_of(stamps[:end], stamp_ns)
    if at < 0:
        return -1
    if end == CAPACITY:
        keep_newest(stamps, KEPT)
        keep_newest(samples.feet, KEPT)
        keep_newest(samples.foot_rots, KEPT)
        keep_newest(samples.contact, KEPT)
        keep_newest(samples.closed, KEPT)
        at, end = max(at - KEPT, 0), KEPT
    make_room(stamps, at, end)
    make_room(samples.feet, at, end)
    make_room(samples.foot_rots, at, end)
    make_room(samples.contact, at, end)
    make_room(samples.closed, at, end)
    stamps[at] = stamp_ns
    samples.feet[at], samples.foot_rots[at], samples.contact[at] = position, rot, contact
    samples.closed[at] = closed
    return end + 1


@kernel
def insert_external(samples: SampleStore, end: int, stamp_ns: int, row: Array) -> int:
    """Insert a sample of another source, such as a camera, among the first `end` rows by its stamp, in place.

    Args:
        samples: store of samples; changed. When it is full, the newest half stays.
        end: number of rows of other sources in it.
        stamp_ns: time at which the sample holds, ns.
        row: position, heading, velocity and their covariances, (26,) as in `ExternalLayout`, NaN = absent.

    Returns:
        The number of rows after that; -1 if there is a row of this stamp already, which stays.
    """
    stamps = samples.external_stamps
    at = place_of(stamps[:end], stamp_ns)
    if at < 0:
        return -1
    if end == EXTERNAL_CAPACITY:
        keep = EXTERNAL_CAPACITY // 2
        keep_newest(stamps, keep)
        keep_newest(samples.external, keep)
        at, end = max(at - keep, 0), keep
    make_room(stamps, at, end)
    make_room(samples.external, at, end)
    stamps[at], samples.external[at] = stamp_ns, row
    return end + 1
