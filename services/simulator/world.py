"""The simulated world: robot, ground, sensors, faults, truth. No bus, no clock: time passes by `step_tick` only.

A control tick is `TICK_STEPS` physics steps. After `step_tick` number k the state belongs to t = 10 ms x k:
`samples` are the samples released in tick k, `truth()` is the exact state. A sample's stamp is the time it was taken
at; a 33 ms sample is released in the first tick at or after its stamp.

Inertial samples are the mean over the ten steps of the tick. MuJoCo's sensors belong to the state BEFORE integration,
so the ten accelerations are those that lead from t - 10 ms to t: their mean is the change of velocity over the tick.
"""

import json
import math
from dataclasses import dataclass, field, replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from services.simulator import sensors, truth
from services.simulator.faults import Fault, FaultBank
from services.simulator.model import Perturbation, Physics, build_spec, find_addresses, retune
from services.simulator.samples import (
    Checkpoint,
    ContactSample,
    ImuSample,
    JointSample,
    Samples,
    Truth,
    pack,
    unpack,
)
from services.simulator.terrain import Terrain
from surefoot.robot import ImuProfile, Robot
from surefoot.rotations import multiply, quat_from_rotvec, quat_from_rpy

Array = NDArray[np.float64]

TICK_STEPS = 10
STEP_NS = 1_000_000
TICK_NS = TICK_STEPS * STEP_NS
SETTLE_STEPS = 500  # physics steps between two looks at whether the robot rests,
SETTLE_TRIES = 6
SETTLED = 1e-4  # m/s and rad/s, and what rest means
STANCE_GAP = 0.001  # m, the lowest foot starts this high above the ground
NO_LIMIT = 1e9
STATE = mujoco.mjtState.mjSTATE_INTEGRATION


class WorldError(ValueError):
    """A request the world cannot fulfil: `field` names what is wrong."""

    def __init__(self, field_name: str, message: str) -> None:
        super().__init__(f"{field_name}: {message}")
        self.field = field_name


@dataclass(frozen=True, eq=False)
class WorldConfig:
    """What is fixed when a world is built."""

    physics: Physics = field(default_factory=Physics)
    perturbation: Perturbation = field(default_factory=Perturbation)
    """How the simulated robot differs from its description."""
    imu_profile: ImuProfile | str | None = None
    """None = the robot's own; "ideal" = exact."""
    kinematics_period_ms: int = 33
    """Of joints and contacts, ms."""
    torque_per_ampere: float | None = None
    """True constant of the servo motors, Nm/A; None = as described."""


