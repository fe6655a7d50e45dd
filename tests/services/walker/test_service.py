"""The walker service without a bus: what it asks, and what it takes up after a restart."""

from typing import Any

import numpy as np
import pytest

from surefoot.robot.reader import load_robot
from surefoot.schemas.cmd import WalkCommand
from surefoot.schemas.hw import EmergencyStop
from surefoot.schemas.navigation import MotionOrder
from surefoot.schemas.state import StanceEnd
from surefoot.schemas.topics import CMD_ESTOP, CMD_JOINTS, FOOTHOLDS_SELECT, NAVIGATOR_ORDER, STATE_GAIT, STATE_ODOMETRY
from tests.services.walker.messages import EPOCH, estimate, samples, service_of, tick_of

ROBOT = load_robot("ragno")


class Robot:
    """Perfect servos, switches by the planned stance, odometry as planned."""

    def __init__(self, memory: str | None, tick: int = 0, **config: Any) -> None:
        self.service, self.tick = service_of(memory=memory, **config), tick
        self.stage = self.service.runtime
        self.joints = ROBOT.neutral.copy()
        self.order: MotionOrder | None = None

    def step(self, *, held: bool = False, estimated: bool = True, stances: tuple[StanceEnd, ...] = ()) -> Any:
        s, feet = self.service.gait.state, ((True,),) * 6
        if s.feet.any():
            feet = tuple((bool(foot[2] < ROBOT.foot_radius + 1e-3),) for foot in s.feet)
        messages: dict[str, Any] = {} if self.order is None else {NAVIGATOR_ORDER.key: self.order}
        messages |= samples(self.tick, self.joints, feet)
        if estimated:
            messages |= estimate(self.tick, (float(s.body[0]), float(s.body[1]), s.yaw), 6)
            odometry = messages[STATE_ODOMETRY.key]
            messages[STATE_ODOMETRY.key] = odometry.model_copy(update={"stances": stances})
        self.service.on_tick(tick_of(self.tick, messages, ("estimator", "walker", "footholds"), held))
        command = self.stage.said[CMD_JOINTS.key].position
        if command is not None:
            self.joints = self.service.gait.state.q.copy()
        self.tick += 1
        return self.stage.said[STATE_GAIT.key]

    def run(self, ticks: int) -> list[Any]:
        return [self.step() for _ in range(ticks)]


@pytest.fixture
def robot(tmp_path: Any) -> Robot:
    """A robot with a memory that stands."""
    made = Robot(str(tmp_path / "walker.json"))
    made.run(20)
    return made


def test_after_an_emergency_stop_no_walk_is_accepted_until_the_next_run(robot: Robot) -> None:
    robot.service.on_message(CMD_ESTOP, EmergencyStop(reason="a hand in the way"))
    reply = robot.service.walk(WalkCommand(action="walk", distance=0.1))
    assert (reply.accepted, reply.code) == (False, "stopped")
    assert not robot.service.walk(WalkCommand(action="walk", distance=0.1, at_tick=100)).accepted
    assert "a hand in the way" in reply.reason
    assert robot.service.walk(WalkCommand(action="stop")).accepted
    robot.service.on_reset()
    robot.run(20)
    assert robot.service.walk(WalkCommand(action="walk", distance=0.1)).accepted


def test_it_never_says_walking_while_the_driver_holds_the_joints(robot: Robot) -> None:
    assert robot.service.walk(WalkCommand(action="walk", distance=0.3)).accepted
    assert robot.run(60)[-1].state == "walking"
    phase, before = robot.step().phase, robot.joints.copy()
    held = [robot.step(held=True) for _ in range(30)]
    assert {(gait.state, gait.phase) for gait in held} == {("hold", phase)}
    assert "driver holds" in held[0].reason
    np.testing.assert_allclose(robot.joints, before)  # the gait stands still: no jump when it goes on
    assert robot.run(60)[-1].state == "walking"


def test_an_estimate_left_out_is_no_loss_but_its_age_is(robot: Robot) -> None:
    assert robot.service.walk(WalkCommand(action="walk", distance=0.3)).accepted
    robot.run(60)
    states = [robot.step(estimated=False).state for _ in range(15)]
    assert states == ["walking"] * 10 + ["hold"] * 5
    assert robot.run(60)[-1].state == "walking"


def test_a_question_about_footholds_names_its_tick(robot: Robot) -> None:
    assert robot.service.walk(WalkCommand(action="walk", distance=0.1)).accepted
    robot.run(100)
    asked = [request for key, request in robot.stage.asked if key == FOOTHOLDS_SELECT.key]
    assert asked
    assert {request.epoch for request in asked} == {EPOCH}
    assert all(20 <= request.tick < robot.tick for request in asked)


def test_stances_go_back_with_the_health_of_their_legs(robot: Robot) -> None:
    assert robot.service.walk(WalkCommand(action="walk", distance=0.3)).accepted
    lifted: set[int] = set()
    for _ in range(1500):
        down = robot.service.gait.state.feet[:, 2] < ROBOT.foot_radius + 1e-3
        ended = tuple(
            StanceEnd(foot=k, slip=0.002, begin=(0.0, 0.0, 0.0), samples=50, healthy=k != 0)
            for k in range(6) if not down[k] and k not in lifted
        )  # fmt: skip
        lifted = {k for k in range(6) if not down[k]}
        robot.step(stances=ended)
    asked = [request for key, request in robot.stage.asked if key == FOOTHOLDS_SELECT.key]
    outcomes = [each for request in asked for each in request.outcomes]
    assert {each.leg for each in outcomes} == set(ROBOT.leg_names)
    assert {each.leg for each in outcomes if not each.healthy} == {ROBOT.leg_names[0]}


