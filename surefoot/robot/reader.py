"""Reader of `robot.toml`, which builds the link tree of the robot from the chains of its limbs."""

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

from surefoot.arrays import Array
from surefoot.errors import shown
from surefoot.geometry.linear import dot, norm, product
from surefoot.robot import description as r
from surefoot.robot.description import RobotError
from surefoot.robot.files import ContactTable, FootTable, LimbTable, LinkTable, RobotFile, ServoTable, Sourced
from surefoot.robot.legs import closed_forms, matrix
from surefoot.robot.profiles import ROBOTS, ImuFile, imu_profile, read_profile
from surefoot.tables import FileModel, read_toml, unknown_key, validated

ROBOT_FILE = "robot.toml"
"""Name of the file with a robot's description, in the folder of the robot."""
LONGEST_NAME = 255
"""Largest length of a part of a path, characters; file systems hold no longer ones."""
BIPED_LEG_JOINTS = 6
LEGS = {"hexapod": 6, "quadruped": 4, "biped": 2}
"""Number of legs that a robot description must have, by kind of robot."""
_NOT_HASHED = frozenset({"source", "sources", "description", "schema", "other_names"})


@dataclass(frozen=True, eq=False)
class RobotInFolder(r.Robot):
    """Robot description with the folder that holds its file, and its meshes for drawing if it was imported."""

    folder: Path | None = None


def load_robot(name: str | PathLike[str]) -> RobotInFolder:
    """Return the robot description with a name or in a file.

    Args:
        name: folder name under `surefoot/robots`, or a path (anything that ends in `.toml` or holds a separator).

    Raises:
        RobotError: names the file, the field, the received value and the allowed ones.
    """
    path = robot_file(name)
    try:
        return described(path)
    except RobotError as error:
        raise error.in_file(path) from None


def described(path: Path) -> RobotInFolder:
    """Return the robot that a `robot.toml` describes (raises RobotError, which names the field but not the file)."""
    data = read_toml(path, RobotError)
    file = validated(RobotFile, data, RobotError)
    _check_sources(file, "", file.sources)
    return _robot(file, data, path.absolute().parent)


def robot_file(name: str | PathLike[str]) -> Path:
    """Return the path of the `robot.toml` for a name or path as in `load_robot` (raises RobotError: there is none)."""
    given: Any = name
    if not isinstance(given, str | PathLike):
        raise RobotError("type", "name", f"got {shown(given)}, expected the name of a robot or the path of its file")
    text = str(name)
    if any(len(part) > LONGEST_NAME for part in Path(text).parts):
        raise RobotError("not_found", "name", f"no robot {shown(text)}; known are {', '.join(robot_names())}")
    is_path = isinstance(name, PathLike) or text.endswith(".toml") or "/" in text
    path = Path(name) if is_path else ROBOTS / text / ROBOT_FILE
    if path.is_dir():
        path = path / ROBOT_FILE
        if not path.is_file():
            raise RobotError("not_found", "name", f"{text!r} holds no robot.toml: a robot is a folder with that file")
    if not path.is_file():
        hint = f"; the folder here is './{text}'" if not is_path and Path(text, "robot.toml").is_file() else ""
        raise RobotError("not_found", "name", f"no robot {text!r}; known are {', '.join(robot_names())}{hint}")
    return path


def robot_place(name: str) -> str:
    """Return a robot's name unchanged, or the absolute path if it is a folder, so that any process can load the robot.

    Raises:
        RobotError: there is no such robot, or its description is wrong.
    """
    folder = "/" in name or (name not in robot_names() and Path(name, "robot.toml").is_file())
    place = str(Path(name).resolve()) if folder else name
    load_robot(place)
    return place


def robot_names() -> tuple[str, ...]:
    """Return the names of the robots that come with the package."""
    return tuple(sorted(path.parent.name for path in ROBOTS.glob("*/robot.toml")))


