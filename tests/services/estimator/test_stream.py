"""All estimators on one stream: start, faults, numbers of feet, frames, order of arrival."""

from functools import cache

import numpy as np
import pytest

from surefoot.geometry.constants import GRAVITY
from surefoot.papers.wawrzynski.synthetic import WalkParams, synthesize
from surefoot.robot.reader import load_robot
from surefoot.services.estimator.feet import mount as feet_module
from surefoot.services.estimator.feet.mount import bare_mount
from surefoot.services.estimator.inputs.results import InputResult
from surefoot.services.estimator.paper.estimators import ESTIMATORS
from surefoot.services.estimator.params import EstimatorParams, StartPose, paper_params
from surefoot.services.estimator.stream import BEST, NAMES, PAPER, Estimator

TICK = 10_000_000
PERIOD = 33_000_000


@cache
def walk(feet=2, seed=0):
    return synthesize(WalkParams(feet=feet, encoders=False, duration_s=8.0), seed)


def make(feet=2, names=(BEST, *ESTIMATORS), **changes):
    return Estimator(bare_mount(feet), EstimatorParams(**changes), names=names)


def run(log, estimator, change=None):
    """Replays with the inputs changed; yields the estimates."""
    waiting = list(log.feet)
    for k, stamp in enumerate(log.stamp_ns.tolist()):
        w, q = log.w[k], log.q[k]
        due = [waiting.pop(0) for _ in range(len(waiting)) if waiting[0].stamp_ns <= stamp]
        if change is not None:
            stamp, w, q, due = change(k, stamp, w, q, due)
        if stamp is not None:
            estimator.imu(stamp, w, q)
        for sample in due:
            estimator.feet(*sample)
        yield estimator.estimate()


def rms(log, estimates, begin=300):
    error = np.array([e.velocity_imu for e in estimates])[begin:] - log.v[begin:]
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))


def finite(e):
    arrays = (e.velocity, e.velocity_imu, e.velocity_heading, e.angular_velocity, e.g_up, e.covariance, e.gyro_bias)
    return all(np.isfinite(a).all() for a in arrays) and np.isfinite([e.roll, e.pitch]).all()


@pytest.mark.parametrize("feet", range(2, 9))
def test_two_to_eight_feet(feet):
    log, estimator = walk(feet), make(feet)
    poses, estimates, others = [], [], {name: [] for name in ("ekf", "kinematics_gyro")}
    for e in run(log, estimator):
        estimates.append(e)
        poses.append(estimator.pose().position)
        for name, found in others.items():
            found.append(estimator.estimate(name))
    assert estimator.initialised
    assert estimator.check.refused == 0
    assert rms(log, estimates) < 0.008
    assert rms(log, estimates) < rms(log, others["ekf"]) < rms(log, others["kinematics_gyro"])
    moved = log.position[-1] - log.position[100]
    np.testing.assert_allclose(poses[-1] - poses[100], moved, atol=0.01)


def test_every_estimator_answers():
    estimator = make(names=NAMES)
    assert set(NAMES) == {BEST, "imu", "kinematics", "kinematics_gyro", "ekf", PAPER}
    list(run(walk(), estimator))
    for name in NAMES:
        e = estimator.estimate(name)
        assert e.mode == name
        assert finite(e)
        assert (np.diag(e.covariance) > 0.0).all()
    with pytest.raises(KeyError):
        make(names=(BEST,)).estimate("ekf")


@pytest.mark.parametrize("name", [BEST, "ekf"])
def test_start_is_the_fiftieth_sample_at_rest(name):
    estimator, log = make(), walk()
    flags = [estimator.estimate(name).initialised for _ in run(log, estimator)]
    assert flags.index(True) == 49
    early = make()
    next(iter(run(log, early)))
    assert np.diag(early.estimate(name).covariance)[3:].min() > 0.5
    assert not early.estimate(name).filter_ok
    assert "waiting" in early.estimate(name).reasons[0]


def test_at_the_start_g_is_the_mean_and_the_bias_is_gone():
    estimator, log = make(refine_gyro_bias=False), walk()
    estimates = [(e, estimator.estimate("ekf")) for _, e in zip(range(50), run(log, estimator), strict=False)]
    for e in estimates[-1]:
        np.testing.assert_allclose(e.g_up, log.q[:50].mean(axis=0), atol=0.05)
        np.testing.assert_allclose(e.gyro_bias, log.w[:50].mean(axis=0), atol=1e-9)
    off = make(remove_gyro_bias=False, refine_gyro_bias=False)
    for _, _ in zip(range(60), run(log, off), strict=False):
        pass
    assert not off.estimate("ekf").gyro_bias.any()


