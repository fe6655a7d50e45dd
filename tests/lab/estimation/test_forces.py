"""Zero and scale of force cells, planted into forces that carry the weight."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.lab.estimation.forces import calibrate_forces
from surefoot.lab.estimation.log import Log
from surefoot.robot.reader import load_robot
from tests.lab.estimation.walks import noisy

BIOLOID = load_robot("bioloid")


def pressed(scale: tuple[float, float], zero: tuple[float, float], known: bool = True, seed: int = 0) -> Log:
    """A walk whose feet share the weight, in cells that read (N - zero) / scale."""
    log, rng = noisy("twist", seed), np.random.default_rng(seed)
    assert log.truth is not None
    weight = BIOLOID.mass * 9.81
    shift = 0.5 + 0.3 * np.sin(np.arange(len(log.foot_ns)) / 11.0)
    share = log.contact * np.stack([shift, 1.0 - shift], axis=1)
    share /= np.maximum(share.sum(axis=1), 1e-9)[:, None]
    force = weight * share + 0.2 * rng.normal(size=share.shape)
    return replace(log, robot=BIOLOID if known else None, force=force / np.array(scale) - np.array(zero))


@pytest.mark.parametrize("seed", range(3))
def test_zero_and_scale_are_found(seed):
    found = {one.name: one for one in calibrate_forces(pressed((1.1, 0.95), (0.5, -1.0), seed=seed))}
    for foot, (scale, zero) in enumerate(zip((1.1, 0.95), (0.5, -1.0), strict=True)):
        one = found[f"force zero of foot {foot}"]
        assert one.observable
        assert one.value == pytest.approx(zero, abs=2.0 * one.half)
        one = found[f"force scale of foot {foot}"]
        assert one.observable
        assert one.value == pytest.approx(100.0 * (scale - 1.0), abs=2.0 * one.half + 0.5)


def test_without_a_weight_feet_are_compared():
    found = [one for one in calibrate_forces(pressed((1.1, 0.9), (0.0, 0.0), known=False)) if one.unit == "%"]
    assert sum(one.value for one in found) == pytest.approx(0.0, abs=1e-9)
    assert found[0].value - found[1].value == pytest.approx(20.0, abs=2.0)


def test_a_log_that_only_stands_shows_no_zero():
    log = pressed((1.0, 1.0), (0.0, 0.0))
    still = log.with_feet(log.foot_ns < 1_900_000_000)
    assert not any(one.observable for one in calibrate_forces(still) if one.unit == "N")


def test_no_forces_no_report():
    assert calibrate_forces(noisy()) == []
