"""A dry run of association, relocalisation and judgement on a made-up floor: calls every kernel that they use."""

import numpy as np

from .landmarks import FloorLandmarks
from .lost import Footprint, LostModel, LostState, evidence_of, in_view, observed
from .matching import Detections, MatchLimits, SightNoise, match
from .relocalise import Glance, relocalise

COUNT, LENGTH = 24, 8
"""Landmarks, and numbers in a descriptor."""


def rehearse_belief() -> None:
    """Match a frame from a right and from a wrong pose, judge both, and relocalise."""
    rng = np.random.default_rng(1)
    positions = rng.uniform((0.4, -0.3), (1.0, 0.3), (COUNT, 2))
    looks = rng.standard_normal((COUNT, LENGTH))
    world, noise = FloorLandmarks(positions, looks), SightNoise()
    seen = Detections(np.hypot(positions[:, 0], positions[:, 1]), np.arctan2(positions[:, 1], positions[:, 0]), looks)
    state, model, cov = LostState(), LostModel.of(noise, Footprint()), 1e-3 * np.eye(3)
    for mean in (np.zeros(3), np.array([5.0, 0.0, 1.0])):
        for limits in (MatchLimits(), MatchLimits(pairs=10)):
            found = match(mean, cov, seen, world, noise, limits)
        expected = 0.1 * in_view(world, (0.0, 0.0, 0.0), Footprint())
        state = observed(state, evidence_of(found, seen, world, noise, expected), model)
    relocalise([Glance(seen)], world, noise)
