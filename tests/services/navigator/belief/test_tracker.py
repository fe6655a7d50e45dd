"""The live belief: unbiased, and as sure as it may be, also when frames share the error of a tilt."""

import math

import numpy as np
import pytest
from scipy.stats import chi2

from surefoot.services.navigator.belief import common_errors
from surefoot.services.navigator.belief.common_errors import CommonErrors
from surefoot.services.navigator.belief.landmarks import FloorLandmarks
from surefoot.services.navigator.belief.matching import DetectionError, Detections, SightNoise
from surefoot.services.navigator.belief.tracker import Motion, PoseTracker, StartUncertainty, held, of_sight

TILT = CommonErrors(math.radians(2.5), sway=0.02, tilt_fade=5.0, height=0.45)
NOISE = SightNoise(0.0, 0.03, math.radians(1.5))
STEP = Motion(
    0.0055, 0.0, 0.0, 0.0055, along=1e-6, across=1e-6, heading=math.radians(0.4) ** 2, drifting=1e-6
)  # a tenth of a second of a walking Nao


def walk(
    seed: int, tilted: CommonErrors, believed: CommonErrors, seconds: float = 20.0, *, standing: bool = False
) -> tuple[float, float]:
    """Walk with a drift past landmarks; return NEES of the pose at the end and the distance of the estimate, m."""
    rng = np.random.default_rng(seed)
    places, looks = rng.uniform((-1.0, -1.5), (3.0, 1.5), (480, 2)), rng.standard_normal((480, 8))
    looks /= np.linalg.norm(looks, axis=1, keepdims=True)
    tracker = PoseTracker(StartUncertainty(0.05, math.radians(5.0), 0.4), NOISE, NOISE, believed)
    tracker.world = FloorLandmarks(places, looks)
    x, y, theta = 0.05 * rng.standard_normal(), 0.05 * rng.standard_normal(), math.radians(5.0) * rng.standard_normal()
    drift, error, keep = (
        0.4 * rng.standard_normal(),
        tilted.array() * rng.standard_normal(3),
        np.array(tilted.kept(0.1, standing=standing)),
    )
    gain = np.zeros((2, 3))
    for k in range(round(seconds / 0.1)):
        forward = STEP.forward + math.sqrt(STEP.along) * rng.standard_normal()
        turn = drift * STEP.walked + math.sqrt(STEP.heading) * rng.standard_normal()
        left = math.sqrt(STEP.across) * rng.standard_normal()
        c, s = math.cos(theta + 0.5 * turn), math.sin(theta + 0.5 * turn)
        x, y, theta = x + forward * c - left * s, y + forward * s + left * c, theta + turn
        drift += math.sqrt(STEP.drifting) * rng.standard_normal()
        error = keep * error + np.sqrt(1.0 - keep * keep) * tilted.array() * rng.standard_normal(3)
        tracker.move(STEP)
        away = places - (x, y)
        r, a = np.hypot(*away.T), np.arctan2(away[:, 1], away[:, 0]) - theta
        a = np.angle(np.exp(1j * a))
        seen = np.flatnonzero((r > 0.35) & (r < 1.18) & (np.abs(a) < 0.57) & (rng.random(480) < 0.1))
        ranges, bearings = [], []
        for i in seen:
            common_errors.fill_gain(r[i], a[i], tilted.height, gain)
            ranges.append(r[i] * (1.0 + 0.03 * rng.standard_normal()) + float((gain[0] * error).sum()))
            bearings.append(a[i] + NOISE.bearing_sd * rng.standard_normal() + float((gain[1] * error).sum()))
        frame = Detections(
            np.maximum(ranges, 0.0), np.array(bearings), looks[seen] + 0.05 * rng.standard_normal((len(seen), 8))
        )
        tracker.look(frame, 0.1 * (k + 1), standing=standing)
    e = tracker.mean[:3] - (x, y, theta)
    e[2] = math.remainder(e[2], 2.0 * math.pi)
    return float(e @ np.linalg.solve(tracker.cov[:3, :3], e)), math.hypot(e[0], e[1])


