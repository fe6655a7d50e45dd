"""The navigation model as records of named numbers, one per action and one for the scene, for kernels and Python."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array, Record, named, record

from .params import KINDS, ActionModel, NavigationModel, mirror_of

ACTION = named(
    "kind forward turn seconds frames match",
    "var_along var_across var_heading var_drift",  # of the true motion
    "filter_heading",  # variance of the heading in the filter: with three states it holds the drift, too
    "range_min range_max cos_half box_at box_half",  # footprint, and the square around it
    "sd_range sd_share sd_bearing tilt_keep mirror late",
)
"""Fields of an action record, SI units, angles in rad.

kind: 0 stand, 1 turn, 2 walk; forward, turn, seconds: expected distance, turn, duration; frames: of the camera; match:
probability that a landmark in view is recognised; var_*: variances of the motion, of the drift (rad per m) and of the
heading in the filter; range_min, range_max, cos_half: sector in view; box_at, box_half: circle ahead that holds it;
sd_*: noise of range (constant, share) and bearing; tilt_keep: share of the tilt error that the next frame has again;
mirror: index of the same action to the other side; late: frames that come after the next decision.
"""
SCENE = named(
    "x_min x_max y_min y_max radius look_ahead",
    "start_x start_y start_yaw goal_x goal_y goal_radius time_limit",
    "density most drift_size drift_normal drift_known start_sd start_yaw_sd",
    "tilt_sd height max_stands max_turns goal_reward gamma course",
)
"""Fields of the scene record (floor, start, goal, noises, limits), SI units, angles in rad.

x_min .. y_max: walls, frame map; radius: of the robot; look_ahead: distance ahead within which a wall blocks; start_*,
goal_*: poses and goal radius; density: landmarks per m^2; most: used of a frame; drift_size, drift_known: heading drift
per m and deviation that the filter expects; drift_normal: 1 = normally distributed, 0 = not; start_sd, start_yaw_sd,
tilt_sd: deviations of start and camera tilt; height: of the camera; max_*: largest numbers in a row; goal_reward;
gamma: discount per action; course of the drift: 0 constant, 1 flip, 2 step, 3 ramp.
"""
STATUS = named("time last stands turns blocked outcome steps way")  # of an episode, or of the live navigator
"""Fields of the counters of a simulated episode or a live navigator.

