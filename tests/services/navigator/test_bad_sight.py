"""Bad frames of a camera and echoes of a ranger: a typed refusal, never a crash or a confident wrong pose."""

import math

import numpy as np
import pytest
from pydantic import ValidationError

from surefoot.schemas.hw import Landmark, LandmarkDetections
from surefoot.schemas.navigation import MAX_WAYPOINTS, GotoRequest, SetPoseRequest, WaypointsRequest
from surefoot.schemas.terrain import LandmarkMap as LandmarkMapMessage
from surefoot.schemas.topics import TERRAIN_LANDMARKS
from surefoot.services.navigator.belief.lost import LostState
from surefoot.services.navigator.belief.matching import DetectionError
from surefoot.services.navigator.belief.strain import DISPLACED, STRAINED
from surefoot.services.navigator.goals import GaitView
from tests.services.navigator.journeys import Journey, ready
from tests.services.refusals import refused

S = 1_000_000_000  # ns


def error_of(journey: Journey) -> tuple[float, float]:
    """Distance of the believed from the true place, m, and that by its standard deviations."""
    belief, w = journey.belief(), journey.walker
    away = np.array([belief.pose[0] - w.x, belief.pose[1] - w.y])
    cov = np.array(belief.covariance).reshape(3, 3)[:2, :2]
    return float(np.hypot(*away)), math.sqrt(float(away @ np.linalg.solve(cov, away)))


@pytest.mark.parametrize("silent", [False, True])
def test_a_suspicion_ends_with_the_frames_of_the_camera(silent: bool) -> None:
    journey = ready()
    journey.service.localiser._suspect = -1.0  # every frame counts as one that may not fit
    journey.step(10)
    journey.seen = not silent
    journey.step(210)
    journey.goto(0.8, 0.2)
    journey.step(300)
    assert journey.feedback().recoveries == ({} if silent else {"suspect_look": 1})


def test_a_suspicion_outlives_a_lost_frame_of_a_slow_camera() -> None:
    journey, period = ready(), 1.7
    localiser, frame = journey.service.localiser, journey.frame()
    localiser._suspect, at = -1.0, localiser._seen_at
    for _ in range(2):
        at += period
        localiser.look(frame.model_copy(update={"stamp_ns": round(1e9 * at)}), GaitView("standing"), at)
    assert localiser.lost.suspected_until > at + 2.0 * period


