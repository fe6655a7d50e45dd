"""Tables of `robot.toml` from a compiled MuJoCo model, with notes on values found, assumed and missing."""

# mujoco has no type stubs for its compiled modules:
# pyright: reportAttributeAccessIssue=false
import json
import math
import re
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from surefoot.arrays import Array
from surefoot.robot.description import Robot, RobotError
from surefoot.robot.names import plain
from surefoot.services.walker.biped.gait import BipedWalker
from surefoot.services.walker.biped.params import BipedParams

from .anatomy import FootPoint, Segment, check_machine, floats, foot_of, quaternion, segments, trunk_body
from .sensors import sensors
from .stance import MOST_TORQUE, can_stand, doubts_of_axes, gait_on_two, standing, torque_limit

STIFFNESS, DAMPING = 5.0, 0.1
"""Servo gains for joints whose file has none, as multiples of the largest torque: `STIFFNESS`: position gain, 1/rad;
`DAMPING`: velocity gain, s/rad."""
SWING = 2.0 * math.pi * 10.0
"""Natural angular frequency, rad/s, from which a servo's rotor inertia is derived if the file has none: without a
rotor, light links vibrate at the simulation rate and standing feet creep by centimetres."""
KINDS = {6: "hexapod", 4: "quadruped", 2: "biped"}
MOST_ENDS = 12
"""Largest number of last bodies of limbs that an error names."""
HALF_TURN = math.pi  # rad, assumed limit of a joint without limits
SMALLEST_BOX = 1e-6  # m, of a flat body's inertia box: its inertia changes by less than 1e-12 m2 times the mass


@dataclass
class Imported:
    """Result of a robot import: tables of robot.toml, names in the imported file, and notes on the import."""

    tables: dict[str, Any]
    joints: dict[str, str]  # the file's joint name by ours
    feet: dict[str, dict[str, Any]]  # body, centre and spheres in the file, by limb
    shared: dict[str, str]  # our joint by the name of the file's joint that has the same motor
    trunk: str
    home: bool = False
    """True: the neutral posture is the keyframe `home` of the file; False: the file has none."""
    found: list[str] = field(default_factory=list)
    assumed: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)


def imported(model: mujoco.MjModel, name: str, imu: str | None = None) -> Imported:
    """Return the tables of a compiled robot.

    Args:
        model: compiled model of the robot.
        name: name of the robot.
        imu: site or body of the trunk at which the inertial unit is, or `x,y,z` in m in the trunk's frame;
            None = what is called imu, else the trunk's frame.

    Raises:
        RobotError: there is no trunk, not 2, 4 or 6 feet, or no such place of the inertial unit.
    """
    check_machine(model)
    trunk = trunk_body(model)
    segs = segments(model, trunk)
    made = Imported({}, {}, {}, {}, model.body(trunk).name)
    angles = _neutral(model, made)
    limbs = _limbs(segs)
    _check_couplings(model, {segs[limb[0]].joint for limb in limbs})
    feet = _feet(model, segs, limbs, angles)
    base = segs[0]
    if (legs := [i for i, foot in enumerate(feet) if foot is not None]) and len(legs) == 2:  # of a biped: left first
        left, right = (base.rot.T @ (segs[limbs[i][0]].origin - base.origin) for i in legs)
        if left[1] < right[1]:
            limbs[legs[0]], limbs[legs[1]] = limbs[legs[1]], limbs[legs[0]]
            feet[legs[0]], feet[legs[1]] = feet[legs[1]], feet[legs[0]]
    names = [_limb_name(model, segs, limb, i) for i, limb in enumerate(limbs)]
    names = names if len(set(names)) == len(names) else [f"limb{i}" for i in range(len(limbs))]
    servos: dict[str, dict[str, Any]] = {}
    chains, places = {}, []
    for limb, label, foot in zip(limbs, names, feet, strict=True):
        links = [_link(model, segs, s, angles, servos, made, label) for s in limb]
        chain: dict[str, Any] = {"source": "file", "links": links}
        if foot is not None:
            link = links[limb.index(foot.segment)]["name"]
            chain["foot"] = {
                "source": "file", "link": link, "position": floats(foot.position), "radius": foot.radius,
                "points": [floats(point) for point in foot.points],
            }  # fmt: skip
            made.feet[label] = {
                "body": model.body(segs[foot.segment].body).name, "centre": foot.centre, "spheres": foot.spheres,
                "anchor": floats(model.jnt_pos[segs[foot.segment].joint]),
            }  # fmt: skip
            (made.assumed if "assumed" in foot.found else made.found).append(f"foot of {label}: {foot.found}")
        chains[label] = chain
        origin = base.rot.T @ (segs[limb[0]].origin - base.origin)
        places.append({"name": label, "chain": label, "position": floats(origin), "source": "file"})
        places[-1] |= _shared(model, segs[limb[0]].joint, links[0]["name"], f"{label}_{links[0]['name']}", made)
    made.tables = {
        "schema": "surefoot.robot.description/1", "name": name, "kind": KINDS[sum(f is not None for f in feet)],
        "description": f"{name}, imported", "sources": {"file": "the imported file", "assumed": "assumed by import"},
        "trunk": _trunk(base, places, made), "servos": servos, "chains": chains, "limbs": places,
        **sensors(model, segs, imu, (made.found, made.assumed, made.missing)),
    }  # fmt: skip
    if others := {ours: theirs for ours, theirs in made.joints.items() if plain(theirs) != plain(ours)}:
        made.tables["other_names"] = others
    return made


