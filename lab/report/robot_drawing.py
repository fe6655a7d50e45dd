"""Drawing of a robot: links, meshes, feet, centre of mass and the frames of docs/frames.md, at the neutral posture.

`python -m surefoot.lab.report.robot_drawing` draws the robots of the package into docs/.
"""

from itertools import product
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from surefoot.arrays import Array
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.robot.description import Robot
from surefoot.robot.kinematics import com, foot_positions, forward
from surefoot.robot.reader import load_robot, robot_names
from surefoot.services.simulator.sensors.landmarks import camera_pose, read_camera

from ..scene.shapes import Body, body_of
from .drawing import BLUE, GREEN, GREY, INK, ORANGE, RED, STYLE, save_picture

AXES = (RED, GREEN, BLUE)
"""Colours of the x, y and z arrow of every drawn frame."""
ARROW = 0.16
"""Length of the axis arrows of a drawn frame, as a share of the robot's largest extent."""
DPI = 110
GLASS = 0.35
"""Opacity of the meshes of a robot, through which its frames are seen."""
UP = np.array([0.0, 0.0, 1.0])


def frames_of(robot: Robot) -> dict[str, tuple[Array, Array]]:
    """Return origin (3,) m, base_link, and rot_base_from_frame (3, 3) of the frames that a robot carries, by name."""
    rot, _ = forward(robot.model, robot.neutral)
    found = {
        "base_link": (np.zeros(3), np.eye(3)),
        "imu": (robot.imu.position, matrix_from_quat(robot.imu.quat_wxyz)),
    }
    if robot.camera is not None:
        seen = camera_pose(robot, read_camera(robot.camera), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), robot.neutral)
        found["camera"] = (seen.mount, seen.look)
    leg = robot.legs[0]
    found[f"foot {leg.name}"] = (foot_positions(robot.model, robot.neutral)[0], rot[leg.foot.link])
    return found


def draw_robot(robot: Robot, path: Path) -> tuple[str, ...]:
    """Write a picture of a robot at its neutral posture, seen from its front left and from its left side.

    Returns:
        What the picture lacks, one sentence each: links whose meshes cannot be drawn.
    """
    body = body_of(robot)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 4.4), dpi=DPI)
        for place, (elevation, azimuth) in enumerate(((22.0, 35.0), (0.0, 90.0)), 1):
            axes: Any = figure.add_subplot(1, 2, place, projection="3d", proj_type="ortho")
            _draw(axes, robot, body, named=place == 1)
            axes.view_init(elevation, azimuth)
        figure.suptitle(f"{robot.name}: {robot.description}", color=INK)
        figure.subplots_adjust(0.0, 0.0, 1.0, 0.95, 0.0)
        save_picture(figure, path)
    return body.notes


def _draw(axes: Any, robot: Robot, body: Body, named: bool) -> None:
    rot, pos = forward(robot.model, robot.neutral)
    feet = foot_positions(robot.model, robot.neutral)
    everything = np.vstack((pos, feet, robot.trunk.box / 2.0, -robot.trunk.box / 2.0))
    centre, size = (everything.max(0) + everything.min(0)) / 2.0, float(np.ptp(everything, axis=0).max())
    for link, parent in enumerate(robot.model.parent):
        if parent >= 0:
            axes.plot(*np.stack((pos[parent], pos[link])).T, color=GREY, lw=2.5, solid_capstyle="round")
    for leg, foot in zip(robot.legs, feet, strict=True):
        axes.plot(*np.stack((pos[leg.foot.link], foot)).T, color=GREY, lw=2.5)
        points = pos[leg.foot.link] + leg.foot.points @ rot[leg.foot.link].T
        axes.scatter(*points.T, s=14, color=INK, depthshade=False)
        if len(points) > 2:
            order = np.argsort(np.arctan2(*(leg.foot.points - leg.foot.points.mean(0))[:, 1::-1].T))
            axes.plot(*points[np.append(order, order[0])].T, color=INK, lw=1.2)
    points = pos[body.link] + np.einsum("nij,nj->ni", rot[body.link], body.local)
    for mesh in body.meshes:
        at = mesh.placed(points)[mesh.triangles]
        axes.add_collection3d(Poly3DCollection(at, alpha=GLASS, facecolors=mesh.colour, shade=True))
    _box(axes, robot.trunk.box)
    axes.scatter(*com(robot.model, robot.neutral), s=60, color=ORANGE, marker="X", depthshade=False)
    if named:
        axes.text(*(com(robot.model, robot.neutral) - 0.06 * size * UP), "CoM", color=ORANGE, fontsize=8)
    for name, (origin, turn) in frames_of(robot).items():
        for i, colour in enumerate(AXES):
            tip = origin + ARROW * size * turn[:, i]
            axes.plot(*np.stack((origin, tip)).T, color=colour, lw=1.8)
            if named and name == "base_link":
                axes.text(*tip, "xyz"[i], color=colour, fontsize=8)
    if named:
        for origin, names in _labels(frames_of(robot)):
            axes.text(*(origin + 0.05 * size * UP), ", ".join(names), color=INK, fontsize=8, ha="right")
    for set_limits, middle in zip((axes.set_xlim, axes.set_ylim, axes.set_zlim), centre, strict=True):
        set_limits(middle - 0.5 * size, middle + 0.5 * size)
    axes.set_box_aspect((1.0, 1.0, 1.0), zoom=1.45)
    axes.set_axis_off()


def _labels(frames: dict[str, tuple[Array, Array]]) -> list[tuple[Array, list[str]]]:
    """Return each origin once, with the names of the frames that lie there (within 5 mm)."""
    found: list[tuple[Array, list[str]]] = []
    for name, (origin, _) in frames.items():
        same = next((names for place, names in found if np.linalg.norm(place - origin) < 0.005), None)
        if same is None:
            found.append((origin, [name]))
        else:
            same.append(name)
    return found


def _box(axes: Any, size: Array) -> None:
    """Draw the edges of a box of full size (3,) m, centred in base_link."""
    corners = np.array(list(product((-0.5, 0.5), repeat=3))) * size
    for a in range(8):
        for bit in (1, 2, 4):
            if not a & bit:
                axes.plot(*corners[[a, a | bit]].T, color=BLUE, lw=1.0, alpha=0.7)


if __name__ == "__main__":
    for each in robot_names():
        draw_robot(load_robot(each), Path("docs") / f"{each}-frames.png")