RUNS = 30


def band(share: float) -> tuple[float, float]:
    """Return the band that holds the mean NEES of RUNS runs with a probability."""
    return (chi2.ppf((1 - share) / 2, 3 * RUNS) / RUNS, chi2.ppf((1 + share) / 2, 3 * RUNS) / RUNS)


@pytest.mark.parametrize(
    ("tilted", "believed", "away"),
    [
        pytest.param(CommonErrors(1e-9), CommonErrors(), 0.02, id="known tilt"),
        pytest.param(TILT, TILT, math.inf, id="errors that frames share"),
    ],
)
def test_consistent(tilted: CommonErrors, believed: CommonErrors, away: float) -> None:
    found = np.array([walk(seed, tilted, believed) for seed in range(RUNS)])
    low, high = band(0.999)
    assert low < found[:, 0].mean() < high
    assert found[:, 1].mean() < away


def test_shared_errors_that_are_ignored_make_it_far_too_sure() -> None:
    found = np.array([walk(seed, TILT, CommonErrors()) for seed in range(20)])
    assert found[:, 0].mean() > 3.0 * 4.0


def test_place_keeps_the_drift_only_on_request() -> None:
    tracker = PoseTracker(StartUncertainty(), NOISE, NOISE)
    tracker.mean[3], tracker.cov[3, 3] = 0.3, 0.01
    tracker.place((1.0, 2.0, 0.5), keep_drift=True)
    assert (tracker.mean[3], tracker.cov[3, 3]) == (0.3, 0.01)
    tracker.place((1.0, 2.0, 7.0))
    assert (tracker.mean[3], tracker.pose) == (0.0, pytest.approx((1.0, 2.0, 7.0 - 2.0 * math.pi)))


def test_after_changes_nothing() -> None:
    tracker = PoseTracker(StartUncertainty(), NOISE, NOISE, TILT)
    before = (tracker.mean.copy(), tracker.cov.copy())
    mean, cov = tracker.after(STEP)
    np.testing.assert_array_equal(tracker.mean, before[0])
    np.testing.assert_array_equal(tracker.cov, before[1])
    assert mean.shape == (4,)
    assert cov[0, 0] > before[1][0, 0]


def test_ticks_spread_the_error_of_a_turn_as_one_that_grows_all_the_way() -> None:
    """A random walk of the heading, variance h over a straight way d, ends h d^2 / 3 to the side, h d / 2 with it."""
    way, h, ticks = 2.0, 0.01, 400
    tracker = PoseTracker(StartUncertainty(0.0, 0.0, 0.0), NOISE, NOISE)
    for _ in range(ticks):
        tracker.move(Motion(forward=way, heading=h).part(1.0 / ticks))
    expected = np.array([[h * way**2 / 3.0, 0.5 * h * way], [0.5 * h * way, h]])
    assert tracker.cov[1:3, 1:3] == pytest.approx(expected, rel=0.01)


def test_descriptors_of_another_length_are_refused() -> None:
    tracker = PoseTracker(StartUncertainty(), NOISE, NOISE)
    rng = np.random.default_rng(0)
    tracker.world = FloorLandmarks(rng.uniform(-1, 1, (20, 2)), rng.standard_normal((20, 8)))
    with pytest.raises(DetectionError, match="8 numbers, got 4"):
        tracker.look(Detections(np.array([0.5]), np.array([0.0]), np.ones((1, 4))), 0.1, standing=True)


