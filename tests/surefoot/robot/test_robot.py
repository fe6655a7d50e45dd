import math
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from surefoot.robot import kinematics as kin
from surefoot.robot.description import RobotError
from surefoot.robot.reader import ROBOTS, load_robot, robot_names
from tests.processes import run_process
from tests.surefoot.expect import expect_error

RAGNO = (ROBOTS / "ragno" / "robot.toml").read_text()
TOY_BIPED = Path(__file__).parent / "toy_biped.toml"


@pytest.fixture
def load_changed(tmp_path):
    def load(old, new, text=RAGNO):
        assert old in text
        path = tmp_path / "robot.toml"
        path.write_text(text.replace(old, new, 1))
        return load_robot(path)

    return load


@pytest.mark.parametrize("name", robot_names())
def test_every_robot_of_the_package_is_whole(name):
    robot = load_robot(name)
    assert robot.name == name
    assert robot.nj == len(robot.joints) == len(set(robot.joint_names)) == robot.model.lower.size
    assert len({link.name for link in robot.links}) == len(robot.links)
    assert all(link.parent < i for i, link in enumerate(robot.links))
    assert np.all(robot.joint_lower <= robot.neutral)
    assert np.all(robot.neutral <= robot.joint_upper)
    assert all(len(text) > 10 for text in robot.sources.values())
    arrays = [array for array in (*robot.model, *robot.model.rolled) if isinstance(array, np.ndarray)]
    assert all(array.flags.c_contiguous for array in arrays)
    assert robot.imu.profile.gyro.lsb > 0
    used = [leg.foot.link for leg in robot.legs]
    assert len(set(used)) == robot.nlegs


@pytest.mark.parametrize("name", ["ragno", "messor"])
def test_hexapods_keep_the_order_of_legs_and_joints(name):
    robot = load_robot(name)
    assert robot.leg_names == ("lf", "lm", "lh", "rf", "rm", "rh")
    assert robot.joint_names[:4] == ("lf_coxa", "lf_femur", "lf_tibia", "lm_coxa")
    assert [leg.joints for leg in robot.legs] == [tuple(range(3 * i, 3 * i + 3)) for i in range(6)]


@pytest.mark.parametrize(
    ("name", "mass", "error", "share"), [("ragno", 2.155, 1e-4, 0.50), ("messor", 3.638, 1e-9, 0.75)]
)
def test_mass_and_the_share_of_the_legs_are_the_published_ones(name, mass, error, share):
    robot = load_robot(name)
    assert robot.mass == pytest.approx(mass, abs=error)
    assert 1.0 - robot.trunk.mass / robot.mass == pytest.approx(share, abs=1e-3)


def test_ragno_neutral_stance_has_the_published_size():
    robot = load_robot("ragno")
    feet = kin.foot_positions(robot.model, robot.neutral)
    assert np.ptp(feet[:, :2], axis=0) == pytest.approx([0.335, 0.301], abs=5e-4)  # paper: 33 x 30 cm
    assert -feet[:, 2] == pytest.approx(np.full(6, 0.069), abs=2e-4)


def test_ragno_centre_of_mass_follows_the_legs_as_published():
    robot = load_robot("ragno")
    forward = np.zeros(robot.nj)
    forward[0:9:3], forward[9:18:3] = -math.radians(30), math.radians(30)  # negative on the left = forward
    neutral = kin.com(robot.model, robot.neutral)
    feet = kin.foot_positions(robot.model, robot.neutral + forward) - kin.foot_positions(robot.model, robot.neutral)
    assert feet[[1, 4], 0].min() > 0.04
    ahead = kin.com(robot.model, robot.neutral + forward) - neutral
    behind = kin.com(robot.model, robot.neutral - forward) - neutral
    assert ahead[0] == pytest.approx(0.0106, abs=5e-5)  # paper: +1.1 cm
    assert behind[0] == pytest.approx(-0.0093, abs=5e-5)  # paper: -0.9 cm
    assert abs(ahead[1]) < 1e-12


