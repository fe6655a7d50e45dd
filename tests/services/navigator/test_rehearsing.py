"""The dry runs call every kernel: nothing is compiled when the functions are used afterwards."""

import numpy as np

from surefoot.kernels.compiling import COMPILING
from surefoot.services.navigator.belief.lost import Footprint, evidence_of, in_view
from surefoot.services.navigator.belief.matching import match
from surefoot.services.navigator.planning import costs as costs_module
from surefoot.services.navigator.planning.costs import prepare
from surefoot.services.navigator.planning.grid import FloorGrid
from surefoot.services.navigator.planning.route import plan
from surefoot.services.navigator.rehearsal import LARGE_SIDE, rehearse_belief, rehearse_planning
from tests.services.navigator.belief.floors import EASY, Eye, Glance, floor, relocalise


def test_nothing_is_compiled_after_the_dry_runs():
    rehearse_belief()
    rehearse_planning(40)
    before = COMPILING.done
    world = floor(1)
    seen, _ = Eye(world, EASY, 1).look((1.0, 0.0, 0.0))
    found = match(np.array([1.0, 0.0, 0.0]), 1e-3 * np.eye(3), seen, world, EASY)
    evidence_of(found, 1e-3 * np.eye(3), seen, world, EASY, 0.1 * in_view(world, (1.0, 0.0, 0.0), Footprint()))
    relocalise([Glance(seen)], world, EASY)
    plan(prepare(FloorGrid(np.zeros((60, 60), dtype=np.int8), 0.05)), (1.0, 1.0), (2.0, 2.0))
    assert COMPILING.done == before


def test_the_large_map_of_the_dry_run_has_marks():
    assert LARGE_SIDE**2 > costs_module.LARGE
    large = FloorGrid(np.zeros((LARGE_SIDE, LARGE_SIDE), dtype=np.int8), 0.05)
    assert prepare(large).marks.shape[1] == costs_module.MARKS