@pytest.mark.parametrize("sd", [0.0, 0.02, 0.5])
def test_a_landmark_corrects_as_far_as_its_own_place_is_known(sd) -> None:
    """One landmark ahead: along x a Kalman update with the sum of both variances, P R / (P + R)."""
    tracker = PoseTracker(StartUncertainty(position=0.05, heading=1e-4), NOISE, NOISE)
    looks = np.random.default_rng(0).standard_normal((2, 8))
    tracker.world = FloorLandmarks(np.array([[0.8, 0.0], [3.0, 3.0]]), looks, sd=np.full(2, sd))
    prior, noise = 0.05**2, (0.03 * 0.8) ** 2 + sd**2
    assert tracker.look(Detections(np.array([0.8]), np.array([0.0]), looks[:1]), 0.1, standing=True).matched == 1
    assert tracker.cov[0, 0] == pytest.approx(prior * noise / (prior + noise), rel=0.02)
    beside = (0.8 * math.radians(1.5)) ** 2 + sd**2
    assert tracker.cov[1, 1] == pytest.approx(prior * beside / (prior + beside), rel=0.02)


@pytest.mark.parametrize("common", [0.0, 0.3, 4.0])
def test_sights_of_one_landmark_know_it_no_better_than_the_map_does(common: float) -> None:
    variances = [of_sight(0.7, common, n) for n in range(1, 41)]
    assert 1.0 / sum(1.0 / variance for variance in variances) == pytest.approx(0.7 / 40 + common)


def test_a_robot_that_stands_is_no_surer_than_the_places_of_its_map() -> None:
    rng, nees = np.random.default_rng(5), []
    for _ in range(RUNS):
        places, looks = rng.uniform(-1.5, 1.5, (90, 2)), rng.standard_normal((90, 8))
        looks /= np.linalg.norm(looks, axis=1, keepdims=True)
        tracker = PoseTracker(StartUncertainty(0.05, math.radians(3.0), 0.4), NOISE, NOISE)
        tracker.world = FloorLandmarks(places + 0.01 * rng.standard_normal(places.shape), looks, sd=np.full(90, 0.01))
        r, a = np.hypot(*places.T), np.arctan2(places[:, 1], places[:, 0])
        for k in range(100):
            seen = np.flatnonzero((r > 0.35) & (r < 1.18) & (np.abs(a) < 0.57) & (rng.random(90) < 0.4))
            ranges = r[seen] * (1.0 + 0.03 * rng.standard_normal(len(seen)))
            tracker.look(Detections(ranges, a[seen] + NOISE.bearing_sd * rng.standard_normal(len(seen)), looks[seen]),
                         0.1 * (k + 1), standing=True)  # fmt: skip
        nees.append(float(tracker.mean[:3] @ np.linalg.solve(tracker.cov[:3, :3], tracker.mean[:3])))
    low, high = band(0.99)
    assert 0.3 * low < np.mean(nees) < high


def near_floor(sd: float) -> tuple[np.ndarray, Detections, FloorLandmarks]:
    """Return five landmarks ahead of the origin, a frame of them without noise, and the map."""
    rng = np.random.default_rng(3)
    places, looks = rng.uniform((0.5, -0.3), (1.0, 0.3), (5, 2)), np.eye(5)
    seen = Detections(np.hypot(*places.T), np.arctan2(places[:, 1], places[:, 0]), looks)
    return places, seen, FloorLandmarks(places, looks, sd=np.full(5, sd))


def stood(seconds: float = 60.0) -> tuple[PoseTracker, Detections]:
    """Return a tracker that saw five landmarks in every frame for a while, 10 frames a second."""
    _, seen, world = near_floor(0.02)
    tracker = PoseTracker(StartUncertainty(), NOISE, NOISE)
    tracker.world = world
    for k in range(round(10 * seconds)):
        tracker.look(seen, 0.1 * (k + 1), standing=True)
    return tracker, seen