def test_imu_profile_is_in_si():
    gyro, accel = load_robot("ragno").imu.profile.gyro, load_robot("ragno").imu.profile.accel
    assert gyro.lsb == pytest.approx(math.radians(0.05))
    assert gyro.noise_density * math.sqrt(50) == pytest.approx(0.0054, rel=0.01)  # rad/s at 100 Hz
    assert accel.noise_density * math.sqrt(50) == pytest.approx(0.035, rel=0.02)  # m/s2
    assert accel.limit == pytest.approx(18 * 9.81)


@pytest.mark.parametrize(
    ("old", "new", "code", "field"),
    [
        ("mass = 1.0775", "", "missing", "trunk.mass"),
        ("mass = 1.0775", "mass = -1.0", "value", "trunk.mass"),
        ("mass = 1.0775", "mass = 0.0", "value", "trunk.mass"),
        ("mass = 1.0775", "mass = nan", "value", "trunk.mass"),
        ("mass = 1.0775", 'mass = "heavy"', "type", "trunk.mass"),
        ("mass = 1.0775", "mass = true", "type", "trunk.mass"),
        ("mass = 0.060", "mass = -0.060", "value", "chains.leg.links[1].mass"),
        ("mass = 0.075", "mass = 0.075\nmasss = 1.0", "unknown_key", "chains.leg.links[0].masss"),
        ("com = [0.038, 0.012, 0.0]", "com = [0.038, 0.012]", "type", "chains.leg.links[1].com"),
        ("com = [0.038, 0.012, 0.0]", "com = [0.038, inf, 0.0]", "value", "chains.leg.links[1].com[1]"),
        ("inertia_box = [0.076", "inertia_box = [0.0", "value", "chains.leg.links[1].inertia_box"),
        ("axis = [0.0, 0.0, 1.0]", "axis = [0.0, 0.0, 2.0]", "value", "chains.leg.links[0].axis"),
        ("lower_deg = -60.0", "lower_deg = 70.0", "value", "chains.leg.links[0].upper_deg"),
        ("lower_deg = -60.0", "lower_deg = -6e5", "value", "chains.leg.links[0].lower_deg"),
        ("neutral_deg = 24.0", "neutral_deg = 91.0", "value", "chains.leg.links[1].neutral_deg"),
        ("neutral_deg = 24.0", "neutral_deg = -61.0", "value", "chains.leg.links[1].neutral_deg"),
        ("upper_deg = 90.0", "upper_deg = 360.1", "value", "chains.leg.links[1].upper_deg"),
        ("lower_deg = -60.0", "lower_deg = -360.1", "value", "chains.leg.links[0].lower_deg"),
        ("[servos.main]", "[chains.arm]\nsource = 'fit'\nlinks = []\n[servos.main]", "type", "chains.arm.links"),
        ("[servos.main]\n", "[servos.main]\nlatency_ms = -0.1\n", "value", "servos.main.latency_ms"),
        ("[servos.main]\n", "[servos.main]\nlatency_ms = 100.1\n", "value", "servos.main.latency_ms"),
        ("[servos.main]\n", "[servos.main]\nbacklash_deg = -0.1\n", "value", "servos.main.backlash_deg"),
        ("[servos.main]\n", "[servos.main]\nresolution_deg = 5.1\n", "value", "servos.main.resolution_deg"),
        ("quat_wxyz = [1.0, 0.0, 0.0, 0.0]", "quat_wxyz = [1.0, 0.0, 0.0]", "type", "imu.quat_wxyz"),
        ("quat_wxyz = [1.0, 0.0, 0.0, 0.0]", "quat_wxyz = [1.0, 0.0, 0.0, 0.0, 0.0]", "type", "imu.quat_wxyz"),
        ('servo = "main"', 'servo = "mian"', "unknown_name", "chains.leg.links[0].servo"),
        ('name = "femur"', 'name = "coxa"', "duplicate", "chains.leg.links[1].name"),
        ('name = "femur"', 'name = "Fe mur"', "value", "chains.leg.links[1].name"),
        ('link = "tibia"', 'link = "toe"', "unknown_name", "chains.leg.foot.link"),
        ("radius = 0.008", "radius = 0", "value", "chains.leg.foot.radius"),
        ("radius = 0.008", "radius = 0.008\npoints = []", "value", "chains.leg.foot.points"),
        ('name = "rh"', 'name = "lf"', "duplicate", "limbs[5].name"),
        ('chain = "leg"', 'chain = "arm"', "unknown_name", "limbs[0].chain"),
        ("mirror = true", 'mirror = "yes"', "type", "limbs[3].mirror"),
        ("yaw_deg = 45.0", "yaw = 45.0", "unknown_key", "limbs[0].yaw"),
        ("kp = 12.0", "kp = 0.0", "value", "servos.main.kp"),
        ("max_torque = 1.5", "max_torque = -1.5", "value", "servos.main.max_torque"),
        ('profile = "adis16365"', 'profile = "adis"', "unknown_name", "imu.profile"),
        ("quat_wxyz = [1.0", "quat_wxyz = [0.5", "value", "imu.quat_wxyz"),
        ("off_n = 0.4", "off_n = 0.9", "value", "contacts.off_n"),
        ("switches = 1", "switches = 9", "value", "contacts.switches"),
        ('kind = "switch"', 'kind = "laser"', "value", "contacts.kind"),
        ("switches = 1", "switches = 0", "value", "contacts.switches"),
        ('kind = "switch"', 'kind = "switch"\nmin_n = 1.0', "unknown_key", "contacts.min_n"),
        ('kind = "switch"', 'kind = "force"\nmin_n = 2.0\nmax_n = 2.0', "value", "contacts.max_n"),
        ('kind = "switch"', 'kind = "force"', "missing", "contacts.min_n"),
        ('[servos.main]\nsource = "study"', "[servos.main]", "missing", "servos.main.source"),
        ('[servos.main]\nsource = "study"', '[servos.main]\nsource = "me"', "unknown_name", "servos.main.source"),
        ('kind = "hexapod"', 'kind = "snake"', "value", "kind"),
        ("surefoot.robot.description/1", "surefoot.robot.description/2", "value", "schema"),
        ("[gait]", "[gaits]", "missing", "gait"),
        ("[imu]", "[extra]\nx = 1\n[imu]", "unknown_key", "extra"),
        ("level_gain = ", 'level_gain = "some" #', "type", "gait.level_gain"),
    ],
)
def test_a_bad_field_is_refused_by_name(load_changed, old, new, code, field):
    with expect_error(RobotError, code, field=field):
        load_changed(old, new)