@pytest.mark.parametrize(("code", "off"), [("late", -S // 2), ("future", 10**9 * S)])
def test_frames_that_are_not_of_now_are_refused_and_change_nothing(code: str, off: int) -> None:
    journey, dark = ready(), ready()
    plain, dark.seen = journey.frame, False
    journey.frame = lambda: plain().model_copy(update={"stamp_ns": plain().stamp_ns + off})  # type: ignore[method-assign]
    for each in (journey, dark):
        each.reach(0.5, 0.0)
    assert journey.belief().pose == dark.belief().pose
    assert journey.belief().covariance == dark.belief().covariance
    assert journey.service.localiser.refused[code] > 10
    assert sum("refused" in line for line in journey.stage.logged) == 1


def test_a_frame_that_comes_twice_counts_once(journey: Journey) -> None:
    localiser, frame = journey.service.localiser, journey.frame()
    before = localiser.tracker.frames
    localiser.look(frame, GaitView("standing"), 0.2)
    pose = localiser.tracker.pose
    with refused(DetectionError, "repeated", "stamp_ns"):
        localiser.look(frame, GaitView("standing"), 0.3)
    assert (localiser.tracker.frames, localiser.tracker.pose) == (before + 1, pose)


def test_one_frame_of_the_future_does_not_stop_the_clock_of_the_belief() -> None:
    journey = ready(control="odometry")
    plain = journey.frame
    journey.frame = lambda: plain().model_copy(update={"stamp_ns": 10**9 * S})  # type: ignore[method-assign]
    journey.step(10)
    journey.frame = plain  # type: ignore[method-assign]
    journey.seen = False
    journey.reach(0.5, 0.0)
    assert error_of(journey)[0] < 0.05


def test_frames_of_256_with_nonsense_and_range_zero_are_survived() -> None:
    """Now and then they hinder nothing; if there is nothing else, it is lost rather than wrong."""
    journey, rng = ready(), np.random.default_rng(3)
    plain = journey.frame

    def crowded() -> LandmarkDetections:
        frame = plain()
        false = tuple(
            Landmark(
                range=0.0 if i % 3 == 0 else float(rng.uniform(0.0, 5.0)),
                bearing=float(rng.uniform(-math.pi, math.pi)),
                descriptor=tuple(rng.standard_normal(8).tolist()),
            )
            for i in range(256 - len(frame.landmarks))
        )
        return frame.model_copy(update={"landmarks": frame.landmarks + false})

    journey.frame = lambda: crowded() if journey.tick % 300 == 0 else plain()  # type: ignore[method-assign]
    journey.goto(0.8, 0.2)
    journey.until_ended()
    assert (journey.feedback().state, journey.feedback().recoveries) == ("succeeded", {})
    journey.frame = crowded  # type: ignore[method-assign]
    lost = 0
    for _ in range(60):
        journey.step(10)
        lost += journey.belief().lost
        assert error_of(journey)[0] < 0.1
    assert lost > 30
    with pytest.raises(ValidationError):
        LandmarkDetections(landmarks=crowded().landmarks * 2)


def test_a_camera_that_is_gone_in_mid_walk_leaves_a_belief_that_grows(journey: Journey) -> None:
    journey.goto(1.2, 0.2)
    journey.step(400)
    before, journey.seen = journey.belief().entropy, False
    assert journey.until_ended().state == "succeeded"
    assert journey.belief().entropy > before
    assert error_of(journey)[1] < 3.0


def test_a_ranger_stuck_at_its_shortest_ends_the_goal_as_blocked() -> None:
    journey = ready(set=("conduct.wait=5.0",))
    journey.distance = 0.25
    journey.step(10)
    journey.goto(1.0, 0.0)
    end = journey.until_ended()
    assert (end.state, end.error_code) == ("failed", "blocked")
    assert end.recoveries["wait"] == 1
    assert (end.recoveries["step_back"], end.recoveries["stand"]) == (2, 1)
    assert journey.missed(0.0, 0.0) < 0.21


def test_a_goal_while_lost_begins_with_finding_the_pose(journey: Journey) -> None:
    w = journey.walker
    w.x, w.y, w.yaw = 1.0, -0.5, 0.5 * math.pi
    journey.odom = False  # it was lifted: no odometry shows it
    while not journey.service.localiser.lost.lost:
        journey.step()
        assert journey.tick < 320  # noticed within 3 s
    journey.odom = True
    journey.service.localiser._taken = (w.x, w.y, w.yaw)  # its own count goes on as if nothing had happened
    assert journey.service.localiser.tracker.pose[:2] == pytest.approx((0.0, 0.0), abs=0.1)  # not yet found
    assert journey.goto(1.0, 0.5).accepted
    journey.step(2)
    assert journey.pilot.orders.order is None  # no step before it knows where it is
    end = journey.until_ended()
    assert end.state == "succeeded"
    assert (end.recoveries["stand_and_look"], end.recoveries["relocalise"]) == (1, 1)
    assert math.hypot(w.x - 1.0, w.y - 0.5) < 0.2


@pytest.mark.parametrize(
    "change",
    [
        {"count": 0, "data": b""},
        {"data": b"\0" * 17},
        {"count": 4, "data": np.zeros((4, 10), dtype="<f4").tobytes()},
        {"count": 4, "data": np.full((4, 10), np.nan, dtype="<f4").tobytes()},
    ],
    ids=["empty", "cut off", "all in one point", "nan"],
)
def test_a_landmark_map_that_cannot_be_is_refused_and_the_goal_reached_by_odometry(
    journey: Journey, change: dict[str, object]
) -> None:
    good = journey.maps[TERRAIN_LANDMARKS.key]
    assert isinstance(good, LandmarkMapMessage)
    journey.maps[TERRAIN_LANDMARKS.key] = good.model_copy(update={**change, "version": 2})
    journey.reach(0.5, 0.0)
    assert sum("terrain/landmarks refused" in line for line in journey.stage.logged) == 1
    assert journey.service.localiser.tracker.world is None


def stretched(journey: Journey, by: float, version: int) -> None:
    """Publish the landmarks of the floor anew, `by` times as far along x."""
    rows = np.hstack((journey.places * (by, 1.0), journey.looks)).astype("<f4").tobytes()
    good = journey.maps[TERRAIN_LANDMARKS.key]
    journey.maps[TERRAIN_LANDMARKS.key] = good.model_copy(update={"data": rows, "version": version})


def test_a_robot_lost_by_a_stretched_map_is_found_by_the_right_one() -> None:
    journey = Journey()
    localiser = journey.service.localiser
    stretched(journey, 1.15, 2)
    journey.step(20)
    journey.goto(1.0, 0.0)
    journey.step(500)
    assert localiser.lost.lost
    assert localiser.strain.probabilities[STRAINED] > 0.9
    localiser.camera_turn = (0.1, 0.0, 0.0)  # as found by a map that was wrong
    stretched(journey, 1.0, 3)
    localiser.place((journey.walker.x, journey.walker.y, journey.walker.yaw))
    for _ in range(30):
        journey.step(10)
        assert not localiser.lost.lost
    assert localiser.strain.probabilities[STRAINED] < 0.1
    assert localiser.camera_turn == (0.0, 0.0, 0.0)
    assert error_of(journey)[0] < 0.05


@pytest.mark.parametrize(("elsewhere", "strained", "words"), [(0.72, 0.68, "elsewhere"), (0.68, 0.72, "strained")])
def test_two_doubts_that_make_a_robot_lost_together_name_the_larger(
    journey: Journey, elsewhere: float, strained: float, words: str
) -> None:
    localiser, weights = journey.service.localiser, np.full(5, (1.0 - strained) / 3.0)
    weights[STRAINED], weights[DISPLACED] = strained, 0.0
    localiser._lost_state = LostState(right=1.0 - elsewhere, displaced=elsewhere)
    with np.errstate(divide="ignore"):
        localiser.strain._logs = np.log(weights) - localiser.strain._prior
    localiser.look(LandmarkDetections(landmarks=(), stamp_ns=S // 5), GaitView("standing"), 0.2)
    assert localiser.lost.lost
    assert max(localiser._lost_state.probability, localiser.strain.probabilities[STRAINED]) < 0.9
    assert words in localiser.lost.reason


@pytest.mark.parametrize(
    ("request_", "field", "value"),
    [
        (GotoRequest, "position", (math.nan, 0.0)),
        (GotoRequest, "position", (0.0, math.inf)),
        (WaypointsRequest, "positions", ()),
        (WaypointsRequest, "positions", ((0.0, 0.0),) * 1000),
        (WaypointsRequest, "positions", ((0.0, math.nan),)),
        (SetPoseRequest, "pose", (0.0, 0.0, math.nan)),
    ],
)
def test_numbers_that_no_goal_has_are_refused_with_field_and_limit(request_: type, field: str, value: object) -> None:
    with pytest.raises(ValidationError) as caught:
        request_(**{field: value})
    problem = caught.value.errors()[0]
    assert problem["loc"][0] == field
    if isinstance(value, tuple) and len(value) > MAX_WAYPOINTS:
        assert problem.get("ctx", {})["max_length"] == MAX_WAYPOINTS
