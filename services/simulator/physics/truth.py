"""Exact contact forces, sliding and displacement of the feet, and falls: for reports, never for the robot.

A foot stands in a physics step while its normal force is at least `GATE_N`. Sliding is the length of the path of the
material point at the contact, in the ground plane, integrated over those steps:

    s += |(1 - n n') (v_c + w x (-r n))| dt

(v_c velocity of the foot sphere's centre, w angular rate of the link, r radius, n normal of the ground). Most of the
way of a spherical foot's CENTRE is rolling, so both are kept: `displacement` (Walas & Belter's d) and `sliding`.
Every physics step counts: the first milliseconds after touch-down hold a quarter of all sliding of a walk.
"""

# mujoco has no type stubs for its compiled modules:
# pyright: reportAttributeAccessIssue=false
import math
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array, Ints
from surefoot.kernels.jit import kernel
from surefoot.robot.description import Robot

from .addresses import Addresses
from .placing import Displacement
from .twist import TwistTracker

GATE_N = 0.5  # N, a foot stands from this normal force on
LIFT_TICKS = 3  # ticks below the gate that end a stance: a bounce of 20 ms does not
TOUCH_REACH = 1.3  # radii, the site of a touch sensor must enclose the contact
FALL_TILT = math.radians(45.0)
WALL = 0.5  # a normal that rises less than this is a wall's


class FeetTruth(NamedTuple):
    """State of the feet, one entry per foot: views of two tables, which are updated in place and copied as one."""

    force: Array  # (L, 3) N, contact force on the foot, world axes
    centre: Array  # (L, 3) m, foot centre in world
    normal: Array  # (L, 3) of the ground under each foot, last seen
    start: Array  # (L, 3) m, centre at touch-down
    normal_force: Array  # (L,) N
    sliding: Array  # (L,) m, in the present stance
    displacement: Array  # (L,) m, horizontal, in the present stance
    last_sliding: Array  # (L,) m, of the last finished stance
    last_displacement: Array  # (L,) m
    stances: Ints  # (L,) finished stances
    below: Ints  # (L,) ticks since the foot last stood; -1 = in swing, 0 = stood in this tick


def feet_of(table: Array, counts: Ints) -> FeetTruth:
    """Return the state of the feet as views of its two tables.

    `table` (L, 17): force N, centre m, normal, start m (3 columns each), normal force N, sliding and displacement m of
    this stance, sliding and displacement m of the last; `counts` (L, 2): finished stances, ticks since the foot stood.
    """
    return FeetTruth(
        table[:, 0:3], table[:, 3:6], table[:, 6:9], table[:, 9:12], table[:, 12], table[:, 13], table[:, 14],
        table[:, 15], table[:, 16], counts[:, 0], counts[:, 1],
    )  # fmt: skip


_feet_of = kernel(feet_of)


class Contacts(NamedTuple):
    """The C contacts between geoms in one physics step, as arrays of MuJoCo: geoms, axes, places and forces."""

    geom: NDArray[np.int32]  # (C, 2)
    frame: Array  # (C, 9) normal from the first geom to the second, then two tangents
    pos: Array  # (C, 3) m, world
    address: NDArray[np.int32]  # (C,) first row in `efc_force`, -1 = no force
    efc_force: Array  # N


class GeomRoles(NamedTuple):
    """Roles of the geoms of a MuJoCo model: which are one of the P foot spheres, of which foot, and which are belly."""

    sphere_of_geom: Ints  # (ngeom,) -1 = no sphere of a foot
    foot_of_sphere: Ints  # (P,)
    is_belly: NDArray[np.bool_]  # (ngeom,)


class FootBodies(NamedTuple):
    """Body, centre (m, axes of the body) and radius (m) of each of L feet, for kernels."""

    body: Ints  # (L,) body ids
    local: Array  # (L, 3) m, foot centre in the link
    radius: Array  # (L,) m


class SphereSteps(NamedTuple):
    """Touch and motion of the P contact spheres in each physics step of a tick, views of MuJoCo's history."""

    foot_of_sphere: Ints  # (P,)
    touch: Array  # (P, steps) N, normal force
    linear: Array  # (P, 3 steps) m/s, world
    angular: Array  # (P, 3 steps) rad/s, world
    step_s: float  # s, a physics step


