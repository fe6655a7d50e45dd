"""Robot for the study of lost robots: the navigator, a walker without legs, a camera and a ranger in a corridor.

The service `navigator` runs whole (localiser, tracker, pilot, maps), and its own `lost` of `state/pose` is measured.
Beside it stand a walker without legs, which obeys its orders, and a camera with the noise of the model.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import poisson

from benchmarks.lost_floor import HIGH, LOW, MIDDLE, World, corridor, special, wrong_map
from surefoot.arrays import Array
from surefoot.lockstep.join import TickInputs
from surefoot.schemas import topics
from surefoot.schemas.hw import Landmark, LandmarkDetections, Range, Tick
from surefoot.schemas.navigation import GotoRequest
from surefoot.schemas.state import GaitState, Odometry
from surefoot.schemas.terrain import HeightMapMessage
from surefoot.schemas.terrain import LandmarkMap as LandmarkMapMessage
from surefoot.services.navigator.belief.matching import Detections
from surefoot.services.navigator.belief.relocalise import between, placed
from surefoot.services.navigator.belief.strain import turned_back
from surefoot.services.navigator.service import SERVICE, NavigatorConfig

TICK = 0.01
NEAR, FAR, HALF = 0.35, 1.18, math.radians(33)
"""Footprint of Nao's lower camera: `NEAR`, `FAR`: least and largest distance on the floor, m; `HALF`: half of its
horizontal angle, rad."""
CELL = 0.05
HEIGHT = 0.45
"""Height of the robot's camera over the floor, m."""
SEEN = {"walking": 0.10, "turning": 0.03, "standing": 0.45}
"""Share of the landmarks in view that a frame recognises, 0 to 1, by state of the gait; measured on the simulated
Nao."""
HARD_SEEN = {"walking": 0.108, "turning": 0.043, "standing": 0.32}
"""Share of the landmarks in view that a frame of the camera `nao_paper` recognises, 0 to 1, by state of the gait."""
STEP_S, START_S, CLOSE_S = 1.8, 1.0, 0.9
"""`STEP_S`: duration of an action, s; `START_S`: time to start walking, s; `CLOSE_S`: time to come to stand, s."""
FALSE = 0.1
"""Share of detections whose descriptor is that of another landmark, 0 to 1."""
WEIGHED_S = 3.0
"""Time after a robot was put down elsewhere in which the oracles evaluate its frames, s."""