def canonical(value: object) -> object:
    """Return the part of a file's content that affects behaviour: no sources and descriptions, numbers as float."""
    if isinstance(value, dict):
        return {k: canonical(v) for k, v in cast("dict[str, object]", value).items() if k not in _NOT_HASHED}
    if isinstance(value, list):
        return [canonical(v) for v in cast("list[object]", value)]
    if isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    return value


def _check_sources(value: object, path: str, known: Mapping[str, str]) -> None:
    """Refuse the first table whose source is not a key of [sources]."""
    if isinstance(value, FileModel):
        if isinstance(value, Sourced) and value.source not in known:
            raise _unknown(f"{path}.source", value.source, known)
        for name, part in value:
            _check_sources(part, f"{path}.{name}".removeprefix("."), known)
    elif isinstance(value, dict):
        for name, part in cast("dict[str, object]", value).items():
            _check_sources(part, f"{path}.{name}", known)
    elif isinstance(value, list):
        for i, part in enumerate(cast("list[object]", value)):
            _check_sources(part, f"{path}[{i}]", known)


def _unknown(field: str, got: str, known: Mapping[str, object] | list[str]) -> RobotError:
    return RobotError("unknown_name", field, f"got {got!r}, known are {', '.join(known)}")


def _robot(file: RobotFile, data: dict[str, object], folder: Path | None = None) -> RobotInFolder:
    tree = _Tree(file)
    for i, limb in enumerate(file.limbs):
        tree.add_limb(limb, f"limbs[{i}]")
    if len(tree.legs) != LEGS[file.kind]:
        raise RobotError("value", "limbs", f"a {file.kind} has {LEGS[file.kind]} legs, got {len(tree.legs)}")
    joints = {joint.name: "" for joint in tree.joints}
    for name in file.other_names:
        if name not in joints:
            raise _unknown("other_names", name, joints)
    imu, profile = read_profile(ImuFile, file.imu.profile, "imu.profile")
    mount = r.ImuMount(np.array(file.imu.position), _unit(file.imu.quat_wxyz), imu_profile(imu))
    encoders, current = file.encoders, file.current
    content = {"robot": canonical(data), "imu": canonical(profile)}
    return RobotInFolder(
        name=file.name,
        kind=file.kind,
        description=file.description,
        links=tuple(tree.links),
        joints=tuple(tree.joints),
        legs=tuple(tree.legs),
        trunk=tree.trunk,
        imu=mount,
        contacts=_contacts(file.contacts),
        encoder=r.Encoder(math.radians(encoders.resolution_deg), math.radians(encoders.zero_sigma_deg)),
        current=r.CurrentSensor(current.torque_per_ampere, current.noise_ampere),
        gait={key: value for key, value in file.gait if key != "source"},
        sources=file.sources,
        model=_model(tree.links, tree.joints, tree.legs),
        hash=hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest(),
        camera=file.camera,
        ranger=file.ranger,
        other_names=file.other_names,
        folder=folder,
    )


class _Place(NamedTuple):
    """Pose at which a limb is mounted on the trunk, and the limb's place in the description."""

    limb: str
    side: float  # -1.0 = reflected at the plane y = 0, else 1.0
    hip: Array  # (3,) m, base_link
    mount: Array  # (4,) rot_base_from_hip, w x y z
    first: int  # index of the limb's first link
    shared: dict[str, str]  # joint whose motor moves a link too, by link
    path: str  # of the limb in the file


