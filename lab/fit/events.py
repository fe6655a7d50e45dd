"""Recording of a navigating robot as a sequence of motions and landmark sightings; no ground truth is read."""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.arrays import Array
from surefoot.errors import SurefootError
from surefoot.record.recording import read_recording
from surefoot.schemas.state import SeenLandmarks
from surefoot.services.navigator.belief.landmarks import FloorLandmarks
from surefoot.services.navigator.belief.matching import DetectionError, SightNoise
from surefoot.services.navigator.belief.tracker import Motion, PoseTracker, StartUncertainty
from surefoot.services.navigator.catalogue import act_of, errors_of
from surefoot.services.navigator.execution import Execution
from surefoot.services.navigator.goals import Act
from surefoot.services.navigator.localiser import detections
from surefoot.services.navigator.policy.params import NavigationModel

KEYS = ("navigator/order", "state/gait", "state/pose", "hw/landmarks", "terrain/landmarks")
IMAGES = "state/landmarks"
"""Key of the landmarks that vision recognised; if it is recorded, it is read in place of `hw/landmarks`."""
MOVE, FRAME, SEE = 0.0, 1.0, 2.0
"""Kind of an event, its column 0; further columns: `MOVE`: index of the action, share of the action; `FRAME`: time
since the last frame, s; `SEE`: landmark x, y (m, map), range (m), bearing (rad), 1 = the robot stands, 0 = it walks."""
COLUMNS = 6
SAME_TURN = math.radians(2.0)
SAME_WAY = 0.02
STANDING = ("standing", "waiting", "hold")
"""States of the gait in which the robot stands on its feet."""
GATE_WIDER = 1.5
"""Factor on the model's range and bearing standard deviations for landmark matching, as they are not fitted yet."""


@dataclass
class Run:
    """Content of one recording of a navigating robot: motions, sightings and times.

    Attributes:
        path: MCAP file.
        start: pose at the beginning: x, y (m), yaw (rad), map.
        events: (n, 6): motions (0, action, share), frames (1, s since the last), sightings (2, landmark x, y, m, map,
            range, m, bearing, rad, 1 if standing).
        durations: durations of each action, s, by (kind of the previous action, name of the action).
        halts: times from the last landing of a walk or turn until the robot stands, s, by kind of action.
        frames: (landmarks in view, landmarks matched) of each camera frame, by action name; of an image, recognised
            landmarks count as matched.
        density: density of landmarks in the map, 1/m^2, if the frames are images, else 0.
    """

    path: Path
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)
    events: Array = field(default_factory=lambda: np.zeros((0, COLUMNS)))
    durations: dict[tuple[str, str], list[float]] = field(default_factory=dict[tuple[str, str], list[float]])
    halts: dict[str, list[float]] = field(default_factory=dict[str, list[float]])
    frames: dict[str, list[tuple[int, int]]] = field(default_factory=dict[str, list[tuple[int, int]]])
    density: float = 0.0


def read_run(path: Path, model: NavigationModel, world: FloorLandmarks | None = None) -> Run:
    """Return motions, landmark sightings and times of a recording.

    Args:
        path: MCAP file with the topics `KEYS`; state/landmarks may stand for hw/landmarks.
        model: navigation model: its actions, and the noises for the gate of landmark matches.
        world: landmark map; None = that of the topic terrain/landmarks in the recording.

    Raises:
        SurefootError: the file cannot be read, lacks one of the topics, or no landmark matches the map.
    """
    messages = list(read_recording(path, (*KEYS, IMAGES)))
    keys = {item.key for item in messages} | (set() if world is None else {"terrain/landmarks"})
    sight = IMAGES if IMAGES in keys else "hw/landmarks"
    for key in (*KEYS[:3], sight, "terrain/landmarks"):
        if key not in keys:
            raise SurefootError(
                "invalid", f"{path} has no {key}; fit needs recordings of a goal with a camera and a landmark map", key
            )
    return _RunReader(path, model, world).read([item for item in messages if item.key in (*KEYS[:3], sight, KEYS[4])])


