"""Imported robots with two soles, and with legs that first turn about the vertical."""

import math

import numpy as np
import pytest

from surefoot.lab.cli.robot import _grouped
from surefoot.lab.robots.compare import MOST_DIFFERENCE, differences
from surefoot.lab.robots.folder import import_robot
from surefoot.robot.description import RobotError
from surefoot.robot.kinematics import com, foot_positions, forward
from surefoot.robot.reader import load_robot
from surefoot.services.walker.interface import MotionCommand
from surefoot.services.walker.legged.gait import LeggedWalker
from tests.services.walker.biped import biped_plant
from tests.services.walker.legged.plant import Plant

SOLE, AT = (0.2, 0.1, 0.03), (0.03, 0.0, -0.035)
"""Size of a foot's box and its centre from the ankle, m."""
LEG = (
    ("0 0 1", (-0.6, 0.6), "0 0 -.03"), ("1 0 0", (-0.5, 0.5), "0 0 0"), ("0 1 0", (-1.6, 0.6), "0 0 -.2"),
    ("0 1 0", (0.0, 2.2), "0 0 -.2"), ("0 1 0", (-1.1, 0.8), "0 0 0"), ("1 0 0", (-0.5, 0.5), ""),
)  # fmt: skip
"""Axis, limits in rad, and place of the next joint, of each joint of a biped's leg: yaw, roll, three pitch, roll."""


def link(name, mass, size, at=(0.0, 0.0, 0.0), shape=""):
    x, y, z = (mass / 12.0 * (np.dot(size, size) - s * s) for s in size)
    place = " ".join(map(str, at))
    hull = f'<collision><origin xyz="{place}"/><geometry>{shape}</geometry></collision>' if shape else ""
    return (
        f'<link name="{name}"><inertial><origin xyz="{place}"/><mass value="{mass}"/><inertia ixx="{x}" ixy="0" '
        f'ixz="0" iyy="{y}" iyz="0" izz="{z}"/></inertial>{hull}</link>'
    )


def joint(name, parent, child, place, axis, limits, yaw=0.0):
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="{place}" '
        f'rpy="0 0 {yaw}"/><axis xyz="{axis}"/><limit lower="{limits[0]}" upper="{limits[1]}" effort="60" '
        'velocity="8"/></joint>'
    )


def biped(last="foot", order=(("r", -0.08), ("l", 0.08))):
    box = '<box size="{} {} {}"/>'.format(*SOLE)
    text = link("pelvis", 5.0, (0.15, 0.2, 0.2), (0.0, 0.0, 0.1))
    for side, y in order:
        parent, place = "pelvis", f"0 {y} -.02"
        for k, (axis, limits, following) in enumerate(LEG):
            name = f"{side}_{last}" if k == 5 else f"{side}_{k}"
            long = k in (2, 3)
            text += (
                link(name, 0.8, (0.08, 0.08, 0.2), (0.0, 0.0, -0.1)) if long
                else link(name, 0.3, SOLE, AT, box) if k == 5 else link(name, 0.3, (0.05, 0.05, 0.05))
            )  # fmt: skip
            text += joint(f"{side}_j{k}", parent, name, place, axis, limits)
            parent, place = name, following
    return f'<robot name="two">{text}</robot>'


def crab(coxa=0.06, yaw=None):
    """Four legs that turn about the vertical, then pitch twice; the hips make a long rectangle.

    `coxa`: distance of the first two axes, m; `yaw`: direction of a left leg at the middle of its range, rad.
    """
    text = link("torso", 6.0, (0.5, 0.3, 0.1))
    for n, x, y in (("lf", 0.22, 0.1), ("rf", 0.22, -0.1), ("lh", -0.22, 0.1), ("rh", -0.22, -0.1)):
        turned = math.atan2(y, x) if yaw is None else math.copysign(yaw, y)
        ball = '<sphere radius=".015"/>'
        text += link(f"{n}_coxa", 0.3, (0.06, 0.04, 0.04)) + link(f"{n}_femur", 0.5, (0.16, 0.03, 0.03))
        text += link(f"{n}_tibia", 0.25, (0.2, 0.02, 0.02)) + link(f"{n}_tip", 0.03, (0.03, 0.03, 0.03), shape=ball)
        text += joint(f"{n}_1", "torso", f"{n}_coxa", f"{x} {y} 0", "0 0 1", (-0.9, 0.9), turned)
        text += joint(f"{n}_2", f"{n}_coxa", f"{n}_femur", f"{coxa} 0 0", "0 1 0", (-1.5, 1.5))
        text += joint(f"{n}_3", f"{n}_femur", f"{n}_tibia", ".16 0 0", "0 1 0", (0.0, 2.6))
        text += (
            f'<joint name="{n}_4" type="fixed"><parent link="{n}_tibia"/><child link="{n}_tip"/>'
            '<origin xyz=".2 0 0"/></joint>'
        )
    return f'<robot name="crab">{text}</robot>'


@pytest.fixture
def bring_in(tmp_path):
    def run(text):
        file = tmp_path / "toy.urdf"
        file.write_text(text)
        return import_robot(file, tmp_path / "out"), load_robot(tmp_path / "out")

    return run


