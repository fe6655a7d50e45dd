"""Every gait keeps the robot on at least three feet and lets each leg swing once a cycle."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.robot import kinematics
from surefoot.robot.reader import load_robot
from surefoot.services.walker.legged.patterns import HEXAPOD_GAITS, TRIPOD, gaits_of
from surefoot.services.walker.legged.standins import hull_margin

ROBOT = load_robot("ragno")
LUPO = load_robot("lupo")


@pytest.mark.parametrize("gait", HEXAPOD_GAITS.values(), ids=lambda gait: gait.name)
def test_each_leg_swings_once_and_the_others_hold_the_weight(gait):
    assert sorted(leg for group in gait.groups for leg in group) == list(range(6))
    feet = kinematics.foot_positions(ROBOT.model, ROBOT.neutral)
    com = kinematics.com(ROBOT.model, ROBOT.neutral)
    for group in gait.groups:
        standing = [leg for leg in range(6) if leg not in group]
        assert len(standing) >= 3
        assert hull_margin(feet[standing, :2], com[:2]) > 0.03


def test_tripods_alternate():
    assert [set(group) for group in TRIPOD.groups] == [{0, 2, 4}, {1, 3, 5}]
    assert ROBOT.leg_names == ("lf", "lm", "lh", "rf", "rm", "rh")


@pytest.mark.parametrize("order", ["lf lh rf rh", "rh rf lh lf", "lf rf lh rh"])
def test_a_crawl_goes_forward_on_each_side_whatever_the_order_of_the_legs(order):
    legs = {leg.name: leg for leg in LUPO.legs}
    names = order.split()
    (crawl,) = gaits_of(replace(LUPO, legs=tuple(legs[name] for name in names))).values()
    assert crawl.leans
    assert [names[leg] for (leg,) in crawl.groups] == ["lh", "lf", "rh", "rf"]


@pytest.mark.parametrize(
    "gait", [*HEXAPOD_GAITS.values(), *gaits_of(load_robot("lupo")).values()], ids=lambda g: g.name
)
def test_stance_is_centred_on_neutral(gait):
    """The foot lands `lead` steps ahead and lifts as far behind, whatever the number of groups."""
    step = 0.01
    landing = gait.lead * step
    lift = landing - (gait.steps_per_cycle - 1) * step
    assert landing == pytest.approx(-lift)


def test_hull_margin_is_a_signed_distance():
    square = np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]])
    assert hull_margin(square, np.array([0.5, 0.4])) == pytest.approx(0.4)
    assert hull_margin(square, np.array([1.2, 0.5])) == pytest.approx(-0.2)