class _RunReader:
    def __init__(self, path: Path, model: NavigationModel, world: FloorLandmarks | None) -> None:
        self.run, self.model = Run(path), model
        self.acts = [act_of(name, action, model) for name, action in model.actions.items()]
        sight = model.sight
        noise = SightNoise(sight.range_sd, sight.range_sd_share, math.radians(sight.bearing_sd_deg)).wider(GATE_WIDER)
        shared = errors_of(model, sway=True)
        drift = math.radians(model.drift.known_sd_deg) * 10.0
        start = StartUncertainty(model.filter.position_sd, math.radians(model.filter.heading_sd_deg), drift)
        self.tracker = PoseTracker(start, noise, noise, shared)
        self.tracker.world, self.given = world, world is not None
        self.execution = Execution(model.conduct.lag)
        self.events: list[tuple[float, ...]] = []
        self.order: tuple[int, Act | None] = (0, None)
        self.taken = 0
        """Sequence number of the last action order that the walker started."""
        self.under_way: list[tuple[Motion, int, float]] = []
        """Motions being executed: motion, index of its action, its turn as a multiple of the action's (1 = whole)."""
        self.now, self.frame_at = 0.0, 0.0
        self.standing, self.started, self.unknown = True, False, False
        self.landing: tuple[str, float] | None = None
        """Kind of the action under way, and the time of its last landing, s; None = the robot stands."""

    def read(self, messages: list[Any]) -> Run:
        """Process all messages of a recording in the order of their ticks; return its motions, sightings and times."""
        decoded = [(item.key, item.message()) for item in messages]
        order = ("terrain/landmarks", "state/pose", "state/gait", "hw/landmarks", IMAGES)
        rank = {key: i for i, key in enumerate(order)}
        decoded.sort(key=lambda pair: (pair[1].tick, rank.get(pair[0], 9)))
        for key, message in decoded:
            if key == "terrain/landmarks" and not self.given:
                self.tracker.world = FloorLandmarks.from_bytes(message.data, message.count, message.descriptor_length)
            elif key == "state/pose" and not self.started:
                self.started, self.run.start = True, message.pose
                self.tracker.place(message.pose)
            elif key == "state/gait":
                self._gait(message)
            elif key == "navigator/order":
                self._order(message)
                if self.unknown:
                    break  # the robot goes where no action of the model goes
            elif key == "hw/landmarks" or (key == IMAGES and message.fresh):
                self._frame(message)
        if not any(event[0] == SEE for event in self.events):
            raise SurefootError("invalid", f"{self.run.path} has no landmark that matches the map", "landmarks")
        self.run.events = np.array([(*e, *([0.0] * (COLUMNS - len(e)))) for e in self.events])
        return self.run

    def _order(self, m: Any) -> None:
        if m.number != self.order[0]:
            command = m.command
            moves = command is not None and command.action in ("walk", "turn")
            self.order = (m.number, self._act(command) if moves else None)
            self.unknown = self.unknown or (moves and self.order[1] is None)

    def _act(self, command: Any) -> Act | None:
        """Return the model's action for a command, or a scaled turn on the spot; None if no action matches."""
        turn = command.angle or 0.0
        for act in self.acts:
            same = abs(turn - act.motion.turn) < SAME_TURN
            ahead = abs((command.distance or 0.0) - act.motion.forward) < SAME_WAY
            if act.kind == command.action and same and ahead:
                return act
        for act in self.acts:
            if act.kind == command.action == "turn" and act.motion.turn * turn > 0.0:
                return replace(act, motion=act.motion.part(turn / act.motion.turn))
        return None

    def _gait(self, m: Any) -> None:
        self.now = m.stamp_ns * 1e-9
        number, act = self.order
        if m.order == number and m.order != self.taken:
            self.taken = number
            if act is not None and not m.order_refused:
                self.execution.begin(act.motion, act.duration, self.now, m.ends_in_s)
                index = next(i for i, each in enumerate(self.acts) if each.name == act.name)
                whole = self.acts[index].motion
                share = act.motion.turn / whole.turn if whole.turn else 1.0
                self.under_way.append((act.motion, index, share))
                self._time(act, m.ends_in_s, whole=act is self.acts[index])
        elif m.order == number or act is None:
            self.execution.correct(self.now, m.ends_in_s)  # else an order is on its way, as in `Pilot.follow`
        self._halt(m)
        self.standing = m.state in STANDING
        before = [(piece, piece.done) for piece in self.execution.pieces]
        for motion in self.execution.advance(self.now):
            self.tracker.move(motion)
        for piece, done in before:
            if piece.done > done:
                index, share = self._piece(piece.motion)
                self.events.append((MOVE, float(index), share * (piece.done - done)))
        pieces = self.execution.pieces
        self.under_way = [item for item in self.under_way if any(item[0] is piece.motion for piece in pieces)]

    def _piece(self, motion: Motion) -> tuple[int, float]:
        return next((index, share) for own, index, share in self.under_way if own is motion)

    def _time(self, act: Act, ends_in: float | None, *, whole: bool) -> None:
        """Record the planned duration of a `whole` action, s; `ends_in`: time to its end, s, None = unknown."""
        if ends_in is None:
            self.landing = None
            return
        end = self.now + ends_in
        kind, began = self.landing or ("stand", self.now)
        if whole:
            self.run.durations.setdefault((kind, act.name), []).append(end - began)
        self.landing = (act.kind, end)

    def _halt(self, m: Any) -> None:
        if self.landing is None:
            return
        if m.ends_in_s is not None and m.order == self.order[0]:
            self.landing = (self.landing[0], self.now + m.ends_in_s)
        elif m.state == "standing" and m.ends_in_s is None and self.now >= self.landing[1]:
            self.run.halts.setdefault(self.landing[0], []).append(self.now - self.landing[1])
            self.landing = None

    def _frame(self, m: Any) -> None:
        time = m.stamp_ns * 1e-9
        self.events.append((FRAME, time - self.frame_at))
        self.frame_at = time
        t, world = self.tracker, self.tracker.world
        if world is None or not self.started:
            return
        visible = in_view(t.mean, world, self.model)
        try:
            seen = detections(m)
            found = t.look(seen, time, standing=self.standing).matches
        except DetectionError:
            return
        pairs = [] if found is None else list(zip(found.detections, found.landmarks, strict=True))
        for detection, landmark in pairs:
            x, y = world.positions[landmark]
            r, a = float(seen.ranges[detection]), float(seen.bearings[detection])
            self.events.append((SEE, float(x), float(y), r, a, float(self.standing)))
        name = self._name()
        if isinstance(m, SeenLandmarks):
            self.run.density = len(world) / world.area
        if name:
            count = min(visible, m.recognised) if isinstance(m, SeenLandmarks) else len(pairs)
            self.run.frames.setdefault(name, []).append((visible, count))

    def _name(self) -> str:
        """Return the name of the action during which the present camera frame was taken; empty if there is none."""
        if self.standing:
            return next((act.name for act in self.acts if act.kind == "stand"), "")
        pieces = self.execution.pieces
        return self.acts[self._piece(pieces[0].motion)[0]].name if pieces else ""


def in_view(mean: Array, world: FloorLandmarks, model: NavigationModel) -> int:
    """Return the number of landmarks in the camera's field of view at a pose `mean` = x, y (m), heading (rad), map."""
    sight = model.sight
    away = world.positions - mean[:2]
    r = np.hypot(away[:, 0], away[:, 1])
    a = np.arctan2(away[:, 1], away[:, 0]) - mean[2]
    a = np.abs(np.arctan2(np.sin(a), np.cos(a)))
    inside = (r >= sight.range_min) & (r <= sight.range_max) & (a <= math.radians(sight.half_angle_deg))
    return int(inside.sum())
