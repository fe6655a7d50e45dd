"""Time series of a run as arrays, collected from its messages one at a time, live or from a recording."""

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from surefoot.arrays import Array
from surefoot.errors import Refusal, SurefootError
from surefoot.geometry.linear import product
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.record.recording import read_recording

from ..scene.sights import SightKeeper

VARIANTS = ("imu", "kinematics", "kinematics_gyro", "ekf", "best")
KEYS = (
    "sim/truth",
    "state/velocity",
    *(f"state/velocity/{name}" for name in VARIANTS),
    "state/odometry",
    "state/gait",
    "state/stability",
    "state/pose",
    "navigator/feedback",
    "hw/image",
    "state/landmarks",
)
"""Topic keys whose messages are collected as time series of a run; messages of other keys are ignored."""


@dataclass(frozen=True)
class StanceTrace:
    """Finished stance of a foot: end time (s), foot index, slide of its contact point (m), place (x, y in m).

    The place is in the world, or in odom if the run has no truth.
    """

    time: float
    foot: int
    sliding: float
    place: tuple[float, float]
    twist: float | None = None
    """Turn of the sole about the vertical during the stance, rad; None for a point foot."""


@dataclass(frozen=True)
class Mark:
    """Event marked in the report of a run: time, s, and description in words."""

    time: float
    text: str


@dataclass(frozen=True)
class DecisionTrace:
    """Decision of the navigator: time (s), action, reason, and value of each allowed action.

    Features of the decision: distance (m) and bearing (rad) of the goal, and entropy of the believed pose (nats).
    """

    time: float
    action: str
    reason: str
    values: dict[str, float]
    distance: float
    bearing: float
    entropy: float


@dataclass(frozen=True)
class GoalEnd:
    """End of a goal: time (s), state, place (x, y in the map, m), error code, duration (s), recoveries."""

    time: float
    state: str
    place: tuple[float, float]
    error: str
    seconds: float
    recoveries: int


