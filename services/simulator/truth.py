"""What no robot knows: contact forces, sliding and displacement of the feet, falls. For judging only.

A foot stands while its normal force is at least `GATE_N`. Per control tick and standing foot, the material point of
the foot at the contact moves by dc + dtheta x (p - c) (c foot centre, p contact point, dtheta rotation of the foot
link); its part in the ground plane is sliding. Most of the way of a spherical foot's CENTRE is rolling, so both are
kept: `displacement` (Walas & Belter's d) and `sliding`. Ticks are integrated when the foot stands at both ends, so
less than one tick at each end of a stance is left out.
"""

# mujoco has no type stubs for its compiled modules:
# pyright: reportAttributeAccessIssue=false
import math
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from services.simulator.model import Addresses
from surefoot.jit import kernel
from surefoot.robot import Robot

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

GATE_N = 0.5  # N, a foot stands from this normal force on
LIFT_TICKS = 3  # ticks below the gate that end a stance: a bounce of 20 ms does not
FALL_TILT = math.radians(45.0)


class FeetTruth(NamedTuple):
    """State of the feet, one row per foot; arrays are updated in place."""

    force: Array  # (L, 3) N, contact force on the foot, world axes
    normal_force: Array  # (L,) N
    centre: Array  # (L, 3) m, foot centre in world
    rot: Array  # (L, 9) rot_world_from_link, row by row
    start: Array  # (L, 3) m, centre at touch-down
    sliding: Array  # (L,) m, in the present stance
    displacement: Array  # (L,) m, horizontal, in the present stance
    last_sliding: Array  # (L,) m, of the last finished stance
    last_displacement: Array  # (L,) m
    stances: Ints  # (L,) finished stances
    below: Ints  # (L,) ticks since the force fell below the gate; -1 = in swing, 0 = stands


class TruthTracker:
    """Follows the feet from tick to tick."""

    def __init__(self, robot: Robot, model: mujoco.MjModel, addresses: Addresses) -> None:
        n = robot.nlegs
        self.trunk = addresses.trunk
        self.bodies = addresses.foot_bodies
        self.local = np.array([leg.foot.position for leg in robot.legs])
        self.spheres = addresses.foot_geoms[addresses.foot_geoms >= 0]
        self.sphere_of_geom = np.full(model.ngeom, -1, dtype=np.int64)
        self.sphere_of_geom[self.spheres] = np.arange(len(self.spheres))
        self.foot_of_sphere = addresses.foot_of_geom[self.spheres]
        self.is_belly = np.ascontiguousarray(addresses.is_belly)
        self.contact = np.zeros((n, 6))  # force-weighted contact point and normal of each foot
        self.sphere_force = np.zeros(len(self.spheres))
        self.fallen = False
        self.feet = FeetTruth(
            np.zeros((n, 3)), np.zeros(n), np.zeros((n, 3)), np.zeros((n, 9)), np.zeros((n, 3)), np.zeros(n),
            np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n, dtype=np.int64), np.full(n, -1, dtype=np.int64),
        )  # fmt: skip

    def forces(self, data: mujoco.MjData) -> bool:
        """Read the contact forces of the last physics step.

        Fills `sphere_force` (normal force per contact sphere, N), `feet.force` and `contact`.

        Returns:
            Whether the trunk touched the ground.
        """
        contact = data.contact
        return _forces(
            np.ascontiguousarray(contact.geom),
            np.ascontiguousarray(contact.frame),
            np.ascontiguousarray(contact.pos),
            np.ascontiguousarray(contact.efc_address),
            data.efc_force,
            self.sphere_of_geom,
            self.foot_of_sphere,
            self.is_belly,
            self.sphere_force,
            self.feet.force,
            self.contact,
        )

    def update(self, data: mujoco.MjData, first: bool = False) -> None:
        """Take the state at the end of a tick; kinematics of `data` must belong to it.

        Args:
            data: after the last physics step of the tick and `mj_kinematics`.
            first: begin anew: feet that touch begin their stance here.
        """
        touched = self.forces(data)
        xmat = data.xmat
        _feet(data.xpos, xmat, self.bodies, self.local, self.contact, self.feet, first)
        tilted = float(xmat[self.trunk, 8]) < math.cos(FALL_TILT)
        self.fallen = (self.fallen and not first) or touched or tilted

    def state(self) -> dict[str, Any]:
        """All arrays as lists."""
        return {"fallen": bool(self.fallen), **{k: v.tolist() for k, v in self.feet._asdict().items()}}

    def restore(self, state: dict[str, Any]) -> None:
        """Continue where `state` was taken."""
        self.fallen = bool(state["fallen"])
        for key, array in self.feet._asdict().items():
            array[:] = state[key]


