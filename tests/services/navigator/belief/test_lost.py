"""Lost or not: probabilities, what raises and lowers them, calibration on streams drawn from the model, real frames."""

import math
from dataclasses import replace

import numpy as np
import pytest

from surefoot.errors import Refusal
from surefoot.services.navigator.belief.lost import (
    Footprint,
    FrameEvidence,
    LostModel,
    LostState,
    echoed,
    evidence_of,
    in_view,
    observed,
    passed,
    shares_of,
)
from surefoot.services.navigator.belief.matching import Detections, match
from tests.services.navigator.belief.floors import EASY, LENGTH, ROUGH, Eye, floor

MODEL, DT = LostModel(), 0.1


def after(frames, state=None, model=MODEL):
    state = state or LostState()
    for frame in frames:
        state = observed(passed(state, DT, model), frame, model)
    return state


def test_probabilities_add_up_to_one():
    rng, state = np.random.default_rng(1), LostState()
    for _ in range(500):
        counts = rng.poisson([2, 1, 0.3])
        state = after([FrameEvidence(*counts.tolist(), tuple(rng.uniform(0, 9, counts[0])), 2.0)], state)
        parts = (state.right, state.displaced, state.off_map, state.blind, state.misfit)
        assert min(parts) >= 0.0
        assert sum(parts) == pytest.approx(1.0, abs=1e-12)


def test_what_is_seen_here_lowers_and_what_belongs_elsewhere_raises():
    start = after([FrameEvidence()] * 50)
    assert after([FrameEvidence(here=1)], start).displaced < start.displaced
    assert after([FrameEvidence(elsewhere=1)], start).displaced > start.displaced
    assert after([FrameEvidence(strange=1)], start).off_map > start.off_map
    assert (
        after([FrameEvidence(here=1, nis=(8.0,))], start).displaced
        > after([FrameEvidence(here=1, nis=(0.5,))], start).displaced
    )


def test_where_fewer_belong_elsewhere_one_weighs_more_and_where_more_do_none_weighs_less():
    fresh = shares_of(LostState(), MODEL)
    assert fresh == pytest.approx(MODEL.right)
    shares = [shares_of(after([FrameEvidence(10 - n, n)] * 200), MODEL) for n in (0, 1, 2, 4)]
    assert [sum(found) for found in shares] == pytest.approx([1.0] * 4)
    assert shares[0][1:] == MODEL.fewest
    assert shares[1][1] == pytest.approx(0.1, abs=0.02)
    assert all(found[1] <= MODEL.right[1] for found in shares)
    wrong = replace(LostState(), right=0.5, displaced=0.5)
    assert observed(wrong, FrameEvidence(elsewhere=1), MODEL).usual == wrong.usual


def test_no_single_frame_decides():
    settled = after([FrameEvidence(here=2)] * 100)
    assert after([FrameEvidence(elsewhere=20)], settled).probability < 0.1
    assert after([FrameEvidence(elsewhere=20)] * 5, settled).probability > MODEL.threshold


def test_false_detections_and_silence_are_no_loss():
    rng = np.random.default_rng(2)
    worst, state = 0.0, LostState()
    for _ in range(36_000):  # an hour
        n = rng.poisson(2.4)
        elsewhere = rng.binomial(n, 0.15)
        state = after([FrameEvidence(n - elsewhere, elsewhere, 0, (), 2.4)], state)
        worst = max(worst, state.probability)
    assert worst < MODEL.threshold
    assert after([FrameEvidence()] * 600).probability < 0.5  # nothing is expected where nothing is seen


def test_a_dark_camera_is_blind_and_not_displaced():
    state = after([FrameEvidence(here=2, expected=2.4)] * 50)
    state = after([FrameEvidence(expected=2.4)] * 30, state)
    assert state.blind > 0.9
    assert state.displaced + state.off_map < 0.05
    assert state.probability > MODEL.threshold  # what should be seen and is not makes lost
    assert "nothing is seen" in state.reason(MODEL)
    state = after([FrameEvidence(here=2, expected=2.4)] * 10, state)
    assert state.probability < 0.05
    assert state.reason(MODEL) == ""


