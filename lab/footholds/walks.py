"""Walks of a hexapod under a rule that chooses its footholds, and what came of every stance.

World, estimator and walker are joined by function calls in the order of a control tick, with the one-tick actuation
delay of bus servos. Truth is read by the judge and for the outcomes of stances, never by walker or rule.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.heightmap import HeightMap
from surefoot.robot.description import Robot
from surefoot.robot.reader import load_robot
from surefoot.services.estimator.stream import Estimator
from surefoot.services.footholds import select as chooser
from surefoot.services.footholds.ground import FootholdGround, build_ground
from surefoot.services.simulator.ground.terrain import make_terrain, observed_map
from surefoot.services.simulator.physics.model import Physics
from surefoot.services.simulator.world import PhysicsWorld, WorldConfig
from surefoot.services.walker.hexapod.gait import HexapodWalker
from surefoot.services.walker.hexapod.params import WalkerParams
from surefoot.services.walker.hexapod.standins import nominal_footholds
from surefoot.services.walker.interface import (
    FootholdReply,
    FootholdRequest,
    LandingRequest,
    MotionCommand,
    Select,
    WalkerOutputs,
)

from ..runs.joined import TICK_S, sense

PATIENCE_S = 5.0  # simulated time to stand before the walk command
REACHED = 0.95  # part of the commanded distance that counts as the end, by truth

Rule = Callable[[FootholdGround, Robot, chooser.TrunkPose, Sequence[chooser.Landing], int], Sequence[chooser.Foothold]]
"""Chooses the footholds of legs that land together: ground, robot, base, landings, number of the step."""
Observer = Callable[[PhysicsWorld, HexapodWalker, WalkerOutputs], None]


@dataclass(frozen=True)
class Setting:
    """What is the same for all seeds of a study."""

    terrain: str = "demo"
    distance: float = 1.5
    """m."""
    amplitude: float | None = None
    """Height of the terrain, m; None = the kind's own."""
    friction: float = Physics().friction
    robot: str = "ragno"
    profile: str = "noise"
    """Of the map, see `observed_map`."""
    delay: int = 1
    """Ticks of actuation delay."""
    limit_s: float = 120.0
    """s of simulated time."""
    params: tuple[tuple[str, Any], ...] = ()
    """Of the walker."""
    command: MotionCommand | None = None
    """None = straight ahead over `distance`."""


@dataclass(frozen=True, eq=False)
class Stance:
    """One finished stance with the choice that began it."""

    leg: int
    step: int
    """Number of the choice in the walk."""
    planned: tuple[float, float]
    """x, y of the foothold that was chosen, frame map, m."""
    nominal: tuple[float, float]
    """x, y of the nominal foothold, m."""
    stroke: tuple[float, float, float]
    """m, map axes."""
    landed: tuple[float, float]
    """x, y of the foot centre at touch-down by truth, m."""
    sliding: float
    """Way of the contact point in the ground plane, m."""
    displacement: float
    """Horizontal way of the foot centre, m (the d of the paper)."""
    load: float
    """Mean normal force in the stance, N."""


@dataclass(frozen=True)
class Walk:
    """Verdict of one seed."""

    seed: int
    reached: bool
    fallen: bool
    state: str
    reason: str
    x: float
    y: float
    time_s: float
    steps: int
    tilt_deg: float
    sliding_mm: float
    displacement_mm: float
    stances: int
    odometry_mm: float
    margin_mm: float
    unreachable: int
    costs_us: tuple[float, ...] = field(repr=False, default=())
    """Wall time of the walker per tick, us."""
    slides_mm: tuple[float, ...] = field(repr=False, default=())
    """Sliding of every finished stance, mm."""