def test_a_box_becomes_a_sole_whose_spheres_touch_its_lower_face_and_sides(bring_in, tmp_path):
    made, robot = bring_in(biped())
    assert "foot of l: box at body 'l_foot'" in made.found
    assert max(differences(tmp_path / "out").values()) < MOST_DIFFERENCE
    for leg in robot.legs:
        points, radius = leg.foot.points, leg.foot.radius
        assert len(points) == 4
        low, high = points.min(axis=0) - radius, points.max(axis=0) + radius
        assert low == pytest.approx(np.array(AT) - np.array(SOLE) / 2.0, abs=1e-12)
        assert high[:2] == pytest.approx((np.array(AT) + np.array(SOLE) / 2.0)[:2], abs=1e-12)
        assert np.ptp(points[:, 2]) < 1e-12


def test_two_boxes_at_one_height_are_one_sole_and_a_higher_one_is_none_of_it(bring_in):
    text = biped()
    for side in "lr":
        end = text.index("</link>", text.index(f'<link name="{side}_foot">'))
        more = "".join(
            f'<collision><origin xyz="{x} 0 {z}"/><geometry><box size=".08 .1 .03"/></geometry></collision>'
            for x, z in ((0.2, -0.035), (0.0, 0.05))
        )
        text = text[:end] + more + text[end:]
    _, robot = bring_in(text)
    assert all(len(leg.foot.points) == 8 for leg in robot.legs)
    assert max(np.ptp(leg.foot.points[:, 2]) for leg in robot.legs) < 1e-12


def test_an_imported_biped_stands_with_level_soles_and_walks(bring_in, tmp_path):
    _, robot = bring_in(biped())
    assert robot.leg_names == ("l", "r")  # left first, whatever the file lists first
    rot, _ = forward(robot.model, robot.neutral)
    for leg in robot.legs:
        assert rot[leg.foot.link][2] == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    feet, centre = foot_positions(robot.model, robot.neutral), com(robot.model, robot.neutral)
    assert abs(centre[0] - feet[:, 0].mean()) < SOLE[0] / 2.0
    assert abs(centre[1]) < 1e-6
    plant = biped_plant.Plant(tmp_path / "out").stand()
    plant.begin("walk", distance=0.2)
    plant.until(biped_plant.standing, 1500)
    assert not plant.fallen
    assert plant.world.truth().position[0] == pytest.approx(0.2, abs=0.03)


def test_a_leg_that_turns_first_stands_outside_of_its_axis_and_crawls(bring_in):
    _, robot = bring_in(crab())
    feet, hips = foot_positions(robot.model, robot.neutral), np.array([leg.hip for leg in robot.legs])
    out = feet[:, :2] - hips[:, :2]
    assert (np.linalg.norm(out, axis=1) > 0.15).all()
    assert (np.sign(out) == np.sign(hips[:, :2])).all()
    p = Plant(LeggedWalker(robot))
    p.run(1.0)
    outs = p.obey(MotionCommand("walk", distance=0.3))
    assert p.walker.state.body[0] == pytest.approx(0.3, abs=0.01)
    assert max(out.unreachable for out in outs) == 0


@pytest.mark.parametrize("more", [{}, {"coxa": 0.02}, {"yaw": 0.5 * math.pi}], ids=["usual", "short coxa", "sideways"])
def test_a_crab_keeps_its_pace_whatever_its_legs_are_like(bring_in, more):
    _, robot = bring_in(crab(**more))
    p = Plant(LeggedWalker(robot))
    outs = p.obey(MotionCommand("walk", distance=1.0), limit=75.0)
    assert p.walker.state.body[0] == pytest.approx(1.0, abs=0.01)
    assert len(outs) < 7000  # the shortest first links: a foot has farthest to come down, slowly


def test_a_biped_of_three_joints_a_leg_is_imported_without_a_gait(bring_in):
    legs = crab().replace("lh_", "x_").replace("rh_", "y_")
    for name in "xy":
        for part in ("coxa", "femur", "tibia", "tip"):
            start = legs.index(f'<link name="{name}_{part}">')
            legs = legs[:start] + legs[legs.index("</link>", start) + len("</link>") :]
        for k in range(1, 5):
            start = legs.index(f'<joint name="{name}_{k}"')
            legs = legs[:start] + legs[legs.index("</joint>", start) + len("</joint>") :]
    made, robot = bring_in(legs)
    assert robot.kind == "biped"
    assert robot.gait == {}
    assert any(text.startswith("gait: limbs.lf: expected the axes yaw, roll, pitch") for text in made.missing)


def test_a_refusal_for_want_of_feet_names_where_the_limbs_end(bring_in):
    with pytest.raises(RobotError, match=r"got 0 limbs with a foot.*the limbs end at r_5, l_5"):
        bring_in(biped(last="5"))


def test_notes_that_differ_in_a_name_only_are_one_line():
    texts = [f"kp of j{k}: full torque; better: kp" for k in range(12)] + ["gait: from the legs", "torque of a: 3 Nm"]
    assert _grouped(texts) == [
        "kp of j0, j1, j2 and 9 more: full torque; better: kp", "gait: from the legs", "torque of a: 3 Nm",
    ]  # fmt: skip
    assert _grouped(["foot of l: box at body 'l'"]) == ["foot of l: box at body 'l'"]


def test_a_torque_that_stands_for_none_is_replaced_on_two_legs_too(bring_in):
    made, robot = bring_in(biped().replace('effort="60"', 'effort="10000"'))
    assert any(text.startswith("torque of") for text in made.assumed)
    assert max(joint.servo.max_torque for joint in robot.joints) < 100.0