def test_a_floor_without_known_landmarks_is_off_the_map():
    state = after([FrameEvidence(strange=2)] * 30, after([FrameEvidence(here=2)] * 30))
    assert state.off_map > MODEL.threshold
    assert "not on the map" in state.reason(MODEL)


def test_probability_means_what_it_says():
    """Streams drawn from the model: of the moments with probability p, a part p is truly displaced."""
    model = LostModel(displacement_rate=0.02, recovery_rate=1e-9, leaving_rate=1e-9, blinding_rate=1e-9)
    rng, said, true = np.random.default_rng(3), [], []
    for _ in range(400):
        state, displaced = LostState(), False
        for _ in range(150):
            displaced = displaced or rng.uniform() < 1.0 - math.exp(-model.displacement_rate * DT)
            counts = rng.multinomial(int(rng.uniform() < 0.15), model.displaced if displaced else model.right)
            state = after([FrameEvidence(*counts.tolist())], state, model)
            said.append(state.displaced)
            true.append(displaced)
    said, true = np.array(said), np.array(true)
    for low, high in ((0.0, 0.1), (0.1, 0.4), (0.4, 0.7), (0.7, 0.95), (0.95, 1.01)):
        inside = (said >= low) & (said < high)
        assert inside.sum() > 200
        assert true[inside].mean() == pytest.approx(said[inside].mean(), abs=0.08)


@pytest.mark.parametrize(("noise", "recognised"), [(EASY, 0.1), (ROUGH, 0.1)])
def test_a_displaced_walker_is_noticed_in_three_seconds(noise, recognised):
    model, cov = LostModel(), np.diag([0.03**2, 0.03**2, math.radians(3) ** 2])
    for seed in range(10):
        world = floor(seed, copied=0.5)
        eye, believed = Eye(world, noise, seed, recognised=recognised, false=0.1), np.array([2.0, 0.0, 0.0])
        state, noticed = LostState(), None
        for i in range(80):
            truth = believed if i < 50 else np.array([2.3, 0.6, -math.pi / 2])
            seen, _ = eye.look(truth)
            expected = recognised * in_view(world, tuple(believed.tolist()), Footprint())
            found = match(believed, cov, seen, world, noise)
            state = observed(passed(state, DT, model), evidence_of(found, cov, seen, world, noise, expected), model)
            if i < 50:
                assert state.probability < 0.5
            elif noticed is None and state.probability > model.threshold:
                noticed = i
        assert noticed is not None
        assert "elsewhere" in state.reason(model)


def test_evidence_counts_every_detection_but_outliers_and_nonsense():
    world = floor(4)
    seen, _ = Eye(world, EASY, 5, false=0.3).look((1.0, 0.0, 0.0))
    looks = np.vstack((seen.looks, np.full((1, LENGTH), 9.0), seen.looks[:1]))
    more = Detections(np.append(seen.ranges, [0.7, 0.0]), np.append(seen.bearings, [0.0, 0.0]), looks)
    found = match(np.array([1.0, 0.0, 0.0]), np.eye(3) * 1e-3, more, world, EASY)
    evidence = evidence_of(found, np.eye(3) * 1e-3, more, world, EASY)
    assert evidence.strange == 1
    counted = evidence.here + evidence.elsewhere + evidence.strange
    assert counted == len(more) - found.counts["outlier"] - found.counts["invalid"]
    assert found.counts["invalid"] == 1


