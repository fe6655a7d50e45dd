"""Export of a robot description as an MJCF file, for other programs and `surefoot robot import`."""

from collections.abc import Iterable
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from surefoot.disk import whole
from surefoot.robot.description import Link, Robot

ROOT = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
"""Pose of the trunk in the exported keyframe, world frame, (7,): position, m, then quaternion w x y z."""


def mjcf_of(robot: Robot) -> str:
    """Return the MJCF text of a robot: links with their inertia, joints, servos, feet, inertial unit, keyframe `home`.

    Lengths in m, angles in rad, numbers in full precision. Backlash, resolution and delay of the servos are left out:
    MJCF has no elements for them.
    """
    top = Element("mujoco", model=robot.name)
    SubElement(top, "compiler", angle="radian", autolimits="true", inertiafromgeom="false")
    world = SubElement(top, "worldbody")
    bodies: list[Element] = []
    for i, link in enumerate(robot.links):
        parent = world if link.parent < 0 else bodies[link.parent]
        body = SubElement(parent, "body", name=link.name, pos=_row(link.position), quat=_row(link.quat_wxyz))
        _inertial(body, link)
        if link.joint >= 0:
            _joint(body, robot, i)
        bodies.append(body)
    _trunk(bodies[0], robot)
    for leg in robot.legs:
        body = bodies[leg.foot.link]
        SubElement(body, "site", name=f"{leg.name}_foot", pos=_row(leg.foot.position))
        for k, point in enumerate(leg.foot.points):
            name, size = f"{leg.name}_foot_{k}", repr(leg.foot.radius)
            SubElement(body, "geom", name=name, type="sphere", size=size, pos=_row(point))
    _motors(top, robot)
    angles = [robot.neutral[link.joint] for link in _depth_first(robot) if link.joint >= 0]
    SubElement(SubElement(top, "keyframe"), "key", name="home", qpos=_row((*ROOT, *angles)))
    indent(top)
    return tostring(top, encoding="unicode") + "\n"


def write_mjcf(robot: Robot, path: Path) -> None:
    """Write the MJCF text of a robot to a file, completely or not at all."""
    text = mjcf_of(robot)
    with whole(path) as part:
        part.write_text(text, encoding="utf-8")


def _inertial(body: Element, link: Link) -> None:
    SubElement(
        body, "inertial", pos=_row(link.com), quat=_row(link.inertia_quat_wxyz), mass=repr(float(link.mass)),
        diaginertia=_row(link.inertia),
    )  # fmt: skip


def _joint(body: Element, robot: Robot, index: int) -> None:
    link, joint = robot.links[index], robot.joints[robot.links[index].joint]
    made = SubElement(body, "joint", name=link.name, axis=_row(link.axis))
    if joint.link == index:
        made.set("range", _row((joint.lower, joint.upper)))
        made.set("armature", repr(joint.servo.armature))
        made.set("frictionloss", repr(joint.servo.frictionloss))


def _trunk(body: Element, robot: Robot) -> None:
    body.insert(0, Element("freejoint"))
    SubElement(body, "site", name="imu", pos=_row(robot.imu.position), quat=_row(robot.imu.quat_wxyz))
    SubElement(body, "geom", name="trunk", type="box", size=_row(0.5 * robot.trunk.box), contype="0", conaffinity="0")
    for i, (x, y, z, radius) in enumerate(robot.trunk.belly):
        SubElement(body, "geom", name=f"belly_{i}", type="sphere", size=repr(float(radius)), pos=_row((x, y, z)))


def _motors(top: Element, robot: Robot) -> None:
    """Add a position servo for each joint, and an equality constraint for joints that share a motor, to the MJCF."""
    motors, equal = SubElement(top, "actuator"), Element("equality")
    for i, link in enumerate(robot.links):
        if link.joint < 0:
            continue
        joint = robot.joints[link.joint]
        if joint.link != i:
            SubElement(equal, "joint", joint1=link.name, joint2=joint.name)
            continue
        servo = joint.servo
        SubElement(
            motors, "position", name=joint.name, joint=joint.name, kp=repr(servo.kp), kv=repr(servo.kv),
            forcerange=_row((-servo.max_torque, servo.max_torque)),
        )  # fmt: skip
    if len(equal):
        top.append(equal)


def _depth_first(robot: Robot, link: int = 0) -> Iterable[Link]:
    """Yield a link of a robot and all links below it, depth first, which is the order of bodies in MuJoCo."""
    yield robot.links[link]
    for i, other in enumerate(robot.links):
        if other.parent == link:
            yield from _depth_first(robot, i)


def _row(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
