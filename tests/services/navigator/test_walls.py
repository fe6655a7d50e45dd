"""Walls and people that the map does not know: seen by the ranger, gone around, waited for, or reported."""

import math
from typing import Any

import numpy as np
import pytest

from surefoot.errors import Refusal
from surefoot.schemas.hw import Range
from surefoot.services.navigator.config import NavigatorConfig
from surefoot.services.navigator.goals import PATIENCE, NavigationGoal
from surefoot.services.navigator.maps import Maps
from surefoot.services.navigator.pilot import Pilot
from surefoot.services.navigator.planning.grid import OCCUPIED, FloorGrid
from surefoot.services.navigator.planning.seen import SeenObstacles, expected_echo
from surefoot.services.navigator.ranging import take_range
from tests.services.navigator.journeys import Journey, ready

HALF, LONGEST, SHORTEST = 0.5, 2.55, 0.25
Box = tuple[float, float, float, float]


class Walled(Journey):
    """A journey with boxes (x0, y0, x1, y1) in m that stand on the floor and are in no map."""

    def __init__(self, *boxes: Box, **config: Any) -> None:
        super().__init__(**config)
        self.boxes = list(boxes)

    def step(self, ticks: int = 1) -> None:
        """Let ticks pass, with the echo of each."""
        for _ in range(ticks):
            if self.tick % 10 == 0:
                self.distance = self.echo()
            super().step()

    def echo(self) -> float | None:
        """Distance of the nearest wall or box in the cone, m."""
        w, reach = self.walker, np.arange(0.01, LONGEST, 0.01)
        angles = w.yaw + np.linspace(-HALF, HALF, 13)
        x = w.x + 0.05 * math.cos(w.yaw) + np.outer(np.cos(angles), reach)
        y = w.y + 0.05 * math.sin(w.yaw) + np.outer(np.sin(angles), reach)
        hit = (x < -0.9) | (x > 3.1) | (y < -0.975) | (y > 1.025)
        hit |= (x > 1.9) & (x < 2.2) & (y > 0.425) & (y < 0.675)  # the pillar of the map
        for x0, y0, x1, y1 in self.boxes:
            hit |= (x > x0) & (x < x1) & (y > y0) & (y < y1)
        first = np.where(hit.any(axis=1), reach[hit.argmax(axis=1)], np.inf).min()
        return None if math.isinf(first) else max(SHORTEST, float(first))

    def touched(self) -> bool:
        """Return whether the walker stands in a box."""
        w = self.walker
        return any(x0 < w.x < x1 and y0 < w.y < y1 for x0, y0, x1, y1 in self.boxes)

    def walk(self, most: int = 12_000) -> Any:
        """Walk until the goal has ended, touching nothing; return the feedback."""
        for _ in range(most):
            self.step()
            assert not self.touched()
            if not self.pilot.under_way and self.pilot.state != "idle":
                break
        self.step(10)
        return self.feedback()


def walled(*boxes: Box, **config: Any) -> Walled:
    """A journey that has begun."""
    journey = Walled(*boxes, **config)
    journey.step(20)
    return journey


@pytest.mark.parametrize("policy", ["steer", "planner", "hand"])
def test_a_wall_that_the_map_does_not_know_is_gone_around(policy: str) -> None:
    journey = walled((1.4, -0.2, 1.5, 1.1), policy=policy)  # half of the corridor
    journey.goto(2.4, 0.0)
    end = journey.walk()
    assert (end.state, end.error_code) == ("succeeded", "")
    assert 1 <= end.recoveries["replan"] <= 8
    assert journey.missed(2.4, 0.0) < 0.2


def test_a_door_that_is_shut_ends_the_goal_as_blocked_and_not_in_endless_turning() -> None:
    journey = walled((1.0, -1.1, 1.1, 1.1))
    journey.goto(1.8, 0.0)
    end = journey.walk()
    assert (end.state, end.error_code) == ("failed", "blocked")
    assert journey.tick < 12_000
    assert journey.walker.state == "standing"


def test_a_shut_door_that_is_forgotten_again_and_again_ends_the_goal_as_well() -> None:
    journey = walled((1.0, -1.1, 1.1, 1.1), set=("conduct.remember=4", "conduct.replans=1000"))
    journey.goto(1.8, 0.0)
    end = journey.walk(40_000)
    assert (end.state, end.error_code) == ("failed", "blocked")
    assert end.recoveries["replan"] > 3
    assert journey.tick < 20_000
    assert "routes around" in end.error_msg or "close ahead" in end.error_msg


