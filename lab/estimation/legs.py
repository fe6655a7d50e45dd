"""Foot positions of a log as functions of the leg parameters that calibration estimates."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from surefoot.arrays import Array, Ints
from surefoot.geometry.rotations import matrix_from_rotvec
from surefoot.kernels.jit import kernel
from surefoot.robot.description import KinematicModel, Robot
from surefoot.robot.kinematics import foot_jacobians, forward
from surefoot.services.estimator.feet.mount import FootMount, foot_mount

from .log import Log

SHORTEST_LINK_M = 0.005
"""Length of a link, m, below which calibration does not treat it as an unknown."""
ORIENTED = 1e-6
"""Smallest change of the entries of foot rotation matrices from which a log counts as having foot orientations."""
RANGES = {
    "length": 0.10, "zero": np.radians(3.0), "offset": 0.05, "mounting": np.radians(10.0), "lever": 0.05,
    "radius": 0.02, "pivot": 0.06, "gyro bias": 0.06, "acc bias": 0.3,
}  # fmt: skip
"""Half range (two standard deviations) of the prior by kind of unknown: `length` as a share, `zero` and `mounting`
rad, `offset` s, `lever`, `radius` and `pivot` m, gyro bias rad/s, acc bias m/s^2."""
SHOWN = {
    "length": (100.0, "%"), "zero": (180.0 / np.pi, "deg"), "offset": (1e3, "ms"), "mounting": (180.0 / np.pi, "deg"),
    "lever": (1e3, "mm"), "radius": (1e3, "mm"),
}  # fmt: skip
"""Factor from SI and unit in reports by kind of unknown; kinds that are absent (biases) are estimated, not reported."""

RESIZING = ("length", "zero")
"""Kinds of unknown parameters that change the size of the noise of foot positions: leg lengths and joint zeros."""


@dataclass(frozen=True)
class Unknown:
    """Unknown parameter of a calibration; its value is a correction, added to what log or robot file states."""

    name: str
    kind: str  # see RANGES
    index: int = 0  # foot, link, joint or axis
    others: tuple[int, ...] = ()  # indices beside `index` to which the same value is added

    @property
    def range(self) -> float:
        """Half width of the range that the prior allows for a parameter, in its unit."""
        return float(RANGES[self.kind])


class LegModel:
    """Feet of a log as functions of the values theta of its unknown parameters, such as lengths and joint zeros."""

    def __init__(self, log: Log, unknowns: Sequence[Unknown]) -> None:
        self.log, self._unknowns = log, unknowns
        self._mount = None if log.joints is None or log.robot is None else foot_mount(log.robot)

    def values(self, theta: Array, kind: str, count: int) -> Array:
        """Return the values of one kind of parameter by their index, (count,), in their unit; 0 where none is unknown.

        `theta`: value of each unknown, (P,), in its unit; `kind`: length, zero (of joints), offset, mounting, lever,
        radius, pivot, gyro bias or acc bias.
        """
        out = np.zeros(count)
        for u, value in zip(self._unknowns, theta, strict=True):
            if u.kind == kind:
                out[[u.index, *u.others]] += value
        return out

    def feet(self, theta: Array, rows: Ints) -> tuple[Array, Array]:
        """Return foot centres (k, F, 3) m, IMU axes, and rotations from foot to IMU (k, F, 3, 3), at samples (k,).

        `theta`: value of each unknown, (P,), in its unit; `rows`: foot samples of the log.
        """
        log = self.log
        if self._mount is None:
            share = 1.0 + self.values(theta, "length", log.feet_count)
            position, rot = log.foot_position[rows] * share[:, None], log.foot_rot[rows]
        else:
            position, rot = self._by_joints(self._mount, theta, rows)
        turn = matrix_from_rotvec(self.values(theta, "mounting", 3))
        return position @ turn.T + self.values(theta, "lever", 3), turn @ rot

    def noise_size(self, theta: Array, rows: Ints) -> Array:
        """Return the logarithm of the size of the noise of the feet, up to a constant, (k, F), no unit.

        `theta`: value of each unknown, (P,), in its unit; `rows`: foot samples, (k,).
        """
        if self._mount is None:
            share = 1.0 + self.values(theta, "length", self.log.feet_count)
            return np.broadcast_to(np.log(share), (len(rows), self.log.feet_count))
        model, joints = self._changed(self._mount, theta), self.log.joints
        assert joints is not None
        zeros = self.values(theta, "zero", joints.shape[1])
        return 0.5 * np.log(_lever_squares(model, joints[rows] + zeros))

    def _by_joints(self, mount: FootMount, theta: Array, rows: Ints) -> tuple[Array, Array]:
        joints = self.log.joints
        assert joints is not None
        zeros = self.values(theta, "zero", joints.shape[1])
        position, rot = _feet_of_rows(self._changed(mount, theta), joints[rows] + zeros)
        turn = mount.rot_imu_from_base
        return (position - mount.imu_position) @ turn.T, turn @ rot

    def _changed(self, mount: FootMount, theta: Array) -> KinematicModel:
        model = mount.model
        assert model is not None
        links = len(model.parent)
        share = 1.0 + self.values(theta, "length", links + len(model.foot_link))[:, None]
        return model._replace(origin_pos=model.origin_pos * share[:links], foot_point=model.foot_point * share[links:])


@kernel
def _feet_of_rows(model: KinematicModel, joints: Array) -> tuple[Array, Array]:
    """Return foot centres (k, F, 3) m and rotations from foot to base_link (k, F, 3, 3) by joint angles (k, nj) rad."""
    count, feet = joints.shape[0], model.foot_link.size
    position, out = np.empty((count, feet, 3)), np.empty((count, feet, 3, 3))
    for k in range(count):
        rot, pos = forward(model, joints[k])
        for f in range(feet):
            link = model.foot_link[f]
            out[k, f] = rot[link]
            for i in range(3):
                position[k, f, i] = pos[link, i]
                for j in range(3):
                    position[k, f, i] += rot[link, i, j] * model.foot_point[f, j]
    return position, out


@kernel
def _lever_squares(model: KinematicModel, joints: Array) -> Array:
    """Return the sum of the squares of the entries of each foot's Jacobian (k, F), m^2, by joint angles (k, nj) rad."""
    out = np.zeros((joints.shape[0], model.foot_link.size))
    for k in range(joints.shape[0]):
        moved = foot_jacobians(model, joints[k])
        for f in range(out.shape[1]):
            out[k, f] = (moved[f] ** 2).sum()
    return out


