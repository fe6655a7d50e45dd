"""Reader of `robot.toml`: chains are expanded into the link tree, every number is checked."""

import hashlib
import json
import math
from os import PathLike
from pathlib import Path
from typing import cast

import numpy as np

from surefoot.geometry.linear import dot, product
from surefoot.robot import description as r
from surefoot.robot.description import Array, RobotError
from surefoot.robot.profiles import read_contacts, read_current, read_encoder, read_imu
from surefoot.tables import Table, read_toml

ROBOTS = Path(__file__).parents[1] / "robots"
BIPED_LEG_JOINTS = 6
_NOT_HASHED = frozenset({"source", "sources", "description", "schema"})


def read_robot(name: str | PathLike[str]) -> r.Robot:
    """Read, validate and expand a description; see `surefoot.robot.reader.load_robot`."""
    text = str(name)
    is_path = isinstance(name, PathLike) or text.endswith(".toml") or "/" in text
    path = Path(name) if is_path else ROBOTS / text / "robot.toml"
    if path.is_dir():
        path = path / "robot.toml"
        if not path.is_file():
            raise RobotError("not_found", "name", f"{text!r} holds no robot.toml: a robot is a folder with that file")
    if not path.is_file():
        hint = f"; the folder here is './{text}'" if not is_path and Path(text, "robot.toml").is_file() else ""
        raise RobotError("not_found", "name", f"no robot {text!r}; known are {', '.join(robot_names())}{hint}")
    data = read_toml(path, RobotError)
    return _Reader(data).robot()


def canonical(value: object) -> object:
    """Content that changes behaviour: tables without sources and texts for people, all numbers as float."""
    if isinstance(value, dict):
        return {k: canonical(v) for k, v in cast("dict[str, object]", value).items() if k not in _NOT_HASHED}
    if isinstance(value, list):
        return [canonical(v) for v in cast("list[object]", value)]
    if isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    return value