class _Tree:
    """Builder of the links, joints and legs of a robot, in the order of its limbs."""

    def __init__(self, file: RobotFile) -> None:
        trunk, still = file.trunk, np.zeros(3)
        self.chains = file.chains
        self.walks_on_two = file.kind == "biped" and any(key != "source" for key, _ in file.gait)
        self.servos = {key: _servo(servo) for key, servo in file.servos.items()}
        belly = np.array([np.append(sphere.position, sphere.radius) for sphere in trunk.belly])
        self.trunk = r.Trunk(trunk.mass, np.array(trunk.com), np.array(trunk.box), belly)
        base = np.array([1.0, 0.0, 0.0, 0.0])
        box = self.trunk.box if trunk.inertia_box is None else np.array(trunk.inertia_box)
        axes = _unit(trunk.inertia_quat_wxyz)
        self.links = [r.Link("base_link", -1, -1, still, base, still, trunk.mass, self.trunk.com, box, axes)]
        self.joints: list[r.Joint] = []
        self.legs: list[r.Leg] = []

    def add_limb(self, limb: LimbTable, path: str) -> None:
        """Add a limb's links, its joints, and its leg if it has a foot; `path`: of the limb in the file, for errors."""
        if any(link.name.startswith(f"{limb.name}_") for link in self.links):
            raise RobotError("duplicate", f"{path}.name", f"{limb.name!r} is used twice")
        if limb.chain not in self.chains:
            raise _unknown(f"{path}.chain", limb.chain, self.chains)
        chain, where, yaw = self.chains[limb.chain], f"chains.{limb.chain}", math.radians(limb.yaw_deg)
        mount = np.array([math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)])
        side, shared = -1.0 if limb.mirror else 1.0, dict(limb.shared)
        first, first_joint = len(self.links), len(self.joints)
        place = _Place(limb.name, side, np.array(limb.position), mount, first, shared, path)
        names: dict[str, int] = {}
        for i, link in enumerate(chain.links):
            names[link.name] = len(self.links)
            self._add_link(link, names, place, f"{where}.links[{i}]")
        for key in shared:
            raise RobotError("unknown_key", f"{path}.shared.{key}", unknown_key(key, list(names)))
        links, joints = tuple(range(first, len(self.links))), tuple(range(first_joint, len(self.joints)))
        if 0 <= self.links[first].joint < first_joint:
            joints = (self.links[first].joint, *joints)
        if not joints:
            raise RobotError("missing", f"{where}.links", "has no joint: give one of the links an axis")
        if chain.foot is None:
            return
        if self.walks_on_two and len(joints) != BIPED_LEG_JOINTS:
            got = ", ".join(self.joints[j].name for j in joints)
            text = f"a walking biped's leg has {BIPED_LEG_JOINTS} joints, this one has {got}"
            raise RobotError("missing", f"{where}.links", text)
        self.legs.append(r.Leg(limb.name, joints, links, place.hip, _foot(chain.foot, names, side, f"{where}.foot")))

    def _add_link(self, t: LinkTable, names: dict[str, int], place: _Place, path: str) -> None:
        index, name, side = len(self.links), f"{place.limb}_{t.name}", place.side
        is_first = index == place.first
        if any(link.name == name for link in self.links):
            raise RobotError("duplicate", f"{path}.name", f"{name!r} is used twice")
        flip = np.array([1.0, side, 1.0])
        position = np.array(t.position) * flip
        quat = _unit(t.quat_wxyz) * np.array([1.0, side, 1.0, side])
        parent = 0 if is_first else index - 1
        if t.parent is not None:
            if names.get(t.parent, index) >= index:
                raise _unknown(f"{path}.parent", t.parent, list(names)[:-1])
            parent = names[t.parent]
        if is_first:
            turn = place.mount
            c, s = turn[0] ** 2 - turn[3] ** 2, 2 * turn[0] * turn[3]
            position = place.hip + product(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), position)
            quat = _quat_product(turn, quat)
        axis, joint = np.zeros(3), -1
        if t.axis is not None:
            axis, joint = _unit(t.axis), len(self.joints)
            if side < 0 and t.mirrored == "axis":  # a rotation's mirror image: equal angles are symmetric
                axis = axis * np.array([-1.0, 1.0, -1.0])
            made = self._joint(t, name, index, side < 0 and t.mirrored == "limits", path)
            if t.name in place.shared:
                joint = self._shared(t.name, place, is_first)
            else:
                self.joints.append(made)
        com, box = np.array(t.com) * flip, np.array(t.inertia_box)
        axes = _unit(t.inertia_quat_wxyz) * np.array([1.0, side, 1.0, side])
        self.links.append(r.Link(name, parent, joint, position, quat, axis, t.mass, com, box, axes))

    def _shared(self, key: str, place: _Place, first: bool) -> int:
        """Return the index of the joint whose motor also moves the link `key` of a limb (raises RobotError)."""
        field, wanted, known = f"{place.path}.shared.{key}", place.shared.pop(key), [j.name for j in self.joints]
        if wanted not in known:
            raise _unknown(field, wanted, known)
        if not first:
            raise RobotError("value", field, "only the first link of a limb can share a motor")
        return known.index(wanted)

    def _joint(self, t: LinkTable, name: str, link: int, mirror: bool, path: str) -> r.Joint:
        lower, upper, neutral = t.lower_deg, t.upper_deg, t.neutral_deg
        assert lower is not None  # a link with an axis has all three
        assert upper is not None
        assert neutral is not None
        if mirror:
            lower, upper, neutral = -upper, -lower, -neutral
        if t.servo not in self.servos:
            raise _unknown(f"{path}.servo", str(t.servo), self.servos)
        low, high, mid = (math.radians(x) for x in (lower, upper, neutral))
        return r.Joint(name, link, low, high, mid, self.servos[t.servo])


