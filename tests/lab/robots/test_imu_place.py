"""Pose of the inertial unit of an imported robot: that of the file, else that of the option --imu."""

import json

import numpy as np
import pytest

from surefoot.geometry.rotations import matrix_from_quat
from surefoot.lab.robots.folder import import_robot
from surefoot.robot.description import RobotError
from surefoot.robot.reader import load_robot
from tests.lab.robots.test_import import MJCF, URDF

TURNED = MJCF.replace('<site name="imu" pos=".03 0 .02"/>', '<site name="my_imu" pos=".03 0 .02" quat=".6 0 .8 0"/>')
BARE = MJCF.replace('<site name="imu" pos=".03 0 .02"/>', '<site name="box" pos=".1 .2 .3" quat="0 0 0 1"/>')
LINK = """<link name="imu_link"/><joint name="imu_joint" type="fixed"><parent link="body"/><child link="imu_link"/>
<origin xyz="-.01 .02 .05" rpy="3.14159265358979 0 1.5707963267949"/></joint></robot>"""
HALF, QUARTER = np.diag([1.0, -1.0, -1.0]), np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@pytest.fixture
def unit(tmp_path):
    """Import a text; return position and rotation of the inertial unit, and the notes."""

    def run(text, suffix=".xml", imu=None):
        (tmp_path / f"toy{suffix}").write_text(text)
        made = import_robot(tmp_path / f"toy{suffix}", tmp_path / "out", imu)
        found = load_robot(tmp_path / "out").imu
        return found.position, matrix_from_quat(found.quat_wxyz), made

    return run


def test_pose_of_a_site_of_the_file(unit):
    position, rot, made = unit(TURNED)
    assert position == pytest.approx([0.03, 0, 0.02], abs=1e-12)
    assert rot == pytest.approx(matrix_from_quat(np.array([0.6, 0, 0.8, 0])), abs=1e-12)
    assert "inertial unit: 'my_imu'" in made.found


def test_pose_of_a_link_of_a_urdf(unit):
    position, rot, made = unit(URDF.replace("</robot>", LINK), ".urdf")
    assert position == pytest.approx([-0.01, 0.02, 0.15], abs=1e-12)  # of the root, 0.1 m below the body
    assert rot == pytest.approx(QUARTER @ HALF, abs=1e-9)
    assert "inertial unit: 'imu_link'" in made.found
    assert not [text for text in made.assumed if "inertial unit" in text]


def test_a_named_site_or_a_place_is_taken(unit, tmp_path):
    position, rot, _ = unit(BARE, imu="box")
    assert position == pytest.approx([0.1, 0.2, 0.3], abs=1e-12)
    assert rot == pytest.approx(np.diag([-1.0, -1.0, 1.0]), abs=1e-12)
    (tmp_path / "out").rename(tmp_path / "first")
    position, rot, made = unit(MJCF, imu="-0.01,0,2e-2")
    assert position.tolist() == [-0.01, 0.0, 0.02]
    assert np.array_equal(rot, np.eye(3))
    assert "inertial unit: at -0.01,0,2e-2 m" in made.found


def test_without_a_place_the_note_names_the_option(in_process, tmp_path):
    (tmp_path / "toy.xml").write_text(BARE)
    code, out, _ = in_process("robot", "import", tmp_path / "toy.xml", "-o", tmp_path / "out", "--json")
    assert code == 0
    note = next(text for text in json.loads(out)["assumed"] if "inertial unit" in text)
    assert "better: --imu LINK or --imu x,y,z" in note
    code, out, _ = in_process("robot", "import", tmp_path / "toy.xml", "-o", tmp_path / "two", "--imu", "box", "--json")
    assert code == 0
    assert "inertial unit" not in "".join(json.loads(out)["assumed"])


@pytest.mark.parametrize(
    ("imu", "part"),
    [
        ("bux", "imu: got 'bux' (did you mean 'box'?), allowed are x,y,z"),
        ("fl_calf", "imu: got 'fl_calf'"),
        ("1,2", "imu: got '1,2'"),
        ("1,x,2", "imu: got '1,x,2', allowed are three numbers in m"),
        ("nan,0,0", "imu: got 'nan,0,0', allowed are"),
        ("30,0,20", "imu: got '30,0,20', allowed are three numbers in m from -10 to 10"),
    ],
)
def test_a_place_that_is_none_is_refused(unit, tmp_path, imu, part):
    with pytest.raises(RobotError) as caught:
        unit(BARE, imu=imu)
    assert part in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()