def _check_couplings(model: mujoco.MjModel, first: set[int]) -> None:
    """Raise RobotError for a joint coupled to another joint, except between the first hinges of limbs, `first`."""
    for i in range(model.neq):
        if int(model.eq_obj1id[i]) not in first:
            names = " coupled to ".join(
                repr(model.joint(int(j)).name) for j in (model.eq_obj1id[i], model.eq_obj2id[i])
            )
            text = (
                f"got {names}, allowed are joints with a motor and the first hinges of two limbs; remove it in a copy"
            )
            raise RobotError("value", "equality", text)


def _shared(model: mujoco.MjModel, joint: int, link: str, ours: str, made: Imported) -> dict[str, Any]:
    """Return the table of a limb whose first hinge shares the motor of another limb; empty if it has its own."""
    for i in range(model.neq):
        if int(model.eq_obj1id[i]) == joint:
            theirs = model.joint(int(model.eq_obj2id[i])).name
            motor = next((name for name, known in made.joints.items() if known == theirs and name != ours), None)
            if motor is None:
                text = f"got {model.joint(joint).name!r} coupled to {theirs!r}, allowed is a hinge of a limb before it"
                raise RobotError("value", "equality", text)
            made.shared[model.joint(joint).name] = motor
            del made.joints[ours]
            return {"shared": {link: motor}}
    return {}


def stand_on(made: Imported, robot: Robot) -> None:
    """Add a standing posture, torques where the file has none, and gait parameters to the tables of a robot.

    Args:
        made: tables of the robot, changed in place.
        robot: robot description made from these tables; its neutral posture is used if the robot can stand in it.
    """
    if robot.nlegs == 2:
        if not _stand_on_two(made, robot):
            return
    elif can_stand(robot):
        made.assumed += doubts_of_axes(robot)
        _bend(made, robot, standing(robot, made.home))
    else:
        made.missing.append("gait: walks on four or six legs need three joints a leg")
        return
    most = torque_limit(robot)
    for name, servo in made.tables["servos"].items():
        if servo["max_torque"] > MOST_TORQUE * most:
            text = (
                f"torque of {name}: {most:.3g} Nm in place of {servo['max_torque']:g}, which no leg of this robot needs"
            )
            made.assumed.append(f"{text}; better: the motor's in [servos]")
            servo |= {"kp": STIFFNESS * most, "kv": DAMPING * most, "max_torque": most}


def _stand_on_two(made: Imported, robot: Robot) -> bool:
    """Add gait and standing posture of a robot with two legs; if its legs are not of the kind that walks, a note.

    Returns:
        True if the legs are of that kind.
    """
    try:
        gait = gait_on_two(robot)
        q = BipedWalker(robot, BipedParams.for_robot(robot, **gait)).servos.stance
    except RobotError as error:
        made.missing.append(f"gait: {error}")
        return False
    made.tables["gait"] |= gait
    if not made.home:
        _bend(made, robot, q)
    return True


def _bend(made: Imported, robot: Robot, q: Array) -> None:
    """Store joint angles `q` (nj,) rad of a stance as neutral posture, with a note if they differ from the present."""
    links = {f"{limb}_{link['name']}": link for limb, chain in made.tables["chains"].items() for link in chain["links"]}
    moved = np.flatnonzero(np.abs(q - robot.neutral) > 0.0)
    for j in moved:
        links[robot.joints[j].name]["neutral_deg"] = math.degrees(q[j])
    if moved.size:
        text = "neutral posture: bent legs, feet under the hips; better: a keyframe 'home', or neutral_deg"
        made.assumed = [t for t in made.assumed if not t.startswith("neutral posture")] + [text]


