"""Simulated walks of a hexapod with a rule that chooses its footholds, and the outcome of every stance.

Outcomes and verdict come from the ground truth of the simulation, which neither the walker nor the rule reads.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Self

import numpy as np

from surefoot.geometry.heightmap import HeightMap
from surefoot.robot.description import Robot
from surefoot.robot.reader import load_robot
from surefoot.services.footholds import select as chooser
from surefoot.services.footholds.ground import FootholdGround, build_ground
from surefoot.services.simulator.ground.terrain import Terrain, make_terrain, observed_map
from surefoot.services.simulator.physics.model import Physics
from surefoot.services.simulator.world import PhysicsWorld, WorldConfig
from surefoot.services.walker.interface import FootholdReply, FootholdRequest, LandingRequest, MotionCommand
from surefoot.services.walker.legged.gait import LeggedWalker
from surefoot.services.walker.legged.params import WalkerParams
from surefoot.services.walker.legged.standins import nominal_footholds

from ..runs.joined import TICK_S, JoinedLoop

PATIENCE_S = 5.0
"""Longest simulated time that the robot may take to stand up, s; then the walk ends without its command."""
REACHED = 0.95
"""Share of the commanded distance, 0 to 1, from which on a walk counts as complete, by the true position."""

Rule = Callable[[FootholdGround, Robot, chooser.TrunkPose, Sequence[chooser.Landing], int], Sequence[chooser.Foothold]]
"""Function that chooses the footholds of legs that land together, from ground, robot, trunk pose, landings and step
index."""


@dataclass(frozen=True)
class Setting:
    """Conditions of a simulated walk that are equal for all seeds of a study."""

    terrain: str = "demo"
    """Name of the simulator's kind of terrain."""
    distance: float = 1.5
    """Commanded length of the walk along x, m."""
    amplitude: float | None = None
    """Height amplitude of the terrain, m; None = default of the kind of terrain."""
    friction: float = Physics().friction
    robot: str = "ragno"
    profile: str = "noise"
    """Name of the error profile by which the robot's height map is made from the true one, see `observed_map`."""
    delay: int = 1
    """Delay from a joint command to its execution, control ticks."""
    limit_s: float = 120.0
    """Simulated time after which a walk ends even if it is not complete, s."""
    params: tuple[tuple[str, Any], ...] = ()
    """Parameters of the walker that differ from the robot's defaults: (name, value) pairs."""
    command: MotionCommand | None = None
    """Command of the walk; None = straight ahead over `distance`."""


@dataclass(frozen=True, eq=False)
class ChosenStance:
    """Outcome of one finished stance, with the choice of the foothold that began it."""

    leg: int
    """Index of the stance leg in the robot description."""
    step: int
    """Ordinal number of the foothold choice within the walk, from 1."""
    planned: tuple[float, float]
    """Position x, y of the chosen foothold, map frame, m."""
    nominal: tuple[float, float]
    """Position x, y of the nominal foothold, map frame, m."""
    stroke: tuple[float, float, float]
    """Planned movement of the foot relative to the body during the stance, map axes, m."""
    landed: tuple[float, float]
    """True position x, y of the foot centre at touch-down, world frame, m."""
    sliding: float
    """Length of the path of the contact point in the ground plane during the stance, m."""
    displacement: float
    """Horizontal displacement of the foot centre during the stance, m."""
    load: float
    """Mean normal force on the foot during the stance, N."""