class World:
    """One robot on one ground.

    Args:
        robot: the description; read only.
        terrain: the ground.
        seed: of all sensors and faults.
        config: see `WorldConfig`.
    """

    tick: int
    """Control ticks since the reset."""
    samples: Samples
    """What the hardware releases in this tick."""
    command: Array
    """Joint positions the servos follow, (nj,), rad."""

    def __init__(self, robot: Robot, terrain: Terrain, seed: int = 0, config: WorldConfig | None = None) -> None:
        self.robot, self.terrain, self.seed = robot, terrain, seed
        self.config = config or WorldConfig()
        spec = build_spec(robot, terrain, self.config.perturbation, self.config.physics)
        spec.geom("terrain").quat = _tilt(terrain)
        for name, kind in (("acc", mujoco.mjtSensor.mjSENS_ACCELEROMETER), ("gyro", mujoco.mjtSensor.mjSENS_GYRO)):
            # The history holds the samples of one tick, so that ten steps run in one call.
            site = mujoco.mjtObj.mjOBJ_SITE
            spec.add_sensor(name=name, type=kind, objtype=site, objname="imu", nsample=TICK_STEPS)
        self.model = spec.compile()
        self.address = find_addresses(self.model, robot)
        self.data = mujoco.MjData(self.model)
        self.tracker = truth.TruthTracker(robot, self.model, self.address)
        history = self.data.history
        # Per sensor: a user value, the cursor, TICK_STEPS times, TICK_STEPS x 3 values.
        starts = [int(self.model.sensor_historyadr[i]) + 2 + TICK_STEPS for i in range(2)]
        self._acc, self._gyro = (history[s : s + 3 * TICK_STEPS].reshape(TICK_STEPS, 3) for s in starts)
        self._points = tuple(len(leg.foot.points) for leg in robot.legs)
        self._period = self.config.kinematics_period_ms
        self._changed = False
        self.reset()

    # --- time ---------------------------------------------------------------------------------------------------

    def reset(
        self, seed: int | None = None, pose: tuple[float, float, float] = (0.0, 0.0, 0.0), stance: Array | None = None
    ) -> None:
        """Begin anew at tick 0 in a settled stance; equal arguments give equal bits.

        Args:
            seed: of sensors and faults; None = the last one.
            pose: x, y in m and yaw in rad of the trunk before it settles.
            stance: joint angles that are held, (nj,), rad; None = neutral.

        Raises:
            WorldError: a stance outside the joint limits, or the robot does not come to rest.
        """
        robot = self.robot
        self.seed = self.seed if seed is None else int(seed)
        stance = np.array(robot.neutral if stance is None else stance, dtype=np.float64)
        if stance.shape != (robot.nj,) or not ((stance >= robot.joint_lower) & (stance <= robot.joint_upper)).all():
            raise WorldError("stance", f"must be {robot.nj} joint angles within their limits, got {stance!r}")
        self.tick, self.steps = 0, 0
        self._pushes: list[tuple[int, int, int, tuple[float, ...]]] = []  # first and end tick, body, force
        self.faults = FaultBank(robot.joint_names, robot.leg_names)
        self._tuning = {"friction": None, "mass": 1.0, "servo": 1.0}
        if self._changed:
            self._retune()
            self._changed = False
        self._make_sensors()
        mujoco.mj_resetData(self.model, self.data)
        self._place(pose, stance)
        self.command = stance
        self.data.ctrl[:] = stance - self.joint_sensor.zero
        for _ in range(SETTLE_TRIES):
            mujoco.mj_step(self.model, self.data, SETTLE_STEPS)
            if float(np.abs(self.data.qvel).max()) < SETTLED:
                break
        else:
            raise WorldError("pose", f"the robot does not come to rest at {pose!r}: speeds {self.data.qvel[:6]!r}")
        self._finish_tick(first=True)
        self._take_kinematics()
        self._release()

    def step_tick(self, command: Array | None = None) -> None:
        """Advance one control tick.

        Args:
            command: joint positions for the servos, (nj,), rad, checked by the caller (`CommandGuard`); None = hold.
        """
        self.tick += 1
        if self.faults:
            command = self._broken_servos(command)
        if command is not None:
            self.command = command
        if self._pushes:
            self._push()
        model, data = self.model, self.data
        data.ctrl[:] = self.command - self.joint_sensor.zero
        end = self.steps + TICK_STEPS
        sample = (self.steps // self._period + 1) * self._period
        while sample <= end:
            mujoco.mj_step(model, data, sample - self.steps)
            self.steps = sample
            self._take_kinematics()
            sample += self._period
        if self.steps < end:
            mujoco.mj_step(model, data, end - self.steps)
            self.steps = end
        self._finish_tick()
        self._release()

    @property
    def stamp_ns(self) -> int:
        """Simulated time since the reset, ns."""
        return self.steps * STEP_NS

    def _finish_tick(self, first: bool = False) -> None:
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        self.tracker.update(self.data, first)

    def _place(self, pose: tuple[float, float, float], stance: Array) -> None:
        """Put the robot parallel to the plane, or level on a height field, just above the ground."""
        d = self.data
        d.qpos[:3] = (pose[0], pose[1], 0.0)
        d.qpos[3:7] = multiply(_tilt(self.terrain), quat_from_rpy(0.0, 0.0, pose[2]))
        d.qpos[self.address.joint_qpos_slice] = stance
        mujoco.mj_kinematics(self.model, d)
        spheres = self.tracker.spheres
        centre, radius = d.geom_xpos[spheres], self.model.geom_size[spheres, 0]
        ground = self.terrain.map.height(centre[:, 0], centre[:, 1])
        if not np.isfinite(ground).all():
            raise WorldError("pose", f"a foot would stand beside the map at {pose!r}")
        gap = (centre[:, 2] - ground) * self.terrain.normal[2] - radius
        d.qpos[2] = (STANCE_GAP - float(gap.min())) / self.terrain.normal[2]

    # --- sensors ------------------------------------------------------------------------------------------------

    def _make_sensors(self) -> None:
        robot, config = self.robot, self.config
        profile = robot.imu.profile if config.imu_profile is None else config.imu_profile
        if isinstance(profile, str):
            if profile != "ideal":
                raise WorldError("imu_profile", f"got {profile!r}: give a profile or 'ideal'")
            profile = None
        self._imu_limit = np.full(6, NO_LIMIT)
        if profile is not None:
            self._imu_limit = np.repeat([profile.accel.limit, profile.gyro.limit], 3)
        self.imu_sensor = sensors.ImuSensor(profile, self.seed, 1e9 / TICK_NS)
        self.joint_sensor = sensors.JointSensor(
            robot.encoder, robot.current, robot.nj, self.seed, config.torque_per_ampere
        )
        self.foot_sensor = sensors.FootSensor(robot.contacts, self._points)
        self._due: tuple[JointSample | None, ContactSample | None] = (None, None)

    def _take_kinematics(self) -> None:
        """Sample joints and feet now, for release at the end of the tick."""
        self.tracker.forces(self.data)
        joints = self.joint_sensor.measure(self.data.qpos[self.address.joint_qpos_slice], self.data.actuator_force)
        touch, force = self.foot_sensor.measure(self.tracker.sphere_force)
        stamp, seq = self.steps * STEP_NS, self.steps // self._period
        self._due = (JointSample(stamp, seq, *joints), ContactSample(stamp, seq, self._by_foot(touch.tolist()), force))

    def _by_foot(self, flags: list[bool]) -> tuple[tuple[bool, ...], ...]:
        rest = iter(flags)
        return tuple(tuple(next(rest) for _ in range(n)) for n in self._points)

    def _release(self) -> None:
        y = self.imu_sensor.measure(sensors.window_mean(self._acc, self._gyro))
        joints, contacts = self._due
        self._due = (None, None)
        if self.faults:
            self.samples = self._broken_sensors(y, joints, contacts)
        else:
            self.samples = Samples(self._imu_sample(y, self._imu_limit), joints, contacts)

    def _imu_sample(self, y: Array, limit: Array) -> ImuSample:
        return ImuSample(self.stamp_ns, self.tick, y[:3], y[3:], bool((np.abs(y) >= limit).any()))

    # --- disturbances -------------------------------------------------------------------------------------------

    def add_fault(self, fault: Fault) -> None:
        """Plan a fault; see `faults.Fault`. Its random stream depends on the world's seed too.

        Raises:
            FaultError: what is wrong with it.
        """
        self.faults.add(replace(fault, seed=fault.seed + self.seed))
        if fault.start_tick <= self.tick and fault.kind.startswith("servo"):
            self._retune()

    def push(
        self, force: tuple[float, float, float], duration: float, body: str = "trunk", start_tick: int = 0
    ) -> None:
        """Pull at the centre of mass of a link.

        Args:
            force: N, world axes.
            duration: s, in whole ticks.
            body: a link's name; "trunk" is base_link.
            start_tick: first tick; the next one if that has passed.

        Raises:
            WorldError: unknown link, or numbers that are not finite.
        """
        names = [link.name for link in self.robot.links]
        name = names[0] if body == "trunk" else body
        if name not in names:
            raise WorldError("body", f"got {body!r}, known are trunk, {', '.join(names)}")
        if not all(math.isfinite(f) for f in force) or not (math.isfinite(duration) and duration > 0.0):
            raise WorldError("force", f"must be finite, for a duration > 0, got {force!r}, {duration!r}")
        start = max(start_tick, self.tick + 1)
        end = start + max(1, round(duration * 1e9 / TICK_NS))
        self._pushes.append((start, end, int(self.address.bodies[names.index(name)]), tuple(map(float, force))))

    def set(self, quantity: str, value: float) -> None:
        """Change the world while it runs.

        Args:
            quantity: `friction` (coefficient of the ground), `mass` or `servo` (factors on all masses, all gains).
            value: finite, > 0.

        Raises:
            WorldError: unknown quantity or impossible value.
        """
        if quantity not in self._tuning:
            raise WorldError("quantity", f"got {quantity!r}, known are {', '.join(self._tuning)}")
        if not (math.isfinite(value) and 0.0 < value <= 100.0):
            raise WorldError("value", f"must be in (0, 100], got {value!r}")
        self._tuning[quantity] = float(value)
        self._retune()

    def _retune(self) -> None:
        """Bring the compiled model to the present settings, always from the description."""
        base, tuning = self.config.perturbation, self._tuning
        strength = self.faults.servo_strength(self.tick)
        now = replace(
            base,
            trunk_mass_scale=base.trunk_mass_scale * tuning["mass"],
            leg_mass_scale=base.leg_mass_scale * tuning["mass"],
            kp_scale=base.kp_scale * tuning["servo"] * strength,
            kv_scale=base.kv_scale * tuning["servo"] * strength,
            torque_scale=base.torque_scale * strength,
        )
        physics = self.config.physics
        if tuning["friction"] is not None:
            physics, now = replace(physics, friction=tuning["friction"]), replace(now, friction_scale=1.0)
        retune(self.model, self.address, self.robot, now, physics)
        self._changed = True

    def _push(self) -> None:
        wrench = self.data.xfrc_applied
        wrench[:] = 0.0
        for start, end, body, force in self._pushes:
            if start <= self.tick < end:
                wrench[body, :3] += force
        self._pushes = [push for push in self._pushes if push[1] >= self.tick]

    def _broken_servos(self, command: Array | None) -> Array | None:
        """Servo faults that begin or end now, and the command after its bad line."""
        if self.faults.changes_servos(self.tick):
            self._retune()
        if not self.faults.packets:
            return command
        sent = None if command is None else {"q": command.tolist()}
        arrived = self.faults.packet(self.tick, "command", sent)
        return None if arrived is None else np.array(arrived["q"])

    def _broken_sensors(self, y: Array, joints: JointSample | None, contacts: ContactSample | None) -> Samples:
        """The samples after all faults of sensors and lines."""
        bank, tick, limit = self.faults, self.tick, self._imu_limit.copy()
        broken = bank.imu(tick, y, limit)
        imu = None if broken is None else self._imu_sample(broken, limit)
        if joints is not None:
            table = bank.joints(tick, joints.position, joints.current, joints.torque)
            joints = None if table is None else JointSample(joints.stamp_ns, joints.seq, *table)
        if contacts is not None:
            flat = np.array([flag for foot in contacts.touch for flag in foot])
            touch = bank.contacts(tick, flat, self.tracker.foot_of_sphere)
            contacts = None if touch is None else contacts._replace(touch=self._by_foot(touch.tolist()))
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

    # --- what is so ---------------------------------------------------------------------------------------------

    def truth(self) -> Truth:
        """The exact state now."""
        d, feet = self.data, self.tracker.feet
        qpos, qvel = d.qpos, d.qvel
        return Truth(
            self.stamp_ns, qpos[:3].copy(), qpos[3:7].copy(), qvel[:3].copy(), qvel[3:6].copy(),
            d.subtree_com[self.address.trunk].copy(), qpos[self.address.joint_qpos_slice].copy(), feet.centre.copy(),
            feet.force.copy(), feet.normal_force.copy(), feet.displacement.copy(), feet.sliding.copy(),
            feet.last_sliding.copy(), feet.last_displacement.copy(), feet.stances.copy(),
            math.acos(min(1.0, max(-1.0, float(d.xmat[self.address.trunk, 8])))), self.tracker.fallen,
        )  # fmt: skip

    def checkpoint(self) -> Checkpoint:
        """Everything that decides the future, between two ticks."""
        state = np.empty(mujoco.mj_stateSize(self.model, STATE))
        mujoco.mj_getState(self.model, self.data, state, STATE)
        meta = {
            "world": self._identity(),
            "seed": self.seed,
            "tick": self.tick,
            "steps": self.steps,
            "command": self.command.tolist(),
            "tuning": self._tuning,
            "pushes": self._pushes,
            "faults": self.faults.state(),
            "truth": self.tracker.state(),
            "imu": self.imu_sensor.state(),
            "joints": self.joint_sensor.state(),
            "feet": self.foot_sensor.state(),
            "samples": [None if s is None else pack(s) for s in self.samples],
        }
        return Checkpoint(state, json.dumps(meta, sort_keys=True))

    def restore(self, saved: Checkpoint) -> None:
        """Go back to a checkpoint of this world; the future is the same to the bit.

        Raises:
            WorldError: the checkpoint is of another robot, ground or configuration.
        """
        meta = json.loads(saved.meta)
        if meta["world"] != self._identity() or saved.physics.shape != (mujoco.mj_stateSize(self.model, STATE),):
            raise WorldError("checkpoint", f"is of {meta['world']!r}, this world is {self._identity()!r}")
        self.seed, self.tick, self.steps = meta["seed"], meta["tick"], meta["steps"]
        self.command = np.array(meta["command"])
        self._tuning = meta["tuning"]
        self._pushes = [(a, b, body, tuple(force)) for a, b, body, force in meta["pushes"]]
        self.faults.restore(meta["faults"])
        self._retune()
        mujoco.mj_setState(self.model, self.data, saved.physics, STATE)
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        self.tracker.restore(meta["truth"])
        self.imu_sensor.restore(meta["imu"])
        self.joint_sensor.restore(meta["joints"])
        self.foot_sensor.restore(meta["feet"])
        kinds = (ImuSample, JointSample, ContactSample)
        pairs = zip(kinds, meta["samples"], strict=True)
        self.samples = Samples(*(None if s is None else unpack(kind, s) for kind, s in pairs))

    def _identity(self) -> list[str]:
        """Robot, ground and profile; a checkpoint fits no other world."""
        profile = self.imu_sensor.profile
        return [self.robot.hash, self.terrain.name, self.terrain.map.sha256, profile.name if profile else "ideal"]


def _tilt(terrain: Terrain) -> Array:
    """Quaternion that turns z onto the plane's normal. (4,)"""
    nx, ny, nz = terrain.normal
    sine = math.hypot(nx, ny)
    if sine == 0.0:
        return np.array([1.0, 0.0, 0.0, 0.0])
    angle = math.atan2(sine, nz)
    return quat_from_rotvec(np.array([-ny, nx, 0.0]) * (angle / sine))


def warm() -> None:
    """Compile the kernels."""
    sensors.warm()
    truth.warm()