def add_sensors(spec: mujoco.MjSpec, robot: Robot, steps: int) -> None:
    """Add the inertial sensors first, then the sensors of force and velocity of each foot sphere, for `TruthTracker`.

    Each sensor holds its samples of the last `steps` physics steps, so that the steps of a tick run in one call.
    """
    sensor, site = mujoco.mjtSensor, mujoco.mjtObj.mjOBJ_SITE
    for name, kind in (("acc", sensor.mjSENS_ACCELEROMETER), ("gyro", sensor.mjSENS_GYRO)):
        spec.add_sensor(name=name, type=kind, objtype=site, objname="imu", nsample=steps)
    names: list[str] = []
    for leg in robot.legs:
        body = spec.body(robot.links[leg.foot.link].name)
        for k, point in enumerate(leg.foot.points):
            names.append(f"truth_{leg.name}_{k}")
            body.add_site(name=names[-1], pos=point, size=[TOUCH_REACH * leg.foot.radius] * 3)
    for kind in (sensor.mjSENS_TOUCH, sensor.mjSENS_FRAMELINVEL, sensor.mjSENS_FRAMEANGVEL):
        for name in names:
            spec.add_sensor(name=f"{name}_{kind.name}", type=kind, objtype=site, objname=name, nsample=steps)


class TruthTracker:
    """Tracker of the true forces, places and slip of the feet of the simulated robot from tick to tick."""

    def __init__(self, robot: Robot, model: mujoco.MjModel, data: mujoco.MjData, addresses: Addresses) -> None:
        n = robot.nlegs
        self._data, self._xpos, self._xmat = data, data.xpos, data.xmat  # views: these arrays never move
        self.trunk = addresses.trunk
        self._bodies = FootBodies(
            addresses.foot_bodies,
            np.array([leg.foot.position for leg in robot.legs]),
            np.array([leg.foot.radius for leg in robot.legs]),
        )
        self.spheres = addresses.foot_geoms[addresses.foot_geoms >= 0]
        sphere_of_geom = np.full(model.ngeom, -1, dtype=np.int64)
        sphere_of_geom[self.spheres] = np.arange(len(self.spheres))
        self.foot_of_sphere = addresses.foot_of_geom[self.spheres]
        self._geoms = GeomRoles(sphere_of_geom, self.foot_of_sphere, np.ascontiguousarray(addresses.is_belly))
        self.contact = np.zeros((n, 6))  # force-weighted contact point and normal of each foot
        self.sphere_force = np.zeros(len(self.spheres))
        self.fallen = False
        self._table, self._counts = _feet_at_rest(n)
        self.feet = feet_of(self._table, self._counts)
        soles = any(len(leg.foot.points) > 1 for leg in robot.legs)
        self.soles = TwistTracker(addresses.foot_bodies) if soles else None
        types = np.array(model.sensor_type)
        sensor = mujoco.mjtSensor
        touch, linear, angular = (
            _window(model, data, int(np.flatnonzero(types == int(kind))[0]), len(self.spheres))
            for kind in (sensor.mjSENS_TOUCH, sensor.mjSENS_FRAMELINVEL, sensor.mjSENS_FRAMEANGVEL)
        )
        self._steps = SphereSteps(self.foot_of_sphere, touch, linear, angular, float(model.opt.timestep))

    def forces(self) -> bool:
        """Read the contact forces of the last physics step into `sphere_force` (N), `feet.force` and `contact`.

        Returns:
            True if the trunk touched the ground.
        """
        c = self._data.contact
        contacts = Contacts(
            np.ascontiguousarray(c.geom), np.ascontiguousarray(c.frame), np.ascontiguousarray(c.pos),
            np.ascontiguousarray(c.efc_address), self._data.efc_force,
        )  # fmt: skip
        return _forces(contacts, self._geoms, self.sphere_force, self.feet.force, self.contact)

    def update(self, first: bool = False) -> None:
        """Update all feet by the state at the end of a tick; the kinematics in the data must belong to that state.

        Args:
            first: True = forget earlier ticks: feet that touch begin their stance here.
        """
        touched = self.forces()
        _feet(self._bodies, self._steps, self._xpos, self._xmat, self.contact, self._table, self._counts, first)
        if self.soles is not None:
            self.soles.update(self._xmat, self.feet.below, first)
        tilted = float(self._xmat[self.trunk, 8]) < math.cos(FALL_TILT)
        self.fallen = (self.fallen and not first) or touched or tilted

    def displaced(self, way: Displacement) -> None:
        """Move the stored places of the feet by a displacement of the robot, which counts as no slip and no twist."""
        self.feet.start[:] = way.of(self.feet.start)
        for normal in self.feet.normal:
            way.turned(normal)
        if self.soles is not None:
            self.soles.start += way.turn

    def feet_now(self) -> FeetTruth:
        """Return a copy of the true state of all feet."""
        return feet_of(self._table.copy(), self._counts.copy())

    def state(self) -> dict[str, Any]:
        """Return the tracked state of the feet as lists, for a checkpoint."""
        soles = {} if self.soles is None else {"soles": self.soles.state()}
        return {"fallen": bool(self.fallen), **{k: v.tolist() for k, v in self.feet._asdict().items()}, **soles}

    def restore(self, state: dict[str, Any]) -> None:
        """Set the tracked state of the feet to a `state` that was returned earlier."""
        self.fallen = bool(state["fallen"])
        for key, array in self.feet._asdict().items():
            array[:] = state[key]
        if self.soles is not None:
            self.soles.restore(state["soles"])


