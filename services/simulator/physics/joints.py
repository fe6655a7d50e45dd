"""Joints and servos of the MuJoCo model: position servos, two axes of one motor, free play of output shafts."""

# mujoco has no type stubs for its compiled modules:
# pyright: reportAttributeAccessIssue=false
from typing import TYPE_CHECKING

import mujoco

from surefoot.arrays import Array
from surefoot.robot.description import Robot

if TYPE_CHECKING:
    from .addresses import Addresses

COUPLING_SOLREF = (0.004, 1.0)  # s, damping ratio, of one motor's second axis
BACKLASH_ARMATURE = 2e-4  # kg m2
BACKLASH_DAMPING = 0.02  # Nm s/rad
BACKLASH_SOLREF = (0.004, 1.0)  # s, damping ratio, of the ends of the play


def coupled_links(robot: Robot) -> list[int]:
    """Return the indices of the links that are turned by a motor which already turns another link."""
    return [i for i, link in enumerate(robot.links) if link.joint >= 0 and robot.joints[link.joint].link != i]


def place_joints(qpos: Array, addresses: "Addresses", q: Array) -> None:
    """Write joint angles q (nj,) rad into MuJoCo's positions, both axes of a coupled motor; the gears' play is centred.

    `qpos`: positions of the whole model, (nq,), m and rad, changed in place; `addresses`: where the joints are in it.
    """
    qpos[addresses.joint_qpos_slice] = q
    qpos[addresses.coupled_qpos] = q[addresses.coupled]
    if addresses.backlash_qpos.size:
        qpos[addresses.backlash_qpos[addresses.backlash_qpos >= 0]] = 0.0


def read_joints(qpos: Array, addresses: "Addresses") -> Array:
    """Return the angles of the output shafts of the servos, (nj,) rad, play of their gears included; a copy.

    `qpos`: positions of the whole model, (nq,), m and rad; `addresses`: where the joints are in it.
    """
    q = qpos[addresses.joint_qpos_slice].copy()
    if addresses.backlash_qpos.size:
        has = addresses.backlash_qpos >= 0
        q[has] += qpos[addresses.backlash_qpos[has]]
    return q


def add_joint(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, robot: Robot, index: int, kp: float, kv: float, torque: Array
) -> None:
    """Add the joint of a servo and its motor to a body of the model.

    Args:
        spec: model, changed.
        body: body that the joint turns, changed.
        robot: the description.
        index: index of the joint in the description.
        kp: position gain, Nm/rad.
        kv: velocity gain, Nm s/rad.
        torque: largest torque of every servo, (nj,) Nm.
    """
    joint = robot.joints[index]
    body.add_joint(
        name=joint.name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=robot.links[joint.link].axis,
        range=[joint.lower, joint.upper],
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        armature=joint.servo.armature,
        frictionloss=joint.servo.frictionloss,
    )
    limit = float(torque[index])
    spec.add_actuator(
        name=joint.name,
        target=joint.name,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        gaintype=mujoco.mjtGain.mjGAIN_FIXED,
        gainprm=[kp] + [0.0] * 9,
        biastype=mujoco.mjtBias.mjBIAS_AFFINE,
        biasprm=[0.0, -kp, -kv] + [0.0] * 7,
        forcelimited=mujoco.mjtLimited.mjLIMITED_TRUE,
        forcerange=[-limit, limit],
    )


def add_coupled(spec: mujoco.MjSpec, body: mujoco.MjsBody, robot: Robot, link: int) -> None:
    """Add the second axis that a motor turns to a body: its angle equals that of the first; `link`: its index."""
    joint, name = robot.joints[robot.links[link].joint], robot.links[link].name
    body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=robot.links[link].axis)
    spec.add_equality(
        name=name,
        type=mujoco.mjtEq.mjEQ_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        name1=name,
        name2=joint.name,
        data=[0.0, 1.0] + [0.0] * 10,
        solref=COUPLING_SOLREF,
    )


def add_backlash(body: mujoco.MjsBody, robot: Robot, link: int) -> None:
    """Add the free play of a servo's output shaft to a body, as a joint in series; nothing where it is 0.

    `link`: index of the link in the description that the body belongs to.
    """
    joint = robot.joints[robot.links[link].joint]
    if joint.servo.backlash == 0.0:
        return
    own = joint.link == link
    body.add_joint(
        name=f"{joint.name if own else robot.links[link].name}_backlash",
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=robot.links[link].axis,
        range=[-0.5 * joint.servo.backlash, 0.5 * joint.servo.backlash],
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        armature=BACKLASH_ARMATURE,
        damping=BACKLASH_DAMPING,
        solref_limit=BACKLASH_SOLREF,
    )
