"""Displaced robots: how soon they notice and recover, false alarms, times of matching and relocalising."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from statistics import median

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Bench, goal, seconds_of, table
from surefoot.lab.studies import Line, study
from surefoot.services.navigator.belief.landmarks import FloorLandmarks
from surefoot.services.navigator.belief.lost import (
    Footprint,
    LostModel,
    LostState,
    evidence_of,
    in_view,
    observed,
    passed,
)
from surefoot.services.navigator.belief.matching import Detections, SightNoise, known_elsewhere, match
from surefoot.services.navigator.belief.relocalise import Glance, relocalise

BENCH = Bench("lost")

Array = NDArray[np.float64]

FRAME = 0.1
"""Time between frames, s."""
SPEED, TURN = 0.055, math.radians(23) / 1.8
"""Speed and turn rate of the simulated Nao, m/s and rad/s."""
NEAR, FAR, HALF = 0.35, 1.18, math.radians(33)
"""Footprint of its lower camera: least and largest distance, m, and half of its angle, rad."""
VIEW = Footprint(NEAR, FAR, HALF)
LOW, HIGH = (-1.0, -1.0), (6.5, 1.0)
"""Corners of the corridor, m."""
SEEN = {"walk": 0.10, "turn": 0.03, "settle": 0.19, "stand": 0.45}
"""Recognised share of the landmarks in view, measured on the simulated Nao."""
EASY = SightNoise(common_range_sd=0.01)
ROUGH = SightNoise(range_sd=0.15, range_share=0.0, bearing_sd=math.radians(10), common_range_sd=0.03)
TILT_MEMORY = 0.3
"""Time over which the error common to a frame stays alike, s."""
ATTEMPT, PATIENCE = 0.5, 1.5
"""Time between attempts to relocalise, and until a robot that cannot turns by 46 deg, s."""


def wrapped(angle: float) -> float:
    """Return the same angle in [-pi, pi), rad."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def corridor(seed: int, density: float, copied: float, copies: int = 10) -> FloorLandmarks:
    """Return landmarks at random; a share of them in groups that look the same."""
    rng = np.random.default_rng(seed)
    n = rng.poisson(density * (HIGH[0] - LOW[0]) * (HIGH[1] - LOW[1]))
    looks = rng.standard_normal((n, 8))
    looks /= np.linalg.norm(looks, axis=1, keepdims=True)
    many = int(copied * n)
    looks[:many] = looks[np.arange(many) // copies * copies]
    return FloorLandmarks(rng.uniform(LOW, HIGH, (n, 2)), looks)


@dataclass
class Robot:
    """A robot that walks, sees and believes.

    Args:
        world: the landmarks.
        noise: of its camera.
        seed: of everything random.
        false: share of detections with the look of another landmark.
    """

    world: FloorLandmarks
    noise: SightNoise
    seed: int
    false: float = 0.1

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)
        self.model = LostModel.of(self.noise, VIEW)
        self.truth = np.array([self.rng.uniform(0.0, 5.0), self.rng.uniform(-0.3, 0.3), 0.0])
        self.mean, self.cov = self.truth.copy(), np.diag([0.05**2, 0.05**2, math.radians(5) ** 2])
        self.mode, self.left, self.tilt, self.lost = "walk", 2.0, 0.0, LostState()

    def wander(self) -> None:
        """Move for a frame: walk up and down the corridor, stand now and then, turn at its ends."""
        self.left -= FRAME
        if self.left <= 0.0:
            self.mode = {"walk": "settle", "settle": "stand", "stand": "walk", "turn": "walk"}[self.mode]
            self.left = {"walk": 6.0, "settle": 0.7, "stand": 1.0}[self.mode]
        x, y, heading = self.mean
        goal = math.atan2(-y, 2.0 * math.copysign(1.0, math.cos(heading)))
        if (x > 5.0 and math.cos(heading) > -0.5) or (x < 0.5 and math.cos(heading) < 0.5):
            self.mode, self.left = "turn", 1.0
        steer = wrapped(goal - heading)
        turn = TURN if self.mode == "turn" else max(-TURN, min(TURN, steer)) if self.mode == "walk" else 0.0
        self.move(SPEED if self.mode == "walk" else 0.0, turn)

    def move(self, speed: float, turn: float) -> None:
        """Move for a frame, and predict the belief."""
        step, angle = speed * FRAME, turn * FRAME
        along, bend = (
            0.06 * math.sqrt(0.1 * step),
            math.radians(5) * math.sqrt(step / 0.1) + 0.2 * abs(angle) ** 0.5 * 0.1,
        )
        for pose, noisy in ((self.truth, 1.0), (self.mean, 0.0)):
            r = noisy * self.rng.standard_normal(3)
            way = step + along * r[0]
            c, s = math.cos(pose[2] + 0.5 * angle), math.sin(pose[2] + 0.5 * angle)
            pose[0] += way * c - along * r[1] * s
            pose[1] += way * s + along * r[1] * c
            pose[2] = wrapped(pose[2] + angle + bend * r[2])
        f = np.eye(3)
        f[0, 2], f[1, 2] = -step * math.sin(self.mean[2]), step * math.cos(self.mean[2])
        self.cov = f @ self.cov @ f.T + np.diag([along**2 + 1e-8, along**2 + 1e-8, bend**2 + 1e-8])

    def look(self) -> Detections:
        """Return the detections of a frame."""
        rng, noise = self.rng, self.noise
        keep = math.exp(-FRAME / TILT_MEMORY)
        self.tilt = keep * self.tilt + math.sqrt(1 - keep * keep) * noise.common_range_sd * rng.standard_normal()
        d = self.world.positions - self.truth[:2]
        r = np.hypot(d[:, 0], d[:, 1])
        b = (np.arctan2(d[:, 1], d[:, 0]) - self.truth[2] + np.pi) % (2 * np.pi) - np.pi
        view = np.flatnonzero((r > NEAR) & (r < FAR) & (np.abs(b) < HALF))
        view = view[rng.uniform(size=view.size) < SEEN[self.mode]][:20]
        k = view.size
        sd = np.hypot(noise.range_sd, noise.range_share * r[view])
        ranges = np.maximum(r[view] + sd * rng.standard_normal(k) + self.tilt, 0.0)
        bearings = b[view] + noise.bearing_sd * rng.standard_normal(k)
        shown = np.where(rng.uniform(size=k) < self.false, rng.integers(len(self.world), size=k), view)
        return Detections(ranges, bearings, self.world.descriptors[shown] + noise.look_sd * rng.standard_normal((k, 8)))

    def watch(self, seen: Detections) -> None:
        """Match a frame, correct the belief, update whether it is lost."""
        found = match(self.mean, self.cov, seen, self.world, self.noise, seed=self.seed)
        self.lost = passed(self.lost, FRAME, self.model)
        x, y, heading = self.mean.tolist()
        expected = SEEN[self.mode] * in_view(self.world, (x, y, heading), VIEW)
        evidence = evidence_of(found, seen, self.world, self.noise, expected)
        self.lost = observed(self.lost, evidence, self.model)
        common = self.noise.common_range_sd**2 * max(1.0, 3.0 * len(found.detections))
        for d, mark in zip(found.detections, found.landmarks, strict=True):
            dx, dy = self.world.positions[mark] - self.mean[:2]
            q = math.hypot(dx, dy)
            nu = np.array([seen.ranges[d] - q, seen.bearings[d] - math.atan2(dy, dx) + self.mean[2]])
            nu[1] = wrapped(nu[1])
            h = np.array([[-dx / q, -dy / q, 0.0], [dy / q**2, -dx / q**2, -1.0]])
            own = self.noise.range_sd**2 + (self.noise.range_share * q) ** 2
            s = h @ self.cov @ h.T + np.diag([own + common, self.noise.bearing_sd**2])
            gain = self.cov @ h.T @ np.linalg.inv(s)
            self.mean += gain @ nu
            self.cov = self.cov - gain @ s @ gain.T
            self.cov = 0.5 * (self.cov + self.cov.T)

    def frame(self) -> None:
        """Walk on, see, believe."""
        self.wander()
        self.watch(self.look())

    def displace(self) -> None:
        """Be lifted and put down 0.7 m away, turned by 90 degrees, still on the floor."""
        there = np.array([np.inf, np.inf])
        while not (-0.3 < there[0] < 5.8 and abs(there[1]) < 0.6):
            way = self.rng.uniform(-math.pi, math.pi)
            there = self.truth[:2] + 0.7 * np.array([math.cos(way), math.sin(way)])
        turn = math.copysign(0.5 * math.pi, self.rng.uniform(-1, 1))
        self.truth[:] = there[0], there[1], wrapped(self.truth[2] + turn)

    def error(self, pose: Array) -> tuple[float, float]:
        """Return distance in m and angle in rad of a pose from the truth."""
        return math.hypot(*(pose[:2] - self.truth[:2])), abs(wrapped(pose[2] - self.truth[2]))

    def nees(self, pose: Array, covariance: Array) -> float:
        """Return the NEES of a pose per degree of freedom."""
        e = pose - self.truth
        e[2] = wrapped(e[2])
        return float(e @ np.linalg.solve(covariance, e)) / 3