def wrapped(angle: float) -> float:
    """Return an angle, rad, wrapped to [-pi, pi)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


class Stage:
    """Stand-in for the runtime of a service that keeps the last message of each topic."""

    def __init__(self) -> None:
        self.last: dict[str, Any] = {}

    def publish(self, topic: Any, message: Any, stamp_ns: int | None) -> None:
        """Keep a message as the last one of its topic."""
        self.last[topic.key] = message

    def log(self, level: str, text: str) -> None:
        """Ignore a line of the log."""


class Walker:
    """Simulated walker that walks, turns and stops as ordered, with drift and noise.

    Args:
        rng: random stream of the walker's noise.
        drift: rad per m.
    """

    def __init__(self, rng: np.random.Generator, drift: float) -> None:
        self.rng, self.drift = rng, drift
        self.pose, self.odom = np.zeros(3), np.zeros(3)
        self.state, self.order = "standing", 0
        self._left, self._wait, self._closing, self._rate, self._stops = 0.0, 0.0, 0.0, (0.0, 0.0), False

    def take(self, number: int, command: Any) -> None:
        """Start a walk, turn or stop, order `number`, which the navigator sent in the previous tick."""
        if number == self.order or command is None:
            return
        self.order = number
        if command.action == "stop":
            self._left %= 0.5 * STEP_S  # the step under way lands
            self._stops = self.state != "standing"
            self._closing = CLOSE_S if self._stops and self._left == 0.0 else 0.0
            return
        self._stops = False
        rest = self._left if self.state != "standing" else 0.0
        self._wait = START_S if self.state == "standing" else self._wait
        way, turn = command.distance or 0.0, command.angle or 0.0
        total = rest + (STEP_S * max(1.0, abs(turn) / 0.41) if command.action == "turn" else STEP_S)
        self._rate = ((self._rate[0] * rest + way) / total, (self._rate[1] * rest + turn) / total)
        self._left, self.state = total, "turning" if command.action == "turn" else "walking"

    @property
    def ends_in(self) -> float | None:
        """Time until the last step of an order lands, s; a stop has none."""
        return self._wait + self._left if self._left > 0.0 and not self._stops else None

    def tick(self) -> None:
        """Move the simulated robot for a tick of 10 ms."""
        if self._wait > 0.0:
            self._wait -= TICK
        elif self._left > 0.0:
            step = min(TICK, self._left)
            way, turn = self._rate[0] * step, self._rate[1] * step
            along, bend = 0.006 * math.sqrt(way / 0.1), math.radians(0.5) * math.sqrt(way / 0.1 + abs(turn) / 0.4)
            noise = self.rng.standard_normal(2)
            self._move(self.pose, way + along * noise[0], turn + self.drift * way + bend * noise[1])
            self._move(self.odom, way, turn + self.drift * way + bend * noise[1])  # odometry sees its turns
            self._left -= step
            if self._left <= 1e-9:
                self._left, self._closing = 0.0, CLOSE_S
        elif self._closing > 0.0:
            self._closing -= TICK
        else:
            self.state = "standing"

    def _move(self, pose: Array, way: float, turn: float) -> None:
        middle = pose[2] + 0.5 * turn
        pose += (way * math.cos(middle), way * math.sin(middle), turn)


class Robot:
    """The navigator with a walker, a camera and a ranger in a corridor.

    Args:
        seed: seed of all random numbers.
        world: conditions.
        wrong: kind of the map, see `wrong_map`; empty = right.
        walls: the ranger sees the corridor's walls.
        turn: pitch, roll and turn aside of the camera from where the navigator takes it to be, rad.
    """

    def __init__(
        self, seed: int, world: World, wrong: str = "", *, walls: bool = True,
        turn: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:  # fmt: skip
        self.turn = (-turn[0], -turn[1], -turn[2])
        self.sights: list[int] = []
        """Tick of each recognition of a landmark since the robot was put down elsewhere."""
        self.before: tuple[float, float, float] | None = None
        """Pose, relative to the robot, at which it would be, had it not been put down elsewhere: x, y m, yaw rad; None
        = it was not."""
        self.put_at = 0
        """Tick at which the robot was put down elsewhere."""
        self.evidence: list[tuple[float, Array]] = []
        """Log densities of each frame since the robot was put down, at the true pose and at the poses `others`, less
        that at `before`, nats."""
        self.others, self.weights = np.zeros((0, 3)), np.zeros(0)
        """`others`: poses drawn at random in the corridor, relative to the robot like `before`, (n, 3) m and rad;
        `weights`: logarithms of their weights, (n,)."""
        self.rng, self.hard, self.walls = np.random.default_rng(seed), world.camera == "hard", walls
        self.hole = world.hole
        self.places, self.looks = special(*corridor(seed, world.density, world.copied), world)
        places, looks = wrong_map(wrong, self.places, self.looks, seed)
        gone, elsewhere = np.random.default_rng(seed + 11), corridor(seed + 12, world.density, 0.0)[0]
        places = np.where(gone.uniform(size=(len(places), 1)) < world.moved, np.resize(elsewhere, places.shape), places)
        self.walker = Walker(self.rng, self.rng.choice([-0.349, 0.349]) if self.hard else 0.03)
        self.stage, self.tick_number, self.tilt, self.dark, self.frames = Stage(), 0, 0.0, False, 0
        params: dict[str, Any] = {"params": "nao-paper", "control": "commands"} if self.hard else {"params": "nao"}
        self.navigator = SERVICE(NavigatorConfig(robot="nao", policy="tuned", actions="four", **params))
        self.navigator.attach(self.stage)  # pyright: ignore[reportArgumentType] - what it publishes is all that counts
        self.navigator.on_start()
        rows = np.hstack((places, looks)).astype("<f4").tobytes()
        z = np.zeros((44, 154), dtype="<f4")
        z[:2], z[-2:], z[:, :2], z[:, -2:] = 0.5, 0.5, 0.5, 0.5
        self.maps = {
            topics.TERRAIN_MAP.key: HeightMapMessage(
                rows=44, cols=154, cell=CELL, origin=(LOW[0] - 0.075, LOW[1] - 0.075), data=z.tobytes(), version=1
            ),
            topics.TERRAIN_LANDMARKS.key: LandmarkMapMessage(
                count=len(places), descriptor_length=8, data=rows, version=1
            ),
        }

    @property
    def lost(self) -> bool:
        """True if the navigator counts itself as lost."""
        return self.navigator.localiser.lost.lost

    def goto(self, x: float, y: float) -> None:
        """Request a goal at x, y m, map, from the navigator."""
        self.navigator.requests.goto(GotoRequest(position=(x, y)))

    def step(self, seconds: float) -> None:
        """Simulate the robot, its camera and the navigator for `seconds` s of simulated time."""
        for _ in range(round(seconds / TICK)):
            order = self.stage.last.get(topics.NAVIGATOR_ORDER.key)
            if order is not None:
                self.walker.take(order.number, order.command)
            self.walker.tick()
            tick = Tick(
                tick=self.tick_number, epoch=1, stamp_ns=self.tick_number * 10_000_000, roster=(), roster_version=1,
                due=(), mode="lockstep",
            )  # fmt: skip
            self.navigator.on_tick(TickInputs(tick, self._messages()))
            self.tick_number += 1

    def _messages(self) -> dict[str, Any]:
        w = self.walker
        found: dict[str, Any] = {**self.maps} if self.tick_number == 0 else {}
        found[topics.STATE_GAIT.key] = GaitState(
            walk_id=w.order, state=w.state, phase=0.0, stance=(), footholds=(), remaining=0.0,  # pyright: ignore[reportArgumentType] - one of three of its words
            order=w.order, order_refused="", ends_in_s=w.ends_in,
        )  # fmt: skip
        if not self.hard:
            x, y, yaw = w.odom.tolist()
            found[topics.STATE_ODOMETRY.key] = Odometry(
                position=(x, y, 0.3), quat_wxyz=(1.0, 0.0, 0.0, 0.0), yaw=yaw, velocity=(0.0, 0.0, 0.0),
                covariance=(0.0,) * 16, initialised=True,
            )  # fmt: skip
        if self.tick_number % (170 if self.hard else 10) == 0:
            found[topics.HW_LANDMARKS.key] = self._frame()
        if self.tick_number % 10 == 0 and self.walls:
            found[topics.HW_RANGE.key] = Range(
                distance=self._echo(), shortest=0.25, longest=2.55, field_of_view=math.radians(60), bump=(False, False)
            )
        return found

    def _echo(self) -> float | None:
        """Return the ranger's distance of the nearest wall in its cone, with noise, m; None = farther than 2.55 m."""
        x, y, yaw = self.walker.pose.tolist()
        best = math.inf
        for angle in np.linspace(yaw - 0.52, yaw + 0.52, 13).tolist():
            c, s = math.cos(angle), math.sin(angle)
            ends = [(HIGH[0] - x) / c if c > 0 else (LOW[0] - x) / c if c < 0 else math.inf]
            ends.append((HIGH[1] - y) / s if s > 0 else (LOW[1] - y) / s if s < 0 else math.inf)
            best = min(best, *ends)
        best = max(0.25, best - 0.05 + 0.01 * float(self.rng.standard_normal()))
        return best if best < 2.55 else None

    def _frame(self) -> LandmarkDetections:
        """Return the landmarks that the simulated camera recognises in the present tick, with noise and false ones."""
        rng, (x, y, yaw) = self.rng, self.walker.pose.tolist()
        d = self.places - (x, y)
        r = np.hypot(d[:, 0], d[:, 1])
        b = (np.arctan2(d[:, 1], d[:, 0]) - yaw + np.pi) % (2 * np.pi) - np.pi
        view = np.flatnonzero((r > NEAR) & (r < FAR) & (np.abs(b) < HALF))
        share = (HARD_SEEN if self.hard else SEEN)[self.walker.state]
        view = view[rng.uniform(size=view.size) < (0.0 if self.dark else share)][: 10 if self.hard else 20]
        sd_r, sd_b = self._sds(r[view])
        keep = 0.72
        self.tilt = keep * self.tilt + math.sqrt(1 - keep * keep) * 0.004 * rng.standard_normal()
        ranges = np.maximum(r[view] + sd_r * rng.standard_normal(view.size) + self.tilt * (1 + r[view] ** 2), 0.02)
        bearings = b[view] + sd_b * rng.standard_normal(view.size)
        shown = np.where(rng.uniform(size=view.size) < FALSE, rng.integers(len(self.places), size=view.size), view)
        looks = self.looks[shown] + 0.05 * rng.standard_normal((view.size, 8))
        self.frames += 1
        self._weigh(np.stack((ranges, bearings), 1), shown, share)
        self.sights += [self.tick_number] * view.size
        sights = turned_back(Detections(ranges, bearings, looks), self.turn, HEIGHT)
        marks = tuple(
            Landmark(range=float(a), bearing=wrapped(float(c)), descriptor=tuple(look))
            for a, c, look in zip(sights.ranges, sights.bearings, looks.tolist(), strict=True)
        )
        return LandmarkDetections(landmarks=marks, stamp_ns=self.tick_number * 10_000_000)

    def _sds(self, r: Array) -> tuple[Array, float]:
        """Return standard deviations of ranges, (n,) m, at the distances r, (n,) m, and of a bearing, rad."""
        still = 0.5 if self.walker.state == "standing" else 1.0
        hard = np.full(r.size, 0.138 * still), math.radians(9.2) * still
        return hard if self.hard else (0.03 * r, math.radians(1.5))

    def _weigh(self, seen: Array, shown: NDArray[np.int64], share: float) -> None:
        """Record log densities of a frame (`seen`: ranges, m, and bearings, rad) at the true and at other poses.

        Detections come as a Poisson process. A landmark in view at h is recognised at z with density N(z - h), by its
        own look or, in the share `FALSE`, by that of any; the common tilt of the frame is left out.
        """
        if self.before is None or TICK * (self.tick_number - self.put_at) > WEIGHED_S:
            return
        x, y, yaw = self.walker.pose.tolist()
        found = [
            self._log_density(np.array(placed((float(a), float(b), float(c)), (x, y, yaw))), seen, shown, share)
            for a, b, c in ((0.0, 0.0, 0.0), self.before, *self.others.tolist())
        ]
        self.evidence.append((found[0] - found[1], np.array(found[2:]) - found[1]))

    def _draw(self, count: int = 400) -> None:
        """Draw poses in the corridor, every other one near the robot, with weights that make them uniform over it."""
        rng, here = np.random.default_rng(self.tick_number), self.walker.pose.copy()
        low, high = np.array([*LOW, -math.pi]), np.array([*HIGH, math.pi])
        sds = np.array([0.12, 0.12, 0.15])
        poses = rng.uniform(low, high, (count, 3))
        poses[::2] = here + sds * rng.standard_normal((len(poses[::2]), 3))
        off = poses - here
        off[:, 2] = (off[:, 2] + math.pi) % (2.0 * math.pi) - math.pi
        near = np.exp(-0.5 * np.square(off / sds).sum(1)) / ((2.0 * math.pi) ** 1.5 * sds.prod())
        even = 1.0 / (high - low).prod()
        self.weights = np.log(even / (0.5 * near + 0.5 * even) / count)
        a, b, c = here.tolist()
        self.others = np.array([between((x, y, yaw), (a, b, c)) for x, y, yaw in poses.tolist()])

    def _log_density(self, pose: Array, seen: Array, shown: NDArray[np.int64], share: float) -> float:
        """Return the log density, nats, of the k detections of a frame at a pose x, y (m), yaw (rad), map, (3,).

        A frame of the largest number of detections counts as at least that many. `seen`: ranges, m, and bearings, rad,
        (k, 2); `shown`: landmark whose descriptor each has, (k,); `share`: of those in view that are recognised.
        """
        d = self.places - pose[:2]
        r, b = np.hypot(d[:, 0], d[:, 1]), (np.arctan2(d[:, 1], d[:, 0]) - pose[2] + np.pi) % (2 * np.pi) - np.pi
        view, most = np.flatnonzero((r > NEAR) & (r < FAR) & (np.abs(b) < HALF)), 10 if self.hard else 20
        mean, k = max(1e-9, share * view.size), len(seen)
        count = float(poisson.logpmf(k, mean) if k < most else poisson.logsf(most - 1, mean))
        off = seen[:, None, :] - np.stack((r[view], b[view]), 1)
        sd_r, sd_b = self._sds(r[view])
        square = np.square(off[..., 0] / sd_r) + np.square(off[..., 1] / sd_b)
        each = np.exp(-0.5 * square) / (2.0 * np.pi * sd_r * sd_b)  # (k, landmarks in view)
        alike = np.isclose(self.looks[shown] @ self.looks.T, 1.0)  # (k, landmarks)
        right = np.where(alike[:, view], each, 0.0).sum(1)
        density = (1.0 - FALSE) * right + FALSE * alike.mean(1) * each.sum(1)
        return count + float(np.log(np.maximum(density, 1e-30) / max(1, view.size)).sum())

    def put(self, distance: float, turn_deg: float) -> None:
        """Lift the robot and put it down elsewhere in the corridor."""
        self.sights.clear()
        self.put_at = self.tick_number
        pose, old = self.walker.pose, self.walker.pose.tolist()
        while True:
            way = self.rng.uniform(-math.pi, math.pi)
            x, y = pose[0] + distance * math.cos(way), pose[1] + distance * math.sin(way)
            if self.hole > 0.0:
                x, y = MIDDLE.tolist()
                break
            if LOW[0] + 0.4 < x < HIGH[0] - 0.4 and abs(y) < 0.6:
                break
        pose[0], pose[1] = x, y
        pose[2] += math.copysign(math.radians(turn_deg), self.rng.uniform(-1, 1))
        self.before = between((old[0], old[1], old[2]), (x, y, float(pose[2])))
        self._draw()

    def error(self) -> tuple[float, float]:
        """Return distance in m and angle in rad of the believed pose from the truth."""
        x, y, yaw = self.navigator.localiser.tracker.pose
        return math.hypot(x - self.walker.pose[0], y - self.walker.pose[1]), abs(wrapped(yaw - self.walker.pose[2]))

    def until(self, done: Callable[[], bool], most: float) -> float | None:
        """Simulate until `done` returns true; return the time it took, s, None = not within `most` s."""
        for i in range(round(most / 0.1)):
            if done():
                return 0.1 * i
            self.step(0.1)
        return None
