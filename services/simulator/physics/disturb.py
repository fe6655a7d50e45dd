"""Changes to a running world: pushes, properties of model and ground, torque limits, faults."""

# mujoco has no type stubs for its compiled modules:
# pyright: reportAttributeAccessIssue=false
import math
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.errors import InvalidField
from surefoot.geometry.constants import GRAVITY
from surefoot.robot.description import Robot
from surefoot.schemas.topics import TICK_S

from .addresses import Addresses
from .faults import STAMPED, Fault, FaultBank
from .model import NO_TORQUE, Perturbation, Physics, retune
from .samples import (
    ContactSample,
    ImuSample,
    JointSample,
    Samples,
    ServoCommand,
    pack,
    unpack,
)

QUANTITIES = ("friction", "mass", "servo")
MAX_VALUE = 100.0
MOST_WEIGHTS = 100.0
"""Largest force of a push in multiples of the robot's weight; a stronger push is refused, as the physics would
diverge."""


class WorldError(InvalidField):
    """Refusal of a request that the world cannot fulfil; `field` names the wrong argument."""


def too_strong(robot: Robot, force: tuple[float, float, float]) -> str:
    """Return what is wrong with the size of a force on a robot, (3,) N: received and allowed; empty = nothing."""
    most, size = MOST_WEIGHTS * GRAVITY * robot.mass, math.hypot(*force)
    if size <= most:
        return ""
    return f"got {size:g} N, allowed are 0 to {most:.0f} N, {MOST_WEIGHTS:g} times the weight of {robot.name}"


@dataclass(frozen=True)
class Push:
    """Push of the robot: force at the centre of mass of a body (MuJoCo id) in the ticks start <= tick < end."""

    start: int
    end: int
    body: int
    force: tuple[float, float, float]
    """Force at the centre of mass of the pushed body, (3,) N, world axes."""