@dataclass(frozen=True)
class WalkVerdict:
    """Verdict on one simulated walk over the ground of a seed.

    `reached`, `fallen`: True if the robot completed the distance, or fell; `state`, `reason`: of the gait at the end;
    `x`, `y`: true trunk position at the end, m; `time_s`: simulated time, s; `steps`, `stances`: their numbers.
    """

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
    """Largest true tilt of the trunk from the vertical during the walk, deg."""
    sliding_mm: float
    """Mean path length of the contact point per stance, mm."""
    displacement_mm: float
    """Mean horizontal displacement of the foot centre per stance, mm."""
    stances: int
    odometry_mm: float
    """Horizontal position error of the odometry at the end of the walk, mm."""
    margin_mm: float
    """Smallest static stability margin during the walk, mm."""
    unreachable: int
    """Number of foot targets out of the leg's reach, summed over all control ticks of the walk."""
    costs_us: tuple[float, ...] = field(repr=False, default=())
    """Wall time of the walker in each control tick, us."""


class _PendingChoice(NamedTuple):
    """Foothold choice whose stance has not begun yet."""

    step: int
    request: FootholdRequest
    planned: tuple[float, float]


class StanceObserver:
    """Recorder of the finished stances of a simulated walk, by ground truth, with the foothold choice of each."""

    def __init__(self, world: PhysicsWorld) -> None:
        self.tilt = 0.0
        """Largest true tilt of the trunk from the vertical so far, rad."""
        self.sliding: list[float] = []
        """Path length of the contact point in each finished stance, m."""
        self.displacement: list[float] = []
        """Horizontal displacement of the foot centre in each finished stance, m."""
        self.found: list[ChosenStance] = []
        """Finished stances whose foothold was chosen by the rule."""
        self._stances = world.truth().stances.copy()
        n = len(self._stances)
        self._chosen: list[_PendingChoice | None] = [None] * n
        self._standing: list[_PendingChoice | None] = [None] * n
        self._start = np.zeros((n, 2))
        self._load, self._ticks, self._swung = np.zeros(n), np.zeros(n), np.zeros(n, dtype=np.bool_)

    def chose(self, step: int, request: FootholdRequest, planned: tuple[float, float]) -> None:
        """Record the foothold `planned` (x, y, m, map) chosen in step `step`, for the next stance of its leg."""
        self._chosen[request.leg] = _PendingChoice(step, request, planned)

    def look(self, world: PhysicsWorld) -> bool:
        """Record finished stances and tilt from the true state after a tick; return True if the robot has fallen."""
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
        choice, self._standing[foot] = self._standing[foot], None
        if choice is None:
            return
        self.found.append(
            ChosenStance(
                leg=foot, step=choice.step, planned=choice.planned,
                nominal=(choice.request.nominal[0], choice.request.nominal[1]), stroke=choice.request.stroke,
                landed=(float(self._start[foot, 0]), float(self._start[foot, 1])),
                sliding=self.sliding[-1], displacement=self.displacement[-1],
                load=float(self._load[foot] / max(1.0, self._ticks[foot])),
            )
        )  # fmt: skip


class RuleSelector:
    """Foothold selector of a walk: gets footholds from a rule and passes each choice to a `StanceObserver`."""

    def __init__(self, robot: Robot, ground: FootholdGround, rule: Rule | None, stances: StanceObserver) -> None:
        self.robot, self.ground, self.rule, self.stances = robot, ground, rule, stances
        self.steps = 0

    def __call__(self, request: LandingRequest) -> Sequence[FootholdReply]:
        self.steps += 1
        replies = nominal_footholds(request) if self.rule is None else self._ask(request, self.rule)
        for leg, reply in zip(request.legs, replies, strict=True):
            point = leg.nominal if reply.foothold is None else reply.foothold
            self.stances.chose(self.steps, leg, (point[0], point[1]))
        return replies

    def _ask(self, request: LandingRequest, rule: Rule) -> list[FootholdReply]:
        half = 0.5 * request.yaw
        base = chooser.TrunkPose(request.body, (math.cos(half), 0.0, 0.0, math.sin(half)))
        landings = [chooser.Landing(leg.leg, leg.nominal, leg.stroke) for leg in request.legs]
        found = rule(self.ground, self.robot, base, landings, self.steps)
        return [FootholdReply(r.status, r.foothold, r.trunk_shift, r.reason) for r in found]