def test_somebody_who_stands_in_the_way_and_goes_is_waited_for() -> None:
    journey = walled((0.8, -1.1, 1.0, 1.1))
    journey.goto(1.8, 0.0)
    for _ in range(6000):
        journey.step()
        if journey.feedback().recoveries.get("wait"):
            break
    journey.step(300)
    journey.boxes.clear()
    end = journey.walk()
    assert end.state == "succeeded"
    assert end.recoveries["wait"] >= 1


def test_walls_of_the_map_are_no_obstacles_of_the_local_one() -> None:
    journey = walled()
    journey.goto(2.6, 0.75)
    end = journey.walk()
    assert end.state == "succeeded"
    assert "replan" not in end.recoveries
    assert "wait" not in end.recoveries


def grid(*cells: tuple[int, int]) -> FloorGrid:
    """3 x 3 m of 5 cm cells with some occupied."""
    values = np.zeros((60, 60), dtype=np.int8)
    for cell in cells:
        values[cell] = OCCUPIED
    return FloorGrid(values, 0.05)


def test_expected_echo_is_the_nearest_cell_of_the_cone() -> None:
    floor, rng = grid(*((r, 40) for r in range(60))), np.random.default_rng(3)
    for _ in range(50):
        at = (*rng.uniform(0.3, 1.8, 2).tolist(), rng.uniform(-math.pi, math.pi))
        rows, cols = np.nonzero(floor.cells)
        dx, dy = (cols + 0.5) * 0.05 - at[0], (rows + 0.5) * 0.05 - at[1]
        off = np.abs(np.angle(np.exp(1j * (np.arctan2(dy, dx) - at[2]))))
        inside = np.hypot(dx, dy)[(off <= 0.5) & (np.hypot(dx, dy) < 1.5)]
        wanted = min(inside, default=1.525) - 0.025
        assert expected_echo(floor, at, (0.5, 0.0), 1.5, 65) == pytest.approx(2 * (min(wanted, 1.5),), abs=0.03)


def test_expected_echo_holds_those_of_all_headings_that_may_be() -> None:
    floor, rng = grid(*((r, 40) for r in range(20, 60)), (10, 20)), np.random.default_rng(4)
    apart = 0
    for _ in range(50):
        x, y = rng.uniform(0.3, 1.8, 2).tolist()
        yaw = rng.uniform(-math.pi, math.pi)
        least, largest = expected_echo(floor, (x, y, yaw), (0.5, 0.2), 1.5, 65)
        exact = [expected_echo(floor, (x, y, yaw + off), (0.5, 0.0), 1.5, 65)[0] for off in np.linspace(-0.2, 0.2, 21)]
        assert least <= min(exact) + 1e-9
        assert max(exact) <= largest + 1e-9
        apart += largest > least
    assert 10 < apart < 50


def reading(distance: float | None, half: float) -> Range:
    return Range(
        stamp_ns=0, distance=distance, shortest=SHORTEST, longest=LONGEST, field_of_view=2.0 * half, bump=(False,) * 2
    )


def test_a_mark_fades_and_is_cleared_by_an_empty_cone() -> None:
    seen, at = SeenObstacles(grid(), 65, keep=10.0), (0.5, 1.5, 0.0)
    seen.take(reading(0.6, 0.3), at, (0.0, 0.0), 0.0)
    assert seen.marks
    assert not seen.free((0.5, 1.5), ((2.5, 1.5),), 0.12)
    assert seen.free((0.5, 1.5), ((0.5, 2.8),), 0.12)
    turned = (0.5, 1.5, math.pi)
    seen.take(reading(None, 0.3), turned, (0.0, 0.0), 9.0)
    assert seen.marks  # not looked at
    seen.take(reading(None, 0.3), turned, (0.0, 0.0), 11.0)
    assert not seen.marks
    seen.take(reading(0.6, 0.3), at, (0.0, 0.0), 12.0)
    seen.take(reading(None, 0.35), at, (0.0, 0.0), 12.1)
    assert not seen.marks


def test_an_echo_of_a_known_wall_marks_nothing_even_if_the_pose_is_unsure() -> None:
    seen = SeenObstacles(grid(*((r, 40) for r in range(60))), 65, keep=10.0)
    seen.take(reading(1.0, 0.3), (1.0, 1.5, 0.0), (0.02, 0.02), 0.0)
    seen.take(reading(0.8, 0.3), (1.0, 1.5, 0.0), (0.05, 0.02), 0.0)
    assert not seen.marks
    seen.take(reading(0.5, 0.3), (1.0, 1.5, 0.0), (0.05, 0.02), 0.0)
    assert seen.marks


def walls_ahead(journey: Journey, distance: float) -> None:
    """Let the journey's ranger show something that no map has, and a goal begin."""
    journey.distance = distance
    journey.step(10)
    journey.goto(1.2, 0.0)
    journey.step(400)