def test_tilt_is_good_to_the_accelerometer_bias():
    log = walk(seed=2)
    g = np.array([e.g_up for e in run(log, make())])[300:]
    across = np.linalg.norm(np.cross(g / GRAVITY, log.up[300:] / GRAVITY), axis=1)
    assert np.degrees(across).max() < 1.0  # 0.05 m/s^2 of bias = 0.3 deg per axis


def test_standing_differs_from_walking():
    states = np.array([e.standing for e in run(walk(), make())])
    assert states[60:190].all()
    assert not states[300:].any()


def test_frames():
    """A turned and shifted IMU gives the same velocity of base_link."""
    log = walk()
    rot_imu_from_base, at = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([0.05, -0.02, 0.1])
    mount = bare_mount(2)._replace(rot_imu_from_base=rot_imu_from_base, imu_position=at)
    estimator = Estimator(mount, EstimatorParams())
    last = list(run(log, estimator))[-1]
    np.testing.assert_allclose(last.velocity_imu, estimator.best.v)
    rot = rot_imu_from_base.T
    np.testing.assert_allclose(last.g_up, rot @ estimator.best.g)
    expected = rot @ last.velocity_imu + np.cross(last.angular_velocity, -at)
    np.testing.assert_allclose(last.velocity, expected, atol=1e-12)
    assert last.velocity_heading[2] == pytest.approx(last.velocity @ last.g_up / np.linalg.norm(last.g_up))
    assert np.linalg.norm(last.velocity_heading) == pytest.approx(np.linalg.norm(last.velocity))


def nan_burst(k, stamp, w, q, due):
    return stamp, w * np.nan if 300 <= k < 330 else w, q, due


def feet_nan(k, stamp, w, q, due):
    return stamp, w, q, [s._replace(position=s.position * np.nan) for s in due] if 300 <= k < 400 else due


def one_foot_nan(k, stamp, w, q, due):
    broken = [s._replace(position=np.where(np.array([[True], [False]]), np.nan, s.position)) for s in due]
    return stamp, w, q, broken if k >= 300 else due


def clock_ahead(k, stamp, w, q, due):
    return stamp + (10_000_000_000 if 300 <= k < 330 else 0), w, q, due


def clock_back(k, stamp, w, q, due):
    shift = 10_000_000_000 if k < 300 else 0
    return stamp + shift, w, q, [s._replace(stamp_ns=s.stamp_ns + shift) for s in due]


def duplicates(k, stamp, w, q, due):
    return (
        stamp - (TICK if k > 300 and k % 5 == 0 else 0),
        w,
        q,
        [x for s in due for x in ((s, s) if k > 300 else (s,))],
    )


def no_contact(k, stamp, w, q, due):
    gone = [s._replace(contact=np.zeros_like(s.contact)) for s in due]
    return stamp, w, q, gone if 300 <= k < 700 else due


def no_feet(k, stamp, w, q, due):
    return stamp, w, q, [] if k >= 300 else due


def saturated(k, stamp, w, q, due):
    return stamp, w, q * 20.0 if 300 <= k < 310 else q, due


def frozen_unit(k, stamp, w, q, due):
    return stamp, walk().w[300] if k >= 300 else w, walk().q[300] if k >= 300 else q, due


def frozen_legs(k, stamp, w, q, due):
    return stamp, w, q, [s._replace(position=walk().feet[90].position) for s in due] if k >= 300 else due


def hole(k, stamp, w, q, due):
    return (stamp, w, q, due) if not 300 <= k < 400 else (None, w, q, [])


