"""The simulated world: robot, ground, sensors, faults, truth. No bus, no clock: time passes by `step_tick` only.

A control tick is `TICK_STEPS` physics steps. After `step_tick` number k the state belongs to t = 10 ms x k:
`samples` are the samples released in tick k, `truth()` is the exact state. A sample's stamp is the time it was taken
at; a 33 ms sample is released in the first tick at or after its stamp.

Inertial samples are the mean over the ten steps of the tick. MuJoCo's sensors belong to the state BEFORE integration,
so the ten accelerations are those that lead from t - 10 ms to t: their mean is the change of velocity over the tick.
"""

# mujoco has no type stubs for its compiled modules:
# pyright: reportAttributeAccessIssue=false
import json
import math
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from surefoot.arrays import Array
from surefoot.robot.description import ImuProfile, Robot, RobotError
from surefoot.schemas.sim import Obstacle
from surefoot.schemas.topics import HW_IMU, HW_JOINTS, TICK_NS

from .ground import terrain as grounds
from .ground.terrain import Terrain
from .physics import truth
from .physics.disturb import Disturbances, WorldError
from .physics.faults import STAMPED, Fault
from .physics.joints import read_joints
from .physics.model import TRUNK_DOF, Perturbation, Physics, build_spec, find_addresses
from .physics.obstacles import Obstacles
from .physics.placing import displace, displacement, place
from .physics.samples import (
    Checkpoint,
    ContactSample,
    ExactState,
    ImuSample,
    JointSample,
    Samples,
    ServoCommand,
    pack,
    unpack,
)
from .physics.servo_line import ServoLine
from .physics.unequal import UnequalLegs
from .sensors import images
from .sensors import noise as sensors
from .sensors.sight import Floor, Senses, sight_of
from .sensors.suite import SensorSuite

STEP_NS = 1_000_000
TICK_STEPS = TICK_NS // STEP_NS
KINEMATICS_STEPS = HW_JOINTS.period_ns // STEP_NS  # joints and foot switches are sampled together
SETTLE_STEPS, SETTLE_TRIES = 500, 6  # physics steps between two checks for rest, and checks
SETTLED = 1e-4  # m/s and rad/s, speeds of a robot at rest
MAY_STIR = 0.05  # m/s and rad/s, speeds allowed after the last check: feet on edges creep
STATE = mujoco.mjtState.mjSTATE_INTEGRATION


@dataclass(frozen=True, eq=False)
class WorldConfig:
    """Settings of a simulated world that are fixed when it is built: physics, sensors, floor, start, obstacles."""

    physics: Physics = field(default_factory=Physics)
    perturbation: Perturbation = field(default_factory=Perturbation)
    """Differences of the simulated robot and floor from the robot description."""
    imu_profile: ImuProfile | str | None = None
    """Profile of the inertial unit, or its name; None = the robot's own; "ideal" = a sensor without errors."""
    torque_per_ampere: float | None = None
    """True torque constant of the servo motors, Nm/A; None = that of the robot description."""
    floor: Floor = field(default_factory=Floor)
    """Landmarks, goal marker, texture and light of the floor."""
    camera: str | None = None
    """Name of a camera profile; None = the robot's own camera, if it has one."""
    depth_camera: str | None = None
    """Name of a depth camera's profile; None = no depth camera."""
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Pose of the trunk before it settles: x, y in m and yaw in rad, frame `map`."""
    drift: float = 0.0
    """Turn of a biped's straight walk because of unequal legs, rad per m walked, left positive; 0 = straight."""
    obstacles: tuple[Obstacle, ...] = ()
    """Boxes on the floor that are missing in every map."""
    must_rest: bool = True
    """True: a robot that does not come to rest at the start is an error; False: it is accepted, for slippery ground."""