def assume_rotors(made: Imported) -> None:
    """Add an assumed rotor inertia to the tables of servos for which the file has none."""
    for name, servo in made.tables["servos"].items():
        if servo["armature"] <= 0.0:
            servo["armature"] = float(f"{servo['kp'] / SWING**2:.3g}")
            text = f"rotor of {name}: {servo['armature']:g} kg m2, with which it swings at 10 Hz"
            made.assumed.append(f"{text}; better: armature in the file or in [servos]")


def toml_text(tables: dict[str, Any], comment: str) -> str:
    """Return nested tables as TOML text that begins with `comment`; lists of tables are written inline."""
    lines = [f"# {comment}"]

    def put(table: dict[str, Any], path: str) -> None:
        lines.extend(f"{k} = {_value(v)}" for k, v in table.items() if not isinstance(v, dict))
        for key, value in table.items():
            if isinstance(value, dict):
                lines.extend(["", f"[{path}{key}]"])
                put(value, f"{path}{key}.")

    put(tables, "")
    return "\n".join(lines) + "\n"


def _value(value: Any) -> str:
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return "[\n" + "".join(f"  {_value(item)},\n" for item in value) + "]"
    if isinstance(value, list):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_value(item)}" for key, item in value.items()) + " }"
    return json.dumps(value) if isinstance(value, str) else repr(value)


def _neutral(model: mujoco.MjModel, made: Imported) -> Array:
    """Return the joint angles (njnt,) rad of the keyframe `home`, else the middle of the joint limits."""
    keys = [model.key(i).name for i in range(model.nkey)]
    if "home" in keys:
        made.home = True
        made.found.append("neutral posture: keyframe 'home'")
        return model.key_qpos[keys.index("home")][model.jnt_qposadr].copy()
    made.assumed.append("neutral posture: middle of the limits; better: a keyframe 'home', or neutral_deg")
    return np.where(model.jnt_limited.astype(bool), model.jnt_range.mean(axis=1), 0.0)


def _limbs(segs: list[Segment]) -> list[list[int]]:
    """Return, for each limb (chain of segments that starts at the trunk), the segment indices, parents first."""
    roots = [i for i, s in enumerate(segs) if s.parent == 0]
    limb_of = {i: i for i in roots}
    for i, s in enumerate(segs):
        if s.parent > 0:
            limb_of[i] = limb_of[s.parent]
    return [[i for i in limb_of if limb_of[i] == root] for root in roots]


def _feet(model: mujoco.MjModel, segs: list[Segment], limbs: list[list[int]], angles: Array) -> list[FootPoint | None]:
    feet: list[FootPoint | None] = []
    for limb in limbs:
        tips = [i for i in limb if not any(s.parent == i for s in segs)]
        feet.append(foot_of(model, segs, tips[0], angles) if len(tips) == 1 else None)
    if any(foot is not None and foot.named for foot in feet):
        feet = [foot if foot is not None and foot.named else None for foot in feet]
    count = sum(foot is not None for foot in feet)
    if count not in KINDS:
        last = [model.body(segs[i].body).name for limb in limbs for i in limb if all(s.parent != i for s in segs)]
        ends = f" (the limbs end at {', '.join(last)})" if 0 < len(last) <= MOST_ENDS else ""
        text = f"got {count} limbs with a foot, allowed are 2, 4 or 6; name the feet's bodies or sites *foot*{ends}"
        raise RobotError("value", "feet", text)
    return feet


def plain_name(name: str) -> str:
    """Return a name in lower case with all characters but letters and digits replaced by _."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


def _limb_name(model: mujoco.MjModel, segs: list[Segment], limb: list[int], index: int) -> str:
    """Return a limb's name: the common beginning of its body names (`fl` for FL_hip, FL_thigh), else limb and index."""
    first = plain_name(model.body(segs[limb[0]].body).name).split("_")[0]
    same = all(plain_name(model.body(segs[i].body).name).split("_")[0] == first for i in limb)
    return first if same and re.match("[a-z]", first) else f"limb{index}"


