"""Comparison of an imported robot with its source at random postures, by MuJoCo and, if installed, pinocchio.

Compared are mass, centre of mass, foot centres and spheres, foot Jacobians, inertia matrix and gravity torques.
"""

# mujoco and pinocchio have no type stubs for their compiled modules:
# pyright: reportAttributeAccessIssue=false
import importlib
import importlib.util
import re
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.constants import GRAVITY
from surefoot.robot.description import Robot, RobotError
from surefoot.robot.kinematics import com, foot_jacobians, forward, gravity_torques
from surefoot.robot.leg_tree import feet_and_jacobians, leg_arrays
from surefoot.robot.reader import load_robot

from .anatomy import FileMark, pose
from .inertia import mass_matrix
from .notes import FILE, SOURCE, ImportNotes, read_notes, read_text
from .source import BALANCED, compiled, is_urdf
from .untrusted import parsed

POSTURES = 20
"""Number of random postures, from a fixed seed, at which two descriptions of a robot are compared."""
MOST_DIFFERENCE = 1e-9
"""Largest difference accepted between a robot folder and its source, SI unit of each quantity; rounding gives 1e-12."""
WITNESS = "pinocchio"


class ComparedRobot(NamedTuple):
    """Quantities of a robot at one posture, compared between robot folder and source file; frame base_link."""

    mass_kg: Array  # (1,)
    com_m: Array  # (3,)
    feet_m: Array  # (L, 3) and of the spheres (k, 3)
    jacobian_m: Array  # (L, 3, n) d foot / d (joints of its leg)
    inertia_kgm2: Array  # (6 + nj, 6 + nj) of trunk (linear, angular) and joints, with the rotors
    gravity_nm: Array  # (nj,) torques against the weight


class _RandomPosture(NamedTuple):
    q: Array  # (nj,) rad
    up: Array  # (3,) m/s2, upward specific force at rest


def differences(folder: Path) -> dict[str, float]:
    """Return the largest differences, by quantity with unit, of a robot folder from MuJoCo's model of its source."""
    robot, notes, text = _read(folder)
    try:
        return _largest(robot, _mujoco(robot, notes, text))
    except (KeyError, IndexError) as error:  # MuJoCo's: a name or number that the file does not have
        why = str(error.args[0] if error.args else error).partition("\n")[0].strip(" '.")
        raise RobotError("unknown_name", FILE, f"names what {SOURCE} does not have: {why}") from None


def witness(folder: Path) -> dict[str, float] | None:
    """Return the largest differences of an imported robot from pinocchio's model of its source, at random postures.

    Args:
        folder: folder of the imported robot, with its source file.

    Returns:
        Difference by name of the quantity, which ends in its unit; None where pinocchio is not installed.

    Raises:
        RobotError: the folder cannot be read.
    """
    if importlib.util.find_spec(WITNESS) is None:
        return None
    robot, notes, text = _read(folder)
    return _largest(robot, _pinocchio(robot, notes, text))


def checked(folder: Path) -> dict[str, dict[str, float]]:
    """Return the largest differences of a robot folder from its source file, by program and by quantity with unit.

    Raises:
        RobotError: a difference exceeds `MOST_DIFFERENCE`, except pinocchio's inertias where MuJoCo balanced them.
    """
    found = {"mujoco": differences(folder)}
    other, notes = witness(folder), _read(folder)[1]
    found |= {} if other is None else {WITNESS: other}
    balanced = any(BALANCED in text for text in notes.assumed)
    for program, worst in found.items():
        for name, value in worst.items():
            if value > MOST_DIFFERENCE and not (balanced and program == WITNESS and name == "inertia_kgm2"):
                text = (
                    f"got {value:.2g} from {program}, allowed is {MOST_DIFFERENCE}: robot.toml differs from source.xml"
                )
                raise RobotError("value", f"differences.{name}", text)
    return found