@dataclass
class Traces:
    """Time series of the messages of one epoch; a message of a later epoch, after a reset, clears them."""

    epoch: int = -1
    rows: dict[str, list[tuple[float, ...]]] = field(default_factory=dict)
    """One row of numbers per message, by topic key; the first column is the simulated time, s."""
    stances: list[StanceTrace] = field(default_factory=list)
    events: list[Mark] = field(default_factory=list)
    choices: list[DecisionTrace] = field(default_factory=list)
    goals: list[GoalEnd] = field(default_factory=list)
    sights: SightKeeper = field(default_factory=SightKeeper)
    ground: tuple[Array, float, tuple[float, float]] | None = None
    """Elevation map given to the robot, m: heights (ny, nx), cell size, centre (x, y) of cell [0, 0]; None = no map."""
    fallen_at: float | None = None
    touches: int | None = None
    """Number of times at which the robot began to touch an obstacle; None = the world has no obstacles."""
    last_tick: int = -1
    refused: bool = False
    """True if some messages could not be decoded and are missing here, False if all were."""
    _finished: tuple[int, ...] = ()
    _gait: tuple[str, str] = ("", "")
    _touching: bool = False
    _decided: int = 0
    _goal: tuple[str, str] = ("", "")

    def feed(self, key: str, message: Any) -> None:
        """Add a message to the series; keys that have no series, and earlier epochs, are ignored."""
        reader = _READERS.get(key)
        if reader is None or message.epoch < self.epoch:
            return
        if message.epoch > self.epoch:
            self._begin(message.epoch)
        if key != "terrain/map":
            self.last_tick = max(self.last_tick, message.tick)
        reader(self, key, message)

    def series(self, key: str) -> Array:
        """Return the rows of a key, one per message, (n, columns), first the time in s; (0, 1) when there are none."""
        rows = self.rows.get(key)
        return np.array(rows) if rows else np.empty((0, 1))

    def note(self, time: float, text: str) -> None:
        """Add an event of the run, in words, at a time in s."""
        self.events.append(Mark(time, text))

    def _begin(self, epoch: int) -> None:
        self.epoch = epoch
        self.rows.clear()
        self.stances.clear()
        self.events.clear()
        self.choices.clear()
        self.goals.clear()
        self.sights = SightKeeper()
        self._decided, self._goal = 0, ("", "")
        self.fallen_at, self.last_tick, self._finished, self._gait = None, -1, (), ("", "")
        self.touches, self._touching = None, False

    def _row(self, key: str, message: Any, *values: float) -> float:
        time = message.stamp_ns * 1e-9
        self.rows.setdefault(key, []).append((time, *values))
        return time

    def _truth(self, key: str, m: Any) -> None:
        """Add a row: time s, position m (3, world), velocity m/s (3, base_link), yaw, tilt rad, CoM m (3, world)."""
        rot_world_from_base = matrix_from_quat(np.array(m.quat_wxyz))
        velocity = product(rot_world_from_base.T, np.array(m.velocity))
        yaw = math.atan2(rot_world_from_base[1, 0], rot_world_from_base[0, 0])
        time = self._row(key, m, *m.position, *velocity, yaw, m.tilt, *m.com)
        if m.fallen and self.fallen_at is None:
            self.fallen_at = time
            self.note(time, "falls")
        if m.touching is not None:
            self.touches = (self.touches or 0) + (m.touching and not self._touching)
            self._touching = m.touching
        before = self._finished or (0,) * len(m.stances)
        for foot, (count, old) in enumerate(zip(m.stances, before, strict=True)):
            if count > old:
                twist = m.stance_twist[foot] if m.stance_twist else None
                self.stances.append(
                    StanceTrace(time, foot, m.stance_sliding[foot], tuple(m.foot_position[foot][:2]), twist)
                )
        self._finished = tuple(m.stances)

    def _velocity(self, key: str, m: Any) -> None:
        """Add a row: time s, velocity m/s (3, base_link axes), 1 = initialised, deviations m/s (3), NIS."""
        variance = np.maximum(np.array(m.covariance).reshape(6, 6).diagonal()[3:], 0.0)
        self._row(key, m, *m.velocity, float(m.initialised), *np.sqrt(variance), np.nan if m.nis is None else m.nis)

    def _odometry(self, key: str, m: Any) -> None:
        """Add a row: time s, position m (3, odom), yaw rad, standard deviations of x and y m, 1 = initialised.

        Without `sim/truth` the stances in the message are added too; after `state/landmarks`, its pose to the sights.
        """
        variance = np.maximum(np.array(m.covariance).reshape(4, 4).diagonal(), 0.0)
        time = self._row(key, m, *m.position, m.yaw, *np.sqrt(variance[:2]), float(m.initialised))
        if "state/landmarks" in self.rows:
            self.sights.moved(m)
        if "sim/truth" not in self.rows:  # what the robot measured itself is all there is
            self.stances += [StanceTrace(time, s.foot, s.slip, tuple(s.begin[:2])) for s in m.stances]

    def _gait_state(self, key: str, m: Any) -> None:
        """Add a row: time s, rest to go m or rad, margin of the last step m, steps, feet in stance, 1 = waiting."""
        margin = np.nan if m.margin is None else m.margin
        waiting = float(m.state == "waiting")
        time = self._row(key, m, m.remaining, margin, m.steps, float(sum(m.stance)), waiting)
        now = (m.state, m.reason)
        if now != self._gait:
            if m.reason and m.reason != self._gait[1]:
                self.note(time, m.reason)
            self._gait = now

    def _stability(self, key: str, m: Any) -> None:
        """Add a row of stability: time, s, margins of the planned and of the measured CoM, m (NaN = none)."""
        planned, measured = (np.nan if margin is None else margin for margin in (m.margin_planned, m.margin_measured))
        self._row(key, m, planned, measured)

    def _pose(self, key: str, m: Any) -> None:
        """Add a row: time s, x, y m, yaw rad (map), covariance (9), entropy nats, drift, its sd, matched, P(lost)."""
        lost = m.lost_probability
        time = self._row(key, m, *m.pose, *m.covariance, m.entropy, m.drift, m.drift_sd, m.matched, lost)
        self.sights.believed(m)
        if m.lost and m.lost_reason and m.lost_reason not in {event.text for event in self.events}:
            self.note(time, m.lost_reason)

    def _feedback(self, key: str, m: Any) -> None:
        """Add a row of a goal's feedback: time, s, and distance remaining, m; note its decisions and its end."""
        time = self._row(key, m, m.distance_remaining)
        d = m.decision
        if d is not None and d.number != self._decided:
            self._decided = d.number
            self.choices.append(
                DecisionTrace(time, d.action, d.reason, dict(d.values), d.distance, d.bearing, d.entropy)
            )
        now = (m.goal_id, m.state)
        if now != self._goal and m.goal_pose is not None and m.state in ("succeeded", "failed", "cancelled"):
            self.note(time, f"goal {m.goal_id} {m.state} {m.error_code}".rstrip())
            self.goals.append(
                GoalEnd(time, m.state, tuple(m.goal_pose), m.error_code, m.navigation_time, m.number_of_recoveries)
            )
        self._goal = now

    def _image(self, key: str, m: Any) -> None:
        self.sights.image(m)

    def _landmarks(self, key: str, m: Any) -> None:
        """Add a row for a new image: time s, counts of features, of those with a candidate, and of those recognised."""
        if m.fresh:
            self._row(key, m, m.features, m.compared, m.recognised)
            self.sights.landmarks(m, self.choices[-1].action if self.choices else "")

    def _map(self, key: str, m: Any) -> None:
        heights = np.frombuffer(m.data, dtype="<f4").reshape(m.rows, m.cols).astype(np.float64)
        self.ground = (heights, m.cell, tuple(m.origin))


