"""The crawl in a loop of kinematics: the trunk moves over three feet before the fourth lifts."""

import itertools

import numpy as np
import pytest

from surefoot.geometry import rotations
from surefoot.geometry.heightmap import HeightMap
from surefoot.robot import kinematics
from surefoot.robot.description import RobotError
from surefoot.robot.reader import load_robot
from surefoot.services.walker.interface import MotionCommand, StanceVerdict
from surefoot.services.walker.legged.gait import LeggedWalker
from surefoot.services.walker.legged.params import WalkerParams
from surefoot.services.walker.legged.standins import hull_margin
from surefoot.services.walker.legged.state import Stage
from tests.services.walker.legged.plant import Plant, begun, plant

LUPO = load_robot("lupo")
PARAMS = WalkerParams.for_robot(LUPO)


def margin(p, standing=None):
    """Margin of the planned centre of mass in the hull of planned feet, m: an oracle by joint angles."""
    s = p.walker.state
    rot = rotations.matrix_from_rpy(s.level[0], s.level[1], s.yaw)
    com = s.body + rot @ kinematics.com(LUPO.model, s.q)
    feet = s.body + kinematics.foot_positions(LUPO.model, s.q) @ rot.T
    return hull_margin(feet[p.out.stance if standing is None else standing, :2], com[:2])


def crawled(command, seconds=60.0, heights=None):
    """Obey a command; yield the plant after each tick until it stands again."""
    p = Plant(LeggedWalker(LUPO), heights)
    p.run(1.0)
    assert p.walker.command(command).accepted
    for _ in range(round(100 * seconds)):
        p.step()
        yield p
        if p.out.state in ("standing", "refused"):
            return
    raise AssertionError(f"still {p.out.state}: {p.out.reason}")


def rough(amplitude=0.04):
    """Return ground of random heights between nodes 8 cm apart, flat about the start."""
    rng = np.random.default_rng(5)
    z = np.kron(rng.uniform(0.0, amplitude, (25, 25)), np.ones((16, 16))).astype(np.float32)
    x = -0.7 + 0.005 * np.arange(z.shape[1])
    z[:, x < 0.35] = 0.0
    return HeightMap(z=z, cell=0.005, origin=(-0.7, -1.0))


@pytest.mark.parametrize(
    ("command", "ground"),
    [
        (MotionCommand("walk", distance=0.4), None),
        (MotionCommand("walk", distance=-0.3), None),
        (MotionCommand("turn", angle=0.8), None),
        (MotionCommand("walk", distance=0.4), rough()),
    ],
    ids=["forward", "backward", "turn", "rough"],
)
def test_the_centre_of_mass_stays_over_the_standing_feet(command, ground):
    least, most = np.inf, 0
    for p in crawled(command, heights=ground):
        least, most = min(least, margin(p)), max(most, np.count_nonzero(~p.out.stance))
        assert p.out.unreachable == 0
    assert most == 1
    assert least > 0.5 * PARAMS.lean_margin_m


def test_the_trunk_rests_while_a_foot_is_in_the_air():
    places = [(p.out.stance.copy(), p.walker.state.body.copy()) for p in crawled(MotionCommand("walk", distance=0.3))]
    moved = 0.0
    for (before, a), (after, b) in itertools.pairwise(places):
        if before.all() and after.all():
            moved += np.hypot(*(b - a)[:2])
        elif not before.all() and not after.all():
            assert np.array_equal(a, b)
    assert moved > 0.3


def test_a_foot_has_given_its_load_to_the_others_when_it_lifts():
    lifted = []
    before, share, command = np.ones(4, dtype=bool), np.ones(4), None
    for p in crawled(MotionCommand("walk", distance=0.3)):
        if before.all() and not p.out.stance.all():
            swinging = ~p.out.stance
            jump = np.abs(p.out.command - command)[[list(leg.joints) for leg in LUPO.legs]]
            lifted.append((share[swinging].max(), share[~swinging].min(), jump[~swinging].max()))
        before, share, command = p.out.stance.copy(), p.walker.state.support.copy(), p.out.command.copy()
    given, carried, jumps = np.array(lifted).T
    assert len(lifted) > 8
    assert given.max() < 0.01
    assert carried.min() == 1.0
    assert jumps.max() < 1e-3  # rad, of the legs that stand


