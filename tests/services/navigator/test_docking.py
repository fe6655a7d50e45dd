"""Docking on a marker in the whole service: by what the robot sees of it, surely within tolerances or not at all."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from surefoot.errors import Refusal
from surefoot.schemas.hw import LandmarkDetections, Sighting
from surefoot.schemas.navigation import DockRequest, GoalResult, PauseGoalRequest, ResumeGoalRequest
from surefoot.services.navigator.marker import Dock, MarkerSight, landmark_in
from tests.services.navigator.journeys import Journey, ready
from tests.services.refusals import refused

MARKER = (1.5, 0.2)
ABOUT = (1.56, 0.14)
"""Where the request puts the marker, m: beside it, so that only its sight leads to it."""


def with_marker(journey: Journey, place: tuple[float, float] = MARKER) -> Journey:
    """The journey with a marker on the floor, which the camera sees with its noise."""
    plain = journey.frame

    def frame() -> LandmarkDetections:
        w, rng = journey.walker, journey.rng
        r, a = math.hypot(place[0] - w.x, place[1] - w.y), math.atan2(place[1] - w.y, place[0] - w.x) - w.yaw
        a = math.remainder(a, math.tau)
        noise = rng.standard_normal(2)
        seen = 0.35 < r < 1.18 and abs(a) < 0.4 and w.state == "standing"
        goal = Sighting(range=r * (1.0 + 0.03 * float(noise[0])), bearing=a + 0.026 * float(noise[1])) if seen else None
        return plain().model_copy(update={"goal": goal})

    journey.frame = frame  # type: ignore[method-assign]
    return journey


def dock(journey: Journey, **request: Any) -> None:
    given: dict[str, Any] = {"position": None if "landmark" in request else ABOUT} | request
    assert journey.service.requests.dock(DockRequest(**given)).accepted


def ended(journey: Journey) -> GoalResult:
    result = journey.until_ended().results[-1]
    assert journey.walker.state == "standing"
    return result


def beside(journey: Journey, place: tuple[float, float] = MARKER) -> tuple[float, float]:
    """Distance of the marker from 0.5 m ahead of the robot, m, and its bearing, rad."""
    w = journey.walker
    dx, dy, c, s = place[0] - w.x, place[1] - w.y, math.cos(w.yaw), math.sin(w.yaw)
    forward, left = c * dx + s * dy, c * dy - s * dx
    return math.hypot(forward - 0.5, left), math.atan2(left, forward)


@pytest.mark.parametrize("yaw", [None, 0.0, 0.35])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_marker_lies_where_it_is_wanted_at_a_success(yaw: float | None, seed: int) -> None:
    journey = with_marker(ready(seed=seed))
    dock(journey, yaw=yaw)
    result = ended(journey)
    assert (result.state, result.error_code) == ("succeeded", ""), result.reason
    distance, bearing = beside(journey)
    assert distance <= 0.03
    assert abs(bearing) <= math.radians(3.0)
    assert yaw is None or abs(journey.walker.yaw - yaw) <= math.radians(3.0)
    assert result.progress is not None
    assert result.progress.marker == pytest.approx((0.5, 0.0), abs=0.03)
    assert result.progress.approaches >= 1


def test_a_landmark_of_the_map_is_a_marker_as_well(journey: Journey) -> None:
    row = int(np.argmin(np.hypot(*(journey.places - MARKER).T)))
    dock(journey, landmark=row, yaw=0.0)
    result = ended(journey)
    assert result.state == "succeeded", result.reason
    place = tuple(journey.places[row].tolist())
    assert beside(journey, place)[0] <= 0.03


@pytest.mark.parametrize("seed", range(4))
def test_a_robot_that_slips_docks_surely_or_ends_unsure(seed: int) -> None:
    journey = with_marker(ready(seed=seed))
    walker, move, rng = journey.walker, journey.walker.tick, np.random.default_rng(seed)

    def slip() -> None:
        before = walker.x, walker.y, walker.yaw
        move()
        way = math.hypot(walker.x - before[0], walker.y - before[1])
        walker.x += 0.1 * way * float(rng.standard_normal())
        walker.y += 1.5 * way * float(rng.standard_normal())
        walker.yaw += 0.5 * abs(walker.yaw - before[2]) * float(rng.standard_normal())

    walker.tick = slip  # type: ignore[method-assign]
    dock(journey, yaw=0.2)
    result = ended(journey)
    assert result.error_code in ("", "arrived_unsure"), result.reason
    assert result.state != "succeeded" or beside(journey)[0] <= 0.03


def test_a_marker_that_is_not_there_ends_unsure(journey: Journey) -> None:
    dock(journey)
    result = ended(journey)
    assert (result.state, result.error_code) == ("failed", "arrived_unsure")
    assert "not seen" in result.reason
    assert result.number_of_recoveries >= 2


def test_a_robot_that_takes_no_small_steps_ends_unsure_after_its_approaches() -> None:
    journey = with_marker(ready(set=("conduct.dock_moves=3",)))
    walker, move = journey.walker, journey.walker.tick

    def coarse() -> None:
        before = walker.x, walker.y
        move()
        if walker.state == "walking" and journey.pilot.goal and journey.pilot.goal.dock.begun:  # type: ignore[union-attr]
            walker.x, walker.y = before

    walker.tick = coarse  # type: ignore[method-assign]
    dock(journey)
    result = ended(journey)
    assert (result.state, result.error_code) == ("failed", "arrived_unsure")
    assert "after 3 approaches" in result.reason


def test_no_walk_ahead_before_an_obstacle(journey: Journey) -> None:
    with_marker(journey)
    dock(journey)
    while not (journey.pilot.goal and journey.pilot.goal.dock and journey.pilot.goal.dock.begun):
        journey.step()
    x, y = journey.walker.x, journey.walker.y
    journey.distance = 0.28
    assert ended(journey).error_code == "arrived_unsure"
    assert math.hypot(journey.walker.x - x, journey.walker.y - y) < 0.01


def test_a_pause_and_a_killed_navigator_leave_the_docking_as_it_was(tmp_path: Path) -> None:
    memory = str(tmp_path / "navigator.json")
    first = with_marker(ready(memory=memory))
    dock(first, yaw=0.1)
    while not (first.pilot.goal and first.pilot.goal.dock and first.pilot.goal.dock.moves):
        first.step()
    first.service.requests.pause_goal(PauseGoalRequest())
    first.step(102 - first.tick % 100)
    second = with_marker(first.restarted(first.tick, memory=memory))
    second.step(500)
    assert second.pilot.goal is not None
    assert second.pilot.goal.dock == first.pilot.goal.dock
    assert second.service.requests.resume_goal(ResumeGoalRequest()).accepted
    assert ended(second).state == "succeeded"
    assert beside(second)[0] <= 0.03


@pytest.mark.parametrize(
    ("request_", "code", "field"),
    [
        ({}, "invalid", "position"),
        ({"landmark": 320}, "invalid", "landmark"),
        ({"position": MARKER, "offset": (0.2, 0.0)}, "invalid", "offset"),
        ({"position": MARKER, "offset": (0.5, 0.5)}, "invalid", "offset"),
        ({"position": (50.0, 0.0)}, "outside", "position"),
    ],
    ids=["no position", "landmark", "near", "aside", "outside"],
)
def test_a_marker_that_cannot_be_docked_on_is_refused(
    journey: Journey, request_: dict[str, Any], code: str, field: str
) -> None:
    with refused(Refusal, code, field):
        journey.service.requests.dock(DockRequest(**request_))


def test_a_robot_that_uses_no_landmarks_docks_on_none() -> None:
    with refused(Refusal, "unsupported"):
        ready(use_landmarks=False).service.requests.dock(DockRequest(position=MARKER))


def test_of_two_landmarks_that_look_alike_side_by_side_none_is_the_marker(journey: Journey) -> None:
    journey.step(1)
    tracker = journey.service.localiser.tracker
    frame = journey.frame()
    while not frame.landmarks:
        frame = journey.frame()
    mark = frame.landmarks[0]
    looks = np.linalg.norm(journey.looks - np.array(mark.descriptor), axis=1)
    row = int(np.argmin(looks))
    assert landmark_in(frame, row, tracker) == mark
    twin = mark.model_copy(update={"bearing": mark.bearing + 0.1})
    assert landmark_in(frame.model_copy(update={"landmarks": (*frame.landmarks, twin)}), row, tracker) is None
    far = mark.model_copy(update={"range": mark.range + 1.0})
    assert landmark_in(frame.model_copy(update={"landmarks": (far,)}), row, tracker) is None


def test_more_sightings_measure_a_marker_better_but_never_beyond_the_tilt() -> None:
    journey = Journey()
    tracker, rng = journey.service.localiser.tracker, np.random.default_rng(3)
    errors, stated = [], []
    for _ in range(60):
        sight, alone = MarkerSight(), None
        for k in range(25):
            seen = Sighting(range=0.5 * (1 + 0.03 * rng.standard_normal()), bearing=0.026 * rng.standard_normal())
            sight.take(LandmarkDetections(landmarks=(), goal=seen), Dock(MARKER, (0.5, 0.0)), tracker)
            if k == 0:
                alone = sight.measured(tracker.standing, tracker.shared)
        found = sight.measured(tracker.standing, tracker.shared)
        assert found is not None
        assert alone is not None
        assert found.sd < 0.6 * alone.sd
        errors.append((found.forward - 0.5, found.left))
        stated.append(found.sd)
    h, tilt = tracker.shared.height, tracker.shared.tilt
    assert min(stated) >= tilt * (h * h + 0.25) / h * 0.9
    assert float(np.std(errors)) < float(np.mean(stated))
    assert float(np.std(errors)) > 0.3 * float(np.mean(stated))
