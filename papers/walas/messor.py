"""Walas & Belter (2011), sections 4.4 to 4.7: stance forces, calibration and measured CoM, on a simulated Messor."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.robot.description import Robot
from surefoot.robot.kinematics import com, foot_positions
from surefoot.services.simulator.ground.terrain import make_terrain
from surefoot.services.simulator.world import PhysicsWorld
from surefoot.services.stability.programs.contacts import contact_set
from surefoot.services.stability.regions.model import Region
from surefoot.services.stability.regions.region import region
from surefoot.services.stability.sensing.calibration import Calibration, calibrate, gain_of_47, level_from_up
from surefoot.services.stability.sensing.forces import (
    FootForces,
    com_from_forces,
    forces_from_torques,
    fuse_normal,
    gain_from_weight,
    leg_inverses,
)
from surefoot.services.stability.sensing.pressure import PressureSensor, read_loads
from surefoot.services.walker.interface import MotionCommand, WalkerInputs
from surefoot.services.walker.legged.gait import LeggedWalker
from surefoot.services.walker.legged.params import WalkerParams

from .stand import DATA_SHEET, Reading, Stand

TORQUE_VARIANCE = 4e-4  # Nm^2, of a torque (0.02 Nm)
TILT_SD = 0.02  # rad, of the estimated tilt: bias of this robot's accelerometers


# -- CoM from one reading ---------------------------------------------------------------------------------------------


def feet_of(robot: Robot, reading: Reading) -> Array:
    """Return the contact points of the feet, (L, 3) m, level axes, relative to the mean of the feet.

    The origin is the mean foot as a tilt error would move the trunk's origin by its height times the error.
    """
    feet = foot_positions(robot.model, reading.joints) @ reading.rot.T
    feet -= feet.mean(axis=0)
    feet[:, 2] -= [leg.foot.radius for leg in robot.legs]
    return feet


def kinematic_com(robot: Robot, reading: Reading) -> Array:
    """Return the CoM by kinematics and the measured tilt, (2,) m, level axes, relative to the mean of the feet."""
    middle = foot_positions(robot.model, reading.joints).mean(axis=0)
    return (reading.rot @ (com(robot.model, reading.joints) - middle))[:2]


def forces_of(robot: Robot, reading: Reading, factor: float, sensor: PressureSensor | None = None) -> FootForces:
    """Return the foot forces by joint torques, N, level axes, fused with pressure sensors if given.

    `factor`: on the torque that the current gives by the motor's data sheet.
    """
    torque = factor * DATA_SHEET * reading.current
    found = forces_from_torques(robot, reading.joints, torque, reading.g_up, TORQUE_VARIANCE)
    rot = reading.rot
    found = FootForces(found.force @ rot.T, rot @ found.covariance @ rot.T, found.observed)
    if sensor is None:
        return found
    load, variance = read_loads(reading.load, sensor)
    up = np.tile([0.0, 0.0, 1.0], (robot.nlegs, 1))
    return fuse_normal(found, up, load, variance)


def measured_com(robot: Robot, reading: Reading, factor: float | None, sensor: PressureSensor | None = None) -> Array:
    """Return the CoM by the foot forces, (2,) m, level axes, relative to the mean of the feet.

    `factor`: on the torques by the data sheet, None = from the known weight; `sensor`: pressure sensors to fuse.
    """
    if factor is None:
        pose = reading.pose()
        factor = gain_from_weight(robot, reading.joints, pose.torque, reading.g_up, pose.stance)
        if factor is None:
            raise ValueError("the torques do not determine their gain")
    forces = forces_of(robot, reading, factor, sensor)
    found = com_from_forces(feet_of(robot, reading), forces.force, forces.covariance, tilt_sd=TILT_SD)
    if found is None:
        raise ValueError("the feet carry nothing")
    return found.com


def printed_com(robot: Robot, reading: Reading, factor: float = 1.0) -> Array:
    """Return the CoM by equations (30), (31) of Walas & Belter as printed, (2,) m, level axes, from the mean foot.

    F = J^-T Q without the legs' weight, y = -A2+ A1 F; factor: on the torque that the current gives by the data sheet.
    """
    found = leg_inverses(robot, reading.joints, reading.g_up)
    torque = factor * DATA_SHEET * reading.current
    force = -np.einsum("iqk,ik->iq", found.inverse, torque[robot.model.leg_joints[:, :3]]) @ reading.rot.T
    moment = np.cross(feet_of(robot, reading), force).sum(axis=0)
    return np.array([-moment[1], moment[0]]) / (robot.mass * GRAVITY)


# -- experiments ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Sweep:
    """Sensor readings while the trunk moves 10 cm forward, back, and 10 cm backward, with the CoM of each.

    It repeats Figs 22 and 23 of Walas & Belter.
    """

    readings: tuple[Reading, ...]
    kinematic: Array  # (k, 2) m, CoM by kinematics, from the mean foot
    printed: Array  # (k, 2) m, by (30), (31) with 0.845 Nm/A
    true: Array  # (k, 2) m
    gain_free: Array  # (k, 2) m
    calibration: Calibration

    def ways(self, path: Array) -> tuple[float, float]:
        """Return the distances from the start to the foremost and the rearmost point of a path (k, 2) m along x, m."""
        return float(path[:, 0].max() - path[0, 0]), float(path[0, 0] - path[:, 0].min())

    @property
    def gain_by_trunk(self) -> float:
        """Return the torque gain by 4.7 of Walas & Belter as printed: travel of trunk (20 cm) over printed CoM's."""
        moved = self.ways(np.array([r.trunk - self.readings[0].trunk for r in self.readings]))
        return gain_of_47(sum(moved), self.ways(self.printed))

    @property
    def gain_by_com(self) -> float:
        """Return the torque gain by 4.7 of Walas & Belter, by the travel of the CoM by kinematics, not of the trunk."""
        return gain_of_47(sum(self.ways(self.kinematic)), self.ways(self.printed))


