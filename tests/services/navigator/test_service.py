"""The navigator service without a bus: goals on a walker without legs, a camera that sees well, and bad input."""

import json
import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from surefoot.errors import Refusal, SurefootError
from surefoot.schemas.hw import Landmark
from surefoot.schemas.navigation import CancelRequest, GotoRequest, PolicyRequest, SetPoseRequest, WaypointsRequest
from surefoot.schemas.topics import NAVIGATOR_ORDER
from surefoot.services.navigator.memory import is_covariance
from surefoot.services.navigator.policy.files import shipped
from tests.services.navigator.journeys import Journey, ready
from tests.services.refusals import refused


@pytest.mark.parametrize("control", ["odometry", "commands"])
def test_reaches_a_goal_and_reports_what_users_of_nav2_expect(control: str) -> None:
    journey = ready(control=control)
    reply = journey.goto(1.2, 0.3)
    assert reply.accepted
    assert reply.length == pytest.approx(math.hypot(1.2, 0.3), abs=0.1)
    journey.step(300)
    half = journey.feedback()
    assert (half.state, half.navigation_time) == ("navigating", pytest.approx(3.0, abs=0.11))
    assert 0.8 < half.distance_remaining < 1.3
    assert half.number_of_poses_remaining == 1
    assert half.decision.reason
    assert half.decision.action in half.decision.values
    end = journey.until_ended()
    assert (end.state, end.error_code, end.error_msg) == ("succeeded", "", "")
    assert journey.missed(1.2, 0.3) < 0.2
    pose = journey.belief()
    assert pose.control == control
    assert not pose.lost
    assert math.hypot(pose.pose[0] - journey.walker.x, pose.pose[1] - journey.walker.y) < 0.05


def test_the_published_pose_is_that_of_its_tick_whenever_odometry_began() -> None:
    journey = Journey()
    journey.seen = journey.odom = False
    journey.step(24)
    journey.odom = True  # from tick 24 on: used in ticks 34, 44, ... but for the publications in between
    journey.goto(0.0, 0.6)
    turned = 0.0
    for _ in range(60):
        journey.step(10 - journey.tick % 10)
        journey.step()
        belief, w = journey.belief(), journey.walker
        turned = max(turned, abs(w.yaw))
        assert belief.pose == pytest.approx((w.x, w.y, w.yaw), abs=2e-3)
        assert belief.map_from_odom == pytest.approx((0.0, 0.0, 0.0), abs=2e-3)
    assert turned > 1.0


def test_first_order_comes_in_the_tick_after_the_goal(journey: Journey) -> None:
    assert journey.stage.said[NAVIGATOR_ORDER.key].number == 0
    journey.goto(1.0, 0.0)
    journey.step()
    assert journey.stage.said[NAVIGATOR_ORDER.key].number == 1


def test_at_tick_is_kept(journey: Journey) -> None:
    journey.goto(1.0, 0.0, at_tick=40)
    journey.step(20)
    assert journey.pilot.state == "idle"
    journey.step()
    assert journey.pilot.state == "navigating"
    requests = journey.service.requests
    for ask in (
        lambda: journey.goto(1.0, 0.0, at_tick=3),
        lambda: requests.cancel(CancelRequest(at_tick=requests.tick)),
        lambda: requests.set_pose(SetPoseRequest(pose=(0.0, 0.0, 0.0), at_tick=requests.tick)),
    ):
        with refused(Refusal, "late", "at_tick"):
            ask()


def test_routes_lead_around_obstacles(journey: Journey) -> None:
    reply = journey.goto(2.6, 0.75)
    assert len(reply.route) > 1
    assert reply.length > math.hypot(2.6, 0.75)


@pytest.fixture
def memory(tmp_path: Path) -> str:
    """The file in which a navigator keeps its goal."""
    return str(tmp_path / "navigator.json")


BAD = [
    (GotoRequest(position=(0.0, 1.05)), "blocked", "position"),
    (GotoRequest(position=(2.05, 0.55)), "blocked", "position"),
    (GotoRequest(position=(40.0, 0.0)), "outside", "position"),
    (GotoRequest(position=(1e9, 0.0)), "invalid", "position"),
    (GotoRequest(position=(1.0, 0.0), frame="camera"), "unknown_frame", "frame"),
    (GotoRequest(position=(1.0, 0.0), policy="best"), "unknown_policy", "policy"),
]


