"""Preview control, footsteps, references: properties and independent solutions."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_are

from surefoot.robot.reader import load_robot
from surefoot.services.walker.biped import plan
from surefoot.services.walker.biped.params import BipedParams, abilities
from surefoot.services.walker.biped.preview import preview_gains, preview_step, riccati
from surefoot.services.walker.biped.route import Standing, route_of, together, upcoming
from surefoot.services.walker.commands import refusal_of
from surefoot.services.walker.interface import MotionCommand

P = BipedParams.for_robot(load_robot("bioloid"))
WIDTH = 0.0385


def walk(reference, height=0.2, ticks=None):
    gains, x, error = preview_gains(height, 0.01), np.zeros((3, 2)), np.zeros(2)
    x[0] = reference[0]
    rows = [preview_step(gains, x, error, reference, k) for k in range(ticks or len(reference) - 1)]
    return np.array(rows), x


def test_riccati_equals_scipy():
    rng = np.random.default_rng(1)
    for _ in range(20):
        a, b = rng.normal(size=(4, 4)), rng.normal(size=(4, 1))
        q = np.diag(rng.uniform(0.1, 1.0, 4))
        theirs = solve_discrete_are(a, b, q, np.array([[0.3]]))
        assert riccati(a, b, q, 0.3) == pytest.approx(theirs, rel=1e-6, abs=1e-8)


def test_preview_gains_fade_and_sum_to_the_state_gain():
    gains = preview_gains(0.2, 0.01)
    assert abs(gains.preview[-1]) < 2e-2 * np.abs(gains.preview).max()
    assert -gains.preview.sum() == pytest.approx(gains.state[0], rel=1e-12)


def test_zmp_follows_its_reference_and_com_comes_to_rest():
    rows = [[0.0, 0.0]] * 100 + [[0.0, 0.04]] * 60 + [[0.05, -0.04]] * 60 + [[0.05, 0.0]] * 300
    zmp, x = walk(np.array(rows))
    assert np.abs(zmp[120:150, 1] - 0.04).max() < 0.004
    assert np.abs(zmp[180:210, 1] + 0.04).max() < 0.004
    assert x[0] == pytest.approx([0.05, 0.0], abs=1e-4)
    assert np.abs(x[1:]).max() < 1e-3


@given(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2))
@settings(max_examples=20, deadline=None)
def test_preview_does_not_care_where_the_world_begins(dx, dy):
    rows = np.array([[0.0, 0.0]] * 60 + [[0.01, 0.04]] * 140)
    here, _ = walk(rows)
    there, _ = walk(rows + np.array([dx, dy]))
    assert there - here == pytest.approx(np.tile([dx, dy], (len(here), 1)), abs=1e-9)


def test_reference_ramps_and_rests():
    ref = plan.reference(np.array([[0.0, 0.0], [1.0, 2.0]]), np.array([10.0]), np.array([4.0]))
    assert ref[:, 0] == pytest.approx([0.25, 0.5, 0.75, 1, 1, 1, 1, 1, 1, 1])
    assert ref[:, 1] == pytest.approx(2 * ref[:, 0])


def test_swing_begins_and_ends_at_rest_on_the_ground():
    begin, end = np.array([0.0, 0.04, 0.0]), np.array([0.05, 0.04, 0.2])
    path = np.array([plan.swing(begin, end, s, 0.015) for s in np.linspace(0, 1, 201)])
    assert path[0] == pytest.approx([*begin, 0.0])
    assert path[-1] == pytest.approx([*end, 0.0], abs=1e-12)
    assert path[:, 3].max() == pytest.approx(0.015)
    assert np.abs(np.diff(path, axis=0)[[0, -1]]).max() < 1e-5
    assert np.all(np.diff(path[:, 0]) >= 0.0)


def all_steps(command, params=P, gain=(1.0, 1.0)):
    feet = np.array([[0.0, WIDTH, 0.0], [0.0, -WIDTH, 0.0]])
    now = Standing(feet, np.zeros(3), 0)
    return upcoming(route_of(command, params, 1), now, params, WIDTH, 1.0, np.array(gain), 100000)


def final(steps):
    feet = np.array([[0.0, WIDTH, 0.0], [0.0, -WIDTH, 0.0]])
    for step in steps:
        feet[step.swing] = step.target
    return feet, steps[-1].body


def test_ten_centimetres_of_nao_are_two_steps_and_a_closing_one():
    params = P.model_copy(update={"step_m": 0.05})
    steps = all_steps(MotionCommand("walk", distance=0.10), params)
    assert (len(steps), steps[1].body) == (3, pytest.approx([0.10, 0.0, 0.0]))
    feet, body = final(steps)
    assert together(feet, body, WIDTH, params)


def test_a_turn_of_23_degrees_is_two_steps_of_half_of_it():
    steps = all_steps(MotionCommand("turn", angle=math.radians(23)))
    assert (len(steps), np.degrees(steps[0].body[2])) == (3, pytest.approx(11.5))
    assert np.degrees(final(steps)[1][2]) == pytest.approx(23.0)


@given(st.floats(-0.4, 0.4), st.floats(-1.0, 1.0))
@settings(max_examples=60, deadline=None)
def test_walks_and_arcs_end_where_the_command_says_with_the_feet_together(distance, angle):
    if abs(distance) < 0.01:
        return
    steps = all_steps(MotionCommand("walk", distance=distance, angle=angle))
    feet, body = final(steps)
    assert together(feet, body, WIDTH, P)
    assert body[2] == pytest.approx(angle, abs=1e-9)
    way = sum(math.hypot(*(b.body - a.body)[:2]) for a, b in zip([steps[0], *steps], steps, strict=False)) + math.hypot(
        *steps[0].body[:2]
    )
    assert way == pytest.approx(abs(distance), abs=1e-6)
    assert all(a.swing != b.swing for a, b in itertools.pairwise(steps))


def test_a_learned_gain_makes_the_plan_shorter():
    steps = all_steps(MotionCommand("walk", distance=0.25), gain=(1.25, 1.0))
    assert final(steps)[1][0] == pytest.approx(0.20)


@pytest.mark.parametrize(
    ("command", "code", "field"),
    [
        (MotionCommand("walk", distance=math.nan), "bad_value", "distance"),
        (MotionCommand("walk", velocity=1.0), "too_fast", "velocity"),
        (MotionCommand("walk", velocity=0.0), "too_fast", "velocity"),
        (MotionCommand("turn"), "missing_field", "angle"),
        (MotionCommand("turn", angle=1.0, distance=1.0), "conflict", "distance"),
        (MotionCommand("turn", angle=1.0, velocity=0.1), "conflict", "velocity"),
        (MotionCommand("walk", angle=1.0), "missing_field", "distance"),
        (MotionCommand("walk", distance=0.0, angle=1.0), "missing_field", "distance"),
        (MotionCommand("walk", distance=0.05, angle=3.0), "too_tight", "angle"),
        (MotionCommand("walk", distance=1.0, gait="tripod"), "unknown_gait", "gait"),
        (MotionCommand("stand", shift=(0.01, 0.0)), "unsupported", "shift"),
    ],
)
def test_impossible_commands_are_refused_and_name_the_field(command, code, field):
    refusal = refusal_of(command, abilities(P), calibrated=True, fallen=False)
    assert not refusal.accepted
    assert (refusal.code, refusal.field) == (code, field)
    assert field in refusal.reason


def test_the_gait_changes_only_while_standing():
    quick = MotionCommand("walk", distance=1.0, gait="quick")
    assert refusal_of(quick, abilities(P), calibrated=True, fallen=False) is None
    assert refusal_of(quick, abilities(P), calibrated=True, fallen=False, stepping_gait="quick") is None
    refusal = refusal_of(quick, abilities(P), calibrated=True, fallen=False, stepping_gait="zmp")
    assert (refusal.code, refusal.field) == ("conflict", "gait")


def test_nothing_before_the_calibration_and_nothing_after_a_fall():
    walking = MotionCommand("walk", distance=1.0)
    assert refusal_of(walking, abilities(P), calibrated=False, fallen=False).code == "not_initialised"
    assert refusal_of(walking, abilities(P), calibrated=True, fallen=True).code == "fallen"
    assert refusal_of(MotionCommand("stop"), abilities(P), calibrated=False, fallen=False) is None


def test_shortened_steps_cost_no_step_of_their_own():
    """After a tilt a step is shorter; what is left then is taken along or given up, not walked for 0.9 s."""
    params = BipedParams.for_robot(load_robot("nao"))
    for command in (MotionCommand("walk", distance=0.1, angle=0.4), MotionCommand("turn", angle=0.4)):
        for scales in ((1.0, 1.0), (0.85, 1.0), (1.0, 0.85), (0.9, 0.9)):
            route, way = route_of(command, params, 1), np.zeros(2)
            for scale in scales:
                forward, turn, route = route.next(scale)
                way += (forward, turn)
                assert abs(forward) <= params.max_step_m
                assert abs(turn) <= params.max_turn_rad
            assert route.finished
            assert way[1] == pytest.approx(0.4, rel=0.11)
            assert abs(way[0]) <= 0.1 + 1e-12
    route = route_of(MotionCommand("walk", distance=0.1), params, 1).next(0.5)[2]
    assert route.steps == 2
    assert not route.finished