class Judge:
    """Follows truth."""

    def __init__(self, world: PhysicsWorld) -> None:
        self.tilt = 0.0
        self.sliding: list[float] = []
        self.displacement: list[float] = []
        self.found: list[Stance] = []
        self._stances = world.truth().stances.copy()
        n = len(self._stances)
        self._chosen: list[tuple[int, FootholdRequest, tuple[float, float]] | None] = [None] * n
        self._standing: list[tuple[int, FootholdRequest, tuple[float, float]] | None] = [None] * n
        self._start = np.zeros((n, 2))
        self._load, self._ticks, self._swung = np.zeros(n), np.zeros(n), np.zeros(n, dtype=np.bool_)

    def chose(self, step: int, request: FootholdRequest, planned: tuple[float, float]) -> None:
        """Take a choice; it belongs to the next stance of its leg."""
        self._chosen[request.leg] = (step, request, planned)

    def look(self, world: PhysicsWorld) -> bool:
        """Take the state after a tick; returns whether the robot has fallen."""
        truth, feet = world.truth(), world.tracker.feet
        self.tilt = max(self.tilt, truth.tilt)
        for foot in np.flatnonzero(truth.stances > self._stances):
            self.sliding.append(float(truth.stance_sliding[foot]))
            self.displacement.append(float(truth.stance_displacement[foot]))
            self._finish(int(foot))
        self._stances = truth.stances
        for foot in np.flatnonzero(feet.below == 0):
            if self._swung[foot]:
                self._standing[foot], self._chosen[foot] = self._chosen[foot], None
                self._start[foot] = feet.start[foot, :2]
                self._load[foot] = self._ticks[foot] = 0.0
            self._load[foot] += feet.normal_force[foot]
            self._ticks[foot] += 1.0
        self._swung = feet.below < 0
        return bool(truth.fallen)

    def _finish(self, foot: int) -> None:
        standing = self._standing[foot]
        self._standing[foot] = None
        if standing is None:
            return
        step, request, planned = standing
        self.found.append(
            Stance(
                leg=foot, step=step, planned=planned, nominal=(request.nominal[0], request.nominal[1]),
                stroke=request.stroke, landed=(float(self._start[foot, 0]), float(self._start[foot, 1])),
                sliding=self.sliding[-1], displacement=self.displacement[-1],
                load=float(self._load[foot] / max(1.0, self._ticks[foot])),
            )
        )  # fmt: skip


def asked_of(
    request: LandingRequest,
) -> tuple[chooser.TrunkPose, list[chooser.Landing]]:
    """Return the question of a walker as base and landings of the foothold functions."""
    half = 0.5 * request.yaw
    base = chooser.TrunkPose(request.body, (math.cos(half), 0.0, 0.0, math.sin(half)))
    return base, [chooser.Landing(leg.leg, leg.nominal, leg.stroke) for leg in request.legs]


class Recorder:
    """The foothold selector of a walk: asks a rule and hands what it chose to a judge."""

    def __init__(self, robot: Robot, ground: FootholdGround, rule: Rule | None) -> None:
        self.robot, self.ground, self.rule = robot, ground, rule
        self.judge: Judge | None = None
        self.steps = 0

    def __call__(self, request: LandingRequest) -> Sequence[FootholdReply]:
        self.steps += 1
        replies = nominal_footholds(request) if self.rule is None else self._ask(request, self.rule)
        if self.judge is not None:
            for leg, reply in zip(request.legs, replies, strict=True):
                point = leg.nominal if reply.foothold is None else reply.foothold
                self.judge.chose(self.steps, leg, (point[0], point[1]))
        return replies

    def _ask(self, request: LandingRequest, rule: Rule) -> list[FootholdReply]:
        base, landings = asked_of(request)
        found = rule(self.ground, self.robot, base, landings, self.steps)
        return [FootholdReply(r.status, r.foothold, r.trunk_shift, r.reason) for r in found]


