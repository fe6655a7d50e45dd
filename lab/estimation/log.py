"""A log of a legged robot as arrays: inertial samples, feet seen from the IMU, contacts, truth where it is known.

Axes: those of the IMU, if nothing else is stated. Feet are positions of foot centres with the orientation of the foot;
`points` are the places of a sole that touch the ground, in foot axes from that centre.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array, Flags, Ints
from surefoot.geometry.constants import GRAVITY
from surefoot.robot.description import Robot
from surefoot.services.estimator.feet.mount import FootSample

from .external import Externals


@dataclass(frozen=True, eq=False)
class TrueMotion:
    """True motion of the IMU at each of n inertial rows."""

    position: Array  # (n, 3) m, world
    rot: Array  # (n, 3, 3) rot_world_from_imu
    v_world: Array  # (n, 3) m/s, world axes
    window_s: float = 0.0  # v_world is the slope of a cubic fitted to positions over so long, 0 = exact; see `truth`
    held: Flags | None = None  # (n,) rows at which the truth is not known, see `held_rows`; None = none

    @cached_property
    def v(self) -> Array:
        """True velocity of the IMU at each inertial row, (n, 3) m/s, IMU axes."""
        return np.einsum("nji,nj->ni", self.rot, self.v_world)

    @property
    def up(self) -> Array:
        """True specific force at rest, (n, 3) m/s^2, IMU axes, points up."""
        return GRAVITY * self.rot[:, 2, :]


@dataclass(frozen=True, eq=False)
class Log:
    """Inputs of an estimator: n inertial rows, m foot samples of F feet, K points and S switches per foot.

    Vectors are in IMU axes, `rot_base_from_imu` (3, 3) turns them into those of base_link; `truth` is the true motion
    at each row, None = unknown.
    """

    name: str
    stamp_ns: Ints  # (n,) end of the interval that the row is the mean of
    w: Array  # (n, 3) rad/s
    q: Array  # (n, 3) m/s^2, specific force, +9.81 along up at rest
    foot_ns: Ints  # (m,)
    foot_position: Array  # (m, F, 3) m
    foot_rot: Array  # (m, F, 3, 3) rot_imu_from_foot
    contact: Flags  # (m, F)
    truth: TrueMotion | None = None
    touch: Flags | None = None  # (m, F, S) switches; None = one per foot, which is `contact`
    force: Array | None = None  # (m, F) N along the sole's normal
    joints: Array | None = None  # (m, nj) rad, in the order of the robot description
    points: Array | None = None  # (F, K, 3) m; None = the foot centre
    radius: Array | None = None  # (F,) m, of round feet; None = soles
    rot_base_from_imu: Array = field(default_factory=lambda: np.eye(3))
    imu_position: Array = field(default_factory=lambda: np.zeros(3))  # in base_link, m
    robot: Robot | None = None  # description, if there is one
    sensors: Mapping[str, float | int] = field(default_factory=dict)  # what is known of the sensors, as parameters
    rest: tuple[int, int] = (0, 0)  # rows of a standstill at the beginning, first and after the last
    begin_s: float = 0.5  # scores begin so long after the start
    end_s: float = 0.1  # and end so long before the end
    saturated: Flags | None = None  # (n,) rows that the driver marks as clipped
    order: Ints | None = None  # order of arrival: index of the inertial row, or n + index of the foot sample
    external: Externals | None = None  # poses, headings, velocities from elsewhere
    chance: Array | None = None  # (m, F) probability of contact, NaN = unknown; None = `contact` is certain

    @property
    def robot_name(self) -> str | None:
        """Name of the robot, None = there is no description."""
        return None if self.robot is None else self.robot.name

    @property
    def feet_count(self) -> int:
        """Number of feet F in the log."""
        return self.foot_position.shape[1]

    @cached_property
    def feet(self) -> tuple[FootSample, ...]:
        """Foot samples of the log as a tuple of records, in the order of their stamps."""
        rows = zip(self.foot_ns.tolist(), self.foot_position, self.foot_rot, self.contact, strict=True)
        return tuple(FootSample(*row) for row in rows)

    def known(self) -> TrueMotion:
        """Return the true motion of the IMU in the log.

        Raises:
            ValueError: the log has none.
        """
        if self.truth is None:
            raise ValueError(f"log {self.name!r} has no truth")
        return self.truth

    @property
    def switches(self) -> Flags | Array:
        """Closed switches of each foot, (m, F, S); the contact flags, S = 1, if there are no switches or they disagree.

        Probabilities instead, (m, F, 1), where the log has them.
        """
        if self.chance is not None:
            return self.chance[:, :, None]
        if self.touch is None or (self.touch.any(axis=2) != self.contact).any():
            return self.contact[:, :, None]
        return self.touch

    @property
    def position(self) -> Array:
        """True position of the IMU at each inertial row, (n, 3) m, world."""
        return self.known().position

    @property
    def rot(self) -> Array:
        """True rotation from IMU to world at each inertial row, (n, 3, 3)."""
        return self.known().rot

    @property
    def v(self) -> Array:
        """True velocity of the IMU at each inertial row, (n, 3) m/s, IMU axes."""
        return self.known().v

    @property
    def v_world(self) -> Array:
        """True velocity of the IMU at each inertial row, (n, 3) m/s, world axes."""
        return self.known().v_world

    @property
    def up(self) -> Array:
        """True specific force at rest at each inertial row, (n, 3) m/s^2, IMU axes: 9.81 m/s^2 upward."""
        return self.known().up

    @cached_property
    def seconds(self) -> Array:
        """Time since the first inertial row, (n,) s."""
        return 1e-9 * (self.stamp_ns - self.stamp_ns[0])

    @property
    def scored(self) -> Flags:
        """Flags of the inertial rows that are scored, (n,): True where the truth is valid, without start and end.

        The first `begin_s` s and the last `end_s` s of the log are left out.
        """
        rows = (self.seconds >= self.begin_s) & (self.seconds <= self.seconds[-1] - self.end_s)
        if self.truth is not None and self.truth.held is not None:
            rows &= ~self.truth.held
        return rows

    def arrival(self) -> Ints:
        """Return the order of arrival of all inputs, (n + m + e,) indices.

        Indices below n are inertial rows, from n on foot samples, from n + m on samples of other sources. A foot sample
        follows the first inertial row at or after its stamp, one of another source that at or after its arrival.
        """
        if self.order is not None:
            return self.order
        n, m = len(self.stamp_ns), len(self.foot_ns)
        others = np.empty(0, dtype=np.int64) if self.external is None else self.external.arrival_ns
        slots = np.searchsorted(self.stamp_ns, np.concatenate([self.foot_ns, others]))  # rows that they wait for
        key = np.concatenate([np.arange(n), np.minimum(slots, n - 1)])
        return np.lexsort((np.concatenate([np.zeros(n), np.ones(m), np.full(len(others), 2)]), key))

    def with_feet(self, keep: Flags | Ints) -> "Log":
        """Return the log with some of the foot samples only; `keep` is a mask, (m,), or indices, (k,)."""
        some = {name: getattr(self, name) for name in ("touch", "force", "joints", "chance")}
        return replace(
            self, foot_ns=self.foot_ns[keep], foot_position=self.foot_position[keep], foot_rot=self.foot_rot[keep],
            contact=self.contact[keep], order=None, **{k: None if v is None else v[keep] for k, v in some.items()},
        )  # fmt: skip

    def with_imu(self, keep: Flags | Ints) -> "Log":
        """Return the log with some of the inertial rows only, by flag (n,) or index (k,), and the truth at them."""
        truth = self.truth
        if truth is not None:
            held = None if truth.held is None else truth.held[keep]
            truth = TrueMotion(truth.position[keep], truth.rot[keep], truth.v_world[keep], truth.window_s, held)
        clipped = None if self.saturated is None else self.saturated[keep]
        return replace(
            self, stamp_ns=self.stamp_ns[keep], w=self.w[keep], q=self.q[keep], truth=truth, saturated=clipped,
            order=None,
        )  # fmt: skip

    def point_views(self, several: bool) -> tuple[Array, Flags]:
        """Return contact points in IMU axes, (m, N, 3) m, and flags of those that touch the ground, (m, N).

        Args:
            several: True = the K points of each foot; else the foot centre alone.
        """
        if not several or self.points is None:
            return self.foot_position, self.contact
        m, feet, k = len(self.foot_ns), self.feet_count, self.points.shape[1]
        seen = self.foot_position[:, :, None] + np.einsum("mfij,fkj->mfki", self.foot_rot, self.points)
        if self.touch is not None and self.touch.shape[2] == k:
            touch = self.touch
        else:
            touch = np.repeat(self.contact[:, :, None], k, axis=2)
        return np.ascontiguousarray(seen.reshape(m, feet * k, 3)), np.ascontiguousarray(touch.reshape(m, feet * k))


class Segments(NamedTuple):
    """Time of a log cut at every inertial row and foot sample; filters that need no order of arrival walk along it."""

    d: Array  # (s,) length, s
    row: Ints  # (s,) inertial row that is the mean over it
    feet: Ints  # (s,) foot sample at its end, -1 = none
    last: Flags  # (s,) the inertial row ends here


def segments(log: Log) -> Segments:
    """Return the time of a log cut at every sample; foot samples outside of the inertial rows are left out."""
    stamps, feet = log.stamp_ns, log.foot_ns
    inside = np.flatnonzero((feet > stamps[0]) & (feet <= stamps[-1]))
    cuts = np.union1d(stamps, feet[inside])
    first = int(np.median(np.diff(stamps))) if len(stamps) > 1 else 10_000_000
    d = 1e-9 * np.diff(cuts, prepend=cuts[0] - first)
    seen = np.full(len(cuts), -1, dtype=np.int64)
    seen[np.searchsorted(cuts, feet[inside])] = inside
    return Segments(d, np.searchsorted(stamps, cuts), seen, np.isin(cuts, stamps))