@pytest.mark.parametrize(("request_", "code", "field"), BAD, ids=[f"{b[1]} {b[0].position}" for b in BAD])
def test_a_goal_that_cannot_be_is_refused(journey: Journey, request_: GotoRequest, code: str, field: str) -> None:
    with refused(Refusal, code, field):
        journey.service.requests.goto(request_)
    journey.step(5)
    assert journey.pilot.state == "idle"


def test_waypoints_name_the_one_that_is_wrong_and_take_the_same_twice(journey: Journey) -> None:
    with refused(Refusal, field="positions.1"):
        journey.service.requests.waypoints(WaypointsRequest(positions=((0.5, 0.0), (0.0, 1.05))))
    reply = journey.service.requests.waypoints(WaypointsRequest(positions=((0.5, 0.0), (0.5, 0.0), (0.8, 0.3))))
    assert len(reply.route) == 2
    assert journey.until_ended().state == "succeeded"


def test_a_goal_in_odom_is_placed_in_the_map() -> None:
    journey = ready(start_x=0.5, start_y=0.1)
    journey.walker.x, journey.walker.y = 0.0, 0.0
    journey.seen = False
    reply = journey.goto(0.5, 0.0, frame="odom")
    assert reply.route[-1] == pytest.approx((1.0, 0.1), abs=0.02)


@pytest.mark.parametrize(("state", "code"), [("waiting", "not_initialised"), ("refused", "fallen")])
def test_a_robot_that_cannot_walk_takes_no_goal(journey: Journey, state: str, code: str) -> None:
    journey.walker.state = state
    journey.step()
    with refused(Refusal, code):
        journey.goto(1.0, 0.0)


def test_cancel(journey: Journey) -> None:
    assert not journey.service.requests.cancel(CancelRequest()).accepted
    journey.goto(1.5, 0.0, goal_id="far")
    journey.step(400)
    assert not journey.service.requests.cancel(CancelRequest(goal_id="near")).accepted
    assert journey.service.requests.cancel(CancelRequest(goal_id="far")).accepted
    journey.until_ended(300)
    assert (journey.feedback().state, journey.feedback().error_code) == ("cancelled", "cancelled")
    assert journey.walker.state == "standing"


def test_an_impossible_pose_is_refused_and_a_possible_one_taken(journey: Journey) -> None:
    for request, field in (
        (SetPoseRequest(pose=(0.0, 1.05, 0.0)), "pose"),
        (SetPoseRequest(pose=(99.0, 0.0, 0.0)), "pose"),
        (SetPoseRequest(pose=(0.0, 0.0, 0.0), covariance=(1.0, 2.0, 0.0, 2.0, 1.0, 0.0, 0.0, 0.0, 1.0)), "covariance"),
        (SetPoseRequest(pose=(0.0, 0.0, 0.0), covariance=(-1.0, *((0.0,) * 8))), "covariance"),
    ):
        with refused(Refusal, field=field):
            journey.service.requests.set_pose(request)
    journey.seen = False
    assert journey.service.requests.set_pose(SetPoseRequest(pose=(1.0, 0.2, 0.3))).accepted
    journey.step(11)
    assert journey.belief().pose == pytest.approx((1.0, 0.2, 0.3), abs=0.02)


def test_covariances() -> None:
    rng = np.random.default_rng(5)
    for _ in range(50):
        root = rng.standard_normal((3, 3))
        good = root @ root.T
        assert is_covariance(good)
        for place in ((1, 0), (0, 2), (2, 1)):
            uneven = good.copy()
            uneven[place] += 0.01
            assert not is_covariance(uneven)
        assert not is_covariance(good - 1.01 * np.linalg.eigvalsh(good)[0] * np.eye(3) - 1e-6 * np.eye(3))