def _link(
    model: mujoco.MjModel, segs: list[Segment], index: int, angles: Array,
    servos: dict[str, dict[str, Any]], made: Imported, label: str,
) -> dict[str, Any]:  # fmt: skip
    s = segs[index]
    up, j = segs[s.parent], s.joint
    position = np.zeros(3) if s.parent == 0 else up.rot.T @ (s.origin - up.origin)
    name = _link_name(model, s, label)
    low, high = (float(x) for x in model.jnt_range[j])
    if not model.jnt_limited[j]:
        low, high = -HALF_TURN, HALF_TURN
        made.assumed.append(f"limits of {model.joint(j).name}: -180 to 180 deg; better: a range in the file")
    low, high = max(math.degrees(low), -360.0), min(math.degrees(high), 360.0)
    table: dict[str, Any] = {"name": name, "position": floats(position), "quat_wxyz": quaternion(up.rot.T @ s.rot)}
    if s.parent > 0:
        table["parent"] = _link_name(model, up, label)
    servo = _servo(model, j, made)
    key = next((k for k, v in servos.items() if v == servo), f"servo{len(servos)}")
    servos[key] = servo
    table |= {
        "axis": floats(model.jnt_axis[j]), "lower_deg": low, "upper_deg": high,
        "neutral_deg": min(max(math.degrees(angles[j]), low), high), "servo": key,
    }  # fmt: skip
    made.joints[f"{label}_{name}"] = model.joint(j).name
    return table | _inertial(s)


def _link_name(model: mujoco.MjModel, s: Segment, label: str) -> str:
    plain = plain_name(model.body(s.body).name).removeprefix(f"{label}_")
    return plain if re.match("[a-z]", plain) else f"link{s.body}"


def _inertial(s: Segment) -> dict[str, Any]:
    """Return the inertia table of a segment: mass, centre of mass, and the box of equal principal inertia, its axes."""
    size, axes = np.linalg.eigh(s.inertia)
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1.0
    box = np.sqrt(np.maximum(6.0 / s.mass * (size.sum() - 2.0 * size), SMALLEST_BOX**2))
    return {"mass": s.mass, "com": floats(s.com), "inertia_box": floats(box), "inertia_quat_wxyz": quaternion(axes)}


def _servo(model: mujoco.MjModel, joint: int, made: Imported) -> dict[str, Any]:
    """Return the servo table of a joint: torque and gains of its actuator, else of the joint, else assumed values."""
    dof, torque, kp, kv = model.jnt_dofadr[joint], 0.0, 0.0, 0.0
    for a in range(model.nu):
        if model.actuator_trnid[a, 0] != joint or model.actuator_trntype[a] != int(mujoco.mjtTrn.mjTRN_JOINT):
            continue
        gear = abs(float(model.actuator_gear[a, 0]))
        motor = model.actuator_biastype[a] == int(mujoco.mjtBias.mjBIAS_NONE)
        if model.actuator_forcelimited[a]:
            torque = gear * float(model.actuator_forcerange[a, 1])
        elif motor and model.actuator_ctrllimited[a]:
            torque = gear * float(model.actuator_ctrlrange[a, 1] * model.actuator_gainprm[a, 0])
        if not motor:
            kp, kv = float(-model.actuator_biasprm[a, 1]), float(-model.actuator_biasprm[a, 2])
    if torque <= 0 and model.jnt_actfrclimited[joint]:
        torque = float(model.jnt_actfrcrange[joint, 1])
    name = model.joint(joint).name
    if not 0.0 < torque < math.inf:
        torque = float(model.body_mass.sum())
        made.assumed.append(
            f"torque of {name}: {torque:.3g} Nm, 1 Nm per kg of the robot; better: an actuator or effort"
        )
    if kp <= 0:
        kp, kv = STIFFNESS * torque, DAMPING * torque
        made.assumed.append(f"kp of {name}: full torque at 0.2 rad; better: kp and kv in [servos]")
    return {
        "source": "file", "kp": kp, "kv": max(kv, 0.0), "max_torque": torque,
        "armature": float(model.dof_armature[dof]), "frictionloss": float(model.dof_frictionloss[dof]),
    }  # fmt: skip


def _trunk(base: Segment, places: list[dict[str, Any]], made: Imported) -> dict[str, Any]:
    reach = np.abs([place["position"] for place in places]).max(axis=0)
    box = np.maximum(2.0 * reach, 0.1)
    half = 0.4 * box
    belly = [{"position": [x * half[0], y * half[1], 0.0], "radius": 0.05} for x in (-1, 1) for y in (-1, 1)]
    belly = [{"position": floats(np.array(b["position"])), "radius": b["radius"]} for b in belly]
    made.assumed.append("trunk box and belly spheres: from the places of the hips; better: box and belly in [trunk]")
    return {"source": "file", "box": floats(box), "belly": belly} | _inertial(base)
