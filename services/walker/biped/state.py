"""State of the biped walker from one tick to the next."""

from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from surefoot.arrays import Array, Flags

from ..interface import MotionCommand
from .route import BipedRoute, Footstep


class Mode(Enum):
    """Stage of the motion of a biped's legs."""

    WAIT = "wait"  # no joint sample yet
    RISE = "rise"  # from the measured joints to the stance
    STAND = "stand"
    START = "start"  # the weight shifts before the first step
    STEP = "step"
    FOLD = "fold"  # lost: going down on bent knees
    FALLEN = "fallen"


@dataclass(frozen=True)
class AcceptedCommand:
    """Accepted command with its gait and its route."""

    command: MotionCommand
    gait: str
    route: BipedRoute | None
    """Route of a walk or turn; None for stand and stop."""


@dataclass(eq=False)
class Touchdown:
    """Deviation from the plan of the foot that swings or landed last: turn of its sole, and height of touch-down.

    `leg` is that foot: 0 = left, 1 = right.
    """

    leg: int = 0
    turn: Array = field(default_factory=lambda: np.zeros(2))
    """Roll and pitch by which its sole is turned back, (2,) rad."""
    height: float = 0.0
    """Height over the floor by plan at which it touched before its time, m; 0 if it did not."""
    clock: int = 0
    """Ticks since it landed by plan."""


@dataclass(eq=False)
class BipedState:
    """State of the gait of a biped; frame odom.

    `command` are the set-points of the servos, `rise_from` those at which rising or folding began, (nj,) rad;
    `contacts`: True for each foot that touches, (2,); `stamp` the time of the tick, s; `steps` the number of finished
    steps; `unreachable`: 1 if the feet are out of reach in this tick, else 0; `next_swing`: 0 = left, 1 = right.
    """

    joints: int
    mode: Mode = Mode.WAIT
    clock: int = 0
    """Ticks in this mode, or in this step."""
    gait: str = "zmp"
    route: BipedRoute | None = None
    undone: BipedRoute | None = None
    """Route before the present step."""
    paused: BipedRoute | None = None
    """Remaining part of a walk that waits for the estimate."""
    late: AcceptedCommand | None = None
    """Command that came while the closing step landed; it is taken up when the robot stands."""
    walk_id: int = 0
    step: Footstep | None = None
    """Present step; None between steps."""
    next_swing: int = 0
    progress: float = 0.0
    """Phase of the present swing, 0..1."""
    tilt: Array = field(default_factory=lambda: np.zeros(2))
    """Roll and pitch of the trunk beyond the plan, (2,) rad."""
    landing: Touchdown = field(default_factory=Touchdown)
    begin: Array = field(default_factory=lambda: np.zeros(3))
    """Place of the swinging foot at lift-off, (3,) x, y (m), yaw (rad), odom."""
    feet: Array = field(default_factory=lambda: np.zeros((2, 3)))
    """Places of the feet, left and right, (2, 3) x, y (m), yaw (rad), odom; of the swinging one at lift-off."""
    body: Array = field(default_factory=lambda: np.zeros(3))
    """Body pose that the feet belong to, half way between them, (3,) x, y (m), yaw (rad), odom."""
    x: Array = field(default_factory=lambda: np.zeros((3, 2)))
    """Planned CoM in odom, (3, 2), rows in m, m/s, m/s^2: position, velocity, acceleration in x and y, SI."""
    error: Array = field(default_factory=lambda: np.zeros(2))
    """Sums of the ZMP error in x and y, (2,) m."""
    ref: Array = field(default_factory=lambda: np.zeros((1, 2)))
    """ZMP reference from the beginning of the present step on, (n, 2) m."""
    row: int = 0
    """Present row of the ZMP reference."""
    zmp_from: Array = field(default_factory=lambda: np.zeros(2))
    """ZMP reference at the beginning of the present step, (2,) m."""
    trunk: Array = field(default_factory=lambda: np.zeros(4))
    """Planned pose of base_link, (4,) x, y, yaw, height, m and rad, odom."""
    q: Array = field(default_factory=lambda: np.zeros(0))
    """Planned joint angles, (nj,) rad."""
    rate: Array = field(default_factory=lambda: np.zeros(2))
    """Smoothed roll and pitch rate, (2,) rad/s."""
    rest: Array = field(default_factory=lambda: np.zeros(2))
    """Slow mean of the measured roll and pitch, (2,) rad: floor, servos' zeros and the bias of the estimate."""
    peak: float = 0.0
    """Largest unplanned tilt of the present step, rad."""
    scale: float = 1.0
    """Factor on the next step after a tilt, 0..1."""
    calibrated: bool = False
    held: bool = False
    duration: float | None = None
    """Time from the first step on after which the walk ends, s; None = no limit."""
    began: float | None = None
    """Simulated time of the first step, s."""
    recovering: bool = False
    """True from a restart in the middle of a run until the robot stands."""
    stamp: float = 0.0
    stopping: bool = False
    measured: Array | None = None
    """Joint angles of the last sample, (nj,) rad; None before the first."""
    rise_from: Array | None = None
    command: Array | None = None
    contacts: Flags = field(default_factory=lambda: np.ones(2, dtype=np.bool_))
    seen: Array = field(default_factory=lambda: np.zeros(3))
    """Odometry of the present tick, (3,): x, y in m, yaw in rad."""
    seen_then: Array | None = None
    """Odometry at the last touch-down of this walk, (3,); None before it."""
    planned_way: Array = field(default_factory=lambda: np.zeros(2))
    """Way and turn of this walk by plan, (2,) m and rad."""
    measured_way: Array = field(default_factory=lambda: np.zeros(2))
    """Way and turn of this walk by odometry, (2,) m and rad."""
    gain: Array = field(default_factory=lambda: np.ones(2))
    """Quotient of measured and planned way, and of measured and planned turn, (2,)."""
    learning: bool = True
    """True if the present command lets the walker learn `gain`."""
    steps: int = 0
    reason: str = ""
    unreachable: int = 0

    def __post_init__(self) -> None:
        self.q = np.zeros(self.joints)
