"""The navigator in process on a floor with zones: it walks around keepout zones, and slowly where speed is limited."""

import math
from pathlib import Path
from typing import Any

import pytest

from surefoot.services.navigator.goals import GaitView
from surefoot.services.navigator.zoning import restrict
from tests.services.navigator.journeys import Journey, ready

PIT = "{name: pit, type: keepout, polygon: [[0.8, -0.3], [1.4, -0.3], [1.4, 0.3], [0.8, 0.3]]}"
HALF = "{name: ramp, type: speed_limit, speed_limit: 50, polygon: [[0.5, -1], [1.5, -1], [1.5, 1], [0.5, 1]]}"
METRES = HALF.replace("speed_limit: 50", "speed_limit: 0.02, percentage: false")


def file_of(folder: Path, *zones: str) -> str:
    path = folder / "zones.yaml"
    path.write_text("zones:\n" + "".join(f" - {zone}\n" for zone in zones), encoding="utf-8")
    return str(path)


def standing(x: float, **config: Any) -> Journey:
    """A journey that begins at x, m."""
    journey = Journey(start_x=x, **config)
    journey.walker.x = x
    journey.step(20)
    return journey


def from_pit(journey: Journey) -> float:
    """Distance of the walker from the pit, m; negative inside."""
    x, y = journey.walker.x, journey.walker.y
    right, up = max(0.8 - x, x - 1.4), max(-0.3 - y, y - 0.3)
    return math.hypot(max(right, 0.0), max(up, 0.0)) if max(right, up) > 0.0 else max(right, up)


def walked(journey: Journey, turning: float = 0.0, most: int = 15_000) -> float:
    """Walk until the goal has ended; return the least distance from the pit, m. `turning`: unwanted, rad per m."""
    least = from_pit(journey)
    for _ in range(most):
        x, y = journey.walker.x, journey.walker.y
        journey.step()
        journey.walker.yaw += turning * math.hypot(journey.walker.x - x, journey.walker.y - y)
        least = min(least, from_pit(journey))
        if journey.pilot.state not in ("navigating", "stopping", "idle"):
            break
    return least


@pytest.mark.parametrize(("seed", "turning"), [(0, 0.0), (1, 1.5), (2, -1.5), (3, 3.0)])
def test_the_closed_loop_stays_out_of_a_keepout_zone(tmp_path: Path, seed: int, turning: float) -> None:
    journey = ready(seed=seed, zones=file_of(tmp_path, PIT))
    journey.goto(2.5, 0.2)
    assert walked(journey, turning) > 0.08
    assert journey.pilot.state == "succeeded"
    assert journey.missed(2.5, 0.2) < 0.25


def test_a_robot_put_down_in_a_zone_leaves_it_and_goes_on(tmp_path: Path) -> None:
    journey = standing(1.0, zones=file_of(tmp_path, PIT))
    journey.goto(2.5, 0.0)
    left = False
    for _ in range(15_000):
        journey.step()
        left |= from_pit(journey) > 0.05
        assert not left or from_pit(journey) > 0.0
        if journey.pilot.state not in ("navigating", "stopping", "idle"):
            break
    assert journey.pilot.state == "succeeded"


def test_only_turns_are_allowed_where_a_walk_would_come_near_to_a_zone(tmp_path: Path) -> None:
    journey = standing(0.66, zones=file_of(tmp_path, PIT))
    journey.goto(1.1, 0.8)
    journey.step(5)
    service = journey.service
    for yaw, forbidden in ((0.0, True), (0.3, True), (1.6, False), (math.pi, False)):
        service.localiser.place((0.66, 0.0, yaw), None)
        assert restrict(journey.pilot, GaitView("standing"), service.localiser.tracker, service.maps) is forbidden
    assert not restrict(journey.pilot, GaitView("walking", ends_in=1.0), service.localiser.tracker, service.maps)


@pytest.mark.parametrize(("zone", "speed"), [(HALF, 0.5 * 0.1 / 1.8), (METRES, 0.02)])
def test_walks_are_slower_where_speed_is_limited(tmp_path: Path, zone: str, speed: float) -> None:
    journey, inside, outside = ready(zones=file_of(tmp_path, zone)), 0.0, 0.0
    journey.goto(2.3, 0.0)
    for _ in range(20_000):
        x, y = journey.walker.x, journey.walker.y
        journey.step()
        pace = math.hypot(journey.walker.x - x, journey.walker.y - y) / 0.01
        if 0.65 < x < 1.4:
            inside = max(inside, pace)
        elif x < 0.3 or x > 1.75:
            outside = max(outside, pace)
        if journey.pilot.state not in ("navigating", "stopping", "idle"):
            break
    assert journey.pilot.state == "succeeded"
    assert inside == pytest.approx(speed, rel=0.02)
    assert outside == pytest.approx(0.1 / 1.8, rel=0.02)


def test_a_repeated_order_is_not_slowed_twice(tmp_path: Path) -> None:
    """As when the walker started again: the pilot repeats what it has not taken up."""
    journey = standing(1.0, zones=file_of(tmp_path, HALF))
    journey.goto(2.3, 0.0)
    for _ in range(300):
        journey.step()
        order = journey.pilot.orders.order
        if order is not None and order.action == "walk":
            break
    orders = journey.pilot.orders
    assert orders.order is not None
    assert orders.order.velocity == pytest.approx(0.5 * 0.1 / 1.8)
    orders.give(orders.order, orders.given)
    assert orders.order.velocity == pytest.approx(0.5 * 0.1 / 1.8)
