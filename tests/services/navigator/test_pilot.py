"""The pilot takes goals to their end, on a walker without legs."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from surefoot.schemas.navigation import Decision
from surefoot.services.navigator.belief.matching import SightNoise
from surefoot.services.navigator.belief.tracker import Motion, PoseTracker, StartUncertainty
from surefoot.services.navigator.goals import Act, NavigationGoal, Point
from surefoot.services.navigator.pilot import Pilot
from tests.services.navigator.strollers import TICK_S, Stroller

TURN = math.radians(23.0)
ACTS = (
    Act("walk", "walk", Motion(forward=0.1, walked=0.1), 1.8),
    Act("left", "turn", Motion(turn=TURN), 1.8),
    Act("right", "turn", Motion(turn=-TURN), 1.8),
    Act("stand", "stand", Motion(), 0.7),
)


class TowardsGoal:
    """Turns to the goal, then walks."""

    def begin(self) -> None:
        """Forget nothing."""

    def decide(self, mean: np.ndarray, cov: np.ndarray, goal: Point, *, blocked: bool) -> Decision:
        """Return a turn when the goal is aside, else a walk."""
        dx, dy = goal[0] - mean[0], goal[1] - mean[1]
        phi = math.remainder(math.atan2(dy, dx) - mean[2], 2.0 * math.pi)
        action = ("left" if phi > 0.0 else "right") if abs(phi) > TURN or blocked else "walk"
        return Decision(number=0, action=action, reason="", distance=math.hypot(dx, dy), bearing=phi, entropy=0.0)


class Run:
    """Pilot, belief and walker together; the belief is exact."""

    def __init__(self, early: bool = True, sd: float = 0.005) -> None:
        self.walker = Stroller(early=early)
        self.pilot = Pilot(ACTS, commands=True)
        noise = SightNoise()
        self.tracker = PoseTracker(StartUncertainty(sd, sd, 0.0), noise, noise)
        self.now = 0.0
        self.blocked, self.close, self.lost, self.suspected = False, False, False, False

    def goal(self, *route: Point, yaw: float | None = None) -> NavigationGoal:
        """Begin a goal."""
        goal = NavigationGoal("g", route, "towards", self.now, yaw, start=self.tracker.pose[:2])
        self.pilot.begin(goal, TowardsGoal())
        return goal

    def under_way(self, x: float, past: float) -> None:
        """Begin a goal at (x, 0) and walk beyond a part of the way, m."""
        self.goal((x, 0.0))
        self.until(lambda: self.walker.x > past)

    def until(self, done: Callable[[], bool], most_s: float = 400.0) -> None:
        """Let time pass until something is so."""
        end = self.now + most_s
        while not done():
            assert self.now < end, f"not in {most_s} s: {self.pilot.state} {self.pilot.decision}"
            self.walker.take(self.pilot)
            self.walker.tick()
            self.now += TICK_S
            view = self.walker.view()
            self.pilot.follow(self.now, view, self.tracker)
            self.pilot.tick(
                self.now, view, self.tracker, blocked=self.blocked, close=self.close, lost=self.lost,
                suspected=self.suspected,
            )  # fmt: skip

    def finish(self) -> tuple[str, str]:
        """Let time pass until the goal has ended; return the state and the error of the pilot."""
        self.until(self.ended)
        return self.pilot.state, self.pilot.error

    def ended(self) -> bool:
        """Return whether the goal has ended."""
        return self.pilot.state not in ("navigating", "stopping")


@pytest.fixture
def run() -> Run:
    return Run()


@pytest.mark.parametrize("early", [True, False])
@pytest.mark.parametrize("place", [(1.0, 0.0), (0.6, 0.8), (-0.9, -0.4)])
def test_arrives_and_stands(place: Point, early: bool) -> None:
    run = Run(early)
    run.goal(place)
    assert run.finish()[0] == "succeeded"
    assert math.hypot(run.walker.x - place[0], run.walker.y - place[1]) < 0.2
    assert run.walker.state == "standing"
    assert run.tracker.pose[:2] == pytest.approx((run.walker.x, run.walker.y), abs=0.02)


def test_actions_follow_without_a_halt_where_the_walker_says_when_it_ends(run: Run) -> None:
    run.goal((1.5, 0.5))
    run.until(run.ended)
    assert run.walker.halts == 1
    assert run.pilot.decisions >= 15


def test_a_robot_that_may_be_lost_stands_and_looks_and_walks_on_by_a_right_belief(run: Run) -> None:
    run.under_way(1.5, 0.53)
    run.suspected = True
    run.until(lambda: run.walker.state == "standing", 1.5)
    assert run.tracker.pose[0] == pytest.approx(run.walker.x, abs=0.03)
    run.suspected = False
    run.until(lambda: run.walker.state == "walking", 0.1)
    assert run.finish()[0] == "succeeded"
    assert dict(run.pilot.goal.recoveries if run.pilot.goal else {}) == {"suspect_look": 1}


def test_a_suspicion_that_stays_turns_the_robot_twice_and_holds_it_up_no_longer(run: Run) -> None:
    goal = NavigationGoal("g", ((0.8, 0.0),), "towards", 0.0, start=(0.0, 0.0))
    run.pilot.begin(goal, TowardsGoal())
    run.suspected = True
    assert run.finish()[0] == "succeeded"
    looks = goal.recoveries["suspect_look"]
    assert looks >= 1
    assert goal.recoveries["turn_and_look"] == 2 * looks


def test_a_new_goal_looks_at_once_where_the_one_before_had_just_looked(run: Run) -> None:
    run.under_way(1.5, 0.53)
    for x in (1.5, 1.6):
        goal = run.goal((x, 0.0))
        run.suspected = True
        run.until(lambda goal=goal: goal.recoveries["suspect_look"] == 1, 0.1)
        run.until(lambda: run.walker.state == "standing", 2.5)
        run.suspected = False
        run.until(lambda: run.walker.state == "walking", 0.2)


def test_a_suspicion_is_no_further_loss_of_a_robot_that_was_found_again_often(run: Run) -> None:
    goal = NavigationGoal("g", ((0.8, 0.0),), "towards", 0.0, start=(0.0, 0.0))
    run.pilot.begin(goal, TowardsGoal())
    goal.recoveries["relocalise"] = run.pilot.conduct.found_again + 1
    run.suspected = True
    assert run.finish()[0] == "succeeded"


def test_a_new_goal_replaces_the_old_one_without_a_halt(run: Run) -> None:
    run.under_way(2.0, 0.5)
    run.goal((0.8, 0.8))
    run.until(run.ended)
    assert run.walker.halts == 1
    assert math.hypot(run.walker.x - 0.8, run.walker.y - 0.8) < 0.2


def test_cancel_ends_on_both_feet_within_two_steps(run: Run) -> None:
    run.under_way(2.0, 0.5)
    began = run.now
    assert run.pilot.cancel()
    run.until(run.ended)
    assert (run.pilot.state, run.walker.state) == ("cancelled", "standing")
    assert run.now - began < 1.9
    assert not run.pilot.cancel()


def test_another_client_takes_over(run: Run) -> None:
    run.under_way(2.0, 0.3)
    run.walker.walk_id += 1
    number = run.pilot.orders.number
    assert run.finish() == ("failed", "taken_over")
    run.now += 5.0
    assert run.pilot.orders.number == number  # no order against it


@pytest.mark.parametrize(
    ("reported", "value", "error"),
    [
        pytest.param("refused", "an emergency stop is in force (x)", "stopped", id="order refused by a stop"),
        pytest.param("refused", "too_fast", "walker_refused", id="order refused"),
        pytest.param("state", "refused", "fallen", id="fall"),
    ],
)
def test_a_refused_order_or_a_fall_ends_the_goal(run: Run, reported: str, value: str, error: str) -> None:
    run.under_way(2.0, 0.3)
    setattr(run.walker, reported, value)
    assert run.finish() == ("failed", error)


def test_a_walker_that_was_started_again_gets_its_order_again(run: Run) -> None:
    run.under_way(1.0, 0.3)
    run.walker = Stroller(run.walker.x, run.walker.y, run.walker.yaw, order=0)
    asked = run.pilot.orders.number
    original = run.walker.take
    run.walker.take = lambda pilot: original(pilot) if pilot.orders.number > asked else None  # type: ignore[method-assign]
    assert run.finish()[0] == "succeeded"
    assert math.hypot(run.walker.x - 1.0, run.walker.y) < 0.2


def test_waypoints_in_turn_and_the_last_heading(run: Run) -> None:
    goal = run.goal((0.6, 0.0), (0.6, 0.6), yaw=math.pi)
    assert run.finish()[0] == "succeeded"
    assert (goal.index, goal.missed) == (2, [])
    assert abs(math.remainder(run.walker.yaw - math.pi, 2.0 * math.pi)) < math.radians(9.0)


def test_a_waypoint_without_progress_is_missed_and_the_last_one_fails_the_goal(run: Run) -> None:
    goal = run.goal((0.8, 0.0), (0.0, 0.8))
    run.blocked = True  # it turns for ever
    run.until(run.ended, 600.0)
    assert goal.missed == [0, 1]
    assert (run.pilot.state, run.pilot.error) == ("failed", "blocked")


def test_unsure_arrival_is_looked_at_and_counted() -> None:
    run = Run(sd=0.2)
    goal = run.goal((0.4, 0.0))
    assert run.finish() == ("failed", "arrived_unsure")
    assert goal.recoveries["look"] == run.pilot.conduct.looks


def test_the_belief_at_the_end_of_an_action_is_what_decides(run: Run) -> None:
    run.goal((1.0, 0.0))
    run.until(lambda: run.pilot.orders.number == 2)
    mean, cov = run.pilot.predicted(run.tracker)
    assert mean[0] == pytest.approx(0.1, abs=1e-4)
    assert np.all(np.linalg.eigvalsh(cov[:3, :3]) >= 0.0)


def test_a_goal_taken_up_late_is_not_given_up_for_the_time_before(run: Run) -> None:
    run.now = 500.0
    goal = NavigationGoal("g", ((1.0, 0.0),), "towards", 10.0, start=(-9.0, 0.0), nearest=1.0, nearest_at=495.0)
    run.pilot.resume(goal, TowardsGoal(), "navigating", ("navigating", "", ""))
    run.until(run.ended)
    assert (run.pilot.state, goal.missed) == ("succeeded", [])


@pytest.mark.parametrize("ends_in", [0.5, 1.2])
def test_what_was_close_within_half_a_second_makes_the_robot_step_back(run: Run, ends_in: float) -> None:
    run.under_way(1.5, 0.53)
    run.until(lambda: ends_in - 0.02 < (run.walker.view().ends_in or 0.0) < ends_in)
    run.close, then, made = True, run.now, run.pilot.decisions
    run.until(lambda: run.now > then)
    run.close = False
    run.until(lambda: run.pilot.decisions > made)
    assert run.pilot.goal is not None
    assert run.pilot.goal.recoveries["step_back"] == (1 if ends_in == 0.5 else 0)
    assert run.finish()[0] == "succeeded"
    assert run.pilot.goal.backs == 0
    assert run.tracker.pose[:2] == pytest.approx((run.walker.x, run.walker.y), abs=0.02)


@pytest.mark.parametrize(("stays", "turns"), [(40.0, False), (90.0, True)])
def test_before_what_stays_close_the_robot_stands_until_it_is_gone_for_a_minute_at_most(
    run: Run, stays: float, turns: bool
) -> None:
    run.under_way(1.5, 0.53)
    goal, begin = run.pilot.goal, run.now
    assert goal is not None
    run.close = run.blocked = True
    run.until(lambda: goal.recoveries["stand"] == 1)
    assert goal.backs == goal.recoveries["step_back"] == 2
    run.until(lambda: run.now > begin + stays)
    assert (abs(run.walker.yaw) > 0.01) is turns
    run.close = run.blocked = False
    assert run.finish()[0] == "succeeded"