def test_a_walker_killed_in_mid_step_goes_on_with_its_command_under_the_same_number(
    robot: Robot, tmp_path: Any
) -> None:
    number = robot.service.walk(WalkCommand(action="walk", distance=0.2)).id
    assert robot.service.walk(WalkCommand(action="turn", angle=0.1, at_tick=900)).accepted
    gaits = robot.run(190)
    assert not all(gaits[-1].stance)
    again = Robot(str(tmp_path / "walker.json"), robot.tick + 20)
    again.joints = robot.joints
    again.service.gait.state.body[:2] = robot.service.gait.state.body[:2]
    gaits = again.run(450)
    assert (gaits[0].walk_id, gaits[0].state) == (number, "recovering")
    assert {"walking", "standing"} <= {gait.state for gait in gaits}
    assert "standing" not in {gait.state for gait in gaits[: [gait.state for gait in gaits].index("walking")]}
    assert again.service.gait.state.body[0] == pytest.approx(0.2, abs=0.01)
    again.run(400)
    assert again.service.gait.state.walk_id == number + 1
    assert again.service.gait.state.yaw == pytest.approx(0.1, abs=0.03)


def test_a_new_run_begins_without_a_command(robot: Robot, tmp_path: Any) -> None:
    robot.service.walk(WalkCommand(action="walk", distance=0.2))
    robot.run(50)
    assert (tmp_path / "walker.json").exists()
    new = Robot(str(tmp_path / "walker.json"))
    assert new.run(60)[-1].state == "standing"
    assert new.service.gait.state.walk_id == 0


def test_without_a_memory_the_tick_is_the_same(robot: Robot) -> None:
    plain = Robot(None)
    plain.run(20)
    for one in (robot, plain):
        one.service.walk(WalkCommand(action="walk", distance=0.1))
    for _ in range(200):
        robot.step()
        plain.step()
        assert np.array_equal(robot.joints, plain.joints)


def test_a_planned_command_that_can_never_be_obeyed_is_refused_at_once():
    """The refusal comes with the command, not in its tick."""
    robot = Robot(None)
    reply = robot.service.walk(WalkCommand(action="walk", velocity=0.9, at_tick=100))
    assert (reply.accepted, reply.code, reply.field) == (False, "too_fast", "velocity")
    assert robot.service.walk(WalkCommand(action="walk", velocity=0.05, at_tick=100)).accepted


def order(number: int, **command: Any) -> MotionOrder:
    return MotionOrder(number=number, command=WalkCommand(**command) if command else None)


def test_an_order_is_obeyed_in_the_tick_it_comes_in_and_once(robot: Robot) -> None:
    robot.order = order(0)
    assert robot.run(20)[-1].order == 0
    robot.order = order(1, action="walk", distance=0.1)
    first = robot.step()
    assert (first.order, first.order_refused, first.walk_id) == (1, "", 1)
    assert {gait.walk_id for gait in robot.run(30)} == {1}
    assert robot.service.walk(WalkCommand(action="stop")).id == 2  # somebody else's command stands
    assert {gait.walk_id for gait in robot.run(30)} == {2}
    robot.order = order(2, action="turn", angle=0.3)
    assert robot.step().walk_id == 3


def test_without_a_navigator_nothing_of_it_is_on_the_wire(robot: Robot) -> None:
    robot.service.walk(WalkCommand(action="walk", distance=0.1))
    text = robot.run(30)[-1].model_dump_json()
    assert not any(name in text for name in ("order", "ends_in_s"))


@pytest.mark.parametrize("command", [{"action": "walk", "velocity": 0.9}, {"action": "walk", "at_tick": 900}])
def test_an_order_that_cannot_be_obeyed_says_why_once(robot: Robot, command: dict[str, Any]) -> None:
    robot.order = order(4, **command)
    refused = robot.step()
    assert (refused.order, refused.walk_id, refused.state) == (4, 0, "standing")
    assert refused.order_refused
    (line,) = robot.stage.logged
    assert refused.order_refused in line
    robot.run(5)
    assert len(robot.stage.logged) == 1
    robot.order = order(5, action="walk", distance=0.1)
    assert robot.step().order_refused == ""


def test_an_emergency_stop_refuses_orders(robot: Robot) -> None:
    robot.service.on_message(CMD_ESTOP, EmergencyStop(reason="a hand in the way"))
    robot.order = order(1, action="walk", distance=0.1)
    assert "a hand in the way" in robot.step().order_refused


@pytest.mark.parametrize("remembers", [True, False])
def test_a_walker_that_is_started_again_does_not_obey_an_old_order(tmp_path: Any, remembers: bool) -> None:
    memory = str(tmp_path / "walker.json") if remembers else None
    before = Robot(memory)
    before.run(20)
    before.order = order(7, action="walk", distance=0.1)
    before.run(5)
    assert before.service.walk(WalkCommand(action="stop")).accepted
    before.run(300)
    after = Robot(memory, before.tick)
    after.order = before.order
    gaits = after.run(50)
    assert {gait.order for gait in gaits} == {7 if remembers else 0}
    assert "walking" not in {gait.state for gait in gaits}
    after.order = order(8, action="turn", angle=0.2)
    gait = after.step()
    assert (gait.order, gait.order_refused) == (8, "")
    assert gait.walk_id == gaits[-1].walk_id + 1