def test_map_and_policies_are_reported(journey: Journey) -> None:
    grid = journey.service.maps.message()
    assert (grid.rows, grid.cols) == (44, 84)
    assert len(grid.data) == 44 * 84
    reply = journey.service.requests.policy(PolicyRequest(use="hand"))
    assert reply.policy == "hand"
    assert {"hand", "planner", "steer"} <= set(reply.known)
    with pytest.raises(Refusal):
        journey.service.requests.policy(PolicyRequest(use="nothing.npz"))


def test_blocked_ahead_it_only_turns(journey: Journey) -> None:
    journey.distance = 0.35
    journey.step(10)
    journey.goto(1.0, 0.0)
    journey.step(400)
    order = journey.stage.said[NAVIGATOR_ORDER.key]
    assert order.command.action == "turn"
    assert "wall" in journey.feedback().decision.reason


@pytest.mark.parametrize("length", [4, 256])
def test_descriptors_of_another_length_are_refused_and_the_walk_goes_on(journey: Journey, length: int) -> None:
    journey.goto(0.5, 0.0)
    odd, plain = (Landmark(range=0.5, bearing=0.0, descriptor=(0.1,) * length),), journey.frame
    journey.frame = lambda: plain().model_copy(update={"landmarks": odd})  # type: ignore[method-assign]
    assert journey.until_ended().state == "succeeded"
    assert any("numbers, got" in line for line in journey.stage.logged)
    assert sum("refused" in line for line in journey.stage.logged) == 1


@pytest.mark.parametrize("camera", ["dark", "frozen"])
def test_without_a_camera_the_belief_grows_and_the_goal_is_reached_by_odometry(journey: Journey, camera: str) -> None:
    journey.goto(0.8, 0.0)
    before = journey.belief().entropy
    frame = journey.frame()
    if camera == "dark":
        journey.seen = False
    else:
        journey.frame = lambda: frame  # type: ignore[method-assign]
    journey.until_ended()
    if camera == "dark":
        assert journey.feedback().state == "succeeded"
        assert journey.belief().entropy > before
    else:  # the same picture for ever contradicts the way: never a confident wrong pose
        pose = journey.belief()
        away = math.hypot(pose.pose[0] - journey.walker.x, pose.pose[1] - journey.walker.y)
        assert pose.lost or away < 0.15 or journey.feedback().state == "failed"


def test_moved_robots_are_found_again(journey: Journey) -> None:
    journey.goto(2.4, 0.0)
    journey.step(900)
    w = journey.walker
    w.x, w.y, w.yaw = w.x - 0.3, w.y + 0.6, w.yaw - 0.5 * math.pi
    journey.odom = False  # it was lifted: no odometry reports it
    journey.step()
    journey.odom = True
    journey.service.localiser._taken = (w.x, w.y, w.yaw)  # its own count goes on as if nothing had happened
    end = journey.until_ended()
    assert end.state == "succeeded"
    assert end.recoveries["relocalise"] >= 1
    assert math.hypot(w.x - 2.4, w.y) < 0.2


def test_a_navigator_that_is_started_again_goes_on_with_its_goal(memory: str) -> None:
    first = ready(memory=memory)
    first.goto(1.5, 0.0, goal_id="kept")
    first.step(600)
    second = first.restarted(first.tick + 50, memory=memory)
    second.step(20)
    assert second.pilot.goal.id == "kept"
    assert second.pilot.orders.number >= first.pilot.orders.number
    assert second.until_ended().state == "succeeded"
    assert second.missed(1.5, 0.0) < 0.2


@pytest.mark.parametrize("order_lost", [False, True])
def test_a_navigator_killed_before_its_tick_was_sent_does_that_tick_again(memory: str, order_lost: bool) -> None:
    first = ready(memory=memory)
    first.goto(0.8, 0.0, goal_id="kept")
    first.step(101 - first.tick % 100)  # a hundredth tick is kept whatever happens
    if order_lost:  # kept, but the walker never saw it
        number = first.pilot.orders.number
        while first.pilot.orders.number == number:
            first.step()
    second = first.restarted(first.tick - 1, memory=memory)
    second.step(20)
    assert second.pilot.goal.id == "kept"
    assert second.until_ended().state == "succeeded"
    assert second.missed(0.8, 0.0) < 0.2


