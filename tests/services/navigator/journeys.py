"""The navigator service without a bus, on a walker without legs and a camera that sees well."""

import math
from typing import Any

import numpy as np

from surefoot.lockstep.join import TickInputs
from surefoot.schemas import topics
from surefoot.schemas.hw import Landmark, LandmarkDetections, Range, Tick
from surefoot.schemas.navigation import GoalReply, GotoRequest
from surefoot.schemas.state import GaitState, Odometry
from surefoot.schemas.terrain import HeightMapMessage
from surefoot.schemas.terrain import LandmarkMap as LandmarkMapMessage
from surefoot.services.navigator.pilot import Pilot
from surefoot.services.navigator.service import SERVICE, NavigatorConfig
from tests.services.navigator.strollers import Stroller
from tests.services.stage import Stage

EPOCH = 2
CELL = 0.05


def floor() -> HeightMapMessage:
    """A corridor of 4 x 2 m with a wall around it and a pillar at (2, 0.6)."""
    z = np.zeros((44, 84), dtype="<f4")
    z[:2], z[-2:], z[:, :2], z[:, -2:] = 0.5, 0.5, 0.5, 0.5
    z[30:35, 58:64] = 0.5
    return HeightMapMessage(rows=44, cols=84, cell=CELL, origin=(-1.0, -1.075), data=z.tobytes(), version=1)


class Journey:
    """Service, walker and a camera in a corridor."""

    def __init__(self, seed: int = 0, tick: int = 0, **config: Any) -> None:
        self.rng = np.random.default_rng(seed)
        self.walker, self.stage, self.tick = Stroller(), Stage(), tick
        self.places = self.rng.uniform((-0.9, -0.9), (3.0, 0.9), (320, 2))
        looks = self.rng.standard_normal((320, 8))
        self.looks = looks / np.linalg.norm(looks, axis=1, keepdims=True)
        self.seen = True
        self.distance: float | None = None
        self.bump = False
        self.odom = True
        self.service = SERVICE(NavigatorConfig(robot="nao", **{"policy": "steer", **config}))
        self.service.attach(self.stage)
        self.service.on_start()
        self.service.on_reset()
        rows = np.hstack((self.places, self.looks)).astype("<f4").tobytes()
        self.maps = {
            topics.TERRAIN_MAP.key: floor(),
            topics.TERRAIN_LANDMARKS.key: LandmarkMapMessage(count=320, descriptor_length=8, data=rows, version=1),
        }

    @property
    def pilot(self) -> Pilot:
        """Of the service."""
        return self.service.pilot

    def step(self, ticks: int = 1) -> None:
        """Let ticks pass."""
        for _ in range(ticks):
            self.walker.take(self.pilot)
            self.walker.tick()
            self.service.on_tick(TickInputs(self._tick(), self._messages()))
            self.tick += 1

    def _tick(self) -> Tick:
        return Tick(
            tick=self.tick, epoch=EPOCH, stamp_ns=self.tick * 10_000_000, roster=(), roster_version=1, due=(),
            mode="lockstep",
        )  # fmt: skip

    def _messages(self) -> dict[str, Any]:
        view, w = self.walker.view(), self.walker
        messages: dict[str, Any] = {
            **self.maps,
            topics.STATE_GAIT.key: GaitState(
                walk_id=view.walk_id, state=view.state, phase=0.0, stance=(), footholds=(), remaining=0.0,  # pyright: ignore[reportArgumentType] - words of the toy
                order=view.order, order_refused=view.refused, ends_in_s=view.ends_in,
            ),
        }  # fmt: skip
        if self.odom:
            messages[topics.STATE_ODOMETRY.key] = Odometry(
                position=(w.x, w.y, 0.3), quat_wxyz=(1.0, 0.0, 0.0, 0.0), yaw=w.yaw, velocity=(0.0, 0.0, 0.0),
                covariance=(0.0,) * 16, initialised=True,
            )  # fmt: skip
        if self.tick % 10 == 0 and self.seen:
            messages[topics.HW_LANDMARKS.key] = self.frame()
        if self.tick % 10 == 0:
            messages[topics.HW_RANGE.key] = Range(
                distance=self.distance, shortest=0.25, longest=2.55, field_of_view=1.0, bump=(self.bump, False)
            )
        return messages

    def frame(self) -> LandmarkDetections:
        """Return what the camera recognises."""
        w = self.walker
        away = self.places - (w.x, w.y)
        r, a = np.hypot(*away.T), np.angle(np.exp(1j * (np.arctan2(away[:, 1], away[:, 0]) - w.yaw)))
        seen = np.flatnonzero((r > 0.35) & (r < 1.18) & (np.abs(a) < 0.57) & (self.rng.random(320) < 0.15))[:10]
        marks = tuple(
            Landmark(
                range=float(r[i] * (1.0 + 0.03 * self.rng.standard_normal())),
                bearing=float(a[i] + 0.026 * self.rng.standard_normal()),
                descriptor=tuple((self.looks[i] + 0.05 * self.rng.standard_normal(8)).tolist()),
            )
            for i in seen
        )
        return LandmarkDetections(landmarks=marks, stamp_ns=self.tick * 10_000_000)

    def goto(self, x: float, y: float, **request: Any) -> GoalReply:
        """Ask for a goal at (x, y), m."""
        return self.service.requests.goto(GotoRequest(position=(x, y), **request))

    def reach(self, x: float, y: float) -> None:
        """Walk to (x, y), m, and check that the goal has succeeded."""
        self.goto(x, y)
        assert self.until_ended().state == "succeeded"

    def restarted(self, tick: int, **config: Any) -> "Journey":
        """A new navigator at a tick, with the same walker, floor and camera."""
        again = Journey(tick=tick, **config)
        again.walker, again.places, again.looks, again.maps = self.walker, self.places, self.looks, self.maps
        return again

    def missed(self, x: float, y: float) -> float:
        """Distance of the walker from a place, m."""
        return math.hypot(self.walker.x - x, self.walker.y - y)

    def belief(self) -> Any:
        """The last published pose."""
        return self.stage.said[topics.STATE_POSE.key]

    def feedback(self) -> Any:
        """The last progress."""
        return self.stage.said[topics.NAVIGATOR_FEEDBACK.key]

    def until_ended(self, most: int = 20_000) -> Any:
        """Walk until the goal has ended, and ten ticks more for the feedback, which is returned."""
        for _ in range(most):
            self.step()
            if self.pilot.state not in ("navigating", "stopping", "idle"):
                break
        self.step(10)
        return self.feedback()


def ready(**config: Any) -> Journey:
    """A journey that has begun."""
    journey = Journey(**config)
    journey.step(20)
    return journey
