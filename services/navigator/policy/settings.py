"""Settings of a live navigator: noise of its odometry, and conduct of goals. No policy depends on them."""

import math
from typing import Annotated

from pydantic import ConfigDict, Field

from surefoot.schemas.base import Strict

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]


class ModelPart(Strict):
    """Base of the parts of a navigation model: immutable, unknown keys and numbers that are not finite are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class OdometryNoise(ModelPart):
    """Standard deviations of `state/odometry` between two of its messages that the filter uses."""

    along: NotNegative = Field(default=0.03, description="part of a way of 10 cm, along and across; grows by its root")
    turn: NotNegative = Field(default=0.05, description="rad per root of a metre walked")
    still: NotNegative = Field(default=1e-3, description="m per root of a second, of a robot that stands")
    still_turn: NotNegative = Field(default=5e-4, description="rad per root of a second, likewise")


class Conduct(ModelPart):
    """Settings of goal execution: times, tolerances, recoveries."""

    xy_goal_tolerance: Positive = Field(
        default=0.20,
        le=10,
        description="m, at a success the robot is surely so near; a goal may state its own",
    )
    yaw_goal_tolerance: Positive = Field(
        default=0.25, le=math.pi, description="rad, likewise of a heading that is asked for"
    )
    sure: Positive = Field(default=2.0, description="standard deviations that fit between estimate and tolerance")
    waypoint_tolerance: Positive = Field(
        default=0.15, le=10, description="m, of the estimate at an intermediate waypoint"
    )
    lead: NotNegative = Field(
        default=0.30, le=5,
        description="s before an action's last step lands: the next is decided (walker 0.25, order 0.02)",
    )  # fmt: skip
    lag: NotNegative = Field(
        default=0.6, le=5,
        description="s from a landing until the trunk is in its place: 42 mm of 10 cm and 6 of 23 deg are left then "
        "(`python -m benchmarks walker actions`)",
    )  # fmt: skip
    looks: int = Field(default=6, ge=0, le=100, description="stands in a row to make sure of an arrival")
    look: Positive = Field(default=2.0, le=60, description="s, longest time of each without a frame")
    aligning_turns: int = Field(default=4, ge=0, le=100, description="turns to the heading that is asked for")
    replans: int = Field(default=20, ge=0, le=1000, description="routes of a goal around what the map does not know")
    wait: NotNegative = Field(
        default=30.0, description="s in all of waiting where no way leads around it; more end the goal as blocked"
    )
    remember: Positive = Field(default=120.0, description="s, an obstacle that the map does not know is kept unseen")
    ranger_ahead: float = Field(default=0.05, ge=-2, le=2, description="m, the ranger before base_link")
    timeout: Positive | None = Field(default=None, description="s for a goal; null = none; a goal may state its own")
    stuck: Positive = Field(default=120.0, description="s without progress after which a waypoint is given up")
    progress: Positive = Field(default=0.10, description="m nearer to the waypoint that count as progress")
    search_look: Positive = Field(default=3.0, le=60, description="s, look of a lost robot in one direction")
    search_turn_deg: float = Field(default=46.0, gt=0, le=180, description="deg, turn between two such looks")
    found_again: int = Field(
        default=10, ge=0, le=1000, description="times that a goal finds a lost pose again; more end it as lost"
    )
    search_turns: int = Field(default=7, ge=0, le=100, description="turns after which a lost robot gives up")
    search_walks: int = Field(
        default=3, ge=0, le=100, description="walks of a lost robot to where places differ that its sights fit alike"
    )
    suspect: float = Field(
        default=0.05, gt=0, le=1,
        description="probability that sights do not fit the belief, from which a walking robot stands and looks",
    )  # fmt: skip
    suspect_turns: int = Field(default=2, ge=0, le=100, description="turns after which it walks on all the same")
    suspect_again: NotNegative = Field(default=10.0, description="s from then until it may look again")
    blocked: NotNegative = Field(
        default=0.38,
        le=10,
        description="m, an echo so near forbids walking ahead, unless it is of a wall of the map beside a free way",
    )
    wall_slack: NotNegative = Field(
        default=0.06, le=10, description="m, an echo so much nearer than a wall of the map still counts as that wall's"
    )
    wall_sure: NotNegative = Field(
        default=0.05, le=10, description="m, largest standard deviation of the position with which any echo does"
    )
    wall_free: Positive = Field(
        default=0.2,
        le=10,
        description="m, way ahead, free on both maps, on which the robot walks on beside such a wall",
    )
    close: NotNegative = Field(
        default=0.30, le=10, description="m, an echo so near of what the map lacks makes the robot step back"
    )
    backs: int = Field(default=2, ge=0, le=100, description="steps back, from that or a bumper, before the next walk")
    stand: NotNegative = Field(
        default=60.0, description="s, longest stand before something too close that allows no step back; then it turns"
    )
    dock_xy: Positive = Field(
        default=0.03, le=1, description="m, at a success the marker that is docked on is surely so near to its place"
    )
    dock_yaw: Positive = Field(
        default=math.radians(3.0), le=math.pi, description="rad, likewise of its bearing and of a wanted heading"
    )
    dock_moves: int = Field(default=8, ge=0, le=100, description="approaches of a goal that docks on a marker")
