"""Samples from elsewhere, live: checked, put where they belong, and reported."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from surefoot.lab.estimation.external import Externals
from surefoot.services.estimator.filter.external import POSITION, VELOCITY, YAW, expected
from surefoot.services.estimator.filter.layout import P, X
from surefoot.services.estimator.filter.log import LogInputs
from surefoot.services.estimator.filter.point import retract
from surefoot.services.estimator.filter.samples import EXTERNAL_CAPACITY, EXTERNAL_WIDTH, insert_external, new_samples
from surefoot.services.estimator.filter.state import FRAME, new_state
from surefoot.services.estimator.inputs.external import ExternalSample
from surefoot.services.estimator.inputs.results import InputResult
from surefoot.services.estimator.stream import BEST
from tests.lab.estimation.cameras import Camera
from tests.services.estimator.test_stream import make, walk

SPREAD = np.eye(3) * 1e-4


@pytest.mark.parametrize("part", [POSITION, YAW, VELOCITY])
def test_derivatives_by_finite_differences(part):
    rng, state = np.random.default_rng(part), new_state(2, 0, FRAME)
    state.x[:9] = Rotation.from_rotvec(rng.normal(size=3)).as_matrix().ravel()
    state.x[X.vel :] = rng.normal(size=len(state.x) - X.vel) * 0.3
    state.points[:, P.down] = 1.0
    base = np.ascontiguousarray(Rotation.from_rotvec(rng.normal(size=3)).as_matrix())
    row, still, step = rng.normal(size=EXTERNAL_WIDTH), np.zeros(3), 1e-6
    state.x[X.gyro_bias : X.gyro_bias + 3] = 0.0
    up = state.x[6:9] * 9.81  # nothing accelerates, nothing turns: only what the age of a sample adds is left out
    _, by, _ = expected(state, part, row, still, up, 0.0, base)
    for j in range(len(state.cov)):
        ends = []
        for sign in (-1.0, 1.0):
            other = new_state(2, 0, FRAME)
            other.x[...], other.points[...] = state.x, state.points
            retract(other, sign * step * np.eye(len(state.cov))[j])
            ends.append(expected(other, part, row, still, up, 0.0, base)[0])
        np.testing.assert_allclose((ends[0] - ends[1]) / (2.0 * step), by[:, j], atol=1e-6)


def test_an_older_sample_is_expected_where_the_robot_was():
    state, row = new_state(1, 0, FRAME), np.zeros(EXTERNAL_WIDTH)
    state.x[X.vel], state.x[X.pos] = 0.5, 2.0
    z, _, _ = expected(state, POSITION, row, np.zeros(3), np.array([0, 0, 9.81]), 0.01, np.eye(3))
    np.testing.assert_allclose(z, [1.995, 0, 0])
    z, _, _ = expected(state, VELOCITY, row, np.zeros(3), np.array([1.0, 0, 9.81]), 0.01, np.eye(3))
    np.testing.assert_allclose(z, [0.49, 0, 0], atol=1e-12)
    z, _, _ = expected(state, YAW, row, np.array([0, 0, 0.2]), np.array([0, 0, 9.81]), 0.01, np.eye(3))
    assert z[0] == pytest.approx(-0.002)


def test_samples_are_kept_in_order_and_the_oldest_go():
    samples, end, row = new_samples(1, 1), 0, np.zeros(EXTERNAL_WIDTH)
    for stamp in (30, 10, 20):
        end = insert_external(samples, end, stamp, row)
    assert samples.external_stamps[:end].tolist() == [10, 20, 30]
    assert insert_external(samples, end, 20, row) == -1
    for stamp in range(100, 100 + EXTERNAL_CAPACITY):
        end = insert_external(samples, end, stamp, row)
    assert (np.diff(samples.external_stamps[:end]) > 0).all()
    assert samples.external_stamps[end - 1] == 99 + EXTERNAL_CAPACITY


@pytest.mark.parametrize(
    ("sample", "result"),
    [
        (ExternalSample(position=[0, 0, 0], position_covariance=SPREAD), InputResult.FRAME),
        (ExternalSample(), InputResult.SHAPE),
        (ExternalSample(yaw=0.1), InputResult.NONFINITE),
        (ExternalSample(yaw=np.inf, yaw_variance=1.0), InputResult.NONFINITE),
        (ExternalSample(yaw=0.1, yaw_variance=0.0), InputResult.COVARIANCE),
        (ExternalSample(yaw=1e4, yaw_variance=0.1), InputResult.UNIT),
        (
            ExternalSample(position=[0, 1e300, 0], position_covariance=SPREAD, yaw=0.0, yaw_variance=0.1),
            InputResult.UNIT,
        ),
        (ExternalSample(velocity=[1e4, 0, 0], velocity_covariance=SPREAD), InputResult.UNIT),
        (ExternalSample(velocity=[1, 2], velocity_covariance=SPREAD), InputResult.SHAPE),
        (ExternalSample(velocity="fast", velocity_covariance=SPREAD), InputResult.SHAPE),
        (ExternalSample(velocity=[1, 2, 3], velocity_covariance=-SPREAD), InputResult.COVARIANCE),
        (ExternalSample(velocity=[1, 2, 3], velocity_covariance=SPREAD + np.eye(3, k=1)), InputResult.COVARIANCE),
    ],
)
def test_what_is_wrong_is_refused_by_name(sample, result):
    e = make(names=(BEST,))
    assert e.external(1, sample) is result
    assert e.check.counts == {f"external_{result}": 1}


def fed(camera):
    """An estimator after a walk with a camera, and its estimates row by row."""
    log = walk()
    e, k, rows = make(names=(BEST,)), 0, []
    waiting = [] if camera is None else camera.samples(log)
    for i, stamp in enumerate(log.stamp_ns.tolist()):
        e.imu(stamp, log.w[i], log.q[i])
        while k < len(log.foot_ns) and log.foot_ns[k] <= stamp:
            e.feet(int(log.foot_ns[k]), log.foot_position[k], log.foot_rot[k], log.contact[k])
            k += 1
        while waiting and waiting[0][0] + camera.late_ns <= stamp:
            assert e.external(*waiting.pop(0)).accepted
        rows.append((*e.best.v, *e.best.position))
    return e, np.array(rows), log


def test_a_live_camera_gives_the_bits_of_the_log():
    camera, whole = Camera(), make(names=(BEST,))
    e, rows, log = fed(camera)
    seen = camera.seen(log)
    known = int((seen.arrival_ns <= log.stamp_ns[-1]).sum())
    log = replace(log, external=Externals(*(part[:known] for part in seen)))
    inputs = LogInputs(
        log.stamp_ns, log.w, log.q, np.zeros(len(log.w), dtype=bool), log.foot_ns, log.foot_position, log.foot_rot,
        log.contact[..., None].astype(float), log.external.stamp_ns, log.external.rows,
    )  # fmt: skip
    found = whole.follow(inputs, log.arrival(), 0, len(log.w))
    np.testing.assert_array_equal(rows, found.vectors[:, 1:3].reshape(-1, 6))
    assert whole.externals == e.externals
    assert e.externals.left_out == 0
    assert not np.array_equal(rows, fed(None)[1])


def test_reasons_name_what_is_left_out():
    e, _, log = fed(Camera())
    last = int(log.stamp_ns[-1])
    assert not any("elsewhere" in text for text in e.estimate().reasons)
    far = ExternalSample([50, 0, 0], SPREAD, 0.0, 1e-4)
    assert e.external(last - 50_000_000, far) is InputResult.OK
    assert any("left out: 1 samples from elsewhere" in text for text in e.estimate().reasons)
    assert e.external(last - 50_000_000, far) is InputResult.DUPLICATE
    assert e.external(last - 900_000_000, far) is InputResult.LATE
    assert e.external(last + 900_000_000, far) is InputResult.AHEAD
    assert e.estimate().filter_ok
