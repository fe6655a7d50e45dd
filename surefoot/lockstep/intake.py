"""Conversion of a robot's sensor samples, with their own clock and rates, to one hardware sample per control tick.

A tick takes the samples whose stamp is within its 10 ms: the mean of the inertial ones, the newest of joints and feet.
A driver and the import of logs share this module, so the same samples give the same result live and from a file.
"""

import math
from collections import Counter, deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from surefoot.geometry.rotations import matrix_from_quat
from surefoot.lockstep.sample import DueSample
from surefoot.robot.description import Robot
from surefoot.robot.kinematics import foot_positions
from surefoot.schemas.base import Vec3
from surefoot.schemas.hw import FootContacts, Imu, JointState
from surefoot.schemas.topics import HW_CONTACTS, HW_IMU, HW_JOINTS, TICK_NS

LOW_M = 0.005
"""Height above the lowest foot, m, below which a foot counts as standing if contacts and forces are unknown."""
UP_TICKS = 50
"""Number of ticks over which the accelerometer is averaged for the direction of gravity, which heights of feet need."""
BACK_NS, AHEAD_NS = 1_000_000_000, 10_000_000_000
"""`BACK_NS`: step back of an inertial stamp, ns, beyond which the clock counts as having jumped (a smaller one is a
late sample); `AHEAD_NS`: step ahead, ns, with that effect. Joint and foot samples so far from the newest inertial one
are refused."""
SILENT_NS = 1_000_000_000
"""Time without a foot sample after which contacts are derived from the heights of the feet again, ns."""
MOST_FEET = 20_000
"""Largest number of foot samples that may wait for a joint sample; beyond it the oldest are dropped."""

Numbers = Sequence[float]


class ForceContact(NamedTuple):
    """Rule of foot contact by force, N = scale (raw - zero): contact begins above `on` and ends below `off`, N."""

    zero: tuple[float, ...]  # (F,) raw
    scale: tuple[float, ...]  # (F,) N per raw unit
    on: float
    off: float

    def force(self, raw: Numbers) -> tuple[float, ...]:
        """Return the forces of the feet, (F,) N, from raw readings (F,)."""
        return tuple(scale * (float(x) - zero) for x, zero, scale in zip(raw, self.zero, self.scale, strict=True))

    def touch(self, force: Numbers, before: Sequence[bool]) -> tuple[bool, ...]:
        """Return whether each foot has contact, (F,), from forces (F,) N and the contacts before (hysteresis)."""
        return tuple(n > self.on or (was and n >= self.off) for n, was in zip(force, before, strict=True))


class _Joints(NamedTuple):
    stamp_ns: int
    position: tuple[float, ...]
    velocity: tuple[float, ...] | None
    torque: tuple[float, ...] | None


