"""A dry run of the navigator with made-up landmarks, a frame of them and one decision."""

import numpy as np

from .belief.landmarks import FloorLandmarks
from .belief.matching import Detections
from .belief.rehearsing import rehearse_belief
from .belief.tracker import Motion
from .config import NavigatorConfig
from .localiser import Localiser
from .planning.rehearsing import rehearse_planning
from .policies import Policies


def rehearse(config: NavigatorConfig) -> None:
    """Predict, match, correct, decide and report once, so that every kernel is loaded.

    Args:
        config: of the service.
    """
    rehearse_belief()
    rehearse_planning()
    policies = Policies(config)
    tracker = Localiser(config, policies.model).tracker
    rng = np.random.default_rng(0)
    places, looks = rng.uniform(-1.0, 1.0, (40, 2)), rng.standard_normal((40, 8))
    tracker.world = FloorLandmarks(places, looks)
    tracker.place((0.0, 0.0, 0.0))
    tracker.move(Motion(0.01, 0.0, 0.01, 0.01, 1e-6, 1e-6, 1e-6, 1e-6))
    ranges, bearings = np.hypot(places[:, 0], places[:, 1]), np.arctan2(places[:, 1], places[:, 0])
    tracker.look(Detections(ranges[:12], bearings[:12], looks[:12]), 0.1, standing=False)
    mean, cov = tracker.after(Motion())
    policies.decider(None).decide(mean, cov, (1.0, 0.0), blocked=False)
    _ = tracker.entropy