def _read(folder: Path) -> tuple[Robot, ImportNotes, str]:
    """Return robot description, import notes and source XML of a robot folder, after checking their consistency.

    Raises:
        RobotError: one of them cannot be used, or the notes name a leg or joint that the robot does not have.
    """
    robot, notes = load_robot(folder), read_notes(folder)
    for table, names, known in (("joints", notes.joints, robot.joint_names), ("feet", notes.feet, robot.leg_names)):
        if lacking := sorted(set(known) - set(names)):
            raise RobotError("missing", f"{FILE}.{table}.{lacking[0]}", "is missing: robot.toml has it")
    for leg in robot.legs:
        if (got := len(notes.feet[leg.name].spheres)) != len(leg.foot.points):
            field, allowed = f"{FILE}.feet.{leg.name}.spheres", len(leg.foot.points)
            raise RobotError("value", field, f"got {got}, allowed are {allowed}, as many as robot.toml has")
    for other, name in notes.shared.items():
        if name not in robot.joint_names:
            known = ", ".join(robot.joint_names)
            raise RobotError("unknown_name", f"{FILE}.shared.{other}", f"got {name!r}, known are {known}")
    text = read_text(folder, SOURCE)
    parsed(text.encode(), SOURCE)
    return robot, notes, text


def _largest(robot: Robot, theirs: Any) -> dict[str, float]:
    random, worst = np.random.default_rng(26), dict.fromkeys(ComparedRobot._fields, 0.0)
    for _ in range(POSTURES):
        up = random.normal(size=3)
        at = _RandomPosture(random.uniform(robot.joint_lower, robot.joint_upper), GRAVITY * up / np.linalg.norm(up))
        for name, a, b in zip(ComparedRobot._fields, ours(robot, at.q, at.up), theirs(at), strict=True):
            if b.size:
                worst[name] = max(worst[name], float(np.abs(a - b).max()))
    return worst


def ours(robot: Robot, q: Array, up: Array) -> ComparedRobot:
    """Return the quantities computed by surefoot at joint angles q (nj,) rad and specific force `up` (3,) m/s2."""
    model = robot.model
    rot, pos = forward(model, q)
    feet, jacobians = feet_and_jacobians(leg_arrays(model), q)
    spheres = [pos[leg.foot.link] + leg.foot.points @ rot[leg.foot.link].T for leg in robot.legs]
    inertia = mass_matrix(robot, q)
    inertia[6:, 6:] += np.diag([joint.servo.armature for joint in robot.joints])
    return ComparedRobot(
        np.array([robot.mass]), com(model, q), np.concatenate((feet, *spheres)), jacobians, inertia,
        gravity_torques(model, q, up),
    )  # fmt: skip


def _mujoco(robot: Robot, notes: ImportNotes, text: str) -> Any:
    model, _ = compiled(text, free=notes.trunk)
    data, trunk = mujoco.MjData(model), model.body(notes.trunk).id
    ids = [model.joint(notes.joints[name]).id for name in robot.joint_names]
    pick = np.zeros((model.nv, 6 + robot.nj))  # rows: their degrees of freedom; a shared motor has two
    base = model.body_dofadr[trunk]
    pick[base : base + 6, :6] = np.eye(6)
    angles_of = np.zeros((model.njnt, robot.nj))
    for j, i in enumerate(ids):
        pick[model.jnt_dofadr[i], 6 + j] = angles_of[i, j] = 1.0
        if model.dof_armature[model.jnt_dofadr[i]] <= 0.0:  # the import has assumed a rotor
            model.dof_armature[model.jnt_dofadr[i]] = robot.joints[j].servo.armature
    for theirs, name in notes.shared.items():
        i, j = model.joint(theirs).id, robot.joint_names.index(name)
        pick[model.jnt_dofadr[i], 6 + j] = angles_of[i, j] = 1.0
    feet = [notes.feet[leg.name] for leg in robot.legs]

    def results(at: _RandomPosture) -> ComparedRobot:
        model.opt.gravity = -at.up
        model.dof_armature[base : base + 6] = 0.0  # a default of the file that no trunk has
        pose(model, data, angles_of @ at.q)
        mujoco.mj_forward(model, data)
        full, jac = np.zeros((model.nv, model.nv)), np.zeros((3, model.nv))
        mujoco.mj_fullM(model, data, full)
        spheres = [FileMark(*mark).place(model, data) for foot in feet for mark in foot.spheres]
        places = iter(spheres)
        centres: list[Array] = []
        for foot in feet:
            own = [next(places) for _ in foot.spheres]
            mark = foot.centre
            centres.append(np.mean(own, axis=0) if mark is None else FileMark(*mark).place(model, data))
        columns = np.zeros_like(foot_jacobians(robot.model, at.q))
        for i, (foot, centre) in enumerate(zip(feet, centres, strict=True)):
            mujoco.mj_jac(model, data, jac, None, centre, model.body(foot.body).id)
            joints = list(robot.legs[i].joints)
            columns[i, :, : len(joints)] = (jac @ pick)[:, [6 + j for j in joints]]
        mass = float(model.body_subtreemass[trunk])
        return ComparedRobot(
            np.array([mass]), data.subtree_com[trunk].copy(), np.array([*centres, *spheres]), columns,
            pick.T @ full @ pick, (data.qfrc_bias @ pick)[6:],
        )  # fmt: skip

    return results


