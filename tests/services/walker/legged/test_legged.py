"""The walker in a loop of kinematics: commands, phases, reactions, refusals, restart. Physics is in test_walk."""

import dataclasses
import itertools
import math

import numpy as np
import pytest

from surefoot.geometry.heightmap import HeightMap
from surefoot.robot import kinematics
from surefoot.robot.reader import load_robot, robot_names
from surefoot.services.walker.interface import MotionCommand, WalkerInputs
from surefoot.services.walker.legged.gait import LeggedWalker
from tests.services.walker.legged.plant import PARAMS, ROBOT, Plant, begun, obeyed, plant

LEGGED = {name: robot for name in robot_names() if (robot := load_robot(name)).nlegs >= 4}


@pytest.fixture(params=LEGGED)
def robot(request):
    return LEGGED[request.param]


def test_walks_a_distance_and_ends_in_the_neutral_stance(robot):
    p, outs = obeyed(MotionCommand("walk", distance=0.3), robot=robot)
    s, params = p.walker.state, p.walker.params
    assert (outs[-1].state, s.body[0]) == ("standing", pytest.approx(0.3, abs=0.005))
    assert abs(s.body[1]) < 0.005
    feet = s.footholds[:, :2] - s.body[:2]
    assert np.hypot(*(feet - p.walker.frame.neutral).T).max() < params.close_tolerance_m
    assert outs[-1].trunk_height == pytest.approx(params.hip_height_m, abs=0.004)


def test_tripods_alternate_with_three_feet_down_and_all_targets_in_reach():
    _, outs = obeyed(MotionCommand("walk", distance=0.3))
    assert all(np.count_nonzero(o.stance) >= 3 for o in outs)
    assert all(o.unreachable == 0 for o in outs)
    groups = [tuple(o.stance) for o in outs if np.count_nonzero(o.stance) == 3]
    order = [g for i, g in enumerate(groups) if i == 0 or g != groups[i - 1]]
    assert set(order) == {(True, False) * 3, (False, True) * 3}
    assert all(a != b for a, b in itertools.pairwise(order))


def test_set_points_are_continuous_and_within_limits(robot):
    _, outs = obeyed(MotionCommand("walk", distance=0.2), robot=robot)
    commands = np.array([o.command for o in outs])
    assert (commands >= robot.joint_lower).all()
    assert (commands <= robot.joint_upper).all()
    assert np.abs(np.diff(commands, axis=0)).max() < 0.15  # rad in a tick: 15 rad/s at the swing's fastest


@pytest.mark.parametrize("angle", [0.8, -0.8])
def test_turns_on_the_spot(angle, robot):
    p, _ = obeyed(MotionCommand("turn", angle=angle), robot=robot)
    assert p.walker.state.yaw == pytest.approx(angle, abs=0.02)
    assert np.hypot(*p.walker.state.body[:2]) < 0.01


def test_walks_backward(robot):
    p, _ = obeyed(MotionCommand("walk", distance=-0.1), robot=robot)
    assert p.walker.state.body[0] == pytest.approx(-0.1, abs=0.005)


@pytest.mark.parametrize("gait", ["ripple", "wave"])
def test_other_gaits_keep_more_feet_down(gait):
    p, outs = obeyed(MotionCommand("walk", distance=0.1, gait=gait))
    assert p.walker.state.body[0] == pytest.approx(0.1, abs=0.005)
    assert min(np.count_nonzero(o.stance) for o in outs) == {"ripple": 4, "wave": 5}[gait]


def test_stop_in_the_middle_of_a_swing_closes_and_stands():
    p = begun(MotionCommand("walk", velocity=0.05))
    p.run(1.75)
    assert p.out.state == "walking"
    assert not p.out.stance.all()
    where = p.walker.state.body[0]
    assert p.walker.command(MotionCommand("stop")).accepted
    outs = p.until("standing", limit=3.0)
    assert {o.state for o in outs} == {"stopping", "standing"}
    assert p.walker.state.body[0] - where < 0.03
    feet = p.walker.state.footholds[:, :2] - p.walker.state.body[:2]
    assert np.hypot(*(feet - p.walker.frame.neutral).T).max() < PARAMS.close_tolerance_m