class PhysicsWorld:
    """Simulated world of one robot on one ground, with its sensors, faults and exact state.

    Args:
        robot: the description; read only.
        terrain: the ground.
        seed: seed of all sensors and faults.
        config: other settings: physics, sensors, landmarks, start; None = the defaults.
    """

    tick: int
    """Number of control ticks since the reset."""
    samples: Samples
    """Samples that the hardware releases in this tick."""
    command: Array
    """Joint positions the servos follow, (nj,), rad."""
    torque_limit: Array | None
    """Torque limits of the servos under the present command, (nj,), Nm; None = the servos' own limits."""

    def __init__(self, robot: Robot, terrain: Terrain, seed: int = 0, config: WorldConfig | None = None) -> None:
        self.robot, self.terrain, self.seed = robot, terrain, seed
        self.config = config or WorldConfig()
        spec = build_spec(robot, terrain, self.config.perturbation, self.config.physics)
        truth.add_sensors(spec, robot, TICK_STEPS)
        self.obstacles = Obstacles(spec, self.config.obstacles, self.config.physics)
        self.model = spec.compile()
        self.obstacles.find(self.model)
        self.address = find_addresses(self.model, robot)
        self.data = mujoco.MjData(self.model)
        self.tracker = truth.TruthTracker(robot, self.model, self.data, self.address)
        # Per sensor: a user value, the cursor, TICK_STEPS times, TICK_STEPS x 3 values.
        starts = [int(self.model.sensor_historyadr[i]) + 2 + TICK_STEPS for i in range(2)]
        self._acc, self._gyro = (self.data.history[s : s + 3 * TICK_STEPS].reshape(TICK_STEPS, 3) for s in starts)
        self._line = ServoLine(robot, STEP_NS)
        self._legs = UnequalLegs(robot, self.config.drift)
        self.disturb = Disturbances(
            robot, self.model, self.address, self.config.perturbation, self.config.physics, self.tracker.foot_of_sphere
        )  # fmt: skip
        self.reset()

    # --- time ---------------------------------------------------------------------------------------------------

    def reset(
        self, seed: int | None = None, pose: tuple[float, float, float] | None = None, stance: Array | None = None
    ) -> None:
        """Reset the world to tick 0, the robot at rest in a stance; equal arguments give equal bits.

        Args:
            seed: seed of sensors and faults; None = the last one.
            pose: x, y in m and yaw in rad of the trunk before it settles; None = `WorldConfig.start`.
            stance: joint angles that are held, (nj,), rad; None = neutral.

        Raises:
            WorldError: a stance outside the joint limits, or the robot does not come to rest.
        """
        robot = self.robot
        self.seed = self.seed if seed is None else int(seed)
        stance = np.array(robot.neutral if stance is None else stance, dtype=np.float64)
        if stance.shape != (robot.nj,) or not ((stance >= robot.joint_lower) & (stance <= robot.joint_upper)).all():
            raise WorldError("stance", f"must be {robot.nj} angles within their limits, got {stance.tolist()}")
        self.tick, self.steps, self._first_tick = 0, 0, 0
        self.disturb.clear()
        c = self.config
        self.sensors = SensorSuite(
            robot, c.imu_profile, HW_IMU.rate_hz, self.seed, c.torque_per_ampere, c.perturbation.zero_sigma
        )
        self.sight = _sight(robot, self.seed, c, self.terrain)
        self.disturb.faults.equip((*STAMPED, *(() if self.sight is None else self.sight.names)))
        pose = c.start if pose is None else pose
        mujoco.mj_resetData(self.model, self.data)
        place(self.model, self.data, self.address, self.tracker.spheres, self.terrain, pose, stance)
        self.command, self.torque_limit = stance, None
        self._line.clear()
        self.data.ctrl[:] = self._line.heard(stance - self.sensors.zero)
        for _ in range(SETTLE_TRIES):
            mujoco.mj_step(self.model, self.data, SETTLE_STEPS)
            if float(np.abs(self.data.qvel).max()) < SETTLED:
                break
        if self.config.must_rest and float(np.abs(self.data.qvel).max()) > MAY_STIR:
            raise WorldError("pose", f"the robot does not come to rest at {pose!r}: speeds {self.data.qvel[:6]!r}")
        self._settled_s = self.data.time
        self._finish_tick(first=True)
        self._take_kinematics()
        self._release()

    def step_tick(self, command: Array | None = None, torque_limit: Array | None = None) -> None:
        """Advance one control tick of 10 ms.

        Args:
            command: joint positions for the servos, (nj,), rad, checked by the caller; None = hold the last ones.
            torque_limit: the most the servos may give for it, (nj,), Nm, >= 0; None = what they can.
        """
        self.obstacles.move(self.data, self.address, self.tick)
        self.tick += 1
        sent = None if command is None else ServoCommand(command, torque_limit)
        if (arrived := self.disturb.before_step(self.tick, self.data, sent)) is not None:
            self.command, self.torque_limit = arrived
        self._line.send(self.steps, ServoCommand(self._legs(self.command) - self.sensors.zero, self.torque_limit))
        end = self.steps + TICK_STEPS
        sample = (self.steps // KINEMATICS_STEPS + 1) * KINEMATICS_STEPS
        while sample <= end:
            self._run_to(sample)
            self._take_kinematics()
            sample += KINEMATICS_STEPS
        self._run_to(end)
        self._finish_tick()
        self._release()

    def _run_to(self, step: int) -> None:
        """Advance the physics up to a step; set-points that arrive before take effect at their step."""
        while (arrival := self._line.arrival(step)) is not None:
            at, (position, limit) = arrival
            if at > self.steps:
                mujoco.mj_step(self.model, self.data, at - self.steps)
                self.steps = at
            self.data.ctrl[:] = position
            self.disturb.limit_torque(limit)
        if self.steps < step:
            mujoco.mj_step(self.model, self.data, step - self.steps)
            self.steps = step

    @property
    def stamp_ns(self) -> int:
        """Simulated time since the reset or the restart from a checkpoint, ns."""
        return self.steps * STEP_NS - self._first_tick * TICK_NS

    @property
    def diverged(self) -> str:
        """Names of the quantities that MuJoCo found not finite or huge since the reset; empty: there are none."""
        if self.data.time - self._settled_s > (self.steps - 0.5) * STEP_NS * 1e-9:
            return ""
        warning, kind = self.data.warning, mujoco.mjtWarning
        found = {"positions": kind.mjWARN_BADQPOS, "speeds": kind.mjWARN_BADQVEL, "accelerations": kind.mjWARN_BADQACC}
        return ", ".join(name for name, which in found.items() if warning[which].number > 0)

    def _finish_tick(self, first: bool = False) -> None:
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        self.tracker.update(first)

    # --- sensors ------------------------------------------------------------------------------------------------

    def _take_kinematics(self) -> None:
        """Sample joints and feet now, for release at the end of the tick."""
        self.tracker.forces()
        seq = self.steps // KINEMATICS_STEPS - self._first_tick * TICK_STEPS // KINEMATICS_STEPS
        q = read_joints(self.data.qpos, self.address)
        self.sensors.take_kinematics(self.stamp_ns, seq, q, self.data.actuator_force, self.tracker.sphere_force)

    def _release(self) -> None:
        self.samples = self.sensors.release(self.stamp_ns, self.tick - self._first_tick, self._acc, self._gyro)
        if self.disturb.faults:
            self.samples = self.disturb.after_step(self.tick, self.samples, self.sensors.limit)
        if self.sight is not None:
            self.sight.look(self.tick - self._first_tick, self.truth, self.model, self.data, self.address)
            if self.disturb.faults:
                self.sight.spoil(self.disturb.faults, self.tick)

    # --- disturbances -------------------------------------------------------------------------------------------

    def push(
        self, force: tuple[float, float, float], duration: float, body: str = "trunk", start_tick: int = 0
    ) -> None:
        """Plan a push: a force at the centre of mass of a link.

        Args:
            force: force vector, (3,) N, world axes.
            duration: duration of the push, s, rounded to whole ticks.
            body: a link's name; "trunk" is base_link.
            start_tick: first tick; the next one if that has passed.

        Raises:
            WorldError: unknown link, or numbers that are not finite.
        """
        self.disturb.push(max(start_tick, self.tick + 1), force, duration, body)

    def displace(self, forward: float, left: float, turn: float, *, only_ask: bool = False) -> None:
        """Move the robot in its posture: m `forward` and `left`, rad `turn`, heading axes; `only_ask`: only check it.

        Raises:
            WorldError: a foot is in the air, the place is in or behind a wall or off the ground, or its ground is less
                even.
        """
        if not (self.tracker.feet.normal_force >= truth.GATE_N).all():
            raise WorldError("at_tick", "only a robot with all feet on the ground is displaced; one is in the air")
        spheres = self.tracker.spheres
        way = displacement(self.model, self.data, self.address, spheres, self.terrain, forward, left, turn)
        if only_ask:
            return
        displace(self.data, way)
        self.tracker.displaced(way)
        if self.sight is not None:
            self.sight.moved()

    def set(self, quantity: str, value: float) -> None:
        """Change the world while it runs.

        Args:
            quantity: `friction` (coefficient of the ground), `mass` or `servo` (factors on all masses, all gains).
            value: finite, > 0.

        Raises:
            WorldError: unknown quantity or impossible value.
        """
        self.disturb.set(self.tick, quantity, value)

    def add_fault(self, fault: Fault) -> None:
        """Plan a fault, which begins at its `start_tick` and lasts for its `duration`.

        Raises:
            FaultError: unknown kind or target, a kind that the robot has no sensor for, or a value out of range.
        """
        self.disturb.add_fault(self.tick, fault, self.seed)

    # --- state ---------------------------------------------------------------------------------------------------

    def truth(self) -> ExactState:
        """Return the exact state of the robot at the end of the last tick: pose, velocities, joints, feet, falls."""
        feet = self.tracker.feet_now()
        qpos, qvel = self.data.qpos.copy(), self.data.qvel[TRUNK_DOF].copy()
        up = float(self.data.xmat[self.address.trunk, 8])
        return ExactState(
            self.stamp_ns, qpos[:3], qpos[3:7], qvel[:3], qvel[3:], self.data.subtree_com[self.address.trunk].copy(),
            read_joints(qpos, self.address), feet.centre, feet.force, feet.normal_force, feet.displacement,
            feet.sliding, feet.last_sliding, feet.last_displacement, feet.stances, math.acos(min(1.0, max(-1.0, up))),
            self.tracker.fallen, *self._twist(), self.obstacles.touched(self.data),
        )  # fmt: skip

    def _twist(self) -> tuple[Array, Array]:
        soles = self.tracker.soles
        return (np.zeros(0), np.zeros(0)) if soles is None else (soles.twist.copy(), soles.last.copy())

    def checkpoint(self) -> Checkpoint:
        """Return a checkpoint of the world between two ticks, from which it continues equally to the bit."""
        state = np.empty(mujoco.mj_stateSize(self.model, STATE))
        mujoco.mj_getState(self.model, self.data, state, STATE)
        meta = {
            "world": self._identity(),
            "seed": self.seed,
            "tick": self.tick,
            "first_tick": self._first_tick,
            "steps": self.steps,
            "command": pack(ServoCommand(self.command, self.torque_limit)),
            "line": self._line.state(self.steps),
            "disturb": self.disturb.state(),
            "truth": self.tracker.state(),
            "sensors": self.sensors.state(),
            "sight": None if self.sight is None else self.sight.state(),
            "samples": [None if s is None else pack(s) for s in self.samples],
        }
        return Checkpoint(state, json.dumps(meta, sort_keys=True))

    def restore(self, saved: Checkpoint, *, restart: bool = False) -> None:
        """Restore a checkpoint of this world, from which it continues equally to the bit.

        Args:
            saved: checkpoint of this world.
            restart: count stamps and sequence numbers from here, as a new epoch does; `tick` goes on, so that pushes
                and faults keep their time. A sample that was released at the checkpoint keeps its age.

        Raises:
            WorldError: the checkpoint is of another robot, ground or configuration.
        """
        meta = json.loads(saved.meta)
        if meta["world"] != self._identity() or saved.physics.shape != (mujoco.mj_stateSize(self.model, STATE),):
            raise WorldError("checkpoint", f"is of {meta['world']!r}, this world is {self._identity()!r}")
        self.seed, self.tick, self.steps = meta["seed"], meta["tick"], meta["steps"]
        self.command, self.torque_limit = unpack(ServoCommand, meta["command"])
        self._line.restore(self.steps, meta["line"])
        self.disturb.restore(self.tick, meta["disturb"])
        mujoco.mj_setState(self.model, self.data, saved.physics, STATE)
        for warning in self.data.warning:  # what went wrong later has not happened
            warning.number = 0
        self._settled_s = self.data.time - self.steps * STEP_NS * 1e-9
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        self.tracker.restore(meta["truth"])
        self.sensors.restore(meta["sensors"])
        if self.sight is not None:
            self.sight.restore(meta["sight"])
        pairs = zip((ImuSample, JointSample, ContactSample), meta["samples"], strict=True)
        self.samples = Samples(*(None if s is None else unpack(kind, s) for kind, s in pairs))
        self._first_tick = meta["first_tick"]
        if restart:
            self._restart()

    def _restart(self) -> None:
        gone = self.stamp_ns
        fresh: list[Any] = [s and s._replace(stamp_ns=s.stamp_ns - gone, seq=0) for s in self.samples]
        self.samples = Samples(*fresh)
        self._first_tick = self.tick

    def _identity(self) -> list[str]:
        """Return what identifies robot, ground, sensor profile and obstacles; a checkpoint fits no other world."""
        named = [self.robot.hash, self.terrain.name, self.terrain.map.sha256, self.sensors.profile_name]
        return [*named, *(box.model_dump_json() for box in self.config.obstacles)]


def _sight(robot: Robot, seed: int, config: WorldConfig, terrain: Terrain) -> Senses | None:
    try:
        return sight_of(robot, seed, config.floor, terrain, config.camera, config.depth_camera)
    except RobotError as error:
        raise WorldError("depth_camera" if error.field == "depth_camera" else "camera", error.message) from None


mujoco.set_mju_user_warning(lambda text: None)  # it writes into the working folder; `diverged` reports instead


def rehearse() -> None:
    """Call every kernel of the simulator once with made-up arguments, so that none is loaded in a tick."""
    for part in (grounds, sensors, images, truth):
        part.rehearse()