class Disturbances:
    """Pushes, settings, torque limits and faults of one run, applied to the compiled model relative to the description.

    Tick n is the step that ends at n x 10 ms and the samples that are released then.
    """

    def __init__(
        self,
        robot: Robot,
        model: mujoco.MjModel,
        address: Addresses,
        base: Perturbation,
        physics: Physics,
        foot_of_sphere: NDArray[np.int64],
    ) -> None:
        self.robot, self.model, self.address = robot, model, address
        self.base, self.physics, self.foot_of_sphere = base, physics, foot_of_sphere
        self._links = tuple(link.name for link in robot.links)
        self._points = tuple(len(leg.foot.points) for leg in robot.legs)
        self._changed = False
        self._own = self._strength()
        self.clear()

    def clear(self) -> None:
        """Begin a run: undo every change."""
        self.pushes: list[Push] = []
        self.faults = FaultBank(self.robot.joint_names, self.robot.leg_names, STAMPED)
        self.settings: dict[str, float] = {}
        self._limit: Array | None = None
        if self._changed:
            self._retune(0)
            self._changed = False

    # --- requests -----------------------------------------------------------------------------------------------

    def push(self, tick: int, force: tuple[float, float, float], duration: float, body: str) -> None:
        """Plan a force (N, world axes) at the centre of mass of a link for `duration` s from a tick on.

        `body`: name of the link, or `trunk`.

        Raises:
            WorldError: the link is unknown, or a number is not finite or positive.
        """
        name = self._links[0] if body == "trunk" else body
        if name not in self._links:
            raise WorldError("body", f"got {body!r}, known are trunk, {', '.join(self._links)}")
        if not (all(map(math.isfinite, force)) and math.isfinite(duration) and duration > 0.0):
            raise WorldError("force", f"must be finite, for a duration > 0 s, got {force!r} for {duration!r}")
        x, y, z = (float(f) for f in force)
        end = tick + max(1, round(duration / TICK_S))
        self.pushes.append(Push(tick, end, int(self.address.bodies[self._links.index(name)]), (x, y, z)))

    def set(self, tick: int, quantity: str, value: float) -> None:
        """Set friction, mass or servo gains from now on; `tick`: now, which shows what servo faults are active.

        `value`: of friction the coefficient, else a factor on the robot's own masses or gains, 0 to 100.

        Raises:
            WorldError: the quantity is unknown, or the value out of range.
        """
        if quantity not in QUANTITIES:
            raise WorldError("quantity", f"got {quantity!r}, known are {', '.join(QUANTITIES)}")
        if not (math.isfinite(value) and 0.0 < value <= MAX_VALUE):
            raise WorldError("value", f"must be in (0, {MAX_VALUE:g}], got {value!r}")
        self.settings[quantity] = float(value)
        self._retune(tick)

    def add_fault(self, tick: int, fault: Fault, seed: int) -> None:
        """Plan a fault; its random numbers depend on its own seed and on `seed`, that of the run."""
        self.faults.add(replace(fault, seed=fault.seed + seed))
        if fault.start_tick <= tick and fault.kind.startswith("servo"):
            self._retune(tick)

    def limit_torque(self, limit: Array | None) -> None:
        """Limit the torques of the servos to `limit`, (nj,) Nm; None = to their own largest torques."""
        before = self._limit
        if limit is before or (limit is not None and before is not None and np.array_equal(limit, before)):
            return
        self._limit = limit
        self._apply_limit()
        self._changed = True

    def _strength(self) -> Array:
        """Return the torque limit of each servo of the model, (nj,) Nm."""
        return self.model.actuator_forcerange[self.address.actuators, 1].copy()

    def _apply_limit(self) -> None:
        torque = self._own if self._limit is None else np.clip(self._limit, NO_TORQUE, self._own)
        self.model.actuator_forcerange[self.address.actuators] = np.stack([-torque, torque], axis=1)

    # --- effects ------------------------------------------------------------------------------------------------

    def before_step(self, tick: int, data: mujoco.MjData, command: ServoCommand | None) -> ServoCommand | None:
        """Apply the pushes and faults of a tick; return the command that reaches the servos, None = none does."""
        if self.pushes:
            self._push(tick, data)
        if not self.faults:
            return command
        if self.faults.changes_servos(tick):
            self._retune(tick)
        if not self.faults.packets:
            return command
        arrived = self.faults.packet(tick, "command", None if command is None else pack(command))
        return None if arrived is None else unpack(ServoCommand, arrived)

    def after_step(self, tick: int, samples: Samples, limit: Array) -> Samples:
        """Return the samples after all faults of sensors and lines.

        Args:
            tick: now.
            samples: samples of intact sensors.
            limit: range of the inertial unit, (6,): accelerometer m/s^2, gyro rad/s; not changed.
        """
        bank = self.faults
        imu, joints, contacts = samples
        if imu is not None:
            limit = limit.copy()
            y = bank.imu(tick, np.concatenate((imu.acc, imu.gyro)), limit)
            y = None if y is None else bank.fail(tick, "imu", y)
            imu = None if y is None else ImuSample(imu.stamp_ns, imu.seq, y[:3], y[3:], at_limit(y, limit))
        if joints is not None:
            table = bank.joints(tick, joints.position, joints.current, joints.torque)
            flat = None if table is None else bank.fail(tick, "joints", np.concatenate(table))
            joints = None if flat is None else JointSample(joints.stamp_ns, joints.seq, *flat.reshape(3, -1))
        if contacts is not None:
            flat = np.array([flag for foot in contacts.touch for flag in foot])
            touch = bank.contacts(tick, flat, self.foot_of_sphere)
            contacts = None if touch is None else self._failed(tick, contacts, touch)
        if not bank.packets:
            return Samples(imu, joints, contacts)
        arrived: list[Any] = []
        for name, kind, sample in (
            ("imu", ImuSample, imu),
            ("joints", JointSample, joints),
            ("contacts", ContactSample, contacts),
        ):
            content = bank.packet(tick, name, None if sample is None else pack(sample))
            arrived.append(None if content is None else unpack(kind, content))
        return Samples(*arrived)

    def _failed(self, tick: int, sample: ContactSample, touch: NDArray[np.bool_]) -> ContactSample | None:
        """Return the foot sensors' sample after whole-sensor faults, None if lost; `touch` (P,): switches before."""
        force = np.zeros(0) if sample.normal_force is None else sample.normal_force
        x = self.faults.fail(tick, "contacts", np.concatenate((np.where(touch, 1.0, -1.0), force)))
        if x is None:
            return None
        flags = by_foot((x[: touch.size] > 0.0).tolist(), self._points)
        return sample._replace(
            touch=flags, normal_force=None if sample.normal_force is None else np.maximum(x[touch.size :], 0.0)
        )

    def _push(self, tick: int, data: mujoco.MjData) -> None:
        data.xfrc_applied[:] = 0.0
        for push in self.pushes:
            if push.start <= tick < push.end:
                data.xfrc_applied[push.body, :3] += push.force
        self.pushes = [push for push in self.pushes if push.end >= tick]  # one tick longer, to take the force away

    def _retune(self, tick: int) -> None:
        base, physics = self.base, self.physics
        mass, servo = self.settings.get("mass", 1.0), self.settings.get("servo", 1.0)
        strength = self.faults.servo_strength(tick)
        now = replace(
            base,
            trunk_mass_scale=base.trunk_mass_scale * mass,
            leg_mass_scale=base.leg_mass_scale * mass,
            kp_scale=base.kp_scale * servo * strength,
            kv_scale=base.kv_scale * servo * strength,
            torque_scale=base.torque_scale * strength,
        )
        if "friction" in self.settings:
            physics, now = replace(physics, friction=self.settings["friction"]), replace(now, friction_scale=1.0)
        retune(self.model, self.address, self.robot, now, physics)
        self._own = self._strength()
        self._apply_limit()
        self._changed = True

    # --- checkpoint ---------------------------------------------------------------------------------------------

    def state(self) -> dict[str, Any]:
        """Return all planned pushes and faults and all settings, as plain JSON values."""
        pushes = [[push.start, push.end, push.body, list(push.force)] for push in self.pushes]
        limit = None if self._limit is None else self._limit.tolist()
        return {
            "pushes": pushes, "settings": dict(self.settings), "torque_limit": limit, "faults": self.faults.state(),
        }  # fmt: skip

    def restore(self, tick: int, state: dict[str, Any]) -> None:
        """Set planned pushes, faults and settings to a `state` that was returned earlier; `tick`: now."""
        self.pushes = [Push(start, end, body, (f[0], f[1], f[2])) for start, end, body, f in state["pushes"]]
        self.settings = dict(state["settings"])
        self._limit = None if state["torque_limit"] is None else np.array(state["torque_limit"])
        self.faults.restore(state["faults"])
        self._retune(tick)


def at_limit(y: Array, limit: Array) -> bool:
    """Return True if an axis of inertial sample y (6,), m/s^2 and rad/s, is at the end of its range, `limit` (6,)."""
    return bool((np.abs(y) >= limit).any())


def by_foot(flags: list[bool], points: tuple[int, ...]) -> tuple[tuple[bool, ...], ...]:
    """Return the flags of all contact spheres grouped by foot; `points`: number of spheres of each foot."""
    rest = iter(flags)
    return tuple(tuple(next(rest) for _ in range(n)) for n in points)
