"""The navigation model as plain arrays for kernels: one row per action, columns named here."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array

from .params import KINDS, ActionModel, NavigationModel, mirror_of

# columns of an action
KIND, FORWARD, TURN, SECONDS, FRAMES, MATCH = 0, 1, 2, 3, 4, 5
VAR_ALONG, VAR_ACROSS, VAR_HEADING, VAR_DRIFT = 6, 7, 8, 9  # of the true motion
FILTER_HEADING = 10  # variance of the heading in the filter: with three states it holds the drift, too
RANGE_MIN, RANGE_MAX, COS_HALF, BOX_AT, BOX_HALF = 11, 12, 13, 14, 15  # footprint, and the square around it
SD_RANGE, SD_SHARE, SD_BEARING, TILT_KEEP, MIRROR, LATE = 16, 17, 18, 19, 20, 21
COLUMNS = 22

STAND, TURNING, WALK = 0, 1, 2  # kinds

# elements of the scene
X_MIN, X_MAX, Y_MIN, Y_MAX, RADIUS, LOOK_AHEAD = 0, 1, 2, 3, 4, 5
START_X, START_Y, START_YAW, GOAL_X, GOAL_Y, GOAL_RADIUS, TIME_LIMIT = 6, 7, 8, 9, 10, 11, 12
DENSITY, MOST, DRIFT_SIZE, DRIFT_NORMAL, DRIFT_KNOWN, START_SD, START_YAW_SD = 13, 14, 15, 16, 17, 18, 19
TILT_SD, HEIGHT, MAX_STANDS, MAX_TURNS, GOAL_REWARD, GAMMA, COURSE = 20, 21, 22, 23, 24, 25, 26
ELEMENTS = 27
COURSES = ("constant", "flip", "step", "ramp")  # of the drift: values of COURSE

# elements of the status of an episode, or of the live navigator
TIME, LAST, STANDS, TURNS, BLOCKED, OUTCOME, STEPS, WAY = 0, 1, 2, 3, 4, 5, 6, 7
STATUS = 8
RUNNING, REACHED, CUT_OFF = 0, 1, 2  # outcomes

NO_ACTION = -1
PER_10CM = 10.0  # 1/m: from "per 10 cm" to "per m"


class ModelTables(NamedTuple):
    """Arrays of a navigation model that kernels read."""

    actions: Array
    """Columns `COLUMNS` of each action, (A, COLUMNS), one row per action, SI units, angles in rad."""
    scene: Array
    """Floor, start, goal, noises and guards, (ELEMENTS,); m, rad, s."""
    switching: Array
    """Extra time of an action of kind j after kind i, (3, 3) s, order STAND, TURNING, WALK."""


@dataclass(frozen=True)
class Arrays:
    """A `NavigationModel` as arrays, with names and sizes."""

    tables: ModelTables
    """Arrays that kernels read."""
    groups: NDArray[np.int64]
    """Index of the rows of `switching` that are alike, (3,): the part of the last action that a planner remembers."""
    states: int
    """Number of states of the filter, nuisances included."""
    names: tuple[str, ...]
    """Names of the actions, (A,)."""

    @property
    def actions(self) -> Array:
        """Actions of the model, one row each, (A, COLUMNS)."""
        return self.tables.actions

    @property
    def scene(self) -> Array:
        """Elements of the scene, (ELEMENTS,)."""
        return self.tables.scene

    @property
    def switching(self) -> Array:
        """Extra time of an action of kind j after kind i, s, (3, 3)."""
        return self.tables.switching


def arrays(model: NavigationModel) -> Arrays:
    """Return a model as arrays, SI, angles in rad: scene (ELEMENTS,), actions (A, COLUMNS), switching (3, 3) s."""
    scene, sight, drift = model.scene, model.sight, model.drift
    values = np.zeros(ELEMENTS)
    values[[X_MIN, X_MAX, Y_MIN, Y_MAX]] = scene.x_min, scene.x_max, scene.y_min, scene.y_max
    values[[RADIUS, LOOK_AHEAD]] = scene.robot_radius, scene.look_ahead
    values[[START_X, START_Y, START_YAW]] = scene.start_x, scene.start_y, math.radians(scene.start_yaw_deg)
    values[[GOAL_X, GOAL_Y, GOAL_RADIUS, TIME_LIMIT]] = scene.goal_x, scene.goal_y, scene.goal_radius, scene.time_limit
    values[[DENSITY, MOST]] = scene.landmarks_per_m2, sight.most
    values[DRIFT_SIZE] = math.radians(drift.per_10cm_deg) * PER_10CM
    values[DRIFT_NORMAL] = drift.kind == "normal"
    values[DRIFT_KNOWN] = math.radians(drift.known_sd_deg) * PER_10CM
    values[[START_SD, START_YAW_SD]] = model.filter.position_sd, math.radians(model.filter.heading_sd_deg)
    values[COURSE] = COURSES.index(drift.course)
    values[[TILT_SD, HEIGHT]] = math.radians(sight.tilt_sd_deg), sight.camera_height
    values[[MAX_STANDS, MAX_TURNS]] = model.guards.stands, model.guards.turns
    values[[GOAL_REWARD, GAMMA]] = model.reward.goal, model.reward.gamma
    switching = np.array([[model.switching.get(a, {}).get(b, 0.0) for b in KINDS] for a in KINDS])
    rows = [tuple(row) for row in switching]
    distinct = list(dict.fromkeys(rows))
    names = model.names
    table = np.array([_row(model, action) for action in model.used])
    table[:, MIRROR] = [names.index(mirror_of(model, name, names)) for name in names]
    states = model.filter.states if sight.tilt_sd_deg == 0 else 6
    groups = np.array([distinct.index(row) for row in rows], dtype=np.int64)
    return Arrays(ModelTables(table, values, switching), groups, states, names)


def _row(model: NavigationModel, action: ActionModel) -> Array:
    sight, row = model.sight, np.zeros(COLUMNS)
    moving = action.kind != "stand"
    row[[KIND, FORWARD, TURN]] = KINDS.index(action.kind), action.forward, math.radians(action.turn_deg)
    row[[SECONDS, FRAMES]] = action.duration, action.frames
    row[MATCH] = action.match * (sight.moving_match_share if moving else 1.0)
    row[VAR_ALONG], row[VAR_ACROSS] = action.along_sd**2, action.across_sd**2
    row[VAR_HEADING] = math.radians(action.heading_sd_deg) ** 2
    row[VAR_DRIFT] = (math.radians(action.drift_walk_deg) * PER_10CM) ** 2
    unknown = math.radians(model.drift.known_sd_deg) * PER_10CM * action.forward if model.filter.states == 3 else 0.0
    row[FILTER_HEADING] = row[VAR_HEADING] + unknown**2
    near = sight.range_min if action.range_min is None else action.range_min
    far = sight.range_max if action.range_max is None else action.range_max
    half = math.radians(sight.half_angle_deg if action.half_angle_deg is None else action.half_angle_deg)
    row[[RANGE_MIN, RANGE_MAX, COS_HALF]] = near, far, math.cos(half)
    row[BOX_AT], row[BOX_HALF] = _box(near, far, half)
    share = 1.0 if moving else sight.standing_share
    row[SD_RANGE], row[SD_SHARE] = share * sight.range_sd, share * sight.range_sd_share
    row[SD_BEARING] = share * math.radians(sight.bearing_sd_deg)
    apart = action.duration / action.frames
    row[TILT_KEEP] = sight.tilt_keep ** (apart / 0.1) if sight.tilt_keep > 0 else 0.0
    row[LATE] = min(action.frames, math.ceil(model.decision_delay / apart - 1e-9))
    return row


def _box(near: float, far: float, half: float) -> tuple[float, float]:
    """Return how far ahead the centre of a sector lies, and the radius of a circle around it that holds the sector."""
    if half >= math.pi / 2:
        return 0.0, far
    at = 0.5 * (far + near * math.cos(half))
    corners = [math.hypot(r * math.cos(half) - at, r * math.sin(half)) for r in (near, far)]
    return at, max(far - at, *corners)