def test_a_foot_keeps_half_of_its_load_until_the_others_can_carry_it():
    """Of four feet the one across loses as much as the one that gives: both would hang before the trunk is there."""
    least = []
    for p in crawled(MotionCommand("walk", distance=0.3)):
        plan, support = p.walker.state.plan, p.walker.state.support
        if p.out.state == "walking" and plan is not None and p.out.stance.all() and support[plan.swing].min() < 0.5:
            least.append(margin(p, ~plan.swing))
    assert len(least) > 50
    assert min(least) > 0.5 * PARAMS.lean_margin_m


def test_no_foot_lifts_while_another_bears_nothing():
    p, dent = begun(MotionCommand("walk", distance=0.3), LUPO), 0.015
    while not (p.walker.state.steps >= 2 and p.out.stance.all()):
        p.step()
    lifting = int(np.flatnonzero(p.walker.state.plan.swing)[0])
    sunk = (lifting + 1) % 4
    before, gap, ticks = p.walker.state.feet[sunk, 2], dent, 0
    while p.out.stance.all():
        p.step()
        gap = p.walker.state.feet[sunk, 2] - before + dent
        p.contacts[sunk] = gap <= 0.001
        ticks += 1
        assert ticks < 200
    assert gap <= 0.002
    assert ticks > 100 * dent / (2.0 * PARAMS.touch_speed)


def test_a_step_is_not_over_while_a_foot_that_stood_bears_nothing():
    """A foot that slips off an edge while another swings finds ground before the trunk leans again."""
    p, dent = begun(MotionCommand("walk", distance=0.3), LUPO), 0.015
    while not (p.walker.state.steps >= 2 and not p.out.stance.all()):
        p.step()
    s, ticks = p.walker.state, 0
    lost, steps = (int(np.flatnonzero(~p.out.stance)[0]) + 1) % 4, p.walker.state.steps
    before = gap = float(s.feet[lost, 2])
    place, leans = p.walker._place(), [float(np.hypot(*s.lean))]
    while s.steps == steps:
        leans.append(float(np.hypot(*s.lean)))
        assert (p.walker._place().x, p.walker._place().y) == pytest.approx((place.x, place.y), abs=1e-9)
        p.contacts[lost] = (gap := s.feet[lost, 2] - before + dent) <= 0.001
        p.step()
        ticks += 1
        assert ticks < 400
    assert gap <= 0.002
    assert leans[0] - leans[-1] > 0.5 * PARAMS.trunk_speed * dent / PARAMS.touch_speed  # back, to be carried meanwhile


def test_the_trunk_accelerates_within_its_limit():
    ticks = [(p.out.state, p.walker.state.body[:2].copy()) for p in crawled(MotionCommand("walk", distance=0.3))]
    bodies = np.array([body for state, body in ticks if state == "walking"])
    fastest = np.hypot(*np.diff(bodies, n=2, axis=0).T).max() / 0.01**2
    assert 0.8 * PARAMS.lean_acceleration < fastest < 1.2 * PARAMS.lean_acceleration


def test_a_foot_comes_down_gently_while_three_carry():
    """At 1 m/s a foot that met the ground 8 mm early pushed with more than the weight and threw a robot over."""
    heights = np.array([p.walker.state.feet[:, 2].copy() for p in crawled(MotionCommand("walk", distance=0.3))])
    assert -np.diff(heights, axis=0).min() / 0.01 < 0.6  # m/s


@pytest.mark.parametrize("velocity", [0.02, 0.04, -0.03])
def test_keeps_the_commanded_velocity(velocity):
    p = begun(MotionCommand("walk", velocity=velocity), LUPO)
    p.run(10.0)
    begin = p.walker._place().x
    p.run(40.0)
    assert (p.walker._place().x - begin) / 40.0 == pytest.approx(velocity, rel=0.1)


def test_refuses_a_velocity_that_no_crawl_reaches():
    p = plant(LUPO)
    p.run(1.0)
    reply = p.walker.command(MotionCommand("walk", velocity=0.2))
    assert (reply.accepted, reply.code, reply.field) == (False, "too_fast", "velocity")
    assert p.walker.command(MotionCommand("walk", distance=1.0, gait="tripod")).code == "unknown_gait"


def test_stop_in_the_middle_of_a_swing_closes_and_stands_upright():
    p = begun(MotionCommand("walk", velocity=0.04), LUPO)
    while p.step().stance.all() or p.tick < 1000:
        pass
    where = p.walker._place().x
    assert p.walker.command(MotionCommand("stop")).accepted
    p.until("standing", limit=30.0)
    s = p.walker.state
    assert abs(s.body[0] - where) < 0.1
    assert np.hypot(*s.lean) < 1e-3
    feet = s.footholds[:, :2] - s.body[:2]
    assert np.hypot(*(feet - p.walker.frame.neutral).T).max() < PARAMS.close_tolerance_m + 1e-3