def unknowns_of(log: Log) -> list[Unknown]:
    """Return the parameters that a log can calibrate: links and joints or a scale per leg, mounting, offset, biases."""
    out: list[Unknown] = []
    if log.joints is not None and log.robot is not None:
        out += _of_robot(log.robot)
    else:
        out += [Unknown(f"length of leg {f}", "length", f) for f in range(log.feet_count)]
    oriented = np.nanmax(np.abs(log.foot_rot - log.foot_rot[:1]), initial=0.0) > ORIENTED
    if oriented and log.radius is not None and (log.radius > 0.0).any():
        out.append(Unknown("foot radius", "radius"))
    elif oriented:
        out += [Unknown(f"pivot of foot {k // 3} {'xyz'[k % 3]}", "pivot", k) for k in range(3 * log.feet_count)]
    out.append(Unknown("time offset of the feet", "offset"))
    for kind, name in (("mounting", "mounting about"), ("lever", "lever along"), ("gyro bias", "gyro bias"),
                       ("acc bias", "acc bias")):  # fmt: skip
        out += [Unknown(f"{name} {axis}", kind, i) for i, axis in enumerate("xyz")]
    return out


def lengths_alike(unknowns: Sequence[Unknown]) -> list[Unknown]:
    """Return the unknowns with one length of all legs in place of those of single legs."""
    first, *others = (u.index for u in unknowns if u.kind == "length")
    return [
        Unknown("length of all legs", "length", first, tuple(others)), *(u for u in unknowns if u.kind != "length")
    ]  # fmt: skip


def _of_robot(robot: Robot) -> list[Unknown]:
    out: list[Unknown] = []
    for f, leg in enumerate(robot.legs):
        for link in leg.links[1:]:  # the first lies in the trunk
            if np.linalg.norm(robot.links[link].position) > SHORTEST_LINK_M:
                out.append(Unknown(f"length to {robot.links[link].name}", "length", link))
        if np.linalg.norm(leg.foot.position) > SHORTEST_LINK_M:
            out.append(Unknown(f"length to the foot of {leg.name}", "length", len(robot.links) + f))
    joints = dict.fromkeys(joint for leg in robot.legs for joint in leg.joints)
    return out + [Unknown(f"zero of {robot.joint_names[joint]}", "zero", joint) for joint in joints]