def sweep(robot: Robot, seed: int = 0, reach: float = 0.10, stops: int = 4) -> Sweep:
    """Move the trunk to +reach and -reach m over the feet, as in section 4.7 of Walas & Belter, and return readings.

    `stops`: number of stops on the way to each end; `seed`: of the sensors.
    """
    stand = Stand(robot, seed)
    way = [reach * k / stops for k in range(stops + 1)]
    targets = [*way, *way[-2::-1], *(-x for x in way[1:]), *(-x for x in way[-2::-1])]
    readings: list[Reading] = []
    for x in targets:
        stand.move((x, 0.0, 0.0))
        readings.append(stand.read())
    kinematic, printed, true, free = (
        np.array(row)
        for row in (
            [kinematic_com(robot, r) for r in readings],
            [printed_com(robot, r) for r in readings],
            [r.com for r in readings],
            [measured_com(robot, r, None) for r in readings],
        )
    )
    fit = calibrate(robot, [r.pose() for r in readings], TORQUE_VARIANCE, apart_sd=0.0)
    return Sweep(tuple(readings), kinematic, printed, true, free, fit)


TILTS = ((0.0, 0.0), (0.15, 0.0), (-0.15, 0.0), (0.0, 0.15), (0.0, -0.15), (0.1, 0.1))
"""Roll and pitch of the trunk in the postures in which the CoM is measured, rad."""


@dataclass(frozen=True)
class ComErrors:
    """Error of the measured CoM, m, one row per posture; columns: noise-free with gain errors, noisy, noisy fused."""

    gains: tuple[float, ...]
    exact: Array  # (gains, postures) m, no sensor noise, torques off by the gain
    noisy: Array  # (postures,) m, sensors as described, currents alone
    fused: Array  # (postures,) m, with the pressure sensors


def com_errors(robot: Robot, seed: int = 0, gains: tuple[float, ...] = (0.7, 1.0, 1.3)) -> ComErrors:
    """Return the errors of the CoM of the standing robot, level and tilted, with unknown gain and with known weight.

    `gains`: factors of the torques; `seed`: of the sensors.
    """
    sensor = PressureSensor()
    exact: list[list[float]] = []
    for gain in gains:
        bare = _without_noise(robot)
        exact.append([_error(bare, r, None) for r in _postures(Stand(bare, seed, ideal=True, gain=gain))])
    noisy: list[tuple[float, float]] = []
    for reading in _postures(Stand(robot, seed)):
        noisy.append((_error(robot, reading, None), _error(robot, reading, sensor)))
    both = np.array(noisy)
    return ComErrors(gains, np.array(exact), both[:, 0], both[:, 1])