def test_a_later_command_replaces_an_earlier_one(robot):
    p = plant(robot)
    p.run(1.0)
    first = p.walker.command(MotionCommand("walk", distance=1.0))
    p.run(2.0)
    second = p.walker.command(MotionCommand("turn", angle=0.3))
    assert second.walk_id == first.walk_id + 1
    p.step()
    p.until("standing")
    assert p.walker.state.yaw == pytest.approx(0.3, abs=0.02)
    assert p.walker.state.body[0] < 0.15


def test_refuses_to_walk_before_the_estimator_is_initialised_but_stands():
    p = Plant(LeggedWalker(ROBOT), initialised=False)
    outs = p.run(0.5)
    assert {o.state for o in outs} == {"waiting"}
    still = np.array([o.command for o in outs])
    assert np.abs(np.diff(still, axis=0)).max() == 0.0  # the standstill calibration needs it
    reply = p.walker.command(MotionCommand("walk", distance=1.0))
    assert (reply.accepted, reply.code) == (False, "not_initialised")
    assert p.walker.command(MotionCommand("stop")).accepted
    p.initialised = True
    p.run(1.0)
    assert p.walker.command(MotionCommand("walk", distance=0.1)).accepted


@pytest.mark.parametrize(
    ("command", "code", "field"),
    [
        (MotionCommand("walk", distance=math.nan), "bad_value", "distance"),
        (MotionCommand("walk", velocity=math.inf), "bad_value", "velocity"),
        (MotionCommand("walk", velocity=0.5), "too_fast", "velocity"),
        (MotionCommand("walk", velocity=0.0), "too_fast", "velocity"),
        (MotionCommand("turn"), "missing_field", "angle"),
        (MotionCommand("walk", distance=1.0, angle=0.2), "unsupported", "angle"),
        (MotionCommand("walk", distance=1.0, gait="trot"), "unknown_gait", "gait"),
        (MotionCommand("walk", shift=(0.01, 0.0)), "bad_value", "shift"),
        (MotionCommand("stand", shift=(0.5, 0.0)), "bad_value", "shift"),
    ],
)
def test_impossible_commands_are_refused_and_change_nothing(command, code, field):
    p = plant()
    p.run(1.0)
    reply = p.walker.command(command)
    assert (reply.accepted, reply.code, reply.field, reply.walk_id) == (False, code, field, 0)
    assert reply.reason
    p.run(0.2)
    assert p.out.state == "standing"


def test_no_new_step_on_a_stale_estimate_and_on_again_when_it_returns():
    p = begun(MotionCommand("walk", velocity=0.05))
    p.run(1.3)
    p.estimate_age = 0.2
    p.run(1.5)
    assert p.out.state == "hold"
    assert p.out.stance.all()
    steps = p.out.steps
    p.run(0.5)
    assert p.out.steps == steps
    p.estimate_age = 0.0
    p.run(1.5)
    assert p.out.state == "walking"
    assert p.out.steps > steps


def test_a_restart_with_feet_in_the_air_puts_them_down_closes_and_walks_on():
    p = begun(MotionCommand("walk", distance=1.0))
    p.run(1.25)
    assert not p.out.stance.all()
    again = plant()
    again.joints, again.contacts = p.joints, p.contacts
    assert not again.contacts.all()
    again.walker.state.body[:] = 0.0
    first = again.step()
    jump = kinematics.foot_positions(ROBOT.model, again.joints) - kinematics.foot_positions(ROBOT.model, p.joints)
    assert np.abs(jump).max() < 0.006  # nothing moves at once
    assert first.state == "recovering"
    again.until("standing", limit=10.0)
    assert again.contacts.all()
    again.obey(MotionCommand("walk", distance=0.1))
    assert again.walker.state.body[0] == pytest.approx(0.1, abs=0.02)