class JoinedWalk(JoinedLoop):
    """Simulated walk over a terrain, tick by tick; without a rule, feet land on their nominal footholds."""

    def __init__(
        self, seed: int, setting: Setting, rule: Rule | None, ground: tuple[Terrain, HeightMap] | None = None
    ) -> None:
        self.seed, self.setting = seed, setting
        self.robot = load_robot(setting.robot)
        if ground is None:
            made = make_terrain(setting.terrain, seed=seed, amp=setting.amplitude)
            ground = made, observed_map(made, setting.profile, seed)
        terrain, heights = ground
        config = WorldConfig(physics=Physics(friction=setting.friction))
        world = PhysicsWorld(self.robot, terrain, seed=seed, config=config)
        self.stances = StanceObserver(world)
        self.selector = RuleSelector(self.robot, build_ground(heights, self.robot.foot_radius), rule, self.stances)
        params = WalkerParams.for_robot(self.robot, **dict(setting.params))
        super().__init__(world, LeggedWalker(self.robot, params, select=self.selector), setting.delay)
        self.walker.set_map(heights)
        self.started = False
        self.unreachable, self.margin = 0, math.inf

    def tick(self) -> bool:
        """Advance the simulated walk by one control tick; return True while it goes on."""
        out = self.decide()
        self.unreachable += out.unreachable
        self.margin = self.margin if out.margin is None else min(self.margin, out.margin)
        if not self.started and out.state == "standing":
            command = self.setting.command or MotionCommand("walk", distance=self.setting.distance)
            self.started = self.walker.command(command).accepted
        elif self.started and out.state in ("standing", "refused"):
            return False
        if not self.started and self.world.tick * TICK_S > PATIENCE_S:
            return False
        self.act()
        return not self.stances.look(self.world) and self.world.tick * TICK_S < self.setting.limit_s

    def run(self) -> Self:
        """Simulate the walk to the commanded distance, a refused command, a fall or the time limit; return the walk."""
        while self.tick():
            pass
        return self

    def verdict(self) -> WalkVerdict:
        """Return the outcome of the simulated walk so far."""
        truth, out, stances = self.world.truth(), self.out, self.stances
        assert out is not None
        odometry = math.hypot(*(np.array(self.estimator.pose().position[:2]) - truth.position[:2]))
        way = self.setting.distance if self.setting.command is None else 0.0
        arrived = self.started and not truth.fallen and out.state == "standing"
        return WalkVerdict(
            seed=self.seed, reached=bool(arrived and truth.position[0] >= REACHED * way), fallen=bool(truth.fallen),
            state=out.state, reason=out.reason, x=round(float(truth.position[0]), 4),
            y=round(float(truth.position[1]), 4), time_s=round(TICK_S * self.world.tick, 2), steps=out.steps,
            tilt_deg=round(math.degrees(stances.tilt), 2),
            sliding_mm=round(1e3 * float(np.mean(stances.sliding or [0.0])), 4),
            displacement_mm=round(1e3 * float(np.mean(stances.displacement or [0.0])), 4),
            stances=len(stances.sliding), odometry_mm=round(1e3 * odometry, 1), margin_mm=round(1e3 * self.margin, 1),
            unreachable=self.unreachable, costs_us=tuple(self.costs_us),
        )  # fmt: skip


def walk(
    seed: int, setting: Setting, rule: Rule | None = None, ground: tuple[Terrain, HeightMap] | None = None
) -> WalkVerdict:
    """Simulate a walk to its end, a refusal, a fall or the time limit; return the verdict.

    Args:
        seed: seed of terrain, map errors and sensor noise.
        setting: conditions of the walk.
        rule: rule that chooses the footholds; None = nominal footholds.
        ground: terrain, and the height map that the robot gets; None = made from setting and seed.
    """
    return JoinedWalk(seed, setting, rule, ground).run().verdict()