def _without_noise(robot: Robot) -> Robot:
    quiet = replace(robot.current, noise_ampere=0.0)
    return replace(robot, current=quiet, encoder=replace(robot.encoder, resolution=0.0, zero_sigma=0.0))


def _postures(stand: Stand) -> Iterator[Reading]:
    for tilt in TILTS:
        stand.move(tilt=tilt)
        yield stand.read()


def _error(robot: Robot, reading: Reading, sensor: PressureSensor | None) -> float:
    return float(np.linalg.norm(measured_com(robot, reading, None, sensor) - reading.com))


@dataclass(frozen=True)
class StandingStudy:
    """Forces, CoM and support region of Messor in its neutral stance (Fig. 24 of Walas & Belter)."""

    reading: Reading
    feet: Array  # (L, 3) m
    force: Array  # (L, 3) N, measured and fused
    measured: Array  # (2,) m
    region: Region


def standing(robot: Robot, factor: float, seed: int = 0) -> StandingStudy:
    """Return forces and CoM of the robot in its neutral stance.

    `factor`: calibrated factor on the torques by the data sheet; `seed`: of the sensors.
    """
    reading = Stand(robot, seed).read()
    sensor = PressureSensor()
    forces = forces_of(robot, reading, factor, sensor)
    feet = feet_of(robot, reading)
    contacts = contact_set(feet, [[0.0, 0.0, 1.0]] * robot.nlegs, 0.6)
    return StandingStudy(reading, feet, forces.force, measured_com(robot, reading, factor, sensor), region(contacts))


@dataclass(frozen=True)
class GaitStudy:
    """Force at the tip of one leg during the tripod gait (Fig. 20 of Walas & Belter)."""

    time: Array  # (k,) s
    measured: Array  # (k,) N, from currents, upward
    printed: Array  # (k,) N, by (30) as printed
    true: Array  # (k,) N
    carried: Array  # (k,) N, all feet, measured


def gait(robot: Robot, factor: float, seed: int = 0, distance: float = 0.25, leg: int = 1) -> GaitStudy:
    """Return the force at the tip of one leg during a walk with the tripod gait, whose walker gets the true pose.

    `factor`: on the torques by the data sheet; `distance`: m; `leg`: its index; `seed`: of the sensors.
    """
    world = PhysicsWorld(robot, make_terrain("flat"), seed)
    walker = LeggedWalker(robot, WalkerParams.for_robot(robot))
    rows: list[tuple[float, ...]] = []
    started = False
    while world.tick < 6000:
        s, truth = world.samples, world.truth()
        rot = matrix_from_quat(truth.quat_wxyz)
        touch = None if s.contacts is None else np.array([any(foot) for foot in s.contacts.touch])
        joints = None if s.joints is None else s.joints.position
        out = walker.step(
            WalkerInputs(
                stamp=0.01 * world.tick, roll=math.atan2(rot[2, 1], rot[2, 2]), pitch=-math.asin(rot[2, 0]),
                x=float(truth.position[0]), y=float(truth.position[1]), yaw=math.atan2(rot[1, 0], rot[0, 0]),
                estimate_stamp=0.01 * world.tick, initialised=True, joints=joints, contacts=touch,
            )
        )  # fmt: skip
        if s.joints is not None and started:
            g_up = GRAVITY * rot[2]
            nominal = DATA_SHEET * s.joints.current
            found = forces_from_torques(robot, s.joints.position, factor * nominal, g_up, TORQUE_VARIANCE)
            level = level_from_up(rot[2])
            upward = (found.force @ level.T)[:, 2]
            inverse = leg_inverses(robot, s.joints.position, g_up).inverse[leg]
            bare = -level[2] @ inverse @ nominal[robot.model.leg_joints[leg, :3]]
            rows.append((0.01 * world.tick, upward[leg], bare, truth.foot_force[leg, 2], upward.sum()))
        if not started and out.state == "standing":
            started = walker.command(MotionCommand("walk", distance=distance)).accepted
        elif started and out.state in ("standing", "refused"):
            break
        world.step_tick(out.command)
    m = np.array(rows)
    return GaitStudy(m[:, 0], m[:, 1], m[:, 2], m[:, 3], m[:, 4])
