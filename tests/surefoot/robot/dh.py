"""Denavit-Hartenberg tables of legs, as papers print them: `robots/<name>/dh_<leg>.toml`.

Standard convention: frame i = frame i-1 turned by theta about z, moved by d along z and a along x, turned by alpha
about x. The joint angles are those of the robot description; theta = offset - angle.
"""

import math
import tomllib

import numpy as np

from surefoot.robot.reader import ROBOTS


def dh_transform(robot, leg, q):
    """Return the pose of the last frame in the first, homogeneous (4, 4), at joint angles q (nj,), rad."""
    table = tomllib.loads((ROBOTS / robot.name / f"dh_{leg}.toml").read_text(encoding="utf-8"))
    pose = np.eye(4)
    for name, offset, d, a, alpha in table["rows"]:
        theta = math.radians(offset) - q[robot.joint_names.index(f"{leg}_{name}")]
        c, s, ca, sa = math.cos(theta), math.sin(theta), math.cos(math.radians(alpha)), math.sin(math.radians(alpha))
        pose = pose @ [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
    return pose