class JoinedWalk:
    """World, estimator and walker of one walk, tick by tick."""

    def __init__(self, seed: int, setting: Setting, rule: Rule | None, smooth: bool = True) -> None:
        self.seed, self.setting = seed, setting
        self.robot = load_robot(setting.robot)
        self.terrain = make_terrain(setting.terrain, seed=seed, amp=setting.amplitude)
        self.heights: HeightMap = observed_map(self.terrain, setting.profile, seed)
        config = WorldConfig(physics=Physics(friction=setting.friction))
        self.world = PhysicsWorld(self.robot, self.terrain, seed=seed, config=config)
        self.estimator = Estimator.for_robot(self.robot)
        self.recorder = Recorder(self.robot, build_ground(self.heights, self.robot.foot_radius, smooth), rule)
        select: Select = self.recorder
        params = WalkerParams.for_robot(self.robot, **dict(setting.params))
        self.walker = HexapodWalker(self.robot, params, select=select)
        self.walker.set_map(self.heights)
        self.judge = self.recorder.judge = Judge(self.world)
        self.pending: list[NDArray[np.float64]] = [self.world.command.copy()] * setting.delay
        self.started, self.ended = False, False
        self.out: WalkerOutputs | None = None
        self.costs_us: list[float] = []
        self.unreachable, self.margin = 0, math.inf

    def tick(self) -> bool:
        """Advance by one tick; returns whether the walk goes on."""
        command = self.setting.command or MotionCommand("walk", distance=self.setting.distance)
        inputs, _ = sense(self.world, self.estimator)
        began = time.perf_counter()
        out = self.out = self.walker.step(inputs)
        self.costs_us.append(1e6 * (time.perf_counter() - began))
        self.unreachable += out.unreachable
        self.margin = self.margin if out.margin is None else min(self.margin, out.margin)
        if not self.started and out.state == "standing":
            self.started = self.walker.command(command).accepted
        elif self.started and out.state in ("standing", "refused"):
            return False
        if not self.started and self.world.tick * TICK_S > PATIENCE_S:
            return False
        self.pending.append(self.world.command if out.command is None else out.command)
        self.world.step_tick(self.pending.pop(0))
        return not self.judge.look(self.world) and self.world.tick * TICK_S < self.setting.limit_s

    def verdict(self) -> Walk:
        """Return what came of the walk."""
        truth, out, judge = self.world.truth(), self.out, self.judge
        assert out is not None
        odometry = math.hypot(*(np.array(self.estimator.pose().position[:2]) - truth.position[:2]))
        way = self.setting.distance if self.setting.command is None else 0.0
        arrived = self.started and not truth.fallen and out.state == "standing"
        return Walk(
            seed=self.seed,
            reached=bool(arrived and truth.position[0] >= REACHED * way),
            fallen=bool(truth.fallen),
            state=out.state,
            reason=out.reason,
            x=round(float(truth.position[0]), 4),
            y=round(float(truth.position[1]), 4),
            time_s=round(TICK_S * self.world.tick, 2),
            steps=out.steps,
            tilt_deg=round(math.degrees(judge.tilt), 2),
            sliding_mm=round(1e3 * float(np.mean(judge.sliding or [0.0])), 4),
            displacement_mm=round(1e3 * float(np.mean(judge.displacement or [0.0])), 4),
            stances=len(judge.sliding),
            odometry_mm=round(1e3 * odometry, 1),
            margin_mm=round(1e3 * self.margin, 1),
            unreachable=self.unreachable,
            costs_us=tuple(self.costs_us),
            slides_mm=tuple(round(1e3 * value, 4) for value in judge.sliding),
        )


def walk(seed: int, setting: Setting, rule: Rule | None = None, observe: Observer | None = None) -> Walk:
    """Walk to the end, a refusal, a fall or the time limit; without a rule feet land on nominal footholds."""
    joined = JoinedWalk(seed, setting, rule)
    while joined.tick():
        if observe is not None and joined.out is not None:
            observe(joined.world, joined.walker, joined.out)
    return joined.verdict()