@pytest.mark.parametrize(
    ("fault", "flag", "count"),
    [
        (nan_burst, "inputs_ok", "imu_nonfinite"),
        (feet_nan, "inputs_ok", "kinematics_nonfinite"),
        (one_foot_nan, "inputs_ok", "kinematics_nonfinite"),
        (clock_ahead, "inputs_ok", "imu_ahead"),
        (clock_back, "inputs_ok", "imu_restart"),
        (duplicates, "inputs_ok", "imu_duplicate"),
        (no_contact, "sensors_ok", None),
        (no_feet, "sensors_ok", None),
        (no_feet, "filter_ok", None),
        (saturated, "sensors_ok", "imu_saturated"),
        (frozen_unit, "sensors_ok", None),
        (frozen_legs, "sensors_ok", None),
        (hole, "inputs_ok", "imu_gap"),
    ],
)
def test_faults_raise_flags_and_nothing_else(fault, flag, count):
    estimator = make()
    estimates = list(run(walk(), estimator, fault))
    assert all(finite(e) for e in estimates)
    for e in estimates[::10]:
        assert np.linalg.eigvalsh(e.covariance).min() > 0.0
    assert not all(getattr(e, flag) for e in estimates[300:])
    assert all(getattr(e, flag) for e in estimates[100:299])
    assert np.linalg.norm([e.velocity for e in estimates], axis=1).max() < 2.0
    assert count is None or estimator.check.counts[count] > 0


@pytest.mark.parametrize("fault", [nan_burst, clock_ahead, clock_back, saturated, hole, feet_nan])
def test_the_estimate_recovers(fault):
    log, estimator = walk(), make()
    speeds = np.array([e.velocity_imu for e in run(log, estimator, fault)])
    assert np.sqrt(np.mean(np.sum((speeds[600:] - log.v[600:]) ** 2, axis=1))) < 0.03


def test_reset_forgets_everything():
    log, estimator = walk(), make()
    first = [e.velocity for e in run(log, estimator)]
    estimator.reset()
    assert not estimator.initialised
    second = [e.velocity for e in run(log, estimator)]
    np.testing.assert_array_equal(first, second)


def test_paper_mode_uses_one_foot():
    params = paper_params(EstimatorParams())
    assert (params.feet, params.rolling, params.gyro_mean, params.remove_gyro_bias) == ("one", False, False, False)
    estimator = make(names=(BEST, PAPER))
    list(run(walk(), estimator))
    assert estimator.estimate(PAPER).g_up[2] > 9.0


def test_a_sliding_foot_of_six_is_named():
    log, estimator = walk(6), make(6)
    slid = np.zeros(6, dtype=bool)

    def slide(k, stamp, w, q, due):
        out = []
        for s in due:
            position = s.position.copy()
            position[0, 0] += 0.15 * max(0.0, 1e-9 * s.stamp_ns - 1.0)  # 15 cm/s while the robot stands
            out.append(s._replace(position=position))
        return stamp, w, q, out if k < 190 else due

    for k, e in enumerate(run(log, estimator, slide)):
        if 110 < k < 190:
            slid |= e.slipping
            assert np.linalg.norm(e.velocity) < 0.03
    assert slid.tolist() == [True] + [False] * 5


