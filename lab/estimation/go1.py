"""Unitree Go1: leg kinematics, foot forces by the joints, and a ROS 1 bag of the real robot.

Joints: FL FR RL RR x hip, thigh, calf; feet FL FR RL RR. Axes of the trunk: x forward, y left, z up. With a, b, c the
angles of a leg's hip, thigh and calf, l = 0.213 m and the hip's offset 0.080 m to the side:

    foot = hip + Rx(a) (-l sin b - l sin(b+c), +-0.080, -l cos b - l cos(b+c))
"""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from surefoot.arrays import Array
from surefoot.errors import SurefootError

from .contacts import schmitt
from .log import Log

LINK = 0.213  # m, thigh and calf
RADIUS = 0.02  # m, of the foot balls
IMU_IN_TRUNK = np.array([-0.01592, -0.06659, -0.00617])  # m, axes parallel
HIPS = np.array([[0.1881, 0.04675, 0.0], [0.1881, -0.04675, 0.0], [-0.1881, 0.04675, 0.0], [-0.1881, -0.04675, 0.0]])
ASIDE = np.array([0.08, -0.08, 0.08, -0.08])  # m, hip to thigh along y
FORCES_FROM = (1, 0, 3, 2)
"""Index of each foot FL FR RL RR among the manufacturer's forces, whose order is FR FL RR RL."""
REST_SHARE, ON, OFF = 0.2, 0.15, 0.1
"""`REST_SHARE`: quantile of a foot's force counts that counts as unloaded; `ON`: share of the range from there to the
95 % quantile above which a foot stands; `OFF`: share of that range below which it lifts."""


def _chain(joints: Array, scale: float) -> tuple[Array, Array, Array]:
    """Return rotations of the hips, feet in hip axes from the hip, m, and calves from the knee, m, of n samples.

    `joints` (n, 12) rad; `scale`: factor on the lengths. Shapes: (n, 4, 3, 3), (n, 4, 3), (n, 4, 3); the calf is the
    vector from knee to foot in hip axes.
    """
    a, b, c = (joints.reshape(-1, 4, 3)[..., i] for i in range(3))
    hip = Rotation.from_euler("x", a.reshape(-1, 1)).as_matrix().reshape(*a.shape, 3, 3)
    flat, length = np.zeros_like(a), scale * LINK
    thigh = np.stack([-length * np.sin(b), flat, -length * np.cos(b)], axis=-1)
    calf = np.stack([-length * np.sin(b + c), flat, -length * np.cos(b + c)], axis=-1)
    return hip, thigh + calf + np.stack([flat, flat + scale * ASIDE, flat], axis=-1), calf


def go1_feet(joints: Array, scale: float = 1.0) -> tuple[Array, Array]:
    """Return centres of the foot balls (n, 4, 3) m, trunk axes, and rotations from calf to trunk (n, 4, 3, 3) of a Go1.

    Args:
        joints: joint angles, (n, 12) rad, hip, thigh and calf of the legs FL FR RL RR.
        scale: factor on the lengths of the legs.
    """
    hip, foot, _ = _chain(joints, scale)
    pitch = joints.reshape(-1, 4, 3)[..., 1:].sum(axis=2)
    calf = Rotation.from_euler("y", pitch.reshape(-1, 1)).as_matrix().reshape(*pitch.shape, 3, 3)
    return HIPS + np.einsum("nfij,nfj->nfi", hip, foot), hip @ calf


def go1_forces(joints: Array, torques: Array) -> Array:
    """Return the vertical ground force on each foot by statics, z of f = -J^-T tau, (n, 4) N, trunk axes.

    J is the Jacobian of a foot, tau the torques of its leg.

    Args:
        joints: joint angles, (n, 12) rad, hip, thigh and calf of the legs FL FR RL RR.
        torques: torques of these joints, (n, 12) Nm.
    """
    hip, foot, calf = _chain(joints, 1.0)
    about_y = np.stack([foot[..., 2], np.zeros_like(foot[..., 0]), -foot[..., 0]], axis=-1)
    about_knee = np.stack([calf[..., 2], np.zeros_like(calf[..., 0]), -calf[..., 0]], axis=-1)
    columns = (np.cross([1.0, 0.0, 0.0], foot), about_y, about_knee)
    jacobian = hip @ np.stack(columns, axis=-1)  # (n, 4, 3, 3) m
    force = np.linalg.solve(np.swapaxes(jacobian, -1, -2), torques.reshape(-1, 4, 3, 1))
    return np.asarray(-force[..., 2, 0], dtype=np.float64)


def go1_bag(path: Path) -> tuple[Log, Array]:
    """Return the log of a ROS 1 bag with `/Hardware_IMU` and `/joint_foot`, and the maker's attitude, (n, 3, 3).

    Positions of `/joint_foot` are those of hip, thigh and calf of FL FR RL RR, whatever its names; forces are counts
    above a baseline of each foot and show contacts only. Stamps are those of the headers.

    Raises:
        SurefootError: `rosbags` is not installed.
    """
    try:
        from rosbags.rosbag1 import Reader  # pyright: ignore[reportMissingImports] - optional
        from rosbags.typesys import Stores, get_typestore  # pyright: ignore[reportMissingImports] - optional
    except ImportError:
        raise SurefootError("invalid", f"{path.name} is a ROS 1 bag: pip install rosbags", "log") from None
    types = get_typestore(Stores.ROS1_NOETIC)
    imu: list[tuple[int, list[float]]] = []
    feet: list[tuple[int, Array, Array]] = []
    with Reader(path) as reader:
        for topic, _, raw in reader.messages():
            if topic.topic not in ("/Hardware_IMU", "/joint_foot"):
                continue
            m: Any = types.deserialize_ros1(raw, topic.msgtype)
            stamp = m.header.stamp.sec * 1_000_000_000 + m.header.stamp.nanosec
            if topic.topic == "/Hardware_IMU":
                vectors = (m.angular_velocity, m.linear_acceleration, m.orientation)
                imu.append((stamp, [x for v in vectors for x in (v.x, v.y, v.z)] + [m.orientation.w]))
            else:
                feet.append((stamp, m.position[:12], m.effort[8:12]))
    first, numbers = imu[0][0] - 1, np.array([row for _, row in imu])
    position, rot = go1_feet(np.array([row[1] for row in feet]))
    counts = np.array([row[2] for row in feet])[:, FORCES_FROM]
    rest, most = np.quantile(counts, [REST_SHARE, 0.95], axis=0)
    contact = schmitt(counts, rest + ON * (most - rest), rest + OFF * (most - rest))
    log = Log(
        path.stem, np.array([stamp - first for stamp, _ in imu]), np.ascontiguousarray(numbers[:, :3]),
        np.ascontiguousarray(numbers[:, 3:6]), np.array([row[0] - first for row in feet]), position - IMU_IN_TRUNK,
        rot, contact, radius=np.full(4, RADIUS), imu_position=IMU_IN_TRUNK,
    )  # fmt: skip
    return log, Rotation.from_quat(numbers[:, 6:]).as_matrix()