def test_landmarks_in_view_are_those_of_the_sector():
    world, view, rng = floor(6), Footprint(), np.random.default_rng(7)
    for _ in range(20):
        x, y, heading = rng.uniform([0, -1, -9], [5, 1, 9])
        d = world.positions - [x, y]
        r, b = np.hypot(*d.T), np.arctan2(d[:, 1], d[:, 0]) - heading
        inside = (r >= view.nearest) & (r <= view.farthest) & (np.cos(b) >= math.cos(view.half_angle))
        assert in_view(world, (x, y, heading), view) == inside.sum()


@pytest.mark.parametrize("dt", [-0.1, math.nan, math.inf])
def test_time_that_cannot_be_is_refused(dt):
    with pytest.raises(Refusal):
        passed(LostState(), dt, MODEL)


def test_matches_that_lie_off_their_places_are_a_misfit():
    """A stretched map: landmarks are found, but with innovations that a right belief does not have."""
    rng = np.random.default_rng(8)

    def stream(scale, here, away):  # counts a frame as measured with the benchmark's corridor
        for _ in range(40):
            n = int(rng.poisson(here))
            nis = tuple(np.minimum(rng.exponential(2.0 * scale, n), 9.0).tolist())
            yield FrameEvidence(n, int(rng.poisson(away)), 0, nis)

    assert after(stream(0.9, 3.0, 0.36)).probability < 0.1
    state = after(stream(4.0, 2.2, 1.15))
    assert state.misfit > MODEL.threshold
    assert "than the belief allows" in state.reason(MODEL)


def test_a_unique_look_in_the_gate_is_worth_more_than_one_of_many():
    start = after([FrameEvidence(elsewhere=2)] * 3)
    unique, common = (
        after([FrameEvidence(here=1, chances=((chance,), ()))], start).displaced for chance in (0.0, 0.9)
    )  # fmt: skip
    assert unique < common
    assert unique < 0.5 * start.displaced


def test_echoes_count_once_a_second_and_never_decide_alone():
    state = passed(LostState(), 10.0, MODEL)
    for _ in range(600):
        state = echoed(passed(state, DT, MODEL), 2.5, (0.6, 0.6), 0.2, MODEL)
    assert state.displaced > passed(LostState(), 70.0, MODEL).displaced
    assert state.probability < MODEL.threshold
    one = echoed(passed(LostState(), 10.0, MODEL), 2.5, (0.6, 0.6), 0.2, MODEL)
    assert echoed(passed(one, DT, MODEL), 2.5, (0.6, 0.6), 0.2, MODEL).echo[0] == one.echo[0]
    assert echoed(passed(one, 2.0, MODEL), 0.6, (0.6, 0.6), 0.2, MODEL).displaced < passed(one, 2.0, MODEL).displaced


def test_echoes_as_expected_beforehand_let_later_ones_weigh_no_more():
    """The rate gave back what they took from a displaced robot: 3 nats beyond that rate are the most of all others."""
    state = plain = LostState()
    for k in range(90):
        state, plain = (passed(each, 1.7, MODEL) for each in (state, plain))
        state = echoed(state, 0.6 if k < 60 else 2.5, (0.5, 0.7), 0.2, MODEL)
        if k < 60:
            assert state.displaced <= plain.displaced
            plain = state
        odds, least = state.displaced / state.right, plain.displaced / plain.right
        assert math.log(odds / least) <= MODEL.echo_most + 1e-9


def test_an_echo_within_what_the_map_allows_is_as_expected():
    kinds = [echoed(passed(LostState(), 2.0, MODEL), d, (1.0, 1.5), 0.2, MODEL).echo[0] for d in (0.7, 0.9, 1.6, 1.8)]
    assert [value > 0.0 for value in kinds] == [True, False, False, True]


def test_frames_far_apart_share_fewer_errors_and_weigh_more():
    frame = FrameEvidence(elsewhere=20)
    near, far = (observed(passed(LostState(), dt, MODEL), frame, MODEL) for dt in (0.1, 1.7))
    assert far.displaced > near.displaced
    assert far.displaced < MODEL.threshold  # still no single one decides