def test_an_error_names_the_file_before_the_field(load_changed):
    with pytest.raises(RobotError) as caught:
        load_changed("kp = 12.0", "kp = 0.0")
    assert re.fullmatch(r"\S+\.toml: servos\.main\.kp: got 0\.0; .*", str(caught.value))
    assert caught.value.message.startswith("got 0.0")


def test_a_hexapod_with_four_legs_is_refused(load_changed):
    two = RAGNO[RAGNO.rindex("[[limbs]]", 0, RAGNO.rindex("[[limbs]]")) : RAGNO.index("[imu]")]
    with expect_error(RobotError, "value", field="limbs", text="6 legs, got 4"):
        load_changed(two, "")


def test_a_trunk_without_spheres_and_a_robot_without_limbs_are_refused(load_changed):
    belly = RAGNO[RAGNO.index("belly = [") : RAGNO.index("[servos.main]")]
    with expect_error(RobotError, "type", field="trunk.belly"):
        load_changed(belly, "belly = []\n")
    without = RAGNO[: RAGNO.index("[[limbs]]")] + RAGNO[RAGNO.index("[imu]") :]
    with expect_error(RobotError, "type", field="limbs"):
        load_changed('kind = "hexapod"', 'kind = "hexapod"\nlimbs = []', without)


def test_a_chain_without_joints_is_refused(load_changed):
    text = TOY_BIPED.read_text()
    arm = text[text.index("[chains.arm]") :]
    axis = arm[arm.index("axis = ") : arm.index("mass = ")]
    with expect_error(RobotError, "missing", field="chains.arm.links"):
        load_changed(arm, arm.replace(axis, "", 1), text)