@pytest.mark.parametrize("sense", ["bumper", "ranger"])
def test_the_robot_steps_back_from_what_touches_it_or_comes_closer_than_it_walks_beside(sense: str) -> None:
    journey = ready()
    if sense == "bumper":
        journey.bump = True
    walls_ahead(journey, 0.3 if sense == "ranger" else LONGEST)
    assert -0.22 < journey.walker.x < -0.08
    assert journey.feedback().recoveries["step_back"] in (1, 2)
    journey.bump = False
    journey.distance = LONGEST
    assert journey.until_ended().state == "succeeded"


def test_the_robot_steps_back_from_no_wall_of_the_map_and_into_none() -> None:
    journey = ready()
    for x in (2.75, -0.7):  # the wall ahead, at 3.1 m, is in the map; that behind is nearer than a step and the radius
        put(journey, x)
        walls_ahead(journey, 0.3)
        assert "step_back" not in journey.feedback().recoveries
        assert journey.missed(x, 0.0) < 0.01


@pytest.mark.parametrize(
    ("echo", "y", "heading", "sd", "turns_only"),
    [
        (0.37, -0.6, -0.7, 0.01, False),  # that of the wall beside
        (0.29, -0.6, -0.7, 0.01, True),  # nearer than the wall
        (SHORTEST, -0.6, -0.7, 0.01, True),  # may be anything
        (0.37, -0.6, -0.7, 0.06, True),  # the wall may be elsewhere
        (0.28, -0.65, -math.pi / 2, 0.01, True),  # the wall ahead
    ],
)
def test_beside_a_wall_of_the_map_the_robot_walks_on(
    echo: float, y: float, heading: float, sd: float, turns_only: bool
) -> None:
    service = ready().service
    service.localiser.place((1.0, y, heading))
    service.localiser.tracker.cov[:3, :3] = np.diag([sd**2, sd**2, 1e-4])
    assert take_range(reading(echo, HALF), service.localiser, service.maps, 10.0) == (turns_only, False)


def test_a_gap_beside_a_corner_at_the_edge_of_the_cone_is_passed() -> None:
    journey = walled((0.55, -0.98, 0.93, -0.02), (2.08, -0.97, 2.23, -0.18), seed=9, policy="planner")
    journey.goto(2.6, 0.0)  # the second wall leaves 0.6 m beside the pillar, and 0.35 m are left behind that
    end = journey.walk()
    assert (end.state, end.error_code) == ("succeeded", "")
    assert journey.missed(2.6, 0.0) < 0.2


def test_an_arc_is_unsure_until_readings_leave_one_place_for_its_object() -> None:
    rng = np.random.default_rng(5)
    for _ in range(20):
        seen, away = SeenObstacles(grid(), 65, keep=100.0), rng.uniform(0.55, 0.7)
        angle = float(rng.choice((-1.0, 1.0)) * rng.uniform(0.12, 0.25))
        thing = (0.5 + away * math.cos(angle), 1.5 + away * math.sin(angle))
        side = math.copysign(0.45, angle)
        for k, heading in enumerate(np.linspace(0.0, angle + side, 15).tolist()):  # it stays in the cone
            seen.take(reading(away, HALF), (0.5, 1.5, heading), (0.0, 0.0), 0.1 * k)
            assert seen.sure <= seen.marks.keys()
            if k == 0:
                assert len(seen.marks) > 7
                assert not seen.sure
                assert seen.free((0.5, 1.5), (thing,), 0.12, sure=True)
        assert 0 < len(seen.sure) < len(seen.marks)
        assert min(math.dist(grid().centre(*cell), thing) for cell in seen.sure) < 0.08
        assert not seen.free((0.5, 1.5), (thing,), 0.12, sure=True)


def test_what_other_readings_showed_free_is_not_marked_unless_nothing_else_is_left() -> None:
    seen, at = SeenObstacles(grid(), 65, keep=100.0), (0.5, 1.5, 0.0)
    seen.take(reading(None, HALF), (0.5, 1.5, 0.4), (0.0, 0.0), 0.0)
    seen.take(reading(0.7, HALF), at, (0.0, 0.0), 0.1)
    assert seen.marks
    assert all(math.atan2(y - 1.5, x - 0.5) < -0.05 for x, y in map(grid().centre, *zip(*seen.marks, strict=True)))
    seen = SeenObstacles(grid(), 65, keep=100.0)
    seen.take(reading(None, HALF + 0.1), at, (0.0, 0.0), 0.0)
    seen.take(reading(0.7, HALF), at, (0.0, 0.0), 0.1)  # something has come
    assert any(grid().centre(*cell)[1] > 1.6 for cell in seen.marks)
    assert any(grid().centre(*cell)[1] < 1.4 for cell in seen.marks)


