"""How soon a displaced robot notices and recovers, how often it does so wrongly, and false alarms per hour.

A made-up robot walks up and down a corridor with landmarks (half of their looks copied tenfold, a tenth of the
detections false), 10 frames a second. Its belief is an extended Kalman filter over x, y, heading. Displaced by 0.7 m
and 90 degrees it has to notice; then it stands, looks, turns on the spot where that is not enough.

    python -m benchmarks.bench_navigator_lost --displacements 100 --hours 10 --density 40 --camera easy
    python -m benchmarks.bench_navigator_lost --standing 1000      share relocalised by s of standing, without turning
"""

import argparse
import json
import math
import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
from surefoot.services.navigator.belief.matching import Detections, SightNoise, match
from surefoot.services.navigator.belief.relocalise import Glance, relocalise

Array = NDArray[np.float64]

FRAME = 0.1
"""s."""
SPEED, TURN = 0.055, math.radians(23) / 1.8
"""m/s and rad/s of the simulated Nao."""
NEAR, FAR, HALF = 0.35, 1.18, math.radians(33)
"""m, m, rad: footprint of its lower camera."""
VIEW = Footprint(NEAR, FAR, HALF)
LOW, HIGH = (-1.0, -1.0), (6.5, 1.0)
"""m, corridor."""
SEEN = {"walk": 0.10, "turn": 0.03, "settle": 0.19, "stand": 0.45}
"""Recognised share of the landmarks in view, measured on the simulated Nao."""
EASY = SightNoise(common_range_sd=0.01)
ROUGH = SightNoise(range_sd=0.15, range_share=0.0, bearing_sd=math.radians(10), common_range_sd=0.03)
TILT_MEMORY = 0.3
"""s, over which the error common to a frame stays alike."""
ATTEMPT, PATIENCE = 0.5, 1.5
"""s between attempts to relocalise; s until a robot that cannot turns by 46 degrees."""