class _Reader:
    def __init__(self, data: dict[str, object]) -> None:
        self.data = data
        self.top = Table(data, "", RobotError)
        self.sources: dict[str, str] = {}
        self.links: list[r.Link] = []
        self.joints: list[r.Joint] = []
        self.legs: list[r.Leg] = []
        self.servos: dict[str, r.Servo] = {}
        self.kind = ""

    def robot(self) -> r.Robot:
        top = self.top
        top.text("schema", ("surefoot.robot.description/1",))
        name, kind = top.name("name"), top.text("kind", ("hexapod", "biped"))
        self.kind = kind
        description = top.text("description")
        src = top.table("sources")
        self.sources = {key: src.text(key) for key in src.keys()}  # noqa: SIM118 - a Table is no dict
        trunk = self._trunk(top.table("trunk"))
        for key, table in top.table("servos").items():
            self.servos[key] = self._servo(table)
        chains = top.table("chains")
        for limb in top.tables("limbs"):
            self._limb(limb, chains)
        wanted = {"hexapod": 6, "biped": 2}[kind]
        if self.legs and len(self.legs) != wanted:
            raise top.refuse("value", "limbs", f"a {kind} has {wanted} legs, got {len(self.legs)}")
        if not self.legs:
            raise top.refuse("value", "limbs", "no limb has a foot")
        imu, profile = read_imu(self._sourced("imu"))
        contacts, encoder = read_contacts(self._sourced("contacts")), read_encoder(self._sourced("encoders"))
        current, gait = read_current(self._sourced("current")), self._gait(self._sourced("gait"))
        camera, ranger = (top.name(key) if top.has(key) else None for key in ("camera", "ranger"))
        top.close()
        content = {"robot": canonical(self.data), "imu": canonical(profile)}
        digest = hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
        return r.Robot(
            name, kind, description, tuple(self.links), tuple(self.joints), tuple(self.legs), trunk, imu, contacts,
            encoder, current, gait, self.sources, _model(self.links, self.joints, self.legs), digest,
            camera, ranger,
        )  # fmt: skip

    def _source(self, table: Table) -> None:
        key = table.text("source")
        if key not in self.sources:
            raise table.refuse("unknown_name", "source", f"got {key!r}, known are {', '.join(self.sources)}")

    def _sourced(self, key: str) -> Table:
        """A table of the file that names its source."""
        table = self.top.table(key)
        self._source(table)
        return table

    def _trunk(self, t: Table) -> r.Trunk:
        self._source(t)
        mass, com, box = t.number("mass", above=0), t.vector("com", 3), _sizes(t, "box")
        belly: list[Array] = []
        for sphere in t.tables("belly"):
            belly.append(np.append(sphere.vector("position", 3), sphere.number("radius", above=0)))
            sphere.close()
        t.close()
        unit, still = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
        self.links.append(r.Link("base_link", -1, -1, still, unit, np.zeros(3), mass, com, box))
        return r.Trunk(mass, com, box, np.array(belly))

    def _servo(self, t: Table) -> r.Servo:
        self._source(t)
        servo = r.Servo(
            kp=t.number("kp", above=0),
            kv=t.number("kv", at_least=0),
            max_torque=t.number("max_torque", above=0),
            armature=t.number("armature", at_least=0),
            frictionloss=t.number("frictionloss", at_least=0),
            resolution=math.radians(t.number("resolution_deg", default=0.0, at_least=0, at_most=5)),
            backlash=math.radians(t.number("backlash_deg", default=0.0, at_least=0, at_most=5)),
            latency=1e-3 * t.number("latency_ms", default=0.0, at_least=0, at_most=100),
        )
        t.close()
        return servo

    def _limb(self, limb: Table, chains: Table) -> None:
        self._source(limb)
        name = limb.name("name")
        if any(link.name.startswith(f"{name}_") for link in self.links):
            raise limb.refuse("duplicate", "name", f"{name!r} is used twice")
        key = limb.text("chain")
        if not chains.has(key):
            raise limb.refuse("unknown_name", "chain", f"got {key!r}, known are {', '.join(chains.keys())}")
        side = -1.0 if limb.flag("mirror", False) else 1.0
        hip, yaw = limb.vector("position", 3), math.radians(limb.number("yaw_deg", default=0.0))
        shared = limb.table("shared") if limb.has("shared") else Table({}, limb.field("shared"), RobotError)
        limb.close()
        chain = chains.table(key)
        self._source(chain)
        mount = np.array([math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)])
        first, first_joint = len(self.links), len(self.joints)
        names: dict[str, int] = {}
        for t in chain.tables("links"):
            names[t.name("name")] = len(self.links)
            self._link(t, name, names, side, (hip, mount) if len(self.links) == first else None, shared)
        shared.close()
        links, joints = tuple(range(first, len(self.links))), tuple(range(first_joint, len(self.joints)))
        if self.links[first].joint >= 0 and self.links[first].joint < first_joint:
            joints = (self.links[first].joint, *joints)
        if not joints:
            raise chain.refuse("missing", "links", "has no joint: give one of the links an axis")
        if chain.has("foot") and self.kind == "biped" and len(joints) != BIPED_LEG_JOINTS:
            got = ", ".join(self.joints[j].name for j in joints)
            raise chain.refuse("missing", "links", f"a biped's leg has {BIPED_LEG_JOINTS} joints, this one has {got}")
        if chain.has("foot"):
            self.legs.append(r.Leg(name, joints, links, hip, self._foot(chain.table("foot"), names, side)))
        chain.close()

    def _link(
        self,
        t: Table,
        limb: str,
        names: dict[str, int],
        side: float,
        mount: tuple[Array, Array] | None,
        shared: Table,
    ) -> None:
        index, name = len(self.links), f"{limb}_{t.name('name')}"
        if any(link.name == name for link in self.links):
            raise t.refuse("duplicate", "name", f"{name!r} is used twice")
        flip = np.array([1.0, side, 1.0])
        position = t.vector("position", 3) * flip
        quat = t.unit("quat_wxyz", 4, (1.0, 0.0, 0.0, 0.0)) * np.array([1.0, side, 1.0, side])
        parent = 0 if mount else index - 1
        if t.has("parent"):
            up = t.text("parent")
            if up not in names or names[up] >= index:
                raise t.refuse("unknown_name", "parent", f"got {up!r}, known are {', '.join(list(names)[:-1])}")
            parent = names[up]
        if mount is not None:
            hip, turn = mount
            c, s = turn[0] ** 2 - turn[3] ** 2, 2 * turn[0] * turn[3]
            position = hip + product(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), position)
            quat = _quat_product(turn, quat)
        axis, joint = np.zeros(3), -1
        if t.has("axis"):
            axis, joint = t.unit("axis", 3), len(self.joints)
            mirrored = t.text("mirrored", ("no", "axis", "limits")) if t.has("mirrored") else "no"
            if side < 0 and mirrored == "axis":  # a rotation's mirror image: equal angles are symmetric
                axis = axis * np.array([-1.0, 1.0, -1.0])
            made = self._joint(t, name, index, side < 0 and mirrored == "limits")
            if shared.has(t.text("name")):
                joint = self._shared(shared, t.text("name"), mount is not None)
            else:
                self.joints.append(made)
        mass, com = t.number("mass", above=0), t.vector("com", 3) * flip
        self.links.append(r.Link(name, parent, joint, position, quat, axis, mass, com, _sizes(t, "inertia_box")))
        t.close()

    def _shared(self, shared: Table, key: str, first: bool) -> int:
        """Index of the joint whose motor moves this link too."""
        wanted, known = shared.text(key), [joint.name for joint in self.joints]
        if wanted not in known:
            raise shared.refuse("unknown_name", key, f"got {wanted!r}, known are {', '.join(known)}")
        if not first:
            raise shared.refuse("value", key, "only the first link of a limb can share a motor")
        return known.index(wanted)

    def _joint(self, t: Table, name: str, link: int, mirror: bool) -> r.Joint:
        lower, upper = t.number("lower_deg", at_least=-360), t.number("upper_deg", at_most=360)
        if not lower < upper:
            raise t.refuse("value", "upper_deg", f"got {upper}, must be above lower_deg = {lower}")
        neutral = t.number("neutral_deg", at_least=lower, at_most=upper)
        servo = t.text("servo")
        if servo not in self.servos:
            raise t.refuse("unknown_name", "servo", f"got {servo!r}, known are {', '.join(self.servos)}")
        if mirror:
            lower, upper, neutral = -upper, -lower, -neutral
        low, high, mid = (math.radians(x) for x in (lower, upper, neutral))
        return r.Joint(name, link, low, high, mid, self.servos[servo])

    def _foot(self, t: Table, names: dict[str, int], side: float) -> r.Foot:
        self._source(t)
        link = t.text("link")
        if link not in names:
            raise t.refuse("unknown_name", "link", f"got {link!r}, known are {', '.join(names)}")
        flip = np.array([1.0, side, 1.0])
        position = t.vector("position", 3) * flip
        points = t.vectors("points", 3) * flip if t.has("points") else position[None, :].copy()
        if not len(points):
            raise t.refuse("value", "points", "is empty: a foot needs at least one sphere")
        foot = r.Foot(names[link], position, points, t.number("radius", above=0))
        t.close()
        return foot

    def _gait(self, t: Table) -> dict[str, float]:
        keys = [key for key in t.keys() if key != "source"]  # noqa: SIM118 - a Table is no dict
        gait = {key: t.number(key) for key in keys}
        t.close()
        return gait