@pytest.mark.parametrize("cell", [0.03, 0.05])
def test_somebody_who_steps_before_a_standing_robot_is_marked_where_they_are_and_not_at_the_edge(cell: float) -> None:
    rng, side = np.random.default_rng(6), int(3.0 / cell)
    for _ in range(60):
        floor = FloorGrid(np.zeros((side, side), dtype=np.int8), cell)
        seen, away = SeenObstacles(floor, 65, keep=100.0), rng.uniform(0.5, 0.9)
        x, y, heading = rng.uniform((0.8, 1.2, -0.3), (1.2, 1.8, 0.3)).tolist()
        for k in range(30):  # it turns, then stands
            turned = max(0, 10 - k) * 0.023
            seen.take(reading(None, HALF), (x, y, heading + turned + rng.uniform(0.0, 0.005)), (0.0, 0.0), 0.1 * k)
        for k in range(5):
            seen.take(reading(away, HALF), (x, y, heading + rng.uniform(0.0, 0.005)), (0.0, 0.0), 3.0 + 0.1 * k)
        off = heading + rng.uniform(-0.2, 0.2)
        assert not seen.free((x, y), ((x + 1.5 * math.cos(off), y + 1.5 * math.sin(off)),), 0.12)
        assert not seen.sure


def put(journey: Journey, x: float) -> None:
    """Put the robot at (x, 0) m, facing along x, with a belief that is right."""
    journey.walker.x = x
    journey.step()
    journey.service.localiser.place((x, 0.0, 0.0))


def marked(*cells: tuple[int, int]) -> SeenObstacles:
    """Return a local map of 3 x 3 m with marked cells, seen at 0 s."""
    seen = SeenObstacles(grid(), 65, keep=100.0)
    seen.marks.update(dict.fromkeys(cells, 0.0))
    return seen


def test_a_robot_too_near_to_a_mark_may_leave_it_and_not_come_nearer() -> None:
    seen, here = marked((32, 10)), (0.525, 1.525)  # 0.1 m to the left of the robot
    assert not seen.free(here, ((0.525, 2.5),), 0.12)
    assert not seen.free(here, ((0.7, 2.5),), 0.12)
    assert seen.free(here, ((1.5, 1.5),), 0.12)
    assert seen.free(here, ((0.525, 0.5),), 0.12)


def doorway() -> tuple[Maps, tuple[float, float], tuple[float, float]]:
    """Return the maps of a wall with a door of 0.6 m, and a place on each side of it, x, y in m."""
    maps = Maps(NavigatorConfig(robot_radius=0.1))
    maps.grid = grid(*((row, 20) for row in range(60) if not 24 <= row < 36))
    return maps, (0.2, 1.5), (1.2, 1.5)


def look(maps: Maps, distance: float | None, x: float = 0.3) -> None:
    """Enter an echo at a distance, m, of a ranger at (x, 1.5) m before the door; None = it shows nothing."""
    maps.see(reading(distance, HALF), (x, 1.5, 0.0), (0.0, 0.0), 0.0)


def test_a_request_for_another_place_changes_nothing_of_the_route_that_is_walked() -> None:
    maps, here, there = doorway()
    around = maps.follow(here, (there,))
    look(maps, 0.6)  # something in the door
    assert maps._unsure  # pyright: ignore[reportPrivateUsage]
    assert not maps.free(here, around[0])
    with pytest.raises(Refusal):
        maps.follow(here, (there,))
    daring = maps.follow(here, (there,), bold=True)
    assert maps.free(here, daring[0])
    with pytest.raises(Refusal):
        maps.ways(here, (there,))
    assert maps.ways(here, ((0.3, 2.0),))
    assert maps.free(here, daring[0])


def test_a_refused_way_through_what_may_be_free_is_tried_again_and_one_that_was_found_is_not() -> None:
    maps, here, there = doorway()
    goal, pilot = NavigationGoal("there", (there,), "steer", 0.0, waited=PATIENCE), Pilot((), commands=False, ways=maps)
    assert not pilot.replan(goal, 0.0, here)  # the door is open
    assert not goal.dared
    look(maps, 0.38, x=0.6)  # surely something in the door
    assert pilot.replan(goal, 0.0, here)
    assert not goal.dared
    look(maps, None)
    look(maps, 0.6)  # something may be there
    assert not pilot.replan(goal, 0.0, here)
    assert goal.dared
    assert pilot.replan(goal, 0.0, here)
