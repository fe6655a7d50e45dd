"""State of the legged walker from one tick to the next."""

from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from surefoot.arrays import Array, Flags, Ints

from .patterns import TRIPOD, GaitPattern
from .planning import StepPlan
from .route import LeggedRoute


class Stage(Enum):
    """Stage of the motion of a robot with four or six legs: waiting for joints, feet down, standing, stepping."""

    WAIT = "wait"  # no joint sample yet
    SETTLE = "settle"  # bringing every foot to the ground
    STAND = "stand"
    STEP = "step"


@dataclass(eq=False)
class WalkerState:
    """State of the gait of a robot with four or six legs; frame map, SI.

    `body` is the place of base_link, (3,) m, `yaw` its heading, rad, `command` the set-points of the servos, (nj,) rad;
    `contacts` are the last samples of the foot switches and `landed` the feet that have landed in this step, (L,);
    stamps are times of samples, s, and `margin` is that of stability in the last plan, m.
    """

    legs: int
    joints: int
    stage: Stage = Stage.WAIT
    gait: GaitPattern = TRIPOD
    """Gait of the walk under way: order in which legs swing."""
    usual: GaitPattern = TRIPOD
    """Gait of the command; `gait` differs from it after a step that was not safe."""
    swung: tuple[int, ...] = ()
    """Indices of the legs that swung in the last step."""
    careful_steps: int = 0
    """Number of steps taken in a gait other than that of the command."""
    route: LeggedRoute | None = None
    walk_id: int = 0
    closing: bool = False
    """True while the feet step to neutral (after a command, on stop, after a restart), else False."""
    closed: set[tuple[int, ...]] = field(default_factory=set)
    """Groups of legs, by index, that have stepped to neutral since closing began."""
    recovering: bool = False
    """True from a restart on measured joint angles until the neutral stance is reached, else False."""
    refused: bool = False
    calibrated: bool = False
    """True if the estimator has been initialised since the start, else False: the robot does not walk."""
    held: bool = False
    """True while inputs are stale, so that no new step begins; False otherwise."""
    now: float = 0.0
    """Simulated time of the present tick, s."""
    lost: bool = False
    """True while the estimator restarts, else False."""
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Pose of frame odom in frame map: x, y (m), heading (rad); changes when the odometry restarts."""
    body: Array = field(default_factory=lambda: np.zeros(3))
    yaw: float = 0.0
    level: Array = field(default_factory=lambda: np.zeros(2))
    """Commanded roll and pitch of the trunk, (2,) rad."""
    felt: Array | None = None
    """Estimated roll and pitch with a lead by their rates at the last tick, (2,) rad; None = no estimate then."""
    skew: Array = field(default_factory=lambda: np.zeros(2))
    """Estimated less commanded roll and pitch of the trunk at the last lift-off, (2,) rad."""
    tilt_offset: Array = field(default_factory=lambda: np.zeros(2))
    """Learned correction of the estimated roll and pitch, (2,) rad, from the heights of standing feet on the map."""
    feet: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """Foot centres as commanded in the last tick, (L, 3) m, frame `map`."""
    footholds: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """Foot centres of the standing feet, (L, 3) m, frame `map`."""
    support: Array = field(default_factory=lambda: np.zeros(0))
    """Share of the planned load that each foot carries, 0..1, (L,)."""
    q: Array = field(default_factory=lambda: np.zeros(0))
    """Planned joint angles without compensation of the servos' sag, (nj,) rad."""
    command: Array | None = None
    measured: Array | None = None
    """Joint angles of the last encoder sample, (nj,) rad; None before the first."""
    measured_stamp: float = -1.0
    contacts: Flags = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    contacts_stamp: float = -1.0
    fresh: bool = False
    """True if a sample of the foot switches came in this tick, else False."""
    plan: StepPlan | None = None
    clock: float = 0.0
    """Time since the present step began, s."""
    landed: Flags = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    hanging: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """Number of samples in a row without contact of each foot that has landed in this step or stands, (L,)."""
    sunk: Array = field(default_factory=lambda: np.zeros(0))
    """Distance by which each standing foot without contact has been lowered to search the ground, (L,) m; set to 0 for
    a foot that touches when the trunk gets a `goal`."""
    group: int = 0
    """Index of the gait's group of legs that swings next."""
    attempts: int = 0
    scale: float = 1.0
    """Factor on the length of the next step after a refused plan, 0..1."""
    trunk_shift: float = 0.0
    """Change of trunk height requested by the foothold service, m, up positive."""
    adjusting: bool = False
    """True while the trunk moves to its height before the next plan, else False."""
    lean: Array = field(default_factory=lambda: np.zeros(2))
    """Offset of the trunk from its position in the gait to where the standing feet carry it, heading axes, (2,) m."""
    goal: Array | None = None
    """Position to which the trunk moves before the next plan so that the standing feet carry it, x, y, (2,) m, map;
    None = none."""
    shifts: int = 0
    """Number of movements of the trunk to `goal` tried for the present step."""
    steps: int = 0
    steps_in_walk: int = 0
    margin: float | None = None
    reason: str = ""
    status: tuple[str, ...] = ()
    unreachable: int = 0

    def __post_init__(self) -> None:
        n = self.legs
        self.feet, self.footholds = np.zeros((n, 3)), np.zeros((n, 3))
        self.support = np.ones(n)
        self.q = np.zeros(self.joints)
        self.contacts = np.zeros(n, dtype=np.bool_)
        self.landed = np.ones(n, dtype=np.bool_)
        self.hanging = np.zeros(n, dtype=np.int64)
        self.sunk = np.zeros(n)
        self.status = ("nominal",) * n