def is_off(far: float, turned: float) -> bool:
    """Return whether a pose is wrong: by more than 0.3 m or 0.5 rad."""
    return far > 0.3 or turned > 0.5


def recover(robot: Robot) -> tuple[float, Array | None, int]:
    """Stand, look and turn until relocalised, 30 s at most; return s that it took, the pose, and attempts."""
    spent, since, attempts, glances, turned, few = 0.0, 0.0, 0, list[Glance](), 0.0, False
    robot.mode = "settle"
    while spent < 30.0:
        spent += FRAME
        since += FRAME
        if robot.mode == "turn":
            before = robot.truth[2]
            robot.move(0.0, TURN)
            turned += wrapped(robot.truth[2] - before)  # odometry hardly errs here
            if since >= 3.6:
                robot.mode, since = "settle", 0.0
            continue
        robot.mode = "settle" if since < 0.7 else "stand"
        glances.append(Glance(robot.look(), (0.0, 0.0, turned)))
        if round(since / FRAME) % round(ATTEMPT / FRAME) == 0:
            attempts += 1
            here = [Glance(g.seen, (0.0, 0.0, g.pose[2] - turned)) for g in glances]
            found = relocalise(here, robot.world, robot.noise)
            few = found.sightings < 6
            if found.pose is not None:
                return spent, np.array(found.pose), attempts
        if since >= (1.0 if few else PATIENCE + 0.7):
            robot.mode, since = "turn", 0.0
    return spent, None, attempts


