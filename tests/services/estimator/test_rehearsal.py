"""After the rehearsal no kernel is compiled or loaded in a tick, not even when a clock begins anew."""

import numpy as np
import pytest

from surefoot.kernels.compiling import COMPILING
from surefoot.kernels.jit import loaded
from surefoot.lab.estimation.track import track
from surefoot.papers.wawrzynski.synthetic import WalkParams, synthesize
from surefoot.robot.reader import load_robot
from surefoot.services.estimator.config import EstimatorConfig
from surefoot.services.estimator.filter.log import follow_log
from surefoot.services.estimator.inputs.clock import RESYNC_AFTER
from surefoot.services.estimator.inputs.results import InputResult
from surefoot.services.estimator.rehearsal import rehearse, rehearse_log

PERIOD = 10_000_000


@pytest.mark.parametrize("first", ["imu", "joints"])
def test_a_new_clock_needs_no_kernel_that_was_not_rehearsed(first: str) -> None:
    robot, config = load_robot("ragno"), EstimatorConfig(robot="ragno")
    rehearse(config, robot, ("best",))
    kernels, compiled = loaded(), COMPILING.done
    estimator, every = config.estimator(robot), np.ones(len(robot.legs), dtype=np.bool_)
    results = []
    for begin in (30_000_000_000, 0):
        for i in range(RESYNC_AFTER + 5):
            if first == "imu" or begin > 0:
                results.append(estimator.imu(begin + i * PERIOD, 1e-3 * np.sin(i + np.arange(3.0)), [0.0, 0.0, 9.81]))
            if first == "joints" or begin > 0:
                results.append(estimator.joints(begin + i * PERIOD, robot.neutral, every))
            estimator.estimate()
    assert results.count(InputResult.RESTART) == 1
    assert loaded() == kernels
    assert COMPILING.done == compiled


def test_a_log_of_another_robot_needs_no_code_that_was_not_rehearsed() -> None:
    rehearse_log(EstimatorConfig(robot="ragno"), load_robot("ragno"))
    signatures: list[object] = list(follow_log.signatures)  # pyright: ignore[reportFunctionMemberAccess]
    assert len(signatures) == 1
    track("best", synthesize(WalkParams(duration_s=0.5), 3))
    assert list(follow_log.signatures) == signatures  # pyright: ignore[reportFunctionMemberAccess]
