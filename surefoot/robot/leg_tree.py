"""Feet and Jacobians of one posture by one call from Python: eight arrays in place of a model, one pass over the links.

A call from Python spends most of its time on handing over a model's arrays one by one, and a named tuple costs twice
as much as a plain one.
"""

from typing import NamedTuple

from surefoot.arrays import Array, Ints
from surefoot.errors import FieldError
from surefoot.kernels.jit import kernel
from surefoot.robot.description import KinematicModel
from surefoot.robot.kinematics import foot_jacobians_of, foot_positions_of, forward

LegArrays = tuple[Ints, Ints, Array, Array, Array, Ints, Array, Ints, int]
"""Arrays of a `LegTree` in its order, and the number of joints."""


class LegTree(NamedTuple):
    """Arrays of a `KinematicModel` that place feet, by the same names and with the same shapes and units."""

    parent: Ints
    joint: Ints
    origin_pos: Array
    origin_rot: Array
    axis: Array
    foot_link: Ints
    foot_point: Array
    leg_joints: Ints


def leg_arrays(model: KinematicModel) -> LegArrays:
    """Return the arrays of a model that place feet, to be kept for many calls of `feet_and_jacobians`."""
    return (*(getattr(model, name) for name in LegTree._fields), len(model.neutral))  # type: ignore[return-value]


def feet_and_jacobians(arrays: LegArrays, q: Array) -> tuple[Array, Array]:
    """Foot centres in base_link, (L, 3) m, and d foot_i / d (joints of leg i), (L, 3, n) m/rad, at angles q (nj,).

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