def _pinocchio(robot: Robot, notes: ImportNotes, text: str) -> Any:
    pin: Any = importlib.import_module(WITNESS)
    model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer()) if is_urdf(text) else _from_mjcf(pin, text)
    data, q = model.createData(), pin.neutral(model)
    joints = [model.joints[model.getJointId(notes.joints[name])] for name in robot.joint_names]
    rows, places = [*range(6), *(joint.idx_v for joint in joints)], [joint.idx_q for joint in joints]
    pick = np.zeros((model.nv, 6 + robot.nj))
    pick[rows, range(6 + robot.nj)] = 1.0
    places_of = [(place, j) for j, place in enumerate(places)]
    for theirs, name in notes.shared.items():
        joint, j = model.joints[model.getJointId(theirs)], robot.joint_names.index(name)
        pick[joint.idx_v, 6 + j] = 1.0
        places_of.append((joint.idx_q, j))
    rotors = np.zeros(6 + robot.nj)
    rotors[6:] = [joint.servo.armature for joint in robot.joints]

    def results(at: _RandomPosture) -> ComparedRobot:
        for place, j in places_of:
            q[place] = at.q[j]
        pin.framesForwardKinematics(model, data, q)
        base = data.oMf[model.getFrameId(notes.trunk, pin.FrameType.BODY)].copy()
        model.gravity.linear = -base.rotation @ at.up
        model.armature = np.zeros(model.nv)
        whole = pin.crba(model, data, q)
        whole = np.triu(whole) + np.triu(whole, 1).T
        mass = np.array([pin.computeTotalMass(model)])
        centre = base.actInv(pin.centerOfMass(model, data, q))
        weight = (pin.computeGeneralizedGravity(model, data, q) @ pick)[6:]
        feet, columns = _frames(pin, model, data, q, robot, notes, pick)
        feet, columns = (feet - base.translation) @ base.rotation, base.rotation.T @ columns
        return ComparedRobot(mass, centre, feet, columns, pick.T @ whole @ pick + np.diag(rotors), weight)

    return results


def _frames(
    pin: Any, model: Any, data: Any, q: Array, robot: Robot, notes: ImportNotes, pick: Array
) -> tuple[Array, Array]:
    """Return L foot centres and k sphere centres of the feet, (L + k, 3) m, and the Jacobians of the foot centres.

    The Jacobians, (L, 3, n) m/rad, are by the joints of each leg. All in pinocchio's world frame; `q`: pinocchio's
    configuration, which also holds the pose of the free base; `pick`: its velocities by (base, joints of the robot).
    """
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    columns = np.zeros((robot.nlegs, 3, robot.model.leg_joints.shape[1]))
    centres, spheres = list[Array](), list[Array]()
    for i, leg in enumerate(robot.legs):
        note = notes.feet[leg.name]
        frame, joints = model.getFrameId(note.body, pin.FrameType.BODY), list(leg.joints)
        place, anchor = data.oMf[frame], np.array(note.anchor)
        centres.append(place.act(anchor + leg.foot.position))
        spheres += [place.act(anchor + point) for point in leg.foot.points]
        jac = pin.getFrameJacobian(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        moved = jac[:3] + np.cross(jac[3:].T, centres[-1] - place.translation).T
        columns[i, :, : len(joints)] = (moved @ pick)[:, [6 + j for j in joints]]
    return np.array([*centres, *spheres]), columns


def _from_mjcf(pin: Any, text: str) -> Any:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "source.xml"
        file.write_text(re.sub(r"<keyframe>.*</keyframe>", "", text, flags=re.DOTALL), encoding="utf-8")  # of scenes
        return pin.buildModelFromMJCF(str(file))