time (s), index of the last action (-1 = none), stands and turns in a row, blocked (1 = a wall is close ahead), outcome
(0 running, 1 goal reached, 2 cut off), number of actions, distance (m).
"""
STAND, TURNING, WALK = 0, 1, 2  # kinds

COURSES = ("constant", "flip", "step", "ramp")  # of the drift: values of COURSE

RUNNING, REACHED, CUT_OFF = 0, 1, 2  # outcomes

NO_ACTION = -1
PER_10CM = 10.0  # 1/m: from "per 10 cm" to "per m"


class ModelTables(NamedTuple):
    """Arrays of a navigation model that kernels read; SI units, angles in rad."""

    actions: Record
    """Actions of the model, records with the fields of ACTION (kind 0 stand, 1 turn, 2 walk; motion, noise, camera),
    (A,)."""
    scene: Record
    """Record of floor, start, goal, noises and limits with the fields of SCENE, (1,); m, rad, s."""
    switching: Array
    """Extra time of an action of kind j after kind i, (3, 3) s; kinds: 0 stand, 1 turn, 2 walk."""


@dataclass(frozen=True)
class Arrays:
    """A navigation model of a robot as arrays for kernels, with sizes and names of its actions."""

    tables: ModelTables
    """Actions, scene and switching times as arrays for compiled kernels."""
    states: int
    """Number of filter states: 3 (pose), 4 (and drift), or 6 (and pitch and roll error of the camera)."""
    names: tuple[str, ...]
    """Names of the actions, in the order of the action axis, (A,)."""


def arrays(model: NavigationModel) -> Arrays:
    """Return a navigation model as arrays, in SI units, angles in rad: actions, scene, and extra times of changes."""
    scene, sight, drift = model.scene, model.sight, model.drift
    values = record(SCENE)
    values.x_min, values.x_max, values.y_min, values.y_max = scene.x_min, scene.x_max, scene.y_min, scene.y_max
    values.radius, values.look_ahead = scene.robot_radius, scene.look_ahead
    values.start_x, values.start_y, values.start_yaw = scene.start_x, scene.start_y, math.radians(scene.start_yaw_deg)
    values.goal_x, values.goal_y, values.goal_radius, values.time_limit = (
        scene.goal_x,
        scene.goal_y,
        scene.goal_radius,
        scene.time_limit,
    )
    values.density, values.most = scene.landmarks_per_m2, sight.most
    values.drift_size = math.radians(drift.per_10cm_deg) * PER_10CM
    values.drift_normal = drift.kind == "normal"
    values.drift_known = math.radians(drift.known_sd_deg) * PER_10CM
    values.start_sd, values.start_yaw_sd = model.filter.position_sd, math.radians(model.filter.heading_sd_deg)
    values.course = COURSES.index(drift.course)
    values.tilt_sd, values.height = math.radians(sight.tilt_sd_deg), sight.camera_height
    values.max_stands, values.max_turns = model.guards.stands, model.guards.turns
    values.goal_reward, values.gamma = model.reward.goal, model.reward.gamma
    switching = np.array([[model.switching.get(a, {}).get(b, 0.0) for b in KINDS] for a in KINDS])
    names = model.names
    table = np.array([row_of(model, action) for action in model.used], dtype=ACTION)
    table["mirror"] = [names.index(mirror_of(model, name, names)) for name in names]
    states = model.filter.states if sight.tilt_sd_deg == 0 else 6
    return Arrays(ModelTables(table, np.array([values], dtype=SCENE), switching), states, names)


def row_of(model: NavigationModel, action: ActionModel) -> Record:
    """Return an action as a record with the fields of ACTION, SI units, angles in rad; its field `mirror` is 0.

    `mirror`, the index of the action to the other side, depends on the other actions and is set by the caller.
    """
    sight, row = model.sight, record(ACTION)
    moving = action.kind != "stand"
    row.kind, row.forward, row.turn = KINDS.index(action.kind), action.forward, math.radians(action.turn_deg)
    row.seconds, row.frames = action.duration, action.frames
    row.match = action.match * (sight.moving_match_share if moving else 1.0)
    row.var_along, row.var_across = action.along_sd**2, action.across_sd**2
    row.var_heading = math.radians(action.heading_sd_deg) ** 2
    row.var_drift = (math.radians(action.drift_walk_deg) * PER_10CM) ** 2
    unknown = math.radians(model.drift.known_sd_deg) * PER_10CM * action.forward if model.filter.states == 3 else 0.0
    row.filter_heading = row.var_heading + unknown**2
    near = sight.range_min if action.range_min is None else action.range_min
    far = sight.range_max if action.range_max is None else action.range_max
    half = math.radians(sight.half_angle_deg if action.half_angle_deg is None else action.half_angle_deg)
    row.range_min, row.range_max, row.cos_half = near, far, math.cos(half)
    row.box_at, row.box_half = _box(near, far, half)
    share = 1.0 if moving else sight.standing_share
    row.sd_range, row.sd_share = share * sight.range_sd, share * sight.range_sd_share
    row.sd_bearing = share * math.radians(sight.bearing_sd_deg)
    apart = action.duration / action.frames
    keep = sight.tilt_keep if moving or sight.standing_tilt_keep is None else sight.standing_tilt_keep
    row.tilt_keep = keep ** (apart / 0.1) if keep > 0 else 0.0
    row.late = min(action.frames, math.ceil(model.decision_delay / apart - 1e-9))
    return row


def _box(near: float, far: float, half: float) -> tuple[float, float]:
    """Return a circle that holds a sector ahead of the robot: distance of its centre ahead, m, and its radius, m.

    `near`, `far`: radii of the sector, m; `half`: its half angle, rad.
    """
    if half >= math.pi / 2:
        return 0.0, far
    at = 0.5 * (far + near * math.cos(half))
    corners = [math.hypot(r * math.cos(half) - at, r * math.sin(half)) for r in (near, far)]
    return at, max(far - at, *corners)