@pytest.mark.parametrize("way", ["place", "widen", "loosen", "move"])
def test_a_belief_made_unsure_anew_converges_as_a_fresh_one(way: str) -> None:
    tracker, seen = stood()
    sure = tracker.entropy
    if way == "place":
        tracker.place((0.15, 0.1, 0.15), 0.15**2 * np.eye(3), keep_drift=True)
    elif way == "widen":
        tracker.widen(20.0)
    elif way == "loosen":
        tracker.loosen(0.08, 0.15)
    else:
        tracker.move(Motion(along=0.15**2, across=0.15**2, heading=0.15**2))
    assert tracker.entropy > sure + 5.0
    fresh = PoseTracker(StartUncertainty(), NOISE, NOISE)
    fresh.world = tracker.world
    if way != "place":
        tracker.mean[:3] += np.linalg.cholesky(tracker.cov[:3, :3]) @ (1.0, -1.0, 0.5)
    fresh.mean[:], fresh.cov[:] = tracker.mean, tracker.cov
    for k in range(50):
        for one in (tracker, fresh):
            one.look(seen, 60.1 + 0.1 * k, standing=True)
        assert math.dist(tracker.pose[:2], fresh.pose[:2]) < 0.01
        assert tracker.entropy == pytest.approx(fresh.entropy, abs=0.3)
    assert math.hypot(*tracker.pose[:2]) < 0.03


def test_a_robot_that_follows_a_landmark_stays_right() -> None:
    """Its steps take from the belief what many sights gave: those of the same landmarks count anew."""
    found = []
    for moves in (False, True):
        rng, (places, _, world) = np.random.default_rng(7), near_floor(0.005)
        tracker, true, errors = PoseTracker(StartUncertainty(), NOISE, NOISE), np.zeros(2), []
        tracker.world = world
        for k in range(600):
            if moves:
                true = true + 0.01 * rng.standard_normal(2)
                true = np.clip(true, -0.25, 0.25)
                tracker.move(Motion(along=1e-4, across=1e-4, heading=1e-5))
            d = places - true
            r = np.hypot(*d.T) * (1.0 + 0.03 * rng.standard_normal(5))
            a = np.arctan2(d[:, 1], d[:, 0]) + NOISE.bearing_sd * rng.standard_normal(5)
            tracker.look(Detections(r, a, np.eye(5)), 0.1 * (k + 1), standing=True)
            errors.append(math.dist(tracker.pose[:2], true))
        found.append(np.mean(errors[100:]))
    assert found[1] < 0.02


def test_sights_left_of_one_landmark_are_as_of_an_exact_filter() -> None:
    """One landmark, one axis: state and place in the map estimated together give the same variance at every step."""
    v, c, prior, rng = 0.7, 0.3, 1e9, np.random.default_rng(0)
    variance, cov, count = prior, np.diag([prior, c]), 0.0
    h = np.array([1.0, -1.0])
    for q in np.where(rng.random(60) < 0.5, 0.0, rng.exponential(0.05, 60)):
        before, variance = variance, variance + q
        count = 1.0 + held(count, c / v, math.log(variance / before))
        variance = 1.0 / (1.0 / variance + 1.0 / of_sight(v, c, count))
        cov = cov + np.diag([q, 0.0])
        gain = cov @ h / (h @ cov @ h + v)
        cov = cov - np.outer(gain, h @ cov)
        assert variance == pytest.approx(cov[0, 0], rel=1e-5)


@pytest.mark.parametrize(("fade", "right"), [(10.0, True), (None, False)])
def test_a_robot_that_stands_is_as_sure_as_a_tilt_that_lasts_lets_it_be(fade: float | None, right: bool) -> None:
    lasting = CommonErrors(math.radians(1.0), tilt_fade=0.3, standing_tilt_fade=10.0)
    believed = CommonErrors(math.radians(1.0), tilt_fade=0.3, standing_tilt_fade=fade)
    nees = np.mean([walk(seed, lasting, believed, 6.0, standing=True)[0] for seed in range(RUNS)])
    low, high = band(0.999)
    assert (low < nees < high) == right
    assert right or nees > high
