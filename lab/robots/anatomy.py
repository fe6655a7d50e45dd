"""Trunk, links (with fixed bodies merged) and feet, found in a compiled MuJoCo model of a robot."""

# mujoco has no type stubs for its compiled modules:
# pyright: reportAttributeAccessIssue=false
import re
from dataclasses import dataclass, field
from typing import NamedTuple

import mujoco
import numpy as np

from surefoot.arrays import Array
from surefoot.robot.description import RobotError

FOOT_NAMES = re.compile(r"foot|feet|toe|sole|_ee|contact|ankle", re.IGNORECASE)
"""Pattern by which the name of a body, geom or site is recognised as that of a foot."""
SAME_M = 1e-4
"""Distance between the centres of two spheres of a foot, m, up to which they count as one sphere."""
ASSUMED_RADIUS = 0.02  # m, of a foot without a sphere: that of a dog-sized robot
CORNER_RADIUS = 0.005
"""Largest radius, m, of the spheres that stand for the corners of a flat sole; half of a thinner box's thickness."""
LEVEL_M = 0.005
"""Largest distance, m, of a box's lower face from that of the lowest box with which it forms a sole."""
ONE_ROOT = "what works instead: a copy with the robot alone"
"""End of the error on a file with several roots."""
NO_MASS = 1e-9  # kg, what weighs less is nothing


@dataclass
class Segment:
    """Moving body of a robot, merged with bodies fixed to it; frame: the body's axes, origin on its joint's axis."""

    body: int
    joint: int  # -1 for the trunk
    parent: int  # index of the segment, -1 for the trunk
    bodies: list[int]
    origin: Array  # (3,) m, world, all joints at zero
    rot: Array  # (3, 3) rot_world_from_segment, all joints at zero
    mass: float = 0.0
    com: Array = field(default_factory=lambda: np.zeros(3))  # (3,) m, segment frame
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))  # kg m2 about com, segment axes