def displacement(seed: int, density: float, noise: SightNoise, copied: float) -> Line:
    """Let a robot walk for a while, displace it, wait until it notices (20 s at most) and recovers."""
    robot = Robot(corridor(seed, density, copied), noise, seed)
    for _ in range(100 + seed % 50):
        robot.frame()
    early = robot.lost.doubt
    robot.displace()
    noticed = None
    for i in range(200):
        robot.frame()
        if robot.lost.doubt >= robot.model.threshold:
            noticed = (i + 1) * FRAME
            break
    spent, pose, attempts = recover(robot)
    far, turned = robot.error(pose) if pose is not None else (None, None)
    wrong = far is not None and turned is not None and is_off(far, turned)
    return {
        "seed": seed, "early": early, "noticed": noticed, "recovered": None if pose is None else spent,
        "error": far, "turn": turned, "wrong": wrong, "attempts": attempts,
    }  # fmt: skip


def alarms(seed: int, minutes: float, density: float, noise: SightNoise, copied: float) -> tuple[int, int, list[float]]:
    """Return the false alarms of an undisturbed robot, its frames with a wrong pose, and NEES of each frame."""
    robot = Robot(corridor(seed, density, copied), noise, seed)
    count, off, nees = 0, 0, []
    for _ in range(round(minutes * 60 / FRAME)):
        robot.frame()
        nees.append(robot.nees(robot.mean, robot.cov))
        far, turned = robot.error(robot.mean)
        off += is_off(far, turned)
        if robot.lost.doubt >= robot.model.threshold:
            count += not is_off(far, turned)
            robot.lost = LostState()
            robot.mean, robot.cov = robot.truth.copy(), np.diag([0.05**2, 0.05**2, math.radians(5) ** 2])
    return count, off, nees


CAMERAS = {"easy": EASY, "rough": ROUGH}


@dataclass(frozen=True)
class World:
    """Conditions of the study.

    Attributes:
        density: landmarks per m2.
        copied: share of landmarks that look like nine others.
        camera: easy or rough.
        first: first seed.
    """

    density: float = 40.0
    copied: float = 0.5
    camera: str = "easy"
    first: int = 1000

    @property
    def noise(self) -> SightNoise:
        """Noise of the camera."""
        return CAMERAS[self.camera]


def displaced(seed: int, world: World) -> Line:
    """Return what came of one displacement."""
    return displacement(seed, world.density, world.noise, world.copied)


def undisturbed(seed: int, world: World) -> Line:
    """Return the alarms of ten minutes without a displacement."""
    count, off, nees = alarms(seed, 10.0, world.density, world.noise, world.copied)
    return {"count": count, "off": off, "nees": nees}