@kernel
def _forces(contacts: Contacts, roles: GeomRoles, sphere_force: Array, force: Array, contact: Array) -> bool:
    """Write the contact forces of a physics step per sphere and per foot; return True if the trunk touched the ground.

    Args:
        contacts: of the step.
        roles: of the geoms.
        sphere_force: result: normal force on each sphere, (P,) N.
        force: result: force on each foot, world axes, (L, 3) N.
        contact: result: place (m) and normal of each foot's contacts, summed with weight N, world, (L, 6).
    """
    geom, frame, pos, address, efc_force = contacts
    sphere_of_geom, foot_of_sphere, is_belly = roles
    sphere_force[:] = 0.0
    force[:] = 0.0
    contact[:] = 0.0
    touched = False
    for i in range(geom.shape[0]):
        if address[i] < 0:
            continue
        a, b = geom[i, 0], geom[i, 1]
        if (is_belly[a] or is_belly[b]) and abs(frame[i, 2]) > WALL:
            touched = True  # on the ground: to lean on a wall is no fall
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
def _feet(
    bodies: FootBodies, steps: SphereSteps, xpos: Array, xmat: Array, contact: Array, table: Array, counts: Ints,
    first: bool,
) -> None:  # fmt: skip
    """Advance the state of the feet by one tick, in place.

    Args:
        bodies: places of the L feet in their links.
        steps: touch and motion of their spheres.
        xpos: places of all bodies, (nbody, 3) m, world.
        xmat: rotations from each body to the world, row by row, (nbody, 9).
        contact: place (m) and normal of each foot's contacts, summed with weight N, world, (L, 6).
        table: (L, 17), written: force, centre, normal, start (3 each), normal force, sliding and displacement, those of
            the last stance.
        counts: (L, 2), written: finished stances, ticks since the foot stood (-1 = in swing).
        first: True = begin anew.
    """
    feet = _feet_of(table, counts)
    for i in range(bodies.body.shape[0]):
        b = bodies.body[i]
        size = 0.0
        for k in range(3):
            size += contact[i, 3 + k] ** 2
            feet.centre[i, k] = xpos[b, k]
            for j in range(3):
                feet.centre[i, k] += xmat[b, 3 * k + j] * bodies.local[i, j]
        size = math.sqrt(size)
        # The normal force lies along the force-weighted mean normal: equal to the sum for one contact per foot.
        feet.normal_force[i] = size
        if size > 0.0:
            for k in range(3):
                feet.normal[i, k] = contact[i, 3 + k] / size
        stood, slid = _slid(steps, feet.normal[i], bodies.radius[i], i)
        if first:
            slid = 0.0
            feet.below[i] = -1
            feet.stances[i] = 0
            feet.last_sliding[i] = 0.0
            feet.last_displacement[i] = 0.0
            feet.sliding[i] = 0.0
            feet.displacement[i] = 0.0
        _stand(feet, i, stood, slid)


