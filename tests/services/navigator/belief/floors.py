"""Made-up floors with landmarks and a camera that looks at them, for tests and studies of the belief."""

import math
from dataclasses import dataclass

import numpy as np

from surefoot.services.navigator.belief.landmarks import FloorLandmarks
from surefoot.services.navigator.belief.matching import Detections, SightNoise
from surefoot.services.navigator.belief.relocalise import Relocaliser, Relocation

NEAR, FAR, HALF = 0.35, 1.18, math.radians(33.0)
"""m, m, rad: what the Nao's lower camera sees of the floor."""
LENGTH = 8
EASY = SightNoise()
"""Of the simulated Nao."""
ROUGH = SightNoise(range_sd=0.15, range_share=0.0, bearing_sd=math.radians(10.0))
"""As hard as the paper's."""


@dataclass(frozen=True)
class Glance:
    """One frame of a robot that stands or turns on the spot, and the pose of base_link by odometry then."""

    seen: Detections
    pose: tuple[float, float, float] = (0.0, 0.0, 0.0)


def relocalise(glances, world, noise, limits=None):
    """The pose from which the camera sees the glances, by one search that is not cut into portions."""
    relocaliser = Relocaliser(world, noise, limits)
    for number, glance in enumerate(glances):
        relocaliser.add(glance.seen, glance.pose, 0.1 * number)
    found = relocaliser.step((0.0, 0.0, 0.0), 2**62)
    return found or Relocation(None, np.zeros((3, 3)), 0.0, "unseen", 0)


def unit(rows):
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


def floor(seed, density=40.0, low=(-1.0, -1.0), high=(6.5, 1.0), copied=0.0, copies=10):
    """Landmarks at random; a share of them in groups that look the same."""
    rng = np.random.default_rng(seed)
    n = rng.poisson(density * (high[0] - low[0]) * (high[1] - low[1]))
    looks = unit(rng.standard_normal((n, LENGTH)))
    many = int(copied * n)
    looks[:many] = looks[np.arange(many) // copies * copies]
    return FloorLandmarks(rng.uniform(low, high, (n, 2)), looks)


@dataclass
class Eye:
    """A camera.

    Args:
        world: the floor.
        noise: of what it measures.
        seed: of its random stream.
        recognised: share of the landmarks in view.
        false: share of the detections that carry the look of another landmark.
        tilt: m, standard deviation of an error of all ranges of a frame.
        most: detections of a frame.
    """

    world: FloorLandmarks
    noise: SightNoise
    seed: int
    recognised: float = 0.45
    false: float = 0.0
    tilt: float = 0.0
    most: int = 20

    def __post_init__(self):
        self.rng = np.random.default_rng(self.seed)

    def look(self, pose):
        """Detections of a frame from a pose (x, y, heading), and which landmark each is; -1 = a false one."""
        rng, noise = self.rng, self.noise
        d = self.world.positions - np.asarray(pose)[:2]
        r = np.hypot(d[:, 0], d[:, 1])
        b = (np.arctan2(d[:, 1], d[:, 0]) - pose[2] + np.pi) % (2 * np.pi) - np.pi
        view = np.flatnonzero((r > NEAR) & (r < FAR) & (np.abs(b) < HALF))
        truth = view[rng.uniform(size=view.size) < self.recognised][: self.most]
        k = truth.size
        sd = np.hypot(noise.range_sd, noise.range_share * r[truth])
        ranges = np.maximum(r[truth] + sd * rng.standard_normal(k) + self.tilt * rng.standard_normal(), 0.03)
        bearings = b[truth] + noise.bearing_sd * rng.standard_normal(k)
        looks = self.world.descriptors[truth] + noise.look_sd * rng.standard_normal((k, LENGTH))
        wrong = rng.uniform(size=k) < self.false
        other = rng.integers(len(self.world), size=k)
        looks[wrong] = self.world.descriptors[other[wrong]] + noise.look_sd * rng.standard_normal((wrong.sum(), LENGTH))
        return Detections(ranges, bearings, looks), np.where(wrong, -1, truth)