@pytest.mark.parametrize("killed_when", ["stopping", "succeeded"])
def test_a_navigator_killed_at_the_end_of_its_goal_reports_that_end(memory: str, killed_when: str) -> None:
    first = ready(memory=memory)
    first.goto(0.5, 0.0, goal_id="kept")
    while first.pilot.state != killed_when:
        first.step()
    second = first.restarted(first.tick - 1, memory=memory)
    end, goal = second.until_ended(), second.pilot.goal
    assert (end.state, end.goal_id, end.error_code) == ("succeeded", "kept", "")
    assert end.navigation_time == pytest.approx(second.pilot.ended - goal.began, abs=0.01)
    assert 2.0 < end.navigation_time < 20.0


def test_a_goal_that_was_cancelled_is_not_walked_on_by_the_next_navigator(memory: str) -> None:
    first = ready(memory=memory)
    first.goto(1.5, 0.0)
    first.step(300)
    first.service.requests.cancel(CancelRequest())
    first.step()
    second = first.restarted(first.tick - 1, memory=memory)  # the order to stop was never sent
    second.until_ended()
    assert (second.feedback().state, second.walker.state) == ("cancelled", "standing")
    assert second.walker.x < 1.0


def test_an_accepted_goal_outlives_a_navigator_killed_before_it_begins(memory: str) -> None:
    first = ready(memory=memory)
    first.goto(0.8, 0.0, goal_id="planned", at_tick=first.tick + 40)
    second = first.restarted(first.tick, memory=memory)
    second.step(39)
    assert second.pilot.state == "idle"
    third = first.restarted(second.tick, memory=memory)
    third.step(2)
    assert third.pilot.state == "navigating"
    assert third.until_ended().state == "succeeded"


def test_a_goal_by_a_policy_file_goes_on_by_that_file_or_logs_that_it_has_gone(tmp_path: Path) -> None:
    memory, file = str(tmp_path / "navigator.json"), tmp_path / "mine.npz"
    journey = ready(memory=memory)
    shutil.copy(shipped()["planner-nao-arcs"], file)
    journey.goto(0.8, 0.0, policy=str(file))
    journey.step(100)
    again = journey.restarted(journey.tick, memory=memory)
    again.step(2)
    assert again.pilot.state == "navigating"
    assert again.stage.logged == ["info: started again in tick 120: goes on with its goal"]
    file.unlink()
    without = journey.restarted(again.tick, memory=memory)
    without.step(10)
    assert (without.feedback().state, without.feedback().policy) == ("navigating", "steer")
    assert without.stage.logged[0].startswith("warning: goal goal-1 goes on by the default policy steer")
    assert str(file) in without.stage.logged[0]


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("end", ["succeeded"]), ("end", ["flying", "", ""]), ("state", "flying"), ("covariance", [1.0]),
        ("pose", [0.0]), ("goal", {"id": "x"}), ("goal", 7), ("planned", [[1]]), ("planned", None), ("ended", "late"),
    ],
)  # fmt: skip
def test_a_damaged_memory_is_left_and_logged(tmp_path: Path, field: str, value: Any) -> None:
    path = tmp_path / "navigator.json"
    first = ready(memory=str(path))
    first.goto(0.8, 0.0)
    first.step(5)
    path.write_text(json.dumps({**json.loads(path.read_text()), field: value}))
    journey = Journey(tick=first.tick, memory=str(path))
    journey.step(2)
    assert journey.pilot.state == "idle"
    assert any("the kept goal cannot be read" in line for line in journey.stage.logged)


def test_memory_of_another_run_is_not_taken_up(tmp_path: Path) -> None:
    path = tmp_path / "navigator.json"
    for text in ('{"epoch": 1, "tick": 5}', "not json", '{"epoch": 2, "tick": 5, "number": "x"}'):
        path.write_text(text)
        journey = Journey(tick=100, memory=str(path))
        journey.step(5)
        assert journey.pilot.state == "idle"


@pytest.mark.parametrize(
    "config", [{"params": "nothing"}, {"policy": "nothing"}, {"map": "nothing.yaml"}, {"landmarks": "nothing.npz"}]
)
def test_configurations_that_cannot_be_are_refused_at_the_start(config: dict[str, Any]) -> None:
    with pytest.raises(SurefootError):
        Journey(**config)