@kernel
def _slid(steps: SphereSteps, normal: Array, radius: float, foot: int) -> tuple[bool, float]:
    """Return True if a foot stood in any physics step of a tick, and the distance its contact slid in those steps, m.

    `normal` (3,): unit normal of the ground, world; `radius` of the foot, m; `foot`: its index.
    """
    stood, slid = False, 0.0
    nx, ny, nz = normal[0], normal[1], normal[2]
    for step in range(steps.touch.shape[1]):
        force, vx, vy, vz = 0.0, 0.0, 0.0, 0.0
        for p in range(steps.foot_of_sphere.shape[0]):
            if steps.foot_of_sphere[p] != foot or steps.touch[p, step] <= 0.0:
                continue
            f, c = steps.touch[p, step], 3 * step
            wx, wy, wz = steps.angular[p, c], steps.angular[p, c + 1], steps.angular[p, c + 2]
            force += f
            vx += f * (steps.linear[p, c] - radius * (wy * nz - wz * ny))
            vy += f * (steps.linear[p, c + 1] - radius * (wz * nx - wx * nz))
            vz += f * (steps.linear[p, c + 2] - radius * (wx * ny - wy * nx))
        if force >= GATE_N:
            stood = True
            along = vx * nx + vy * ny + vz * nz
            vx, vy, vz = vx - along * nx, vy - along * ny, vz - along * nz
            slid += math.sqrt(vx * vx + vy * vy + vz * vz) / force * steps.step_s
    return stood, slid


@kernel
def _stand(feet: FeetTruth, i: int, stood: bool, slid: float) -> None:
    """Begin, continue or end the stance of foot i, in place: it `stood` in this tick, and slid by `slid` m.

    A stance ends after three ticks without load.
    """
    if stood:
        if feet.below[i] < 0:
            feet.sliding[i] = 0.0
            for k in range(3):
                feet.start[i, k] = feet.centre[i, k]
        feet.below[i] = 0
        feet.sliding[i] += slid
        feet.displacement[i] = math.hypot(feet.centre[i, 0] - feet.start[i, 0], feet.centre[i, 1] - feet.start[i, 1])
    elif feet.below[i] >= 0:
        feet.below[i] += 1
        if feet.below[i] >= LIFT_TICKS:
            feet.below[i] = -1
            feet.stances[i] += 1
            feet.last_sliding[i] = feet.sliding[i]
            feet.last_displacement[i] = feet.displacement[i]
            feet.sliding[i] = 0.0
            feet.displacement[i] = 0.0


def _window(model: mujoco.MjModel, data: mujoco.MjData, sensor: int, count: int) -> Array:
    """Return a view of the samples of `count` equal sensors in MuJoCo's history, (count, steps x dim).

    `sensor`: index of the first. The history holds per sensor a user value, the cursor, the times and the values.
    """
    steps, dim = int(model.sensor_history[sensor][0]), int(model.sensor_dim[sensor])
    start, width = int(model.sensor_historyadr[sensor]), 2 + steps * (1 + dim)
    return data.history[start : start + count * width].reshape(count, width)[:, 2 + steps :]


def _feet_at_rest(n: int) -> tuple[Array, Ints]:
    """Return the two tables of n feet in swing: (n, 17) forces, places and distances, (n, 2) counts, -1 = in swing."""
    table, counts = np.zeros((n, 17)), np.zeros((n, 2), dtype=np.int64)
    feet = feet_of(table, counts)
    feet.normal[:, 2], feet.below[:] = 1.0, -1
    return table, counts


def rehearse() -> None:
    """Call every kernel of this module once with made-up arguments, so that none is loaded in a tick."""
    one, three = np.zeros(1, dtype=np.int64), np.zeros((1, 3))
    zeros, flags, contact = np.zeros(1), np.zeros(1, dtype=np.bool_), np.zeros((1, 6))
    none = np.zeros((0, 3))
    table, counts = _feet_at_rest(1)
    contacts = Contacts(
        np.zeros((0, 2), dtype=np.int32), np.zeros((0, 9)), none, np.zeros(0, dtype=np.int32), zeros[:0]
    )
    _forces(contacts, GeomRoles(one, one, flags), zeros, table[:, :3], contact)
    strided, two = np.zeros((2, 4))[:, 1:], np.zeros(2, dtype=np.int64)  # as the views of the history are
    steps = SphereSteps(two, strided[:, :1], strided, strided, 1e-3)
    _feet(FootBodies(one, three, zeros), steps, three, np.zeros((1, 9)), contact, table, counts, True)