class Intake:
    """Buffer of sensor samples, which are released tick by tick; time 0 is the first inertial sample.

    Args:
        robot: description; joints and feet come in its order, inertial samples in the axes of its inertial unit.
        contact: rule for raw foot forces; None = contacts come as flags. Without samples the feet's heights decide.
        report: called with code and text at the first refused sample of each code.
    """

    def __init__(
        self, robot: Robot, contact: ForceContact | None = None, report: Callable[[str, str], None] | None = None
    ) -> None:
        self.robot, self.contact = robot, contact
        self.refused: Counter[str] = Counter()
        """Number of samples refused so far, by code."""
        self._report = report
        self._origin: int | None = None
        self._newest: Counter[str] = Counter()
        self._imu: deque[tuple[int, tuple[float, ...]]] = deque()
        self._joints: deque[_Joints] = deque()
        self._feet: deque[tuple[int, tuple[float, ...]]] = deque(maxlen=MOST_FEET)
        self._end = -TICK_NS
        self._up: deque[Vec3] = deque(maxlen=UP_TICKS)
        self._touch: tuple[bool, ...] = (False,) * robot.nlegs
        self._force: tuple[float | None, ...] = (None,) * robot.nlegs
        self._feet_ns: int | None = None
        """Stamp of the newest accepted foot sample, ns; None = there was none."""
        self._rot: list[list[float]] = matrix_from_quat(robot.imu.quat_wxyz).tolist()  # rot_base_from_imu

    @property
    def newest_ns(self) -> int:
        """Time of the newest inertial sample, ns; -1 = there was none."""
        return self._newest["imu"] if self._origin is not None else -1

    def lacking_ns(self, tick: int) -> int:
        """Return the time from the newest sample to the end of a tick, ns; 0 = inertial and joint samples cover it.

        Of the newest inertial and the newest joint sample the older one counts, or the inertial one as long as there is
        no joint sample. Before the first inertial sample the result is one tick, `TICK_NS`.
        """
        newest = min(self._newest["imu"], self._newest.get("joints", self._newest["imu"]))
        return max(0, tick * TICK_NS - newest) if self._origin is not None else TICK_NS

    def refuse(self, code: str, text: str) -> None:
        """Count a refused sample under its code, and report the first of each code."""
        self.refused[code] += 1
        if self.refused[code] == 1 and self._report is not None:
            self._report(code, text)

    def imu(self, stamp_ns: int, gyro: Numbers, acc: Numbers) -> None:
        """Add an inertial sample: gyro rad/s, specific force m/s^2, axes of the inertial unit."""
        row = (*map(float, gyro), *map(float, acc))
        if self._origin is None and len(row) == 6 and all(map(math.isfinite, row)):
            self._origin = stamp_ns
        if (at := self._place("imu", stamp_ns, row, 6)) is not None:
            self._imu.append((at, row))

    def joints(
        self, stamp_ns: int, position: Numbers, velocity: Numbers | None = None, torque: Numbers | None = None
    ) -> None:
        """Add a sample of joint angles (nj,) rad, rates rad/s and torques Nm, in the order of the description."""
        row = angles = tuple(map(float, position))
        rates = torques = None
        if velocity is not None:
            row += (rates := tuple(map(float, velocity)))
        if torque is not None:
            row += (torques := tuple(map(float, torque)))
        size = self.robot.nj * (1 + (rates is not None) + (torques is not None))
        if self._origin is not None and (at := self._place("joints", stamp_ns, row, size)) is not None:
            self._joints.append(_Joints(at, angles, rates, torques))

    def feet(self, stamp_ns: int, values: Numbers) -> None:
        """Add a sample of the feet: raw forces (F,) if there is a `contact` rule, else flags (F,), 1 = contact."""
        row = tuple(map(float, values))
        if self._origin is not None and (at := self._place("feet", stamp_ns, row, self.robot.nlegs)) is not None:
            self._feet.append((at, row))

    def release(self, tick: int) -> list[DueSample]:
        """Return the samples of a tick, and remove them from the buffer; call it for one tick after the other."""
        end, out = tick * TICK_NS, list[DueSample]()
        rows: list[tuple[int, tuple[float, ...]]] = []
        while self._imu and self._imu[0][0] <= end:
            rows.append(self._imu.popleft())
        if rows:
            mean = [math.fsum(part) / len(rows) for part in zip(*(row for _, row in rows), strict=True)]
            gyro, acc = (mean[0], mean[1], mean[2]), (mean[3], mean[4], mean[5])
            self._up.append(acc)
            out.append(DueSample(HW_IMU, Imu(acc=acc, gyro=gyro), rows[-1][0], tick))
        joints = None
        while self._joints and self._joints[0].stamp_ns <= end:
            joints = self._joints.popleft()
        if joints is not None:
            message = JointState(position=joints.position, velocity=joints.velocity, torque=joints.torque)
            out.append(DueSample(HW_JOINTS, message, joints.stamp_ns, tick))
            self._stand(joints)
            feet = FootContacts(touch=tuple((one,) for one in self._touch), normal_force_n=self._force)
            out.append(DueSample(HW_CONTACTS, feet, joints.stamp_ns, tick))
        self._end = end
        return out

    def _stand(self, joints: _Joints) -> None:
        """Update the contacts of the feet up to the stamp of a joint sample."""
        while self._feet and self._feet[0][0] <= joints.stamp_ns:
            self._feet_ns, row = self._feet.popleft()
            if self.contact is None:
                self._touch = tuple(x > 0.5 for x in row)
            else:
                self._force = force = self.contact.force(row)
                self._touch = self.contact.touch(force, self._touch)
        if self._feet_ns is not None and joints.stamp_ns - self._feet_ns < SILENT_NS:
            return
        self._force = (None,) * self.robot.nlegs
        if not self._up:
            return
        acc = [math.fsum(part) for part in zip(*self._up, strict=True)]
        up = [math.fsum(row[i] * acc[i] for i in range(3)) for row in self._rot]
        length = math.sqrt(math.fsum(x * x for x in up)) or 1.0
        feet = foot_positions(self.robot.model, np.array(joints.position)).tolist()
        height = [math.fsum(x * u for x, u in zip(foot, up, strict=True)) / length for foot in feet]
        self._touch = tuple(h < min(height) + LOW_M for h in height)

    def _place(self, kind: str, stamp_ns: int, row: tuple[float, ...], size: int) -> int | None:
        """Return the time of a sample since the first inertial one, ns; None = it is refused."""
        if len(row) != size:
            self.refuse(f"{kind}_shape", f"{kind}: got {len(row)} numbers, wanted are {size}")
            return None
        if not math.isfinite(sum(row)) and not all(map(math.isfinite, row)):  # a sum of finite numbers may overflow
            self.refuse(f"{kind}_nonfinite", f"{kind}: got a number that is not finite")
            return None
        if self._origin is None:
            return None
        at, now = stamp_ns - self._origin, self._newest["imu"]
        if not now - BACK_NS < at < now + AHEAD_NS:
            if kind != "imu":
                self.refuse(f"{kind}_clock", f"{kind}: a stamp {1e-9 * (at - now):+.3f} s from the inertial ones")
                return None
            self.refuse("clock", f"{kind}: the clock jumps by {1e-9 * (at - now):+.3f} s; time goes on without it")
            at = max(self._newest.values()) + TICK_NS
            self._origin = stamp_ns - at
        if kind in self._newest and at <= self._newest[kind]:
            code = "duplicate" if at == self._newest[kind] else "late"
            self.refuse(f"{kind}_{code}", f"{kind}: a stamp {1e-9 * (self._newest[kind] - at):.6g} s before the last")
            return None
        self._newest[kind] = at
        if kind == "imu" and at <= self._end:
            self.refuse("imu_late", f"imu: {1e-9 * (self._end - at):.3f} s behind the tick; its tick has passed")
            return None
        return at
