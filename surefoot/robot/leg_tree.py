"""Foot positions and Jacobians of a posture by one fast call from Python.

A call of a kernel from Python spends most of its time on passing the arrays of a model, and a named tuple costs twice
as much as a plain one. The call here passes a plain tuple of the eight arrays it needs, and visits the links once.
"""

from typing import NamedTuple

from surefoot.arrays import Array, Ints
from surefoot.errors import FieldError
from surefoot.kernels.jit import kernel
from surefoot.robot.description import KinematicModel
from surefoot.robot.kinematics import foot_jacobians_of, foot_positions_of, forward

LegArrays = tuple[Ints, Ints, Array, Array, Array, Ints, Array, Ints, int]
"""Type of a tuple of the arrays of a `LegTree`, in the order of its fields, and the number of joints."""


class LegTree(NamedTuple):
    """Subset of a `KinematicModel` from which foot positions are computed; same names, shapes and units."""

    parent: Ints
    joint: Ints
    origin_pos: Array
    origin_rot: Array
    axis: Array
    foot_link: Ints
    foot_point: Array
    leg_joints: Ints


def leg_arrays(model: KinematicModel) -> LegArrays:
    """Return the arrays of a model for calls of `feet_and_jacobians`; to be kept, as one result serves all calls."""
    return (*(getattr(model, name) for name in LegTree._fields), len(model.neutral))  # type: ignore[return-value]


def feet_and_jacobians(arrays: LegArrays, q: Array) -> tuple[Array, Array]:
    """Return foot centres, (L, 3) m, and their Jacobians by the joints of their leg, (L, 3, n) m/rad, in base_link.

    `arrays`: of `leg_arrays`; `q`: joint angles, (nj,) rad.

    Raises:
        FieldError: shape of q.
    """
    if q.shape != (arrays[-1],):
        raise FieldError("shape", "q", f"got shape {q.shape}, expected ({arrays[-1]},)")
    return _feet_and_jacobians(arrays, q)


@kernel
def _feet_and_jacobians(arrays: LegArrays, q: Array) -> tuple[Array, Array]:
    parent, joint, origin_pos, origin_rot, axis, foot_link, foot_point, leg_joints, _ = arrays
    tree = LegTree(parent, joint, origin_pos, origin_rot, axis, foot_link, foot_point, leg_joints)
    rot, pos = forward(tree, q)  # type: ignore[arg-type] - the fields that it reads
    return foot_positions_of(tree, rot, pos), foot_jacobians_of(tree, rot, pos)  # type: ignore[arg-type]