def _servo(t: ServoTable) -> r.Servo:
    return r.Servo(
        kp=t.kp,
        kv=t.kv,
        max_torque=t.max_torque,
        armature=t.armature,
        frictionloss=t.frictionloss,
        resolution=math.radians(t.resolution_deg),
        backlash=math.radians(t.backlash_deg),
        latency=1e-3 * t.latency_ms,
    )


def _foot(t: FootTable, names: dict[str, int], side: float, path: str) -> r.Foot:
    if t.link not in names:
        raise _unknown(f"{path}.link", t.link, names)
    flip = np.array([1.0, side, 1.0])
    position = np.array(t.position) * flip
    points = position[None, :].copy() if t.points is None else np.array(t.points) * flip
    return r.Foot(names[t.link], position, points, t.radius)


def _contacts(t: ContactTable) -> r.ContactSensor:
    low, high = 0.0 if t.min_n is None else t.min_n, math.inf if t.max_n is None else t.max_n
    return r.ContactSensor(t.kind, t.switches, t.on_n, t.off_n, low, high)


def _unit(values: list[float]) -> Array:
    """Return a vector (n,) scaled to length 1, as values in the file are rounded."""
    vector = np.array(values)
    return vector / norm(vector)


def _quat_product(a: Array, b: Array) -> Array:
    w, v = a[0] * b[0] - dot(a[1:], b[1:]), a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])
    return np.concatenate(([w], v))


def _model(links: list[r.Link], joints: list[r.Joint], legs: list[r.Leg]) -> r.KinematicModel:
    width = max(len(leg.joints) for leg in legs)
    leg_joints = np.full((len(legs), width), -1, dtype=np.int64)
    for i, leg in enumerate(legs):
        leg_joints[i, : len(leg.joints)] = leg.joints
    closed = closed_forms(links, joints, legs)
    return r.KinematicModel(
        parent=np.array([link.parent for link in links], dtype=np.int64),
        joint=np.array([link.joint for link in links], dtype=np.int64),
        origin_pos=np.array([link.position for link in links]),
        origin_rot=np.array([matrix(link.quat_wxyz) for link in links]),
        axis=np.array([link.axis for link in links]),
        mass=np.array([link.mass for link in links]),
        com=np.array([link.com for link in links]),
        foot_link=np.array([leg.foot.link for leg in legs], dtype=np.int64),
        foot_point=np.array([leg.foot.position for leg in legs]),
        leg_joints=leg_joints,
        hip=closed.hip,
        segment=closed.segment,
        rolled=closed.rolled,
        lower=np.array([j.lower for j in joints]),
        upper=np.array([j.upper for j in joints]),
        neutral=np.array([j.neutral for j in joints]),
    )
