"""A recording of a navigating robot as a sequence of motions and sightings. No truth is read."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.errors import SurefootError
from surefoot.record.recording import read_recording
from surefoot.services.navigator.belief.landmarks import LandmarkMap
from surefoot.services.navigator.belief.matching import DetectionError, SightNoise, match
from surefoot.services.navigator.belief.tracker import PoseTracker, Start
from surefoot.services.navigator.execution import Execution
from surefoot.services.navigator.goals import Act
from surefoot.services.navigator.localiser import detections
from surefoot.services.navigator.policies import act_of, errors_of
from surefoot.services.navigator.policy.params import NavigationModel

Array = NDArray[np.float64]

KEYS = ("navigator/order", "state/gait", "state/pose", "hw/landmarks", "terrain/landmarks")
MOVE, FRAME, SEE = 0.0, 1.0, 2.0
"""Kinds of event, first column; the others: MOVE action, share; FRAME s since the frame before; SEE x and y of the
landmark (m, map), range (m), bearing (rad), 1 if standing."""
COLUMNS = 6
SAME_TURN = math.radians(2.0)
SAME_WAY = 0.02
GATE_WIDER = 1.5
"""Noise is taken for so much larger than the model says while landmarks are matched: the model is what is wanted."""


@dataclass
class Run:
    """One recording.

    Attributes:
        path: file.
        start: x, y, yaw at the beginning, m and rad.
        events: (n, COLUMNS).
        durations: per (kind before, action) the times of the action, s.
        frames: per action name rows (landmarks in view, matched) of each frame.
        places: range (m) and bearing (rad) of each matched landmark, and 1 if standing, (m, 3).
    """

    path: Path
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)
    events: Array = field(default_factory=lambda: np.zeros((0, COLUMNS)))
    durations: dict[tuple[str, str], list[float]] = field(default_factory=dict[tuple[str, str], list[float]])
    frames: dict[str, list[tuple[int, int]]] = field(default_factory=dict[str, list[tuple[int, int]]])
    places: Array = field(default_factory=lambda: np.zeros((0, 3)))


def read_run(path: Path, model: NavigationModel) -> Run:
    """Return the events of a recording.

    Args:
        path: MCAP file with `navigator/order`, `state/gait`, `hw/landmarks` and `terrain/landmarks`.
        model: names the actions; its noises, widened, gate the matches.

    Raises:
        SurefootError: the file cannot be read, has no landmarks, no map of them, or no orders of a navigator.
    """
    messages = list(read_recording(path, KEYS))
    keys = {item.key for item in messages}
    for key in ("navigator/order", "state/gait", "hw/landmarks", "terrain/landmarks"):
        if key not in keys:
            raise SurefootError(
                "unusable", f"{path} has no {key}; fit needs recordings of a goal with a camera and a landmark map", key
            )
    return _Reader(path, model).read(messages)


class _Reader:
    def __init__(self, path: Path, model: NavigationModel) -> None:
        self.run, self.model = Run(path), model
        self.acts = [act_of(name, action) for name, action in model.actions.items()]
        sight = model.sight
        noise = SightNoise(sight.range_sd, sight.range_sd_share, math.radians(sight.bearing_sd_deg)).wider(GATE_WIDER)
        shared = errors_of(model, sway=True)
        drift = math.radians(model.drift.known_sd_deg) * 10.0
        start = Start(model.filter.position_sd, math.radians(model.filter.heading_sd_deg), drift)
        self.tracker = PoseTracker(start, noise, noise, shared)
        self.execution = Execution()
        self.events: list[tuple[float, ...]] = []
        self.places: list[tuple[float, float, float]] = []
        self.order: tuple[int, Act | None] = (0, None)
        self.pending: Act | None = None
        self.under_way: list[tuple[Act, float]] = []
        self.now, self.frame_at = 0.0, 0.0
        self.standing, self.started = True, False
        self.last_end: tuple[str, float] | None = None

    def read(self, messages: list[Any]) -> Run:
        """Take in all messages, in the order of their ticks."""
        decoded = [(item.key, item.message()) for item in messages]
        rank = {key: i for i, key in enumerate(("terrain/landmarks", "state/pose", "state/gait", "hw/landmarks"))}
        decoded.sort(key=lambda pair: (pair[1].tick, rank.get(pair[0], 9)))
        for key, message in decoded:
            if key == "terrain/landmarks":
                self.tracker.world = LandmarkMap.from_bytes(message.data, message.count, message.descriptor_length)
            elif key == "state/pose" and not self.started:
                self.started, self.run.start = True, message.pose
                self.tracker.place(message.pose)
            elif key == "state/gait":
                self._gait(message)
            elif key == "navigator/order":
                self._order(message)
            elif key == "hw/landmarks":
                self._frame(message)
        if not any(event[0] == SEE for event in self.events):
            raise SurefootError("unusable", f"{self.run.path} has no landmark that matches the map", "hw/landmarks")
        self.run.events = np.array([(*e, *([0.0] * (COLUMNS - len(e)))) for e in self.events])
        self.run.places = np.array(self.places).reshape(-1, 3)
        return self.run

    def _order(self, m: Any) -> None:
        if m.number != self.order[0]:
            act = None if m.command is None else self._act(m.command)
            self.order = (m.number, act)

    def _act(self, command: Any) -> Act | None:
        for act in self.acts:
            same = abs((command.angle or 0.0) - act.motion.turn) < SAME_TURN
            ahead = abs((command.distance or 0.0) - act.motion.forward) < SAME_WAY
            if act.kind == command.action and same and ahead:
                return act
        return None

    def _gait(self, m: Any) -> None:
        self.now = m.stamp_ns * 1e-9
        taken = m.order == self.order[0] and self.order[1] is not None and self.pending is not self.order[1]
        if m.order and taken and not m.order_refused and self._fresh(m.order):
            act = self.order[1]
            assert act is not None
            self.execution.begin(act.motion, act.duration, self.now, m.ends_in_s)
            self._time(act, m)
        else:
            self.execution.correct(self.now, m.ends_in_s)
        self.standing = m.state == "standing"
        before = [(piece, piece.done) for piece in self.execution.pieces]
        moved = self.execution.advance(self.now)
        for motion in moved:
            self.tracker.move(motion)
        for piece, done in before:
            if piece.done > done:
                index = next(i for i, act in enumerate(self.acts) if _same(act, piece.motion))
                self.events.append((MOVE, float(index), piece.done - done))
        if self.standing and self.last_end is not None and m.ends_in_s is None and self.last_end[0] != "stand":
            self.last_end = ("stand", self.now)

    def _fresh(self, number: int) -> bool:
        if number == getattr(self, "_seen", 0):
            return False
        self._seen = number
        return True

    def _time(self, act: Act, m: Any) -> None:
        end = self.now + (act.duration if m.ends_in_s is None else m.ends_in_s)
        if m.ends_in_s is not None:
            kind, began = self.last_end or ("stand", self.now)
            began = self.now if kind == "stand" else began
            self.run.durations.setdefault((kind, act.name), []).append(end - began)
        self.last_end = (act.kind, end)

    def _frame(self, m: Any) -> None:
        time = m.stamp_ns * 1e-9
        self.events.append((FRAME, time - self.frame_at))
        self.frame_at = time
        try:
            seen = detections(m)
        except DetectionError:
            return
        t, world = self.tracker, self.tracker.world
        if world is None:
            return
        found = match(t.mean, t.cov, seen, world, t.noise, t.limits, seed=len(self.events))
        name = "stand" if self.standing else self._name()
        for detection, landmark in zip(found.detections, found.landmarks, strict=True):
            x, y = world.positions[landmark]
            r, a = float(seen.ranges[detection]), float(seen.bearings[detection])
            self.events.append((SEE, float(x), float(y), r, a, float(self.standing)))
            self.places.append((r, a, float(self.standing)))
        self.run.frames.setdefault(name, []).append((in_view(t.mean, world, self.model), len(found.detections)))
        t.look(seen, time, standing=self.standing)

    def _name(self) -> str:
        if not self.execution.pieces:
            return ""
        return next(act.name for act in self.acts if _same(act, self.execution.pieces[0].motion))


def _same(act: Act, motion: Any) -> bool:
    return act.motion.forward == motion.forward and act.motion.turn == motion.turn


def in_view(mean: Array, world: LandmarkMap, model: NavigationModel) -> int:
    """Return how many landmarks lie in the footprint of the camera for a pose."""
    sight = model.sight
    away = world.positions - mean[:2]
    r = np.hypot(away[:, 0], away[:, 1])
    a = np.arctan2(away[:, 1], away[:, 0]) - mean[2]
    a = np.abs(np.arctan2(np.sin(a), np.cos(a)))
    inside = (r >= sight.range_min) & (r <= sight.range_max) & (a <= math.radians(sight.half_angle_deg))
    return int(inside.sum())
