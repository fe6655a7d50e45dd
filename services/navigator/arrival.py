"""Arrival at a goal: tests whether the estimated pose lies within the goal's tolerances with deviations to spare."""

import math

from surefoot.arrays import Array

from .belief.ukf import wrap
from .goals import End, NavigationGoal

REACH = (0.5, 0.75)
"""Distance from the last waypoint at which a walk ends, as parts of the goal's position tolerance: for an uncertain and
for a certain pose. Below 0.5 steps of 0.1 m overshoot; above 0.75 the closing step may leave the tolerance."""

BLOCKED_SHARE = 0.25
"""Share of the decisions without progress at which a near echo forbade walking, from which on a stuck goal ends as
blocked."""


def spread(cov: Array) -> float:
    """Return the largest standard deviation of the position in any direction, m.

    `cov`: covariance of x, y (m) first, (2, 2) or larger.
    """
    a, b, c = float(cov[0, 0]), float(cov[0, 1]), float(cov[1, 1])
    return math.sqrt(max(0.0, 0.5 * (a + c) + math.hypot(0.5 * (a - c), b)))


def beside(goal: NavigationGoal, mean: Array) -> tuple[float, float]:
    """Return the distance of a pose from a goal's last waypoint, m, and the turn to the goal's heading, rad.

    The turn is left positive, 0 where the goal asks for no heading. `mean`: believed x, y (m), heading (rad), frame
    map, (n,).
    """
    gx, gy = goal.route[-1]
    turned = 0.0 if goal.yaw is None else float(wrap(goal.yaw - float(mean[2])))
    return math.hypot(gx - float(mean[0]), gy - float(mean[1])), turned


def reach(goal: NavigationGoal, cov: Array, sure: float) -> float:
    """Return the distance of the estimate from the last waypoint at which the walk ends, m: larger if it is certain.

    It is 0.5 to 0.75 of the goal's tolerance.

    Args:
        goal: goal whose position tolerance counts.
        cov: covariance of x, y (m) and heading (rad) first, (n, n).
        sure: number of standard deviations of the position between estimate and tolerance.
    """
    tolerance = goal.xy_tolerance
    return min(REACH[1] * tolerance, max(REACH[0] * tolerance, tolerance - sure * spread(cov)))


def surely_there(goal: NavigationGoal, mean: Array, cov: Array, sure: float) -> bool:
    """Return True if the position lies within the goal's tolerance by at least `sure` standard deviations.

    `mean`, `cov`: believed x, y (m), heading (rad), frame map, (n,), n >= 3, and their covariance, (n, n).
    """
    return beside(goal, mean)[0] + sure * spread(cov) <= goal.xy_tolerance


def surely_turned(goal: NavigationGoal, mean: Array, cov: Array, sure: float) -> bool:
    """Return True if the heading lies within the goal's tolerance by at least `sure` standard deviations.

    It is True for a goal that asks for no heading.

    Args:
        goal: states heading and tolerance.
        mean: believed x, y (m), heading (rad), frame map, (3,) or longer.
        cov: covariance of `mean`, (3, 3) or larger.
        sure: standard deviations to spare.
    """
    if goal.yaw is None:
        return True
    return abs(beside(goal, mean)[1]) + sure * math.sqrt(max(0.0, float(cov[2, 2]))) <= goal.yaw_tolerance


def sure_of_place(goal: NavigationGoal, mean: Array, cov: Array, sure: float) -> bool:
    """Return True if the robot need not stand for a camera frame: its pose at the goal is certain enough.

    The position lies within the tolerance with deviations to spare, and so does the heading, or it is off by more than
    half of its tolerance, so that the robot turns first.

    Args:
        goal: states place, heading and tolerances.
        mean: believed x, y (m), heading (rad), frame map, (n,), n >= 3.
        cov: covariance of `mean`, (n, n).
        sure: standard deviations to spare.
    """
    turning = abs(beside(goal, mean)[1]) > 0.5 * goal.yaw_tolerance
    return surely_there(goal, mean, cov, sure) and (turning or surely_turned(goal, mean, cov, sure))


def arrival(goal: NavigationGoal, mean: Array, cov: Array, sure: float) -> End:
    """Return the outcome of a goal for a robot whose estimate is at the last waypoint: state, error code, message.

    It succeeds if position and heading lie within the tolerances with `sure` deviations to spare, else it fails.

    Args:
        goal: the goal with its tolerances.
        mean: believed x, y (m), heading (rad), frame map, (3,) or longer.
        cov: covariance of `mean`, (3, 3) or larger.
        sure: standard deviations that have to fit between estimate and tolerance.
    """
    distance, turned = beside(goal, mean)
    heading = "" if goal.yaw is None else f" and {math.degrees(abs(turned)):.0f} deg"
    text = f"arrived by the estimate, {distance:.2f} m{heading} beside the goal"
    if surely_there(goal, mean, cov, sure) and surely_turned(goal, mean, cov, sure):
        return ("succeeded", "", text)
    off = f"{spread(cov):.2f} m"
    asked = f"{goal.xy_tolerance:g} m"
    if goal.yaw is not None:
        off += f" and {math.degrees(math.sqrt(max(0.0, float(cov[2, 2])))):.0f} deg"
        asked += f" and {math.degrees(goal.yaw_tolerance):.0f} deg"
    return ("failed", "arrived_unsure", f"{text}, with a deviation of {off}; surely within {asked} was asked for")


def stalled(goal: NavigationGoal, stuck: float) -> End:
    """Return the end of a goal whose last place did not come nearer in `stuck` s: stuck or blocked, with the reason."""
    (blocked, decisions), routes = goal.since, goal.recoveries["replan"]
    text, close = f"no progress towards the goal for {stuck:g} s", blocked >= BLOCKED_SHARE * decisions
    if close:
        text += f", with an obstacle close ahead in {blocked} of {decisions} decisions"
    elif routes:
        text += f", on {routes} routes around what the map does not know"
    return "failed", "blocked" if close or routes else "stuck", text