def test_shifts_the_trunk_over_its_feet_and_walks_on_from_there():
    p = plant(LUPO)
    p.run(1.0)
    assert p.walker.command(MotionCommand("stand", shift=(0.03, -0.02))).accepted
    p.run(3.0)
    assert p.walker.state.body[:2] == pytest.approx([0.03, -0.02], abs=1e-3)
    assert p.walker.state.lean == pytest.approx([0.03, -0.02], abs=1e-3)
    p.obey(MotionCommand("walk", distance=0.2))
    assert p.walker.state.body[:2] == pytest.approx([0.2, 0.0], abs=0.006)


def test_a_standing_foot_that_hangs_goes_down_before_the_trunk_shifts():
    p, dent = plant(LUPO), 0.008
    p.run(1.0)
    before = p.walker.state.feet[2, 2]
    body = p.walker.state.body[:2].copy()
    assert p.walker.command(MotionCommand("stand", shift=(0.03, -0.02))).accepted
    for tick in range(300):
        gap = p.walker.state.feet[2, 2] - before + dent
        p.contacts[2] = gap <= 0.001
        p.step()
        if gap > 0.001 and tick > 10:
            assert p.walker.state.body[:2] == pytest.approx(body, abs=3e-3)
    assert gap + 0.002 >= 0.0
    assert gap <= 0.001
    assert p.walker.state.body[:2] == pytest.approx([0.03, -0.02], abs=1e-3)


def shifted(hanging, slope=0.0, again=()):
    """Shift the trunk of a robot whose feet stand on a slope (rad), some without a contact; return plant and depths."""
    p = plant(LUPO)
    p.run(1.0)
    s = p.walker.state
    s.footholds[:, 2] += np.tan(slope) * s.footholds[:, 0]
    s.feet = s.footholds.copy()
    touch = np.ones(4, dtype=bool)
    for tick in range(700):
        p.contacts = touch.copy()
        p.step()
        if tick == 100:
            before = s.feet[:, 2].copy()
            touch[list(hanging)] = False
        if tick == 101 or tick in again:
            assert p.walker.command(MotionCommand("stand", shift=(0.03, -0.02))).accepted
    return p, before - s.feet[:, 2]


@pytest.mark.parametrize("hanging", [(0, 1, 2, 3), (0, 1, 2), (0, 3)], ids=["four", "three", "two"])
def test_no_foot_looks_for_ground_while_fewer_than_three_touch(hanging):
    p, depth = shifted(hanging)
    assert np.abs(depth).max() < 1e-9
    assert p.walker.state.goal is None
    assert p.walker.state.body[:2] == pytest.approx([0.03, -0.02], abs=1e-3)
    assert p.out.reason == "no ground found under " + ", ".join(LUPO.leg_names[leg] for leg in hanging)


@pytest.mark.parametrize("slope", [0.0, np.radians(12.0), -np.radians(12.0)], ids=["flat", "up", "down"])
@pytest.mark.parametrize("leg", range(4))
def test_a_hanging_foot_looks_for_ground_to_the_same_depth_on_a_slope(leg, slope):
    p, depth = shifted((leg,), slope)
    assert depth[leg] == pytest.approx(PARAMS.search_m, abs=1e-6)
    assert np.delete(depth, leg) == pytest.approx(np.zeros(3), abs=1e-9)
    assert p.walker.state.goal is None
    assert p.out.reason == f"no ground found under {LUPO.leg_names[leg]}"


def test_more_commands_let_a_hanging_foot_go_no_deeper():
    _, depth = shifted((2,), again=(150, 350, 500))
    assert depth[2] == pytest.approx(PARAMS.search_m, abs=1e-6)


def test_a_step_that_stability_refuses_is_not_taken():
    p = plant(LUPO, check=lambda step: StanceVerdict(False, -0.01, "infeasible"))
    p.run(1.0)
    assert p.walker.command(MotionCommand("walk", distance=0.3)).accepted
    outs = p.until("refused", limit=20.0)
    assert all(out.stance.all() for out in outs)
    assert "not be stable" in outs[-1].reason
    assert p.walker.state.stage is Stage.STAND


