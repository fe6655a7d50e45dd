"""Denavit-Hartenberg tables of legs, as papers print them: `robots/<name>/dh_<leg>.toml`.

Standard convention: frame i = frame i-1 turned by theta about z, moved by d along z and a along x, turned by alpha
about x. The joint angles are those of the robot description; theta = offset - angle.
"""

import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.linear import product
from surefoot.robot.description import Robot, RobotError
from surefoot.robot.reader import ROBOTS
from surefoot.tables import Table

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DhTable:
    """One leg from the foot to the trunk."""

    leg: str
    source: str
    joints: tuple[int, ...]  # index of each row's joint in the robot
    rows: Array  # (n, 4): theta offset rad, d m, a m, alpha rad


def read_dh(robot: Robot, leg: str, path: Path | None = None) -> DhTable:
    """Read the table of a leg.

    Raises:
        RobotError: no such table, or a row that cannot be; names the field.
    """
    path = path or ROBOTS / robot.name / f"dh_{leg}.toml"
    if not path.is_file():
        raise RobotError("not_found", "leg", f"{robot.name} has no table for {leg!r}")
    t = Table(tomllib.loads(path.read_text(encoding="utf-8")), "", RobotError)
    t.text("schema", ("surefoot.robot.dh/1",))
    t.text("robot", (robot.name,))
    t.text("leg", (leg,))
    source = t.text("source")
    t.raw("columns")
    joints: list[int] = []
    rows: list[list[float]] = []
    raw = cast("list[object]", t.raw("rows"))
    for i, row in enumerate(raw if isinstance(raw, list) else []):  # pyright: ignore[reportUnnecessaryIsInstance]
        name, *numbers = cast("list[object]", row) if isinstance(row, list) else [""]
        joint = f"{leg}_{name}"
        if joint not in robot.joint_names:
            raise t.refuse("unknown_name", f"rows[{i}]", f"got {row!r}, known are {', '.join(robot.joint_names)}")
        values = [float(x) for x in numbers if isinstance(x, (int, float)) and math.isfinite(x)]
        if len(numbers) != 4 or len(values) != 4:
            raise t.refuse("value", f"rows[{i}]", f"got {row!r}, expected a joint and four finite numbers")
        joints.append(robot.joint_names.index(joint))
        rows.append([math.radians(values[0]), values[1], values[2], math.radians(values[3])])
    t.close()
    return DhTable(leg, source, tuple(joints), np.array(rows))


def dh_transform(table: DhTable, q: Array) -> Array:
    """Pose of the last frame in the first, homogeneous (4, 4), at joint angles q (nj,) of the robot."""
    pose = np.eye(4)
    for joint, (offset, d, a, alpha) in zip(table.joints, table.rows, strict=True):
        theta = offset - q[joint]
        c, s, ca, sa = math.cos(theta), math.sin(theta), math.cos(alpha), math.sin(alpha)
        step = np.array(
            [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0.0, sa, ca, d], [0.0, 0.0, 0.0, 1.0]]
        )
        pose = product(pose, step)
    return pose
