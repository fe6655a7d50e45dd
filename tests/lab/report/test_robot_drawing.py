"""Frames of a robot as they are drawn in docs/frames.md."""

from pathlib import Path

import numpy as np
import pytest

from surefoot.lab.report.robot_drawing import draw_robot, frames_of
from surefoot.robot.kinematics import foot_positions
from surefoot.robot.reader import load_robot, robot_names


@pytest.mark.parametrize("name", robot_names())
def test_frames_are_rotations_at_places_of_the_robot(name: str) -> None:
    robot = load_robot(name)
    frames = frames_of(robot)
    assert {"base_link", "imu"} <= set(frames)
    assert ("camera" in frames) == (robot.camera is not None)
    for origin, rot in frames.values():
        assert np.allclose(rot @ rot.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(rot) > 0.0
        assert np.linalg.norm(origin) < 1.0
    assert np.array_equal(frames[f"foot {robot.legs[0].name}"][0], foot_positions(robot.model, robot.neutral)[0])


def test_camera_looks_ahead_and_down_with_x_to_the_right() -> None:
    _, rot = frames_of(load_robot("nao"))["camera"]
    assert rot[0, 2] > 0.0 > rot[2, 2]
    assert np.allclose(rot[:, 0], (0.0, -1.0, 0.0), atol=1e-9)


def test_each_robot_is_drawn_on_the_page_of_frames() -> None:
    page = (Path(__file__).parents[3] / "docs" / "frames.md").read_text(encoding="utf-8")
    assert [name for name in robot_names() if f"({name}-frames.png)" not in page] == []


def test_a_drawing_is_written_and_is_the_same_each_time(tmp_path: Path) -> None:
    robot = load_robot("bioloid")
    draw_robot(robot, tmp_path / "a.png")
    draw_robot(robot, tmp_path / "b.png")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