@BENCH.part("--displacements 2 --hours 0")
def displacements(*, displacements: int = 100, hours: float = 1.0, world: World, processes: int = 1) -> None:
    """Times until a displaced robot notices and recovers, wrong recoveries, and false alarms.

    A made-up robot walks up and down a corridor with landmarks (half of their looks copied tenfold, a tenth of the
    detections false), 10 frames a second. Its belief is an extended Kalman filter over x, y, heading. Displaced by
    0.7 m and 90 degrees it has to notice; then it stands, looks, turns on the spot where that is not enough.

    Args:
        displacements: number of robots.
        hours: of undisturbed walking.
        world: conditions.
    """
    seeds = range(world.first, world.first + displacements)
    lines = study(partial(displaced, world=world), [{"seed": seed} for seed in seeds], processes=processes)
    rows: list[tuple[object, ...]] = []
    for name, limit in (("noticed", 3.0), ("recovered", 10.0)):
        times = np.array([math.inf if line[name] is None else line[name] for line in lines])
        found = np.quantile(times, (0.5, 0.95, 1.0), method="higher")
        rows.append((name, *(float(x) for x in found), f"{100 * (times <= limit).mean():.1f} % within {limit:g} s"))
    table(f"{displacements} displacements, {world}", ("event", "median s", "95 % s", "largest s", "share"), rows)
    wrong = sum(bool(line["wrong"]) for line in lines)
    bound = f", less than {100 * (1.0 - 0.05 ** (1.0 / len(lines))):.2g} % (95 %)" if not wrong else ""
    print(f"recovered at a wrong pose: {wrong}{bound}")
    first = world.first + 10_000
    jobs = [{"seed": seed} for seed in range(first, first + round(hours * 6))]
    calm = study(partial(undisturbed, world=world), jobs, processes=processes)
    if calm:
        nees = float(np.mean([value for line in calm for value in line["nees"]]))
        count, off = (sum(line[name] for line in calm) for name in ("count", "off"))
        print(f"{hours:g} h undisturbed: {count} false alarms, {off} frames with a wrong pose, NEES {nees:.2f}")


@BENCH.part("--robots 1")
def standing(*, robots: int = 1000, world: World) -> None:
    """Share of robots that are relocalised by standing and looking along the floor, by density and time.

    Args:
        robots: of each row.
        world: conditions; the density is that of the row.
    """
    rows: list[tuple[object, ...]] = []
    for density in (60.0, 40.0, 10.0, 5.0):
        for frames in (1, 5, 10, 30):
            right, wrong, nees = 0, 0, list[float]()
            for seed in range(world.first, world.first + robots):
                robot = Robot(corridor(seed, density, world.copied), world.noise, seed)
                robot.truth[2] = robot.rng.uniform(-0.5, 0.5)
                robot.mode = "stand"
                found = relocalise([Glance(robot.look()) for _ in range(frames)], robot.world, world.noise)
                if found.pose is None:
                    continue
                off = is_off(*robot.error(np.array(found.pose)))
                wrong, right = wrong + off, right + (not off)
                nees.append(robot.nees(np.array(found.pose), found.covariance))
            shares = [value / robots for value in (right, robots - right - wrong, wrong)]
            rows.append((f"{density:g} per m2, {frames} frames", *shares, float(np.mean(nees)) if nees else math.nan))
    table(f"{robots} robots, camera {world.camera}", ("density, frames", "right", "none", "wrong", "NEES / 3"), rows)


def seconds(function: Callable[[], object], times: int) -> float:
    """Return the median processor time of a call, s, after a first one that does not count."""
    function()
    return median(seconds_of(function, time.process_time) for _ in range(times))


@BENCH.part("--times 2")
def frames(*, times: int = 500) -> None:
    """Times of a frame of 20 detections against 6000 landmarks, and of a relocalisation from ten frames.

    Args:
        times: calls of each.
    """
    rng = np.random.default_rng(1)
    looks = rng.standard_normal((6000, 8))
    world = FloorLandmarks(rng.uniform(-5, 5, (6000, 2)), looks / np.linalg.norm(looks, axis=1, keepdims=True))
    cov = np.diag([0.03**2, 0.03**2, math.radians(3) ** 2])
    for name, noise in (("easy", EASY), ("rough", ROUGH)):
        robot = Robot(world, noise, 1)
        robot.mode = "stand"
        seen = Detections(np.zeros(0), np.zeros(0), np.zeros((0, 8)))
        while len(seen) < 20:
            more = robot.look()
            seen = Detections(
                np.append(seen.ranges, more.ranges)[:20], np.append(seen.bearings, more.bearings)[:20],
                np.vstack((seen.looks, more.looks))[:20],
            )  # fmt: skip
        here, away = robot.truth, robot.truth + np.array([0.7, 0.0, 0.5 * math.pi])
        found, lost = match(here, cov, seen, world, noise), match(away, cov, seen, world, noise)
        for what, function in (
            ("match 20 detections", lambda noise=noise, seen=seen, here=here: match(here, cov, seen, world, noise)),
            ("look up those not matched", lambda f=found, s=seen, n=noise: known_elsewhere(f, s, world, n)),
            ("the same, displaced", lambda f=lost, s=seen, n=noise: known_elsewhere(f, s, world, n)),
        ):
            goal(f"{name} camera, {what}", 1e6 * seconds(function, times), unit="us")
        standing = Robot(corridor(1, 40.0, 0.5), noise, 1)
        standing.mode = "stand"
        glances = [Glance(standing.look()) for _ in range(10)]
        spent = seconds(lambda g=glances, w=standing.world, n=noise: relocalise(g, w, n), 5)
        goal(f"{name} camera, relocalise from 10 frames", 1e3 * spent, unit="ms")
