"""Inputs and outputs of gaits: plain frozen dataclasses, arrays in SI, frames in the docstrings of the fields.

Frame `odom` is the frame of the odometry; a scenario starts with `map` = `odom`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from surefoot.arrays import Array, Flags

Vec3 = tuple[float, float, float]

WalkState = Literal["waiting", "standing", "walking", "stopping", "turning", "recovering", "refused", "hold"]
Action = Literal["walk", "turn", "stand", "stop"]


@dataclass(frozen=True, slots=True)
class WalkerInputs:
    """Inputs of a gait in one control tick: estimate of the trunk, joint angles, foot switches, stability margin."""

    stamp: float
    """Simulated time of the tick, s."""
    roll: float = 0.0
    """Estimated roll of base_link, rad."""
    pitch: float = 0.0
    """Estimated pitch of base_link, rad."""
    rate: Vec3 = (0.0, 0.0, 0.0)
    """Estimated angular velocity of the trunk, rad/s, base_link axes; bipeds balance by it."""
    x: float = 0.0
    """Dead-reckoned x of base_link, m, frame odom."""
    y: float = 0.0
    yaw: float = 0.0
    """Dead-reckoned heading of base_link, rad, frame odom, not wrapped."""
    estimate_stamp: float = 0.0
    """Simulated time of the sensor sample behind the estimate, s."""
    initialised: bool = False
    """True if the estimator has finished its standstill calibration; False = the walker waits."""
    joints: Array | None = None
    """Measured joint angles of a sample released in this tick, (nj,) rad; None = no sample."""
    contacts: Flags | None = None
    """True for each closed foot switch in a sample released in this tick, (L,); None = no sample."""
    margin: float | None = None
    """Signed static stability margin published for the previous tick, m; None = not published."""


@dataclass(frozen=True, slots=True)
class WalkerOutputs:
    """Outputs of a gait in one control tick: joint set-points, feet and footholds, progress of the command."""

    command: Array | None
    """Joint set-points, (nj,) rad; None until the first joint sample."""
    state: WalkState
    walk_id: int
    phase: float
    """Phase of the present step, 0..1; 0 between steps."""
    stance: Flags
    """True for each foot planned on the ground, False for each planned in the air, (L,)."""
    footholds: Array
    """Present or planned foot CENTRES (of a biped: soles), (L, 3) m, frame map; of a biped odom."""
    foothold_status: tuple[str, ...]
    """Status of each foot's foothold: ok, raise_trunk, infeasible, nominal (none was requested), no_answer."""
    trunk_height: float
    """Planned height of base_link over the ground under the mean foothold, m."""
    remaining: float
    """Remaining distance of a walk, m, or angle of a turn, rad."""
    margin: float | None
    """Static stability margin of the last step check, m; None = no check."""
    reason: str
    """Reason in words for which a step was refused or degraded; empty when all is well."""
    steps: int
    """Number of steps finished since the start."""
    unreachable: int
    """Number of feet whose target was out of reach in this tick."""
    ends_in_s: float | None = None
    """Time until the last planned step of the command lands, s; None = no command is under way, or unknown."""


@dataclass(frozen=True, slots=True)
class MotionCommand:
    """Command to a gait to walk, turn, stand or stop; a later command replaces an earlier one."""

    action: Action
    distance: float | None = None
    """Distance of a walk along the heading, m, negative = backward; None = until another command."""
    velocity: float | None = None
    """Speed of a walk along the heading, m/s; None = the gait's own speed."""
    angle: float | None = None
    """Angle of a turn, or of the arc of a biped's walk, rad, left positive; None = not given."""
    gait: str | None = None
    """Name of the gait to walk; None = the default gait."""
    duration: float | None = None
    """Time from the first step on after which a walk or turn ends, s; None = no limit."""
    shift: tuple[float, float] | None = None
    """Position of the standing trunk, m forward and left of the middle of its feet; None = it stays."""
    learn: bool = True
    """True if a biped may correct its next steps by odometry; False for a command of the navigator, which estimates the
    drift itself: two corrections of one drift add up."""


