"""Trials on ground primitives (Walas & Belter 2011, section 3.1): one shape under each stance foot, one stroke.

Each trial has a world of its own, so the running one is not disturbed. The robot is put down with its feet over the
primitives; with `tripod` three legs are lifted then; the trunk moves forward by the stroke, and the trial shows whether
the feet stay. A robot that slips before the stroke begins is a result, too.
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.geometry.heightmap import HeightMap
from surefoot.geometry.linear import exp
from surefoot.robot import kinematics
from surefoot.robot.description import Robot
from surefoot.schemas.sim import FootOutcome, PrimitiveTrial, TrialOutcome

from .ground.grid import TerrainBox, random_stream
from .ground.terrain import Terrain
from .physics.model import Physics
from .world import PhysicsWorld, WorldConfig, WorldError

GROUND_CELL = 0.005  # m
BORDER = 0.15  # m of ground around the feet
SIGMA = 0.02  # m, size of hill, ridge, hole and groove, as of the terrain `primitive`
SLOPE_REACH = 0.1  # m over which a slope rises by its height
EDGE_HALF = 0.04  # m, half the edge of the box behind a step edge
LIFT_M, LIFT_TICKS, STROKE_TICKS, REST_TICKS = 0.03, 40, 100, 20


def outcome_of(robot: Robot, trial: PrimitiveTrial) -> TrialOutcome:
    """Return the outcome of a trial on a ground primitive; equal arguments give equal numbers."""
    neutral = kinematics.foot_positions(robot.model, robot.neutral)
    try:
        ground = primitive_ground(neutral[:, :2], trial)
        physics = Physics(friction=trial.friction)
        world = PhysicsWorld(robot, ground, trial.seed, WorldConfig(physics=physics, must_rest=False))
    except WorldError as error:
        return TrialOutcome(status="impossible", reason=str(error))
    legs = list(range(robot.nlegs)) if trial.stance == "six" else _tripod(robot)
    before = np.hypot(*(world.truth().foot_position - neutral)[:, :2].T)
    targets = neutral.copy()
    others = [leg for leg in range(robot.nlegs) if leg not in legs]
    if others:
        _move(world, robot, targets, others, np.array([0.0, 0.0, LIFT_M]), LIFT_TICKS)
    feet = world.tracker.feet
    begin = feet.centre.copy()
    before = np.maximum(before, np.hypot(*(begin - neutral)[:, :2].T))
    started, fell = feet.sliding.copy(), world.truth().fallen
    loads = np.zeros(robot.nlegs)
    loads += _move(world, robot, targets, legs, np.array([-trial.stroke, 0.0, 0.0]), STROKE_TICKS)
    truth = world.truth()
    slid = np.where(feet.sliding >= started, feet.sliding - started, feet.sliding)
    moved = np.hypot(*(truth.foot_position - begin)[:, :2].T)
    found = tuple(
        FootOutcome(
            leg=robot.leg_names[leg], sliding=float(max(slid[leg], 0.0)), displacement=float(moved[leg]),
            before=float(before[leg]), load=float(loads[leg]),
            contact=(float(begin[leg, 0]), float(begin[leg, 1]), float(begin[leg, 2])),
        )
        for leg in legs
    )  # fmt: skip
    if world.diverged or truth.fallen:
        when = "before" if fell else "in"
        return TrialOutcome(status="fallen", feet=found, reason=world.diverged or f"the robot fell {when} the stroke")
    worst = max(each.before for each in found)
    if worst > trial.stroke:
        return TrialOutcome(status="slipped", feet=found, reason=f"a foot slid {1e3 * worst:.0f} mm before the stroke")
    return TrialOutcome(status="ok", feet=found)


def primitive_ground(feet: Array, trial: PrimitiveTrial) -> Terrain:
    """Return ground with the primitive of a trial under every foot; each cell belongs to the nearest foot.

    Args:
        feet: places of the feet, x and y, (n, 2) m, map.
        trial: the primitive, and how far off its middle the feet are.
    """
    low, high = feet.min(axis=0) - BORDER, feet.max(axis=0) + BORDER
    nx, ny = (math.ceil(size / GROUND_CELL) + 1 for size in (high - low).tolist())
    x, y = low[0] + GROUND_CELL * np.arange(nx)[None, :], low[1] + GROUND_CELL * np.arange(ny)[:, None]
    off = (trial.offset * math.cos(trial.offset_yaw), trial.offset * math.sin(trial.offset_yaw))
    away = np.stack([(x - fx) ** 2 + (y - fy) ** 2 for fx, fy in feet.tolist()])
    nearest = away.argmin(axis=0)
    dx, dy = x - feet[nearest, 0] + off[0], y - feet[nearest, 1] + off[1]
    c, s = math.cos(trial.yaw), math.sin(trial.yaw)
    u, v, h = c * dx + s * dy, c * dy - s * dx, trial.height
    z = np.zeros((ny, nx))
    match trial.primitive:
        case "slope":
            z = h * np.clip(u / SLOPE_REACH, -1.0, 1.0)
        case "hill" | "hole":
            z = (h if trial.primitive == "hill" else -h) * exp(-0.5 * (u * u + v * v) / SIGMA**2)
        case "ridge" | "groove":
            z = (h if trial.primitive == "ridge" else -h) * exp(-0.5 * (v / SIGMA) ** 2)
        case "edge" | "flat":
            pass
    if trial.noise > 0.0:
        z = z + trial.noise * random_stream(trial.seed, "experiment/noise").standard_normal(z.shape)
    boxes: tuple[TerrainBox, ...] = ()
    surface = z
    if trial.primitive == "edge" and h > 0.0:
        boxes = tuple(_step(fx - off[0], fy - off[1], trial) for fx, fy in feet.tolist())
        surface = np.where((u >= 0.0) & (u <= 2.0 * EDGE_HALF) & (np.abs(v) <= EDGE_HALF), np.maximum(z, h), z)
    origin = (float(low[0]), float(low[1]))
    field = HeightMap(z=z.astype(np.float32), cell=GROUND_CELL, origin=origin)
    return Terrain("experiment", trial.seed, h, field.with_z(surface.astype(np.float32)), field, boxes=boxes)


def _step(x: float, y: float, trial: PrimitiveTrial) -> TerrainBox:
    """Return the box behind a step edge through (x, y) m, map."""
    c, s, half = math.cos(trial.yaw), math.sin(trial.yaw), 0.5 * trial.height + 0.005
    centre = (x + EDGE_HALF * c, y + EDGE_HALF * s, trial.height - half)
    return TerrainBox(
        centre, (EDGE_HALF, EDGE_HALF, half), (math.cos(0.5 * trial.yaw), 0.0, 0.0, math.sin(0.5 * trial.yaw))
    )


def _tripod(robot: Robot) -> list[int]:
    """Return the legs of one tripod: every second one around the trunk."""
    angles = [math.atan2(leg[1], leg[0]) for leg in kinematics.foot_positions(robot.model, robot.neutral)]
    around = sorted(range(robot.nlegs), key=lambda leg: angles[leg])
    return sorted(around[::2])


def _move(
    world: PhysicsWorld, robot: Robot, targets: Array, legs: list[int], way: Array, ticks: int
) -> NDArray[np.float64]:
    """Move feet of `legs` evenly by `way` (3,) m, base_link, in `ticks` ticks, then rest; return mean loads, (L,) N.

    `targets` (L, 3) m: places of all feet in base_link, changed. The loads are normal forces.
    """
    start, load = targets[legs].copy(), np.zeros(robot.nlegs)
    for tick in range(ticks + REST_TICKS):
        targets[legs] = start + min(1.0, (tick + 1) / ticks) * way
        joints, _ = kinematics.legs_ik(robot.model, targets)
        world.step_tick(joints)
        load += world.tracker.feet.normal_force
    return load / (ticks + REST_TICKS)