def test_another_leg_steps_first_where_the_three_others_do_not_carry():
    asked = []

    def check(step):
        asked.append(step.legs)
        return StanceVerdict(len(set(asked)) > 1, 0.03 if len(set(asked)) > 1 else -0.01, "ok")

    p = plant(LUPO, check=check)
    p.run(1.0)
    assert p.walker.command(MotionCommand("walk", distance=0.3)).accepted
    outs = p.until("standing", limit=60.0)
    first = next(out.stance for out in outs if not out.stance.all())
    refused = set(LUPO.leg_names) - set(asked[0])
    assert {name for name, stands in zip(LUPO.leg_names, first, strict=True) if not stands} != refused
    assert p.walker.state.body[0] == pytest.approx(0.3, abs=0.01)


def test_the_check_is_that_of_the_trunk_over_three_feet():
    asked = []

    def check(step):
        asked.append(step)
        return StanceVerdict(True, 0.03)

    p = plant(LUPO, check=check)
    p.run(1.0)
    p.walker.command(MotionCommand("walk", distance=0.1))
    p.until("walking")
    p.run(1.0)
    step, plan = asked[0], p.walker.state.plan
    assert step.movement == (0.0, 0.0, 0.0)
    assert step.legs == ("lf", "rf", "rh")
    assert step.base_position[:2] == pytest.approx([plan.end.x, plan.end.y])


def swayed(stiffness, settle_s=4.0, params=PARAMS, delay=2):
    """Rolls, rad, of a standing trunk on soft legs that a load tips for 0.8 s, by an oracle of one joint.

    `stiffness`: of the legs against roll, over m g h: below 1 the trunk falls. The estimate is `delay` ticks old.
    """
    g_over_h, roll, speed, rolls = 9.81 / 0.3, 0.0, 0.0, [(0.0, 0.0)] * (delay + 1)
    p = plant(LUPO, params=params)
    p.run(1.0)
    for tick in range(round(100 * settle_s)):
        level, load = p.walker.state.level[0], 0.01 if tick < 80 else 0.0
        for _ in range(10):
            pull = g_over_h * (stiffness * (level - roll) + roll + load)
            speed += 0.001 * (pull - 0.02 * stiffness * g_over_h * speed)
            roll += 0.001 * speed
        rolls.append((roll, speed))
        p.tilt[0], p.turn[0] = rolls[-1 - delay]
        p.step()
    return np.array(rolls)[:, 0]


@pytest.mark.parametrize(("stiffness", "share"), [(1.2, 0.1), (1.5, 0.1), (2.0, 0.3), (3.0, 0.8), (8.0, 0.8)])
def test_a_trunk_on_soft_legs_tips_less_far(stiffness, share):
    slow = np.abs(swayed(stiffness, params=WalkerParams.for_robot(LUPO, brace_gain=0.0)))
    braced = np.abs(swayed(stiffness))
    assert braced.max() < share * slow.max()
    if stiffness >= 2.0:
        assert braced[-100:].max() < 0.6 * braced.max()  # it comes to rest


@pytest.mark.parametrize(
    ("field", "value"), [("brace_gain", -0.1), ("brace_gain", 1e9), ("brace_lead_s", -0.01), ("brace_lead_s", 0.1)]
)
def test_a_brace_that_makes_robots_fall_is_refused(field, value):
    with pytest.raises(RobotError, match=rf"gait\.{field}: got {value}; .* should be (less|greater) than or equal to"):
        WalkerParams.for_robot(LUPO, **{field: value})


def test_a_gap_in_the_estimate_moves_no_foot():
    p = plant(LUPO)
    p.run(1.0)
    p.estimate_age = 1.0
    p.run(0.5)
    p.tilt[:], p.estimate_age, before = 0.05, 0.0, p.walker.state.level.copy()
    p.step()
    assert p.walker.state.level == pytest.approx(before, abs=0.05 * PARAMS.stand_level_gain + 1e-9)


def test_a_swinging_foot_keeps_its_height_when_the_trunk_tips():
    def swing(tip):
        p = begun(MotionCommand("walk", distance=0.3), LUPO)
        while p.step().stance.all():
            pass
        s, heights = p.walker.state, []
        leg, began = int(np.flatnonzero(~p.out.stance)[0]), None
        while not p.out.stance[leg]:
            unplanned = p.tilt - s.level
            began = unplanned if began is None else began
            rot = rotations.matrix_from_rpy(*(unplanned - began), 0.0)
            heights.append((s.body + rot @ (s.feet[leg] - s.body))[2])
            p.tilt += tip
            p.step()
        return np.array(heights)

    level, tipped = swing(np.zeros(2)), swing(np.radians([0.05, -0.03]))
    shared = min(len(level), len(tipped)) - 1
    assert shared > 30
    assert np.abs(tipped[5:shared] - level[5:shared]).max() < 0.003