class FileMark(NamedTuple):
    """Reference to a point of a compiled model: origin of a body or site, or centre, end or corner of a geom.

    The corner of a box is the centre of the sphere of radius `corner_radius` that touches its three faces.
    """

    kind: str  # body, site or geom
    number: int
    end: int = 0  # of a capsule: -1, 1 = against or along its axis; of a box: 1 + bit i for the positive side along i

    def place(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Return the position of the referenced point at the state `data`, (3,) m, world frame."""
        at = {"body": data.xpos, "site": data.site_xpos, "geom": data.geom_xpos}[self.kind][self.number]
        if self.end == 0:
            return at.copy()
        size, axes = model.geom_size[self.number], data.geom_xmat[self.number].reshape(3, 3)
        if model.geom_type[self.number] == int(mujoco.mjtGeom.mjGEOM_BOX):
            sides = np.array([1.0 if (self.end - 1) >> i & 1 else -1.0 for i in range(3)])
            return at + axes @ (sides * (size - corner_radius(size)))
        return at + self.end * size[1] * axes[:, 2]


def corner_radius(size: Array) -> float:
    """Return the radius, m, of the spheres that stand for the corners of a box with half sizes `size` (3,) m."""
    return min(CORNER_RADIUS, float(size.min()))


@dataclass
class FootPoint:
    """Foot of a limb: a single contact sphere, or a sole made of several spheres."""

    segment: int
    position: Array  # (3,) m, segment frame
    points: Array  # (k, 3) m, centres of the spheres, segment frame
    radius: float  # m
    named: bool  # the name is one of a foot
    found: str  # where it comes from, for the report
    centre: FileMark | None  # what it is in the file; None = the mean of the spheres
    spheres: list[FileMark]


def floats(values: Array) -> list[float]:
    """Return numbers as a list without -0."""
    return [float(value) + 0.0 for value in values]


def quaternion(rot: Array) -> list[float]:
    """Return the unit quaternion (w, x, y, z) of a rotation matrix (3, 3)."""
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(rot).ravel())
    return floats(quat / np.sqrt(quat @ quat))


def trunk_body(model: mujoco.MjModel) -> int:
    """Return the index of the trunk: the body with the free joint, else the only root body that carries joints.

    Raises:
        RobotError: there are several such bodies, or none.
    """
    parent = model.body_parentid
    free = [int(model.jnt_bodyid[j]) for j in range(model.njnt) if model.jnt_type[j] == int(mujoco.mjtJoint.mjJNT_FREE)]
    moved = {int(model.body_rootid[model.jnt_bodyid[j]]) for j in range(model.njnt)}
    roots = [body for body in range(1, model.nbody) if parent[body] == 0 and body in moved]
    if len(free) > 1 or (not free and len(roots) != 1):
        names = ", ".join(repr(model.body(b).name) for b in (free or roots)) or "none"
        raise RobotError("value", "worldbody", f"got {names} as roots, allowed is one root; {ONE_ROOT}")
    return free[0] if free else roots[0]


def check_machine(model: mujoco.MjModel) -> None:
    """Raise RobotError for a model that is no tree of hinges; the first hinges of two limbs may share a motor."""
    for i in range(model.neq):
        equal = model.eq_type[i] == int(mujoco.mjtEq.mjEQ_JOINT) and model.eq_data[i, :5].tolist() == [0, 1, 0, 0, 0]
        if equal and model.eq_obj2id[i] >= 0:
            continue
        kind = mujoco.mjtEq(int(model.eq_type[i])).name.removeprefix("mjEQ_").lower()
        name = f" {model.eq(i).name!r}" if model.eq(i).name else ""
        bodies = " and ".join(repr(each) for each in _coupled(model, i))
        text = f"got a {kind!r} constraint{name} of {bodies}, allowed is a tree without closed loops; "
        raise RobotError("value", "equality", f"{text}what works instead: a copy without this constraint")
    for j in range(model.njnt):
        kind = mujoco.mjtJoint(int(model.jnt_type[j])).name.removeprefix("mjJNT_").lower()
        if kind in ("ball", "slide"):
            text = f"got {model.joint(j).name!r} of type {kind!r}, allowed are hinge joints; make it fixed in a copy"
            raise RobotError("value", "joint.type", text)


def _coupled(model: mujoco.MjModel, i: int) -> list[str]:
    """Return the names in the file of what the equality constraint `i` couples; the world's body is `world`."""
    sites = model.eq_objtype[i] == int(mujoco.mjtObj.mjOBJ_SITE)
    joints = model.eq_type[i] == int(mujoco.mjtEq.mjEQ_JOINT)
    named = model.joint if joints else model.site if sites else model.body
    return [named(int(j)).name for j in (model.eq_obj1id[i], model.eq_obj2id[i]) if j >= 0]


def segments(model: mujoco.MjModel, trunk: int) -> list[Segment]:
    """Return the trunk and all bodies with a joint, parents first; mass and inertia of fixed bodies are merged in."""
    data = mujoco.MjData(model)
    pose(model, data, np.zeros(model.njnt))
    found: list[Segment] = []
    of_body: dict[int, int] = {}
    for body in range(trunk, model.nbody):
        up = int(model.body_parentid[body])
        if body != trunk and up not in of_body:
            continue
        hinges = range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
        if body != trunk and len(hinges) > 1:
            text = f"got {len(hinges)} joints at {model.body(body).name!r}, allowed is one; put a body between them"
            raise RobotError("value", "body.joint", text)
        if body == trunk or len(hinges):
            joint = -1 if body == trunk else hinges[0]
            origin = data.xpos[body] if body == trunk else data.xanchor[joint]
            of_body[body] = len(found)
            parent = -1 if body == trunk else of_body[up]
            found.append(Segment(body, joint, parent, [], origin.copy(), data.xmat[body].reshape(3, 3).copy()))
        of_body[body] = of_body[body] if body in of_body else of_body[up]
        found[of_body[body]].bodies.append(body)
    for segment in found:
        _merge(model, data, segment)
    return found


def pose(model: mujoco.MjModel, data: mujoco.MjData, angles: Array) -> None:
    """Set all hinges in `data` to `angles` (njnt,) rad, a free trunk to the world origin, and update the kinematics."""
    for j in range(model.njnt):
        at = model.jnt_qposadr[j]
        if model.jnt_type[j] == int(mujoco.mjtJoint.mjJNT_FREE):
            data.qpos[at : at + 7] = [0, 0, 0, 1, 0, 0, 0]
        else:
            data.qpos[at] = angles[j]
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)


def _merge(model: mujoco.MjModel, data: mujoco.MjData, segment: Segment) -> None:
    mass = model.body_mass[segment.bodies]
    segment.mass = float(mass.sum())
    if segment.mass < NO_MASS:
        got = f"got mass {segment.mass:g} at {model.body(segment.body).name!r}"
        raise RobotError("value", "body.inertial", f"{got}, allowed is above 0 for a moved body")
    com = mass @ data.xipos[segment.bodies] / segment.mass
    whole = np.zeros((3, 3))
    for body in segment.bodies:
        axes, arm = data.ximat[body].reshape(3, 3), data.xipos[body] - com
        whole += axes @ np.diag(model.body_inertia[body]) @ axes.T
        whole += model.body_mass[body] * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    segment.com = segment.rot.T @ (com - segment.origin)
    segment.inertia = segment.rot.T @ whole @ segment.rot


