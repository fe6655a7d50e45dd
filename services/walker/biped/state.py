"""State of the biped walker from one tick to the next."""

from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from surefoot.arrays import Array, Flags

from ..interface import MotionCommand
from .route import BipedRoute, Footstep


class Mode(Enum):
    """Stage of a biped's motion, from waiting for joints over standing and stepping to folding and fallen."""

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
    """Route of a walk or turn; None for the commands stand and stop."""


@dataclass(eq=False)
class Touchdown:
    """Deviation from the plan of the foot that swings or landed last: turn of its sole, and height of touch-down.

    `leg` is that foot: 0 = left, 1 = right.
    """

    leg: int = 0
    turn: Array = field(default_factory=lambda: np.zeros(2))
    """Roll and pitch by which the foot's sole is turned back from its deviation at touch-down, (2,) rad."""
    height: float = 0.0
    """Planned height of the sole above the floor at which the foot touched early, m; 0 = it did not touch early."""
    clock: int = 0
    """Number of ticks since the foot's planned landing."""


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
    """Number of ticks since the present mode or step began."""
    gait: str = "zmp"
    route: BipedRoute | None = None
    undone: BipedRoute | None = None
    """Route as it was before the present step was taken from it; None = no walk is under way."""
    paused: BipedRoute | None = None
    """Remaining route of a walk that waits for a newer estimate; None = no walk waits."""
    late: AcceptedCommand | None = None
    """Command that arrived while the closing step landed, taken up when the robot stands; None = none."""
    walk_id: int = 0
    step: Footstep | None = None
    """Present step; None between steps."""
    next_swing: int = 0
    progress: float = 0.0
    """Phase of the present swing, 0 at lift-off to 1 at the planned landing."""
    tilt: Array = field(default_factory=lambda: np.zeros(2))
    """Roll and pitch of the trunk beyond the planned ones, (2,) rad."""
    landing: Touchdown = field(default_factory=Touchdown)
    begin: Array = field(default_factory=lambda: np.zeros(3))
    """Pose of the swinging foot at lift-off, (3,) x, y (m), yaw (rad), odom."""
    feet: Array = field(default_factory=lambda: np.zeros((2, 3)))
    """Poses of the left and right foot, (2, 3) x, y (m), yaw (rad), odom; of the swinging one at lift-off."""
    body: Array = field(default_factory=lambda: np.zeros(3))
    """Body pose half way between the feet, (3,) x, y (m), yaw (rad), odom."""
    x: Array = field(default_factory=lambda: np.zeros((3, 2)))
    """Planned position, velocity and acceleration (rows) of the CoM in x and y, (3, 2) m, m/s, m/s^2, odom."""
    error: Array = field(default_factory=lambda: np.zeros(2))
    """Accumulated ZMP error of the preview controller in x and y, (2,) m."""
    ref: Array = field(default_factory=lambda: np.zeros((1, 2)))
    """ZMP reference in x and y, a row per tick from the beginning of the present step on, (n, 2) m, odom."""
    row: int = 0
    """Index of the present row of the ZMP reference `ref`."""
    zmp_from: Array = field(default_factory=lambda: np.zeros(2))
    """ZMP reference in x and y at the beginning of the present step, (2,) m, odom."""
    trunk: Array = field(default_factory=lambda: np.zeros(4))
    """Planned pose of base_link, (4,) x, y, yaw, height, m and rad, odom."""
    q: Array = field(default_factory=lambda: np.zeros(0))
    """Planned joint angles without compensation of the servos' sag and lag, (nj,) rad."""
    rate: Array = field(default_factory=lambda: np.zeros(2))
    """Smoothed roll and pitch rate of the trunk, (2,) rad/s."""
    rest: Array = field(default_factory=lambda: np.zeros(2))
    """Slow mean of the measured roll and pitch, (2,) rad, by floor, servo zeros and bias of the estimate."""
    peak: float = 0.0
    """Largest unplanned tilt of the trunk in the present step, rad."""
    scale: float = 1.0
    """Factor on the length of the next step after an unplanned tilt, 0..1."""
    calibrated: bool = False
    held: bool = False
    duration: float | None = None
    """Time from the first step on after which the walk ends, s; None = no limit."""
    began: float | None = None
    """Simulated time of the walk's first step, s; None = no step yet."""
    recovering: bool = False
    """True from a restart in the middle of a run until the robot stands, else False."""
    stamp: float = 0.0
    stopping: bool = False
    measured: Array | None = None
    """Joint angles of the last encoder sample, (nj,) rad; None before the first."""
    rise_from: Array | None = None
    command: Array | None = None
    contacts: Flags = field(default_factory=lambda: np.ones(2, dtype=np.bool_))
    seen: Array = field(default_factory=lambda: np.zeros(3))
    """Odometry of the present tick, (3,): x, y (m), yaw (rad), frame odom."""
    seen_then: Array | None = None
    """Odometry at the last touch-down of this walk, (3,): x, y (m), yaw (rad), odom; None before the first."""
    planned_way: Array = field(default_factory=lambda: np.zeros(2))
    """Planned distance, m, and turn, rad, of this walk so far, (2,)."""
    measured_way: Array = field(default_factory=lambda: np.zeros(2))
    """Distance, m, and turn, rad, of this walk so far by odometry, (2,)."""
    gain: Array = field(default_factory=lambda: np.ones(2))
    """Learned ratio of measured to planned distance, and of measured to planned turn, (2,), no unit."""
    learning: bool = True
    """True if the present command lets the walker update `gain`, the ratios of measured to planned way; False: not."""
    steps: int = 0
    reason: str = ""
    unreachable: int = 0

    def __post_init__(self) -> None:
        self.q = np.zeros(self.joints)
