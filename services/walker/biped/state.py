"""What the biped walker remembers from one tick to the next."""

from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from ..interface import MotionCommand
from .route import BipedRoute, Footstep

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Mode(Enum):
    """What the legs are doing."""

    WAIT = "wait"  # no joint sample yet
    RISE = "rise"  # from the measured joints to the stance
    STAND = "stand"
    START = "start"  # the weight shifts before the first step
    STEP = "step"
    FOLD = "fold"  # lost: going down on bent knees
    FALLEN = "fallen"


@dataclass(frozen=True)
class AcceptedCommand:
    """A command that was accepted."""

    command: MotionCommand
    gait: str
    route: BipedRoute | None
    """None: it is no walking one."""


@dataclass(eq=False)
class BipedState:
    """State of the walker; frame odom."""

    joints: int
    mode: Mode = Mode.WAIT
    clock: int = 0
    """Ticks in this mode, or in this step."""
    gait: str = "zmp"
    route: BipedRoute | None = None
    undone: BipedRoute | None = None
    """What the route was before the present step."""
    paused: BipedRoute | None = None
    """What is left of a walk that waits for the estimate."""
    late: AcceptedCommand | None = None
    """Came while the closing step landed: taken up when the robot stands."""
    walk_id: int = 0
    step: Footstep | None = None
    """The present step."""
    next_swing: int = 0
    progress: float = 0.0
    """Phase of the present swing, 0..1."""
    tilt: Array = field(default_factory=lambda: np.zeros(2))
    """Roll and pitch beyond the plan, rad."""
    begin: Array = field(default_factory=lambda: np.zeros(3))
    """Where the swinging foot came from."""
    feet: Array = field(default_factory=lambda: np.zeros((2, 3)))
    """Where the feet stand; the swinging one: stood."""
    body: Array = field(default_factory=lambda: np.zeros(3))
    """Body pose the feet belong to."""
    x: Array = field(default_factory=lambda: np.zeros((3, 2)))
    """CoM of the plan: position, velocity, acceleration."""
    error: Array = field(default_factory=lambda: np.zeros(2))
    """Sums of the ZMP error."""
    ref: Array = field(default_factory=lambda: np.zeros((1, 2)))
    """ZMP reference from the beginning of the present step on."""
    row: int = 0
    """Present row of it."""
    zmp_from: Array = field(default_factory=lambda: np.zeros(2))
    """Where the reference was when the present step began."""
    trunk: Array = field(default_factory=lambda: np.zeros(4))
    """x, y, yaw, height of base_link."""
    q: Array = field(default_factory=lambda: np.zeros(0))
    """Planned joint angles, (nj,)."""
    rate: Array = field(default_factory=lambda: np.zeros(2))
    """Smoothed roll and pitch rate."""
    rest: Array = field(default_factory=lambda: np.zeros(2))
    """Slow mean of the measured roll and pitch, rad: floor, servos' zeros and the bias of the estimate."""
    peak: float = 0.0
    """Largest unplanned tilt of the present step."""
    scale: float = 1.0
    """Shortens steps after a tilt."""
    calibrated: bool = False
    held: bool = False
    duration: float | None = None
    """s from the first step on after which the walk ends; None = no limit."""
    began: float | None = None
    """Simulated time of that step, s."""
    recovering: bool = False
    """Started again in the middle of a run, not standing yet."""
    stamp: float = 0.0
    stopping: bool = False
    measured: Array | None = None
    """Last joint sample, (nj,)."""
    rise_from: Array | None = None
    command: Array | None = None
    contacts: Flags = field(default_factory=lambda: np.ones(2, dtype=np.bool_))
    seen: Array = field(default_factory=lambda: np.zeros(3))
    """Odometry now: x, y, yaw,"""
    seen_then: Array | None = None
    """and at the last touch-down of this walk."""
    planned_way: Array = field(default_factory=lambda: np.zeros(2))
    """Way and turn of this walk by plan (m, rad),"""
    measured_way: Array = field(default_factory=lambda: np.zeros(2))
    """and by odometry."""
    gain: Array = field(default_factory=lambda: np.ones(2))
    """What a planned way and turn become in the world."""
    learning: bool = True
    """The present command lets the walker learn that."""
    steps: int = 0
    reason: str = ""
    unreachable: int = 0

    def __post_init__(self) -> None:
        self.q = np.zeros(self.joints)