def foot_of(model: mujoco.MjModel, segs: list[Segment], tip: int, angles: Array) -> FootPoint | None:
    """Return the foot at the last segment of a limb, in the frame of that segment; None if no point qualifies.

    A foot is a sphere or several with the name of a foot, any sphere, the lowest end of a capsule or the lower corners
    of boxes with such a name, a body or site with such a name, or the lowest end of any capsule.

    Args:
        model: compiled model.
        segs: all segments of the robot.
        tip: index of the limb's last segment in `segs`.
        angles: angles of all hinges, (njnt,) rad, at which the lowest end is determined.
    """
    data = mujoco.MjData(model)
    pose(model, data, angles)
    segment = segs[tip]
    ends = _ends(model, segment)
    if not ends:
        return None
    best = min(ends, key=lambda e: (e.rank, e.mark.place(model, data)[2] - e.radius))
    marks, centre = [best.mark], best.mark if best.rank else None
    sites = [e.mark for e in ends if e.mark.kind == "site"]
    same = [e for e in ends if e.rank == best.rank and e.radius == best.radius and e.box == best.box]
    if best.rank == 0 or best.box:
        marks = _sole([e.mark for e in same if not e.box or _below(e.mark, best.mark, model, data)], model, data)
        centre = marks[0] if len(marks) == 1 else next(iter(sites), None)
    origin, rot = data.xanchor[segment.joint], data.xmat[segment.body].reshape(3, 3)
    points = np.array([rot.T @ (mark.place(model, data) - origin) for mark in marks])
    position = points.mean(axis=0) if centre is None else rot.T @ (centre.place(model, data) - origin)
    many = f"{len(marks)} spheres at body {model.body(segment.bodies[-1]).name!r}"
    found = best.found if len(marks) == 1 or best.box else many
    return FootPoint(tip, position, points, best.radius, best.named, found, centre, marks)


class _TouchPoint(NamedTuple):
    """Point at which a limb may touch the ground, as found in the compiled file."""

    rank: int  # smaller is likelier a foot
    radius: float  # m
    found: str
    named: bool
    mark: FileMark
    box: bool = False  # a corner of a box


def _below(corner: FileMark, lowest: FileMark, model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """Return True if a corner is on the lower face of its box, in the plane of that of the box with corner `lowest`.

    The lower face of a box is the one whose normal points down most, for a foot may be tilted at this posture.
    """
    down = np.zeros(3)
    for mark in (lowest, corner):
        axes = data.geom_xmat[mark.number].reshape(3, 3)
        i = int(np.abs(axes[2]).argmax())
        down = down if down.any() else -np.sign(axes[2, i]) * axes[:, i]
        if (((mark.end - 1) >> i & 1) == 1) == (axes[2, i] > 0.0):
            return False
    return abs(float(down @ (corner.place(model, data) - lowest.place(model, data)))) <= LEVEL_M


def _ends(model: mujoco.MjModel, segment: Segment) -> list[_TouchPoint]:
    """Return the candidates for a foot on a segment: spheres, ends of capsules, and what is named like a foot.

    These are corners of boxes, fixed bodies and sites.
    """
    kind, ends = mujoco.mjtGeom, list[_TouchPoint]()
    for geom in range(model.ngeom):
        body, shape = int(model.geom_bodyid[geom]), int(model.geom_type[geom])
        named = bool(FOOT_NAMES.search(f"{model.geom(geom).name} {model.body(body).name}"))
        if body in segment.bodies and shape == int(kind.mjGEOM_BOX) and named:
            radius, text = corner_radius(model.geom_size[geom]), f"box at body {model.body(body).name!r}"
            ends += [_TouchPoint(2, radius, text, True, FileMark("geom", geom, 1 + k), True) for k in range(8)]
        if body not in segment.bodies or shape not in (int(kind.mjGEOM_SPHERE), int(kind.mjGEOM_CAPSULE)):
            continue
        sphere = shape == int(kind.mjGEOM_SPHERE)
        rank = (0 if named else 1) if sphere else (2 if named else 4)
        text = f"{'sphere' if sphere else 'end of a capsule'} at body {model.body(body).name!r}"
        for end in (0,) if sphere else (-1, 1):
            ends.append(_TouchPoint(rank, float(model.geom_size[geom][0]), text, named, FileMark("geom", geom, end)))
    for body in segment.bodies[1:]:
        if FOOT_NAMES.search(model.body(body).name):
            text = f"body {model.body(body).name!r}, radius assumed"
            ends.append(_TouchPoint(3, ASSUMED_RADIUS, text, True, FileMark("body", body)))
    for site in range(model.nsite):
        if model.site_bodyid[site] in segment.bodies and FOOT_NAMES.search(model.site(site).name):
            text = f"site {model.site(site).name!r}, radius assumed"
            ends.append(_TouchPoint(3, ASSUMED_RADIUS, text, True, FileMark("site", site)))
    return ends


def _sole(marks: list[FileMark], model: mujoco.MjModel, data: mujoco.MjData) -> list[FileMark]:
    """Return the spheres of a sole without duplicates within `SAME_M` m (a visual and a collision sphere)."""
    kept: list[FileMark] = []
    for mark in marks:
        if all(np.linalg.norm(mark.place(model, data) - other.place(model, data)) > SAME_M for other in kept):
            kept.append(mark)
    return kept