def test_broken_toml_and_unknown_robots_are_one_sentence(tmp_path):
    path = tmp_path / "robot.toml"
    for content in (b"name = [", b"name = '\xff'"):
        path.write_bytes(content)
        with expect_error(RobotError, "syntax"):
            load_robot(path)
    with expect_error(RobotError, "not_found", text="ragno"):
        load_robot("spot")


def test_a_folder_is_a_robot_too_where_it_holds_one(tmp_path):
    assert load_robot(ROBOTS / "ragno").hash == load_robot("ragno").hash
    with expect_error(RobotError, "not_found", field="name", text="holds no robot.toml"):
        load_robot(tmp_path)


@pytest.mark.parametrize("parent", ["toe", "ankle_roll", "knee"])
def test_the_parent_of_a_link_comes_before_it(load_changed, parent):
    with expect_error(RobotError, "unknown_name", field="chains.leg.links[4].parent", text=f"got '{parent}'"):
        load_changed('parent = "hip_pitch"', f'parent = "{parent}"', TOY_BIPED.read_text())


def test_the_source_of_each_limb_is_known(load_changed):
    first, rest = RAGNO[: RAGNO.index("[[limbs]]")], RAGNO[RAGNO.index("[[limbs]]") :]
    with expect_error(RobotError, "unknown_name", field="limbs[0].source", text="got 'me'"):
        load_changed(rest, rest.replace('source = "', 'source = "me" # ', 1), first + rest)


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [
        ("# kg m2, rotor seen at the joint", "", True),
        ('source = "study"', 'source = "assumed"', True),
        ("SI units", "units of the SI", True),
        ("lower_deg = -60.0", "lower_deg = -60", True),
        ("mass = 0.075", "mass = 0.0750001", False),
        ('profile = "adis16365"', 'profile = "adis16350"', False),
        ("on_n = 0.7", "on_n = 0.71", False),
        ("level_gain = ", "level_gain = 1", False),
    ],
)
def test_hash_depends_on_what_changes_behaviour_only(load_changed, old, new, same):
    assert (load_changed(old, new).hash == load_robot("ragno").hash) == same


def test_biped_of_the_same_format():
    robot = load_robot(TOY_BIPED)
    assert robot.leg_names == ("left_leg", "right_leg")
    assert (robot.nj, len(robot.links)) == (13, 16)
    assert robot.joint_names[6] == "left_arm_upper"
    assert robot.model.leg_joints.tolist() == [[0, 1, 2, 3, 4, 5], [7, 8, 9, 10, 11, 12]]
    knee = robot.links[robot.joints[3].link]
    assert robot.links[knee.parent].name == "left_leg_hip_pitch"
    assert robot.legs[0].foot.points.shape == (4, 3)
    assert robot.legs[0].foot.points[:, 1] == pytest.approx(-robot.legs[1].foot.points[:, 1])
    assert np.all(np.isnan(robot.model.segment))
    _, reachable = kin.legs_ik(robot.model, np.zeros((2, 3)))
    assert not reachable.any()


def test_mirrored_leg_is_the_reflection_of_the_other(load_changed):
    robot = load_changed("yaw_deg = -3.0", "", TOY_BIPED.read_text())
    model, flip = robot.model, np.diag([1.0, -1.0, 1.0])
    left, right = (np.array(leg.links) for leg in robot.legs)
    rot, pos = kin.forward(model, np.zeros(robot.nj))
    assert np.allclose(pos[left] @ flip, pos[right])
    assert np.allclose(flip @ rot[left] @ flip, rot[right])


def test_reading_a_robot_needs_no_heavy_library():
    code = (
        "import sys; from surefoot.robot.reader import load_robot; load_robot('ragno');"
        "print([m for m in ('numba', 'scipy', 'mujoco', 'zenoh') if m in sys.modules])"
    )
    done = run_process([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_folder_here_is_told_how_to_be_named(tmp_path, monkeypatch):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "robot.toml").write_text(RAGNO)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RobotError, match=r"the folder here is '\./mine'"):
        load_robot("mine")
    assert load_robot("./mine").nj == 18