@kernel
def _forces(
    geom: NDArray[np.int32],
    frame: Array,
    pos: Array,
    address: NDArray[np.int32],
    efc_force: Array,
    sphere_of_geom: Ints,
    foot_of_sphere: Ints,
    is_belly: NDArray[np.bool_],
    sphere_force: Array,
    force: Array,
    contact: Array,
) -> bool:
    sphere_force[:] = 0.0
    force[:] = 0.0
    contact[:] = 0.0
    touched = False
    for i in range(geom.shape[0]):
        if address[i] < 0:
            continue
        a, b = geom[i, 0], geom[i, 1]
        if is_belly[a] or is_belly[b]:
            touched = True
        sign = 1.0  # the normal points from the first geom to the second
        sphere = sphere_of_geom[b]
        if sphere < 0:
            sphere = sphere_of_geom[a]
            sign = -1.0
        if sphere < 0:
            continue
        foot = foot_of_sphere[sphere]
        normal_force = efc_force[address[i]]
        sphere_force[sphere] += normal_force
        for k in range(3):
            for row in range(3):
                force[foot, k] += sign * frame[i, 3 * row + k] * efc_force[address[i] + row]
            contact[foot, k] += normal_force * pos[i, k]
            contact[foot, 3 + k] += normal_force * sign * frame[i, k]
    return touched


@kernel
def _feet(xpos: Array, xmat: Array, bodies: Ints, local: Array, contact: Array, feet: FeetTruth, first: bool) -> None:
    theta = np.empty(3)
    move = np.empty(3)
    normal = np.empty(3)
    arm = np.empty(3)
    for i in range(bodies.shape[0]):
        b = bodies[i]
        size = 0.0
        for k in range(3):
            normal[k] = contact[i, 3 + k]
            size += normal[k] * normal[k]
        size = math.sqrt(size)
        # The normal force is along the force-weighted mean normal: equal to the sum for one contact per foot.
        feet.normal_force[i] = size
        stands = size >= GATE_N
        rot_now = xmat[b]
        rot_then = feet.rot[i]
        for k in range(3):
            centre = xpos[b, k]
            for j in range(3):
                centre += rot_now[3 * k + j] * local[i, j]
            move[k] = centre - feet.centre[i, k]
            feet.centre[i, k] = centre
        if stands and feet.below[i] == 0 and not first:
            # rotation vector of R_now R_then': small, so twice the skew part is exact to the third order
            for k in range(3):
                u, v = (k + 1) % 3, (k + 2) % 3
                vu = 0.0
                uv = 0.0
                for j in range(3):
                    vu += rot_now[3 * v + j] * rot_then[3 * u + j]
                    uv += rot_now[3 * u + j] * rot_then[3 * v + j]
                theta[k] = 0.5 * (vu - uv)
                arm[k] = contact[i, k] / size - feet.centre[i, k]
                normal[k] /= size
            move[0] += theta[1] * arm[2] - theta[2] * arm[1]
            move[1] += theta[2] * arm[0] - theta[0] * arm[2]
            move[2] += theta[0] * arm[1] - theta[1] * arm[0]
            along = move[0] * normal[0] + move[1] * normal[1] + move[2] * normal[2]
            slid = 0.0
            for k in range(3):
                slid += (move[k] - along * normal[k]) ** 2
            feet.sliding[i] += math.sqrt(slid)
        for k in range(9):
            rot_then[k] = rot_now[k]
        if first:
            feet.below[i] = -1
            feet.stances[i] = 0
            feet.last_sliding[i] = 0.0
            feet.last_displacement[i] = 0.0
            feet.sliding[i] = 0.0
            feet.displacement[i] = 0.0
        if stands:
            if feet.below[i] < 0:
                feet.sliding[i] = 0.0
                for k in range(3):
                    feet.start[i, k] = feet.centre[i, k]
            feet.below[i] = 0
            feet.displacement[i] = math.hypot(
                feet.centre[i, 0] - feet.start[i, 0], feet.centre[i, 1] - feet.start[i, 1]
            )
        elif feet.below[i] >= 0:
            feet.below[i] += 1
            if feet.below[i] >= LIFT_TICKS:
                feet.below[i] = -1
                feet.stances[i] += 1
                feet.last_sliding[i] = feet.sliding[i]
                feet.last_displacement[i] = feet.displacement[i]
                feet.sliding[i] = 0.0
                feet.displacement[i] = 0.0


def warm() -> None:
    """Compile the kernels."""
    one, three = np.zeros(1, dtype=np.int64), np.zeros((1, 3))
    zeros, flags, contact = np.zeros(1), np.zeros(1, dtype=np.bool_), np.zeros((1, 6))
    none = np.zeros((0, 3))
    _forces(
        np.zeros((0, 2), dtype=np.int32), np.zeros((0, 9)), none, np.zeros(0, dtype=np.int32), zeros[:0], one, one,
        flags, zeros, three, contact,
    )  # fmt: skip
    copies = (np.zeros(1) for _ in range(8))
    feet = FeetTruth(
        np.zeros((1, 3)), next(copies), np.zeros((1, 3)), np.zeros((1, 9)), np.zeros((1, 3)), next(copies),
        next(copies), next(copies), next(copies), np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64),
    )  # fmt: skip
    _feet(np.zeros((1, 3)), np.zeros((1, 9)), one, np.zeros((1, 3)), contact, feet, True)