def test_climbs_a_step_of_the_map_and_keeps_the_trunk_over_it():
    z = np.zeros((161, 401), dtype=np.float32)
    z[:, 160:] = 0.025  # x >= 0.4 m
    heights = HeightMap(z=z, cell=0.005, origin=(-0.4, -0.4))
    p = Plant(LeggedWalker(ROBOT), heights)
    outs = p.obey(MotionCommand("walk", distance=0.9))
    assert outs[-1].state == "standing"
    s = p.walker.state
    assert (s.footholds[:, 2] > 0.02).all()
    assert s.body[2] == pytest.approx(0.025 + PARAMS.hip_height_m, abs=0.006)
    assert all(o.unreachable == 0 for o in outs)


def test_a_hole_in_the_map_and_in_the_ground_is_found_by_the_foot():
    """The map has z = 0, the ground is 20 mm lower: the feet go on looking until the switches close."""
    p = Plant(LeggedWalker(ROBOT), HeightMap(z=np.zeros((161, 161), dtype=np.float32), cell=0.005, origin=(-0.4, -0.4)))
    p.run(1.0)
    p.heights = HeightMap(z=np.full((161, 161), -0.02, dtype=np.float32), cell=0.005, origin=(-0.4, -0.4))
    p.walker.command(MotionCommand("walk", distance=0.05))
    p.step()
    while p.walker.state.steps < 1:
        p.step()
        assert p.tick < 400
    landed = p.walker.state.footholds[[0, 2, 4], 2] - p.walker.state.footholds[[1, 3, 5], 2]
    assert landed == pytest.approx(np.full(3, -0.02), abs=0.004)


def test_levelling_works_against_the_estimated_tilt_within_its_limit():
    walker = LeggedWalker(ROBOT)
    p = Plant(walker)
    p.run(1.0)
    for _ in range(2000):
        base = p.inputs()
        walker.step(dataclasses.replace(base, roll=0.1, pitch=-0.05))
        p.tick += 1
    assert walker.state.level[0] == pytest.approx(-PARAMS.level_limit_rad)
    assert walker.state.level[1] == pytest.approx(PARAMS.level_limit_rad)


def test_equal_inputs_give_equal_outputs():
    a, b = plant(), plant()
    for p in (a, b):
        p.obey(MotionCommand("walk", distance=0.1))
    assert np.array_equal(a.out.command, b.out.command)
    assert a.tick == b.tick


def test_nothing_is_commanded_before_the_first_joint_sample():
    out = LeggedWalker(ROBOT).step(WalkerInputs(stamp=0.0))
    assert out.command is None
    assert out.state == "waiting"


def test_a_low_published_margin_shortens_the_steps_and_says_so():
    strides = {}
    for margin in (0.05, 0.004):
        p = plant()
        p.run(1.0)
        p.walker.command(MotionCommand("walk", velocity=0.05))
        for _ in range(300):
            p.walker.step(dataclasses.replace(p.inputs(), margin=margin))
            p.joints, p.tick = p.walker.state.q.copy(), p.tick + 1
            p.contacts = p.walker.state.feet[:, 2] < ROBOT.foot_radius + 1e-3
        strides[margin] = p.walker.state.body[0] / p.walker.state.steps
        low = "margin 4 mm is low" in p.walker.state.reason
        assert low == (margin < PARAMS.low_margin_m)
    assert strides[0.004] == pytest.approx(0.5 * strides[0.05], rel=0.15)


def test_a_walk_counts_from_the_estimate_at_its_first_step_not_from_the_old_plan():
    """The odometry moved by 3 cm while the robot stood (a push): the way begins where the robot is now."""
    p = plant()
    p.run(1.0)
    shifted = p.inputs

    def pushed():
        base = shifted()
        return dataclasses.replace(base, x=base.x + (0.03 if p.walker.state.steps == 0 and base.x < 0.03 else 0.0))

    p.inputs = pushed
    p.obey(MotionCommand("walk", distance=0.1))
    assert p.walker.state.body[0] == pytest.approx(0.13, abs=0.005)