@dataclass(frozen=True, slots=True)
class CommandReply:
    """Immediate reply to a command: accepted, or refused with a code and a reason."""

    accepted: bool
    walk_id: int = 0
    code: str = ""
    """Error code of a refused command, empty = accepted: not_initialised, unknown_gait, unsupported, bad_value,
    missing_field, conflict, too_fast, too_tight or fallen."""
    field: str | None = None
    """Name of the field that was refused; None = accepted, or the robot's state is the cause."""
    reason: str = ""
    """Reason of a refusal in words, empty when the command was accepted."""


def refused(code: str, field: str | None, reason: str) -> CommandReply:
    """Return a refusal: code, wrong field, and words with the received value and the allowed ones."""
    return CommandReply(False, 0, code, field, reason)


@dataclass(frozen=True, slots=True)
class FootholdRequest:
    """Part of a foothold request that belongs to one leg."""

    leg: int
    nominal: Vec3
    """Default landing of the foot CENTRE, map frame, m, used if no better foothold is found."""
    stroke: Vec3
    """Movement of the foot relative to the body in the coming stance, map axes, m (backward in a forward walk)."""


@dataclass(frozen=True, slots=True)
class LandingRequest:
    """Request for the footholds of all legs that swing together, with the trunk pose at their landing."""

    body: Vec3
    """Planned base_link position at touch-down, map frame, m."""
    yaw: float
    """Planned heading of base_link at touch-down, rad, map frame."""
    legs: tuple[FootholdRequest, ...]


@dataclass(frozen=True, slots=True)
class FootholdReply:
    """Foothold chosen for one leg, or the reason why there is none."""

    status: Literal["ok", "raise_trunk", "infeasible", "no_answer"]
    """ok: chosen; raise_trunk: in reach after `trunk_shift`; infeasible: there is none; no_answer: the service did not
    reply, and `foothold` is the nominal one."""
    foothold: Vec3 | None = None
    """Chosen landing of the foot CENTRE, map frame, m; None = no foothold was found."""
    trunk_shift: float = 0.0
    """Change of the trunk's height that makes the foothold reachable, m, up positive; used with status raise_trunk."""
    reason: str = ""


@dataclass(frozen=True, slots=True)
class StanceCheck:
    """Request to check a planned step for stability: standing feet, and the motion of the trunk over them."""

    positions: Array
    """Contact points of the stance feet, map frame, (n, 3) m."""
    normals: Array
    """Unit normals of the ground at the contact points, map frame, (n, 3)."""
    mu: float
    joints: Array
    """Planned joint angles of the stance, (nj,) rad."""
    base_position: Array
    """Position of base_link, (3,) m, map frame."""
    base_quat: Array
    """Rotation from base_link to the map as a quaternion w, x, y, z, (4,)."""
    movement: Vec3
    """Planned movement of the trunk in the step, map axes, m."""
    legs: tuple[str, ...] = ()
    """Name of the leg that each contact point in `positions` belongs to."""


@dataclass(frozen=True, slots=True)
class StanceVerdict:
    """Result of the stability check of a planned step: whether the robot stays stable, and its margin."""

    stable: bool
    margin: float | None = None
    """Least signed static margin before and after the movement, m, None = none; the region is convex, so it is no less
    in between."""
    status: str = "ok"
    region: Array | None = None
    """Corners of the region of safe centres of mass, counter-clockwise, (k, 2) m, map frame; None = it has no area."""
    com: Array | None = None
    """Horizontal position of the centre of mass before the movement, (2,) m, map frame; None = unknown."""
    com_after: Array | None = None
    """Horizontal position of the centre of mass after the movement, (2,) m, map frame; None = unknown."""


Select = Callable[[LandingRequest], Sequence[FootholdReply]]
Check = Callable[[StanceCheck], StanceVerdict]


@dataclass(frozen=True, slots=True)
class BodyPose:
    """Pose of base_link: x, y and height in m, heading in rad."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    yaw: float = 0.0


@dataclass(frozen=True, slots=True)
class Advance:
    """Movement of the trunk in one step, heading axes: forward and left, m, turn to the left, rad."""

    forward: float = 0.0
    left: float = 0.0
    turn: float = 0.0