def _sizes(t: Table, key: str) -> Array:
    size = t.vector(key, 3)
    if not np.all(size > 0):
        raise t.refuse("value", key, f"got {size.tolist()}, every size must be above 0")
    return size


def _quat_product(a: Array, b: Array) -> Array:
    w, v = a[0] * b[0] - dot(a[1:], b[1:]), a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])
    return np.concatenate(([w], v))


def _matrix(q: Array) -> Array:
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _model(links: list[r.Link], joints: list[r.Joint], legs: list[r.Leg]) -> r.KinematicModel:
    width = max(len(leg.joints) for leg in legs)
    leg_joints = np.full((len(legs), width), -1, dtype=np.int64)
    hip, segment = np.zeros((len(legs), 4)), np.full((len(legs), 3), np.nan)
    for i, leg in enumerate(legs):
        leg_joints[i, : len(leg.joints)] = leg.joints
        hip[i, :3] = leg.hip
        closed = _yaw_pitch_pitch(links, joints, leg)
        if closed is not None:
            hip[i], segment[i] = closed
    return r.KinematicModel(
        parent=np.array([link.parent for link in links], dtype=np.int64),
        joint=np.array([link.joint for link in links], dtype=np.int64),
        origin_pos=np.array([link.position for link in links]),
        origin_rot=np.array([_matrix(link.quat_wxyz) for link in links]),
        axis=np.array([link.axis for link in links]),
        mass=np.array([link.mass for link in links]),
        com=np.array([link.com for link in links]),
        foot_link=np.array([leg.foot.link for leg in legs], dtype=np.int64),
        foot_point=np.array([leg.foot.position for leg in legs]),
        leg_joints=leg_joints,
        hip=hip,
        segment=segment,
        lower=np.array([j.lower for j in joints]),
        upper=np.array([j.upper for j in joints]),
    )


