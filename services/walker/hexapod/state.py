"""Everything the hexapod walker remembers from one tick to the next."""

from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from .patterns import TRIPOD, GaitPattern
from .planning import StepPlan
from .route import HexapodRoute

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]


class Stage(Enum):
    """What the legs are doing."""

    WAIT = "wait"  # no joint sample yet
    SETTLE = "settle"  # bringing every foot to the ground
    STAND = "stand"
    STEP = "step"


@dataclass(eq=False)
class WalkerState:
    """State of the walker; frame map unless said otherwise."""

    legs: int
    joints: int
    stage: Stage = Stage.WAIT
    gait: GaitPattern = TRIPOD
    """In use."""
    usual: GaitPattern = TRIPOD
    """As asked for; another one is in use after a step that was not safe."""
    swung: tuple[int, ...] = ()
    """Legs of the last step."""
    careful_steps: int = 0
    """Steps taken in the other gait."""
    route: HexapodRoute | None = None
    walk_id: int = 0
    closing: bool = False
    """Bringing the feet to neutral: after a command, on stop, after a restart."""
    closed: set[tuple[int, ...]] = field(default_factory=set)
    """Groups that have stepped to neutral since closing began."""
    recovering: bool = False
    """Restarted from measured joints and not yet in the neutral stance."""
    refused: bool = False
    calibrated: bool = False
    """The estimator has been initialised since the start."""
    held: bool = False
    """Inputs are stale: no new step begins."""
    now: float = 0.0
    """Simulated time, s."""
    lost: bool = False
    """The estimator began anew and has not found its feet yet."""
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Pose of odom in the map: x, y (m), heading (rad); changes when the odometry begins anew."""
    body: Array = field(default_factory=lambda: np.zeros(3))
    yaw: float = 0.0
    level: Array = field(default_factory=lambda: np.zeros(2))
    """Commanded roll and pitch."""
    tilt_offset: Array = field(default_factory=lambda: np.zeros(2))
    """Learned correction of the estimated roll and pitch, from the heights of standing feet on the map."""
    feet: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """Foot centres as commanded in the last tick, (L, 3)."""
    footholds: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """Where each standing foot stands, (L, 3)."""
    support: Array = field(default_factory=lambda: np.zeros(0))
    """Share of each foot in the planned load, 0..1, (L,)."""
    q: Array = field(default_factory=lambda: np.zeros(0))
    """Planned joint angles without sag compensation, (nj,)."""
    command: Array | None = None
    measured: Array | None = None
    """Last joint sample, (nj,)."""
    measured_stamp: float = -1.0
    contacts: Flags = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    contacts_stamp: float = -1.0
    fresh: bool = False
    """A contact sample came in this tick."""
    plan: StepPlan | None = None
    clock: float = 0.0
    """Time since the step began, s."""
    landed: Flags = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    hanging: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """Samples in a row in which the switch of a foot that has landed in this step was open, (L,)."""
    group: int = 0
    """Group of the gait that swings next."""
    attempts: int = 0
    scale: float = 1.0
    """Shortens the next step after a refused plan."""
    trunk_shift: float = 0.0
    """Change of trunk height asked for by the foothold service, m."""
    adjusting: bool = False
    """The trunk moves to its height before the next plan."""
    goal: Array | None = None
    """Where the trunk goes before the next plan, so that the standing feet carry it, (2,) m."""
    shifts: int = 0
    """Such movements tried for the present step."""
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
        self.status = ("nominal",) * n