def wrapped(angle: float) -> float:
    """Return the same angle in [-pi, pi), rad."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def spread(values: Array) -> dict[str, float]:
    """Return median, 95 % quantile and maximum."""
    found = np.quantile(values, (0.5, 0.95, 1.0), method="higher").round(3).tolist()
    return dict(zip(("median", "95 %", "max"), found, strict=True))


def corridor(seed: int, density: float, copied: float, copies: int = 10) -> FloorLandmarks:
    """Landmarks at random; a share of them in groups that look the same."""
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
        """Match a frame, correct the belief, judge whether it is lost."""
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
        """Distance in m and angle in rad of a pose from the truth."""
        return math.hypot(*(pose[:2] - self.truth[:2])), abs(
            (pose[2] - self.truth[2] + math.pi) % (2 * math.pi) - math.pi
        )


def recover(robot: Robot) -> tuple[float, Array | None, int]:
    """Stand, look and turn until relocalised; s it took, the pose, and attempts. At most 30 s."""
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


def displacement(seed: int, density: float, noise: SightNoise, copied: float) -> dict[str, float | bool | None]:
    """One robot: walks for a while, is displaced, notices (or not within 20 s), recovers."""
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
    wrong = pose is not None and (far > 0.3 or turned > 0.5)  # pyright: ignore[reportOptionalOperand]
    return {
        "seed": seed, "early": early, "noticed": noticed, "recovered": None if pose is None else spent,
        "error": far, "turn": turned, "wrong": wrong, "attempts": attempts,
    }  # fmt: skip


def alarms(
    seed: int, minutes: float, density: float, noise: SightNoise, copied: float
) -> tuple[int, float, list[float]]:
    """False alarms of an undisturbed robot, frames whose pose was truly off by 0.3 m or 0.5 rad, mean NEES."""
    robot = Robot(corridor(seed, density, copied), noise, seed)
    count, off, nees = 0, 0, []
    for _ in range(round(minutes * 60 / FRAME)):
        robot.frame()
        e = robot.mean - robot.truth
        e[2] = wrapped(e[2])
        nees.append(float(e @ np.linalg.solve(robot.cov, e)) / 3)
        far, turned = robot.error(robot.mean)
        off += int(far > 0.3 or turned > 0.5)
        if robot.lost.doubt >= robot.model.threshold:
            count += 1 if far < 0.3 and turned < 0.5 else 0
            robot.lost = LostState()
            robot.mean, robot.cov = robot.truth.copy(), np.diag([0.05**2, 0.05**2, math.radians(5) ** 2])
    return count, off, nees


def standing(count: int, camera: str, noise: SightNoise, copied: float, first: int) -> None:
    """Print how often a robot that only stands and looks along the floor is relocalised, by density and time."""
    print(f"{'camera':6} {'per m2':>6} {'frames':>6} {'right':>7} {'none':>7} {'wrong':>7} {'NEES/3':>7}")
    for density in (60.0, 40.0, 10.0, 5.0):
        for frames in (1, 5, 10, 30):
            right, wrong, nees = 0, 0, list[float]()
            for seed in range(first, first + count):
                robot = Robot(corridor(seed, density, copied), noise, seed)
                robot.truth[2] = robot.rng.uniform(-0.5, 0.5)
                robot.mode = "stand"
                found = relocalise([Glance(robot.look()) for _ in range(frames)], robot.world, noise)
                if found.pose is None:
                    continue
                far, turned = robot.error(np.array(found.pose))
                wrong += int(far > 0.3 or turned > 0.5)
                right += int(far <= 0.3 and turned <= 0.5)
                e = np.array(found.pose) - robot.truth
                e[2] = wrapped(e[2])
                nees.append(float(e @ np.linalg.solve(found.covariance, e)) / 3)
            none, mean = count - right - wrong, float(np.mean(nees)) if nees else math.nan
            shares = " ".join(f"{value / count:7.3f}" for value in (right, none, wrong))
            print(f"{camera:6} {density:6.0f} {frames:6} {shares} {mean:7.2f}", flush=True)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--displacements", type=int, default=100)
    parser.add_argument("--hours", type=float, default=1.0, help="of undisturbed walking")
    parser.add_argument("--density", type=float, default=40.0, help="landmarks per m2")
    parser.add_argument("--copied", type=float, default=0.5, help="share of landmarks that look like nine others")
    parser.add_argument("--camera", choices=("easy", "rough"), default="easy")
    parser.add_argument("--first", type=int, default=1000, help="first seed")
    parser.add_argument("--standing", type=int, default=0, help="robots of the table of standing; nothing else is run")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    noise = EASY if args.camera == "easy" else ROUGH
    if args.standing:
        standing(args.standing, args.camera, noise, args.copied, args.first)
        return
    rows = [displacement(args.first + i, args.density, noise, args.copied) for i in range(args.displacements)]
    noticed = np.array([math.inf if row["noticed"] is None else row["noticed"] for row in rows])
    recovered = np.array([math.inf if row["recovered"] is None else row["recovered"] for row in rows])
    wrong = sum(bool(row["wrong"]) for row in rows)
    n = len(rows)
    total, off, nees = 0, 0, list[float]()
    for i in range(round(args.hours * 6)):
        count, away, each = alarms(args.first + 10_000 + i, 10.0, args.density, noise, args.copied)
        total, off, nees = total + count, off + away, nees + each
    result = {
        "camera": args.camera, "density": args.density, "displacements": n,
        "noticed_s": spread(noticed), "noticed_in_3_s": float((noticed <= 3.0).mean()),
        "recovered_s": spread(recovered),
        "recovered_in_10_s": float((recovered <= 10.0).mean()),
        "wrong": wrong, "wrong_at_most": 1.0 - 0.05 ** (1.0 / n) if wrong == 0 else None,
        "hours": args.hours, "false_alarms": total, "frames_off": off, "nees": float(np.mean(nees)) if nees else None,
    }  # fmt: skip
    if args.json:
        sys.stdout.write(json.dumps(result) + "\n")
        return
    for name, value in result.items():
        print(f"{name:20} {value}")


if __name__ == "__main__":
    main()
