"""Dry run of the navigator on a made-up floor: calls every kernel, so that none is loaded or compiled in a tick."""

import contextlib

import numpy as np

from .belief.apart import telling
from .belief.association import likeness
from .belief.landmarks import FloorLandmarks
from .belief.lost import Footprint, LostModel, LostState, evidence_of, in_view, observed
from .belief.matching import Detections, MatchLimits, SightNoise, match
from .belief.relocalise import Relocaliser
from .belief.tracker import Motion
from .catalogue import Catalogue
from .config import NavigatorConfig
from .localiser import WORK, Localiser
from .planning.costs import prepare
from .planning.grid import OCCUPIED, FloorGrid
from .planning.route import RouteError, plan

LARGE_SIDE = 560
"""Number of cells along an edge of a rehearsal floor large enough to exercise every part of the route search."""


def rehearse(config: NavigatorConfig) -> None:
    """Predict, match, correct, relocalise, plan, decide and report once, so that every kernel is compiled."""
    rehearse_belief()
    rehearse_planning(40)
    catalogue = Catalogue(config)
    tracker, world = Localiser(config, catalogue.model).tracker, _floor((-1.0, -1.0), (1.0, 1.0), 40)
    tracker.world = world
    tracker.place((0.0, 0.0, 0.0))
    tracker.move(Motion(0.01, 0.0, 0.01, 0.01, 1e-6, 1e-6, 1e-6, 1e-6))
    if tracker.strain is not None:
        tracker.strain.look(_frame(world, 12), world, tracker.pose, tracker.cov, tracker.noise, 0.1)
    tracker.look(_frame(world, 12), 0.1, standing=False)
    mean, cov = tracker.after(Motion())
    catalogue.decider(None).decide(mean, cov, (1.0, 0.0), blocked=False)
    _ = tracker.entropy


def rehearse_belief() -> None:
    """Match a frame at a right and at a wrong pose, check both, and relocalise, so that kernels are compiled."""
    world, noise = _floor((0.4, -0.3), (1.0, 0.3), 24), SightNoise()
    seen, state, model, cov = _frame(world, 24), LostState(), LostModel(), 1e-3 * np.eye(3)
    for mean in (np.zeros(3), np.array([5.0, 0.0, 1.0])):
        for limits in (MatchLimits(), MatchLimits(pairs=10)):
            found = match(mean, cov, seen, world, noise, limits)
        expected = 0.1 * in_view(world, (0.0, 0.0, 0.0), Footprint())
        state = observed(state, evidence_of(found, cov, seen, world, noise, expected), model)
    relocaliser = Relocaliser(world, noise)
    relocaliser.add(seen, (0.0, 0.0, 0.0), 0.0)
    relocaliser.step((0.0, 0.0, 0.0), WORK)
    telling(np.array([(0.0, 0.0, 0.0), (0.1, 0.0, 0.0)]), np.array([(0.5, 0.0)]), world, 0.5)
    likeness(seen.looks[0], world.columns, np.empty(len(world.positions)))


def rehearse_planning(side: int) -> None:
    """Plan one possible and one impossible route on a floor of side * side cells, so that kernels are compiled."""
    cells = np.zeros((side, side), dtype=np.int8)
    cells[:-15, 20:22] = OCCUPIED
    costs = prepare(FloorGrid(cells, 0.05))
    plan(costs, (0.4, 0.4), (1.7, 0.4))
    with contextlib.suppress(RouteError):
        plan(costs, (0.4, 0.4), (1.05, 0.4))


def _floor(low: tuple[float, float], high: tuple[float, float], count: int) -> FloorLandmarks:
    """Return `count` landmarks at random places between two corners (x, y in m, frame map), with random descriptors."""
    rng = np.random.default_rng(1)
    return FloorLandmarks(rng.uniform(low, high, (count, 2)), rng.standard_normal((count, 8)))


def _frame(world: FloorLandmarks, count: int) -> Detections:
    """Return the first `count` landmarks as detected from the origin of the map."""
    x, y = world.positions[:count].T
    return Detections(np.hypot(x, y), np.arctan2(y, x), world.descriptors[:count].copy())  # as those of messages
