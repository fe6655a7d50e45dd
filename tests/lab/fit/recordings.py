"""A made-up recording of a navigating robot: messages of a walker, a navigator and a camera, without a simulator."""

import math
from pathlib import Path
from typing import Any, Literal

import numpy as np

from surefoot.bus.codec import encode
from surefoot.bus.interface import Raw
from surefoot.record.recording import RecordingWriter
from surefoot.schemas.cmd import WalkCommand
from surefoot.schemas.hw import Landmark, LandmarkDetections
from surefoot.schemas.navigation import MotionOrder, PoseBelief
from surefoot.schemas.state import GaitState, SeenLandmarks
from surefoot.schemas.terrain import LandmarkMap as MapMessage
from surefoot.schemas.topics import TOPICS
from surefoot.services.navigator.belief.landmarks import FloorLandmarks

State = Literal["standing", "walking", "stopping", "turning"]
TICK_NS = 10_000_000
STEPS, START, CLOSING, LEAD = 180, 100, 90, 30
"""Ticks of an action, of the shift of weight before the first, of the closing step, and before a landing when the next
order comes."""


class Story:
    """Writes the recording tick by tick.

    Args:
        path: of the file.
        skip: keys that are left out.
        noise: standard deviation of ranges, m; bearings have the same in rad.
        images: the frames are those of vision, every second message without one, each with 20 features recognised.
        frame: ticks from one frame to the next.
    """

    def __init__(
        self,
        path: Path,
        skip: tuple[str, ...] = (),
        noise: float = 0.02,
        *,
        images: bool = False,
        frame: int = 10,
    ) -> None:
        self.path, self.skip, self.noise, self.images, self.frame = path, skip, noise, images, frame
        self.rows = {topic.key: topic for topic in TOPICS}
        self.writer = RecordingWriter(path, {"robot": "nao"})
        self.rng = np.random.default_rng(4)
        self.world = FloorLandmarks(self.rng.uniform((-1, -1), (4, 1), (400, 2)), self.rng.normal(size=(400, 8)))
        self.tick, self.number, self.pose = 0, 0, (0.0, 0.0, 0.0)
        self._put("terrain/landmarks", MapMessage(data=self.world.to_bytes(), count=400, descriptor_length=8))
        cov = tuple(np.diag([1e-3, 1e-3, 1e-3]).ravel())
        belief = PoseBelief(
            pose=(0.0, 0.0, 0.0), covariance=cov, entropy=0.0, drift=0.0, drift_sd=0.1, map_from_odom=(0.0, 0.0, 0.0),
            initialised=True, control="commands", matched=0,
        )  # fmt: skip
        self._put("state/pose", belief)

    def _put(self, key: str, message) -> None:
        if key in self.skip:
            return
        stamped = message.stamped(self.tick * TICK_NS, self.tick, 1, self.tick, "test")
        self.writer.write(self.rows[key], stamped, Raw(*encode(stamped), ""))

    def gait(self, state: State, ends_in: float | None) -> None:
        """One tick of the walker; some have a frame."""
        self.tick += 1
        self._put(
            "state/gait",
            GaitState(
                walk_id=self.number, state=state, phase=0.0, stance=(True, True), footholds=(), remaining=0.0,
                order=self.number, ends_in_s=ends_in,
            ),
        )  # fmt: skip
        if self.images and self.tick % 5 == 0 and self.tick % 10:
            self._put("state/landmarks", SeenLandmarks(landmarks=()))
        if self.tick % self.frame == 0:
            marks = self.seen(12 if state == "standing" else 4)
            if self.images:
                self._put("state/landmarks", SeenLandmarks(landmarks=marks, fresh=True, recognised=20))
            else:
                self._put("hw/landmarks", LandmarkDetections(landmarks=marks))

    def seen(self, most: int) -> tuple[Landmark, ...]:
        """The nearest landmarks in view."""
        x, y, yaw = self.pose
        away = self.world.positions - (x, y)
        r, b = np.hypot(*away.T), np.arctan2(away[:, 1], away[:, 0]) - yaw
        b = np.arctan2(np.sin(b), np.cos(b))
        inside = np.flatnonzero((r > 0.4) & (r < 1.1) & (np.abs(b) < 0.5))[:most]
        er, eb = self.rng.normal(0.0, self.noise, (2, len(inside)))
        looks = [tuple(look) for look in self.world.descriptors[inside]]
        found = zip(r[inside] + er, b[inside] + eb, looks, strict=True)
        return tuple(Landmark(range=float(away), bearing=float(at), descriptor=look) for away, at, look in found)

    def order(self, command: WalkCommand) -> None:
        """The navigator orders; the walker takes it up in the next tick."""
        self.number += 1
        self._put("navigator/order", MotionOrder(number=self.number, command=command))

    def stand(self, seconds: float) -> None:
        """Stands still."""
        for _ in range(round(100 * seconds)):
            self.gait("standing", None)

    def act(self, command: WalkCommand, *, first: bool = False) -> None:
        """One action from its order until the next one is due, the body evenly from where it was."""
        self.order(command)
        ticks = STEPS + (START if first else LEAD)
        x, y, yaw = self.pose
        way, turn = command.distance or 0.0, command.angle or 0.0
        for k in range(1, ticks - LEAD + 1):
            share = min(1.0, k / STEPS)
            middle = yaw + 0.5 * share * turn
            self.pose = (x + share * way * math.cos(middle), y + share * way * math.sin(middle), yaw + share * turn)
            self.gait("walking" if command.action == "walk" else "turning", (ticks - k) / 100.0)

    def stop(self) -> None:
        """Ends on two feet after the last landing and the closing step."""
        self.order(WalkCommand(action="stop"))
        for _ in range(LEAD + CLOSING):
            self.gait("stopping", None)
        self.stand(1.0)

    def close(self) -> Path:
        """Finish the file."""
        self.writer.close({})
        return self.path


def walk(**more) -> WalkCommand:
    """A walk of 10 cm."""
    return WalkCommand(action="walk", distance=0.1, **more)


def turn(degrees: float) -> WalkCommand:
    """A turn on the spot."""
    return WalkCommand(action="turn", angle=math.radians(degrees))


def tour(path: Path, skip: tuple[str, ...] = (), last: WalkCommand | None = None, **more: Any) -> Path:
    """Four walks, a turn to the left, an arc, perhaps one more command, and the end."""
    story = Story(path, skip, **more)
    story.stand(0.5)
    story.act(walk(), first=True)
    for command in (walk(), walk(), walk(), turn(23.0), walk(angle=math.radians(-11.5))):
        story.act(command)
    if last is not None:
        story.act(last)
    story.stop()
    return story.close()