_READERS = {
    "sim/truth": Traces._truth,
    "state/odometry": Traces._odometry,
    "state/gait": Traces._gait_state,
    "state/stability": Traces._stability,
    "state/pose": Traces._pose,
    "navigator/feedback": Traces._feedback,
    "hw/image": Traces._image,
    "state/landmarks": Traces._landmarks,
    "terrain/map": Traces._map,
    **{key: Traces._velocity for key in KEYS if key.startswith("state/velocity")},
}


class KeptMessage(Protocol):
    """Encoded message as received from the bus or read from a recording."""

    @property
    def key(self) -> str:
        """Key of the topic of the kept message."""
        ...

    def message(self) -> Any:
        """Return the decoded message (raises Refusal if its bytes are invalid)."""
        ...


def read_traces(kept: Iterable[KeptMessage], notes: Iterable[tuple[float, str]] = ()) -> Traces:
    """Return the traces of a run from its messages; `notes`: events to add, simulated time (s) and text."""
    traces, first, refused = Traces(), dict[str, str](), Counter[str]()
    for item in kept:
        try:
            traces.feed(item.key, item.message())
        except Refusal as refusal:
            first.setdefault(item.key, refusal.message)
            refused[item.key] += 1
    traces.refused = bool(refused)
    for key, count in refused.items():
        traces.note(0.0, f"{count} of {key} could not be read: {first[key]}")
    for time_s, text in notes:
        traces.note(time_s, text)
    return traces


def sights_of(file: Path) -> SightKeeper:
    """Return the images of a recording with what was recognised in them; no images where none can be read."""
    keys = ("hw/image", "state/landmarks", "state/odometry", "state/pose", "navigator/feedback")
    try:
        if next(iter(read_recording(file, keys[:1])), None) is None:
            return SightKeeper()
        return read_traces(read_recording(file, keys)).sights
    except SurefootError:
        return SightKeeper()


def traces_of(file: Path) -> Traces:
    """Return the traces of a recording (raises SurefootError when the file cannot be read)."""
    return read_traces(read_recording(file, (*KEYS, "terrain/map")))