class TestRobot:
    """With joints of a real description."""

    @pytest.fixture
    def robot(self):
        return load_robot("ragno")

    def stand(self, estimator, robot, n=120, q=None):
        rng = np.random.default_rng(0)
        q = robot.neutral if q is None else q
        for k in range(1, n):
            estimator.imu(k * TICK, 0.0054 * rng.normal(size=3), [0.0, 0.0, 9.81] + 0.035 * rng.normal(size=3))
            if (k * TICK) // PERIOD > ((k - 1) * TICK) // PERIOD:
                estimator.joints((k * TICK) // PERIOD * PERIOD, q, np.ones(6, dtype=bool))

    def test_noises_come_from_the_description(self, robot):
        params = EstimatorParams.from_robot(robot)
        assert params.sigma_w == pytest.approx(0.0054, abs=2e-4)
        assert params.sigma_q == pytest.approx(0.036, abs=2e-3)
        assert params.standstill_travel == pytest.approx(0.0009, abs=2e-4)

    def test_stands_over_the_start_pose(self, robot):
        estimator = Estimator.for_robot(robot, StartPose(1.0, -0.5, 0.3, 0.2))
        self.stand(estimator, robot)
        pose = estimator.pose()
        height = (
            0.2 + robot.foot_radius - feet_module.feet_in_imu(feet_module.foot_mount(robot), robot.neutral)[0][0, 2]
        )
        np.testing.assert_allclose(pose.position, [1.0, -0.5, height], atol=2e-3)
        assert pose.yaw == pytest.approx(0.3, abs=5e-3)
        np.testing.assert_allclose(estimator.estimate().velocity, 0.0, atol=5e-3)
        assert estimator.estimate().sensors_ok

    def test_wrong_lengths_are_refused(self, robot):
        estimator = Estimator.for_robot(robot)
        assert estimator.joints(PERIOD, np.zeros(7), np.ones(6, dtype=bool)) is InputResult.SHAPE
        assert estimator.joints(PERIOD, robot.neutral, np.ones(4, dtype=bool)) is InputResult.SHAPE
        assert estimator.imu(TICK, np.zeros(2), np.zeros(3)) is InputResult.SHAPE
        assert make().joints(PERIOD, robot.neutral, np.ones(2, dtype=bool)) is InputResult.SHAPE

    def test_known_level_ground_takes_the_accelerometer_bias_out(self, robot):
        rng = np.random.default_rng(1)
        tilts = {}
        for slope in (np.inf, 0.003):
            estimator = Estimator.for_robot(robot, start_slope_sd=slope)
            for k in range(1, 80):
                acc = [0.2, 0.0, 9.81] + 0.035 * rng.normal(size=3)
                if k % 3 == 1:
                    estimator.joints(k * TICK, robot.neutral, np.ones(6, dtype=bool))
                estimator.imu(k * TICK, 0.0054 * rng.normal(size=3), acc)
            tilts[slope] = abs(estimator.estimate().pitch)
        assert tilts[np.inf] > 0.015
        assert tilts[0.003] < 0.003

    def test_a_restart_in_mid_walk_does_not_claim_to_know_where_it_is(self, robot):
        estimator = Estimator.for_robot(robot, start_slope_sd=0.003)
        self.stand(estimator, robot)
        assert np.diag(estimator.pose().covariance).max() < 1e-4
        estimator.reset(stated=False)
        self.stand(estimator, robot)
        assert np.diag(estimator.pose().covariance)[[0, 1, 2, 5]].min() > 0.5  # the tilt is that of a rest
        assert np.linalg.norm(estimator.estimate().acc_bias) < 0.05

    def test_a_jump_of_the_legs_hardly_moves_the_estimate(self, robot):
        estimator = Estimator.for_robot(robot)
        self.stand(estimator, robot)
        q = robot.neutral.copy()
        q[1::3] += 1.0
        estimator.joints(120 * TICK, q, np.ones(6, dtype=bool))
        estimator.imu(120 * TICK, np.zeros(3), np.array([0.0, 0.0, 9.81]))
        for name in (BEST, "ekf", "kinematics_gyro"):
            assert np.linalg.norm(estimator.estimate(name).velocity) < 0.2


def test_a_sample_older_than_the_window_is_refused_by_name():
    log, estimator = walk(), make()
    for _ in zip(range(200), run(log, estimator), strict=False):
        pass
    before = estimator.estimate()
    assert estimator.feet(*log.feet[10]) is InputResult.LATE
    assert estimator.imu(int(log.stamp_ns[100]), log.w[100], log.q[100]) is InputResult.LATE
    assert estimator.imu(int(log.stamp_ns[190]), log.w[190], log.q[190]) is InputResult.DUPLICATE
    assert estimator.estimate().refused == 3
    np.testing.assert_array_equal(estimator.estimate().velocity, before.velocity)
    assert any("imu_duplicate" in reason for reason in estimator.estimate().reasons)


def test_a_walk_without_a_rest_starts_in_motion():
    log = walk(seed=1)
    begin = 320
    estimator = make(gyro_bias_sd=0.02)
    feet = [s for s in log.feet if s.stamp_ns > log.stamp_ns[begin]]
    estimates = []
    for k in range(begin, len(log.stamp_ns)):
        estimator.imu(int(log.stamp_ns[k]), log.w[k], log.q[k])
        while feet and feet[0].stamp_ns <= log.stamp_ns[k]:
            estimator.feet(*feet.pop(0))
        estimates.append(estimator.estimate())
    assert not estimates[60].initialised
    assert estimates[100].initialised
    assert estimates[-1].initialised
    error = np.array([e.velocity_imu for e in estimates])[300:] - log.v[begin + 300 :]
    assert np.sqrt(np.mean(np.sum(error**2, axis=1))) < 0.012
    assert not estimator.estimate("ekf").initialised


def test_feet_without_sensors_are_judged_by_their_height():
    log, known, unknown = walk(), make(names=(BEST,)), make(names=(BEST,))
    errors = {}
    for estimator, sensed in ((known, True), (unknown, False)):

        def change(k, stamp, w, q, due, sensed=sensed):
            return stamp, w, q, due if sensed else [s._replace(contact=None) for s in due]

        errors[sensed] = rms(log, list(run(log, estimator, change)))
    assert errors[False] < 1.5 * errors[True]