def _yaw_pitch_pitch(links: list[r.Link], joints: list[r.Joint], leg: r.Leg) -> tuple[Array, Array] | None:
    """Hip pose (4,) and segment lengths (3,) if the leg is coxa (z), femur (-y), tibia (-y) along x, else None."""
    if len(leg.joints) != 3:
        return None
    coxa, femur, tibia = (links[joints[j].link] for j in leg.joints)
    foot, link = leg.foot.position, leg.foot.link
    while link != joints[leg.joints[2]].link:  # fixed links between the tibia and the foot
        if links[link].joint >= 0 or link == 0:
            return None
        foot = links[link].position + product(_matrix(links[link].quat_wxyz), foot)
        link = links[link].parent
    axes = np.array([coxa.axis, femur.axis, tibia.axis])
    straight = all(np.allclose(p[1:], 0.0, atol=1e-12) for p in (femur.position, tibia.position, foot))
    level = np.allclose([femur.quat_wxyz, tibia.quat_wxyz], [1, 0, 0, 0]) and np.allclose(coxa.quat_wxyz[1:3], 0)
    chained = tibia.parent == joints[leg.joints[1]].link and femur.parent == joints[leg.joints[0]].link
    chained = chained and coxa.parent == 0
    if not (straight and level and chained and np.allclose(axes, [[0, 0, 1], [0, -1, 0], [0, -1, 0]])):
        return None
    yaw = 2.0 * math.atan2(coxa.quat_wxyz[3], coxa.quat_wxyz[0])
    return np.append(coxa.position, yaw), np.array([femur.position[0], tibia.position[0], foot[0]])


def load_robot(name: str | PathLike[str]) -> r.Robot:
    """Read a robot by name or by path.

    Args:
        name: folder name under `surefoot/robots`, or a path (anything that ends in `.toml` or holds a separator).

    Raises:
        RobotError: what is wrong, with the field.
    """
    return read_robot(name)


def robot_names() -> tuple[str, ...]:
    """Names of the robots that come with the package."""
    return tuple(sorted(path.parent.name for path in ROBOTS.glob("*/robot.toml")))
