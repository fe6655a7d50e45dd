"""Requests to the stability service, its replies, and its status while the robot walks (Walas & Belter, section 4).

Frame ``world``: any gravity-aligned frame, z up, metres. A region is the set of horizontal positions of the centre of
mass (CoM) for which the contacts can hold the robot at rest; polygons run counter-clockwise and are not closed.
"""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from .base import MAX_FEET, Message, PerJoint, QuatWxyz, Reply, Request, Vec2, Vec3

MAX_CONTACTS = 64
MAX_DIRECTIONS = 720

RegionStatus = Literal["ok", "infeasible", "unbounded", "point", "segment"]
SupportStatus = Literal["ok", "unbounded", "infeasible"]
ExtentStatus = Literal["ok", "unbounded", "infeasible", "missed"]
Twist4 = tuple[float, float, float, float]
Twist6 = tuple[float, float, float, float, float, float]
Polygon = tuple[Vec2, ...]


class Contact(Request):
    """A point where the robot may push against the ground, with a friction cone about the normal."""

    position: Vec3 = Field(description="contact point, frame world, m")
    normal: Vec3 = Field(description="normal of the ground towards the robot, frame world; any length but zero")
    mu: float | None = Field(description="static friction coefficient, 0 to 10 000, no unit; null = unlimited", ge=0)
    leg: str | None = Field(
        default=None, max_length=32, description="leg that stands here; null = the leg whose foot is nearest"
    )


Directions = Annotated[tuple[Vec2, ...], Field(min_length=1, max_length=MAX_DIRECTIONS)]


class RegionFields(Request):
    """Base of the requests for a region of the centre of mass: contacts, directions, accuracy and load case."""

    contacts: Annotated[tuple[Contact, ...], Field(max_length=MAX_CONTACTS)] = Field(description="0 to 64 contacts")
    directions: Annotated[int, Field(ge=1, le=MAX_DIRECTIONS)] | Directions | None = Field(
        default=None,
        description="number of equally spaced horizontal directions from +x on, or the directions themselves (frame "
        "world, any length but zero); null = adaptive",
    )
    adaptive: bool | None = Field(
        default=None,
        description="choose directions until inner and outer polygon differ by tolerance_m; default: when no "
        "directions are given; with directions: begin with them",
    )
    tolerance_m: float = Field(
        default=1e-4, gt=0, le=1.0, description="adaptive: largest distance between inner and outer polygon, m"
    )
    max_directions: int = Field(
        default=128,
        ge=4,
        le=MAX_DIRECTIONS,
        description="adaptive: at most so many directions, even if the tolerance is not met",
    )
    certificates: bool = Field(
        default=False, description="return the proof of each value: a virtual twist, the forces and the gap"
    )
    acceleration: Vec3 = Field(
        default=(0.0, 0.0, 0.0),
        description="m/s^2, of the centre of mass, frame world: then the region is cut at com_height_m",
    )
    tilt_rad: float = Field(
        default=0.0,
        ge=0,
        le=1.2,
        description="rad: gravity may lean by that to any of 8 sides, or not: what all nine have in common at "
        "com_height_m; not with directions or certificates",
    )
    com_height_m: float = Field(
        default=0.0, ge=-1e3, le=1e3, description="m, z of the CoM; matters with acceleration or tilt_rad only"
    )


class BasePose(Request):
    """Pose of base_link, frame world."""

    position: Vec3 = Field(default=(0.0, 0.0, 0.0), description="origin of base_link, frame world, m")
    quat_wxyz: QuatWxyz = Field(default=(1.0, 0.0, 0.0, 0.0), description="rotates base_link to world, order w x y z")


LEVEL = BasePose.model_construct()
"""Default pose of base_link (at the origin, level); made without a validator, so that an import builds none."""


class Actuation(Request):
    """Posture (joint angles, base pose) in which the servos hold the robot, and the torque limits of its joints."""

    joints: PerJoint = Field(description="joint angles, rad, order of the robot description")
    base: BasePose = Field(default=LEVEL, description="pose of base_link")
    robot: str | None = Field(
        default=None, min_length=1, max_length=64, description="name of the robot description; null = the service's own"
    )
    max_torque_nm: Annotated[float, Field(gt=0)] | PerJoint | None = Field(
        default=None, description="Nm, limit of every joint, or of each; null = those of the robot description"
    )


class RegionRequest(RegionFields):
    """Asks where the centre of mass may be: at rest, accelerated, with uncertain gravity, or with limited torques."""

    schema_version: ClassVar[str] = "1.1"
    actuation: Actuation | None = Field(
        default=None,
        description="asks for the region that the servos can hold too, in 16 directions unless others are given; each "
        "contact belongs to another leg of three joints; not with adaptive, acceleration or tilt_rad",
    )


class SupportPoint(Reply):
    """Farthest extent of the region of the centre of mass in one horizontal direction, with its proof."""

    direction: Vec2 = Field(description="unit direction a, frame world")
    value: float | None = Field(description="h(a) = largest a'c over the region, m; null unless status is ok")
    point: Vec2 | None = Field(description="point of the region where a'c = h(a), frame world, m")
    status: SupportStatus = Field(description="unbounded: without end that way; infeasible: the set holds nothing")
    gap: float | None = Field(default=None, description="duality gap, m: value is not exceeded, value - gap is reached")
    certificate: Twist4 | None = Field(
        default=None,
        description="(v_x, v_y, v_z, w_z): the twist u(r) = v + Om x r, Om = w_z e_z - a x e_z (v in m, Om a number), "
        "has n'u >= mu |u_t| at every contact, which proves a'c <= v_z",
    )
    forces: tuple[Vec3, ...] | None = Field(
        default=None, description="contact forces that hold the CoM at point, in units of the weight, frame world"
    )
    twist: Twist6 | None = Field(
        default=None,
        description="with acceleration, in place of certificate: (v, Om) with n'u >= mu |u_t| at every contact for "
        "u(r) = v + Om x r, which proves up'(v + Om x c) >= 0 for the CoM c, up = (0, 0, 9.81) + acceleration",
    )
    torques: tuple[Vec3, ...] | None = Field(
        default=None, description="with actuation: Nm, of the joints of each contact's leg, hip first, for these forces"
    )


class RegionReply(Reply):
    """Region of the CoM in which the contacts can hold the robot, with its status."""

    schema_version: ClassVar[str] = "1.1"
    status: RegionStatus = Field(
        description="ok: a polygon; infeasible: the contacts cannot hold the robot anywhere; unbounded: in some "
        "direction without end; point, segment: no area"
    )
    inner: Polygon = Field(description="points of the region, frame world, m: their hull lies inside it")
    outer: Polygon = Field(description="polygon that contains the region, frame world, m; empty if there is none")
    support: tuple[SupportPoint, ...] = Field(description="one entry per direction: in the order given, else by angle")
    gap: float | None = Field(default=None, description="largest distance of the outer polygon from the inner, m")
    area: float | None = Field(default=None, ge=0, description="area of the inner polygon, m^2")
    area_outer: float | None = Field(default=None, ge=0, description="area of the outer polygon, m^2")
    certificate: Twist4 | None = Field(
        default=None,
        description="when infeasible: twist (v_x, v_y, v_z, w_z) with n'u >= mu |u_t| at every contact and v_z < 0: "
        "the robot sinks however hard the contacts push",
    )
    twist: Twist6 | None = Field(
        default=None,
        description="when infeasible with acceleration, in place of certificate: (v, Om) with n'u >= mu |u_t| at every "
        "contact that moves every CoM against up = (0, 0, 9.81) + acceleration",
    )


class Doubt(Request):
    """Uncertainty of a stability check's inputs: standard deviations count `kappa` times, bounds fully."""

    com_sd_m: float = Field(default=0.0, ge=0, le=1, description="m, of the centre of mass, each horizontal axis")
    foot_sd_m: float = Field(default=0.0, ge=0, le=1, description="m, of each contact point, each axis")
    friction: float = Field(default=0.0, ge=0, le=10, description="every mu may be less by that, no unit")
    normal_rad: float = Field(default=0.0, ge=0, le=1.5, description="every normal may be off by that, rad")
    kappa: float = Field(default=3.0, ge=0, le=10, description="standard deviations that count")


class CheckRequest(RegionFields):
    """Asks whether the robot is stable, now and after a movement of its trunk over its feet (Walas & Belter 4.3,
    4.6)."""

    schema_version: ClassVar[str] = "1.4"
    com: Vec2 | None = Field(
        default=None, description="x, y of the centre of mass now, frame world, m; null = from joints and base"
    )
    movement: Vec3 = Field(default=(0.0, 0.0, 0.0), description="planned movement of the trunk, frame world, m")
    joints: PerJoint | None = Field(
        default=None, description="joint angles now, rad, order of the robot description: for the CoM and its shift"
    )
    base: BasePose = Field(default=LEVEL, description="pose of base_link now; used with joints")
    robot: str | None = Field(
        default=None, min_length=1, max_length=64, description="name of the robot description; null = the service's own"
    )
    doubt: Doubt | None = Field(default=None, description="asks for margin_robust, which allows for it")
    gradient: bool = Field(default=False, description="asks how the margin changes with CoM, friction and feet")
    actuation: Actuation | None = Field(
        default=None,
        description="asks for the regions that the servos can hold too, as in RegionRequest; it brings the posture: "
        "margin, gsm and polygons are of the one after the movement, margin_now and extent of the one now, all to the "
        "edge of the inner polygon; not with joints, base, robot, adaptive, acceleration, tilt_rad, doubt, gradient",
    )
    polygons: bool = Field(default=True, description="false: leave inner, outer and support empty (a smaller reply)")


class MarginGradient(Reply):
    """Gradient of the margin by centre of mass, friction and positions of contacts; of equally near edges, by one."""

    com: Vec2 = Field(description="d margin / d com, no unit")
    mu: tuple[float, ...] = Field(description="m, d margin / d mu of each contact; 0 where mu is null")
    position: tuple[Vec3, ...] = Field(description="d margin / d position of each contact, no unit")


class CheckReply(RegionReply):
    """Reply to a stability check: region and margins of the centre of mass before and after a movement of the trunk."""

    schema_version: ClassVar[str] = "1.2"
    stable: bool = Field(description="status is ok and margin >= 0")
    margin: float | None = Field(
        description="m, signed distance of the CoM after the movement to the edge of the region, positive inside; null "
        "when there is no region, or no edge"
    )
    margin_now: float | None = Field(description="m, the same for the CoM now")
    margin_robust: float | None = Field(
        default=None,
        description="m, margin left with the uncertainty `doubt` of the request; null: none was given, or no margin",
    )
    gradient: MarginGradient | None = Field(
        default=None, description="of margin; null: not asked for, or there is no area, or no edge"
    )
    extent: float | None = Field(description="m, way along the movement from the CoM now to the edge of the region")
    gsm: float | None = Field(
        description="m, geometric stability margin: signed way along the movement from the CoM after the movement to "
        "the edge (negative: the edge lies behind); null without horizontal movement"
    )
    extent_status: ExtentStatus | None = Field(
        default=None, description="why extent is null; missed: the line along the movement does not meet the region"
    )
    gsm_status: ExtentStatus | None = Field(default=None, description="why gsm is null; as extent_status")
    com: Vec2 = Field(description="CoM now, frame world, m")
    com_after: Vec2 = Field(description="CoM after the movement = com + movement + shift, frame world, m")
    shift: Vec3 = Field(
        description="m, frame world: CoM shift in the trunk while the feet stay (r_KIN); zero without joints"
    )
    stance: tuple[str, ...] = Field(default=(), description="legs whose feet were held in place for the shift")
    reachable: bool = Field(default=True, description="every stance leg reaches its foot after the movement")


class EquilibriumRequest(Request):
    """Asks for contact forces that hold the robot with its centre of mass at a given place."""

    schema_version: ClassVar[str] = "1.1"
    contacts: Annotated[tuple[Contact, ...], Field(max_length=MAX_CONTACTS)] = Field(description="contacts")
    com: Vec2 = Field(description="x, y of the centre of mass, frame world, m")
    com_height_m: float = Field(
        default=0.0, description="m, z of the centre of mass; matters when it accelerates sideways only"
    )
    acceleration: Vec3 = Field(default=(0.0, 0.0, 0.0), description="m/s^2, of the centre of mass, frame world")
    weight_n: float = Field(default=1.0, gt=0, description="N, weight of the robot; 1 = forces in units of the weight")


class EquilibriumReply(Reply):
    """Contact forces that hold the robot, or the proof (a twist) that there are none."""

    schema_version: ClassVar[str] = "1.2"
    held: bool = Field(description="there are such forces")
    forces_n: tuple[Vec3, ...] | None = Field(
        description="N, per contact, frame world: the smallest sum of squares; null if not held"
    )
    friction_share: float | None = Field(
        description="smallest share of every friction coefficient that still holds, 0 to 1, with normal forces that "
        "sum up to minmax_load_n at most; null if not held"
    )
    minmax_forces_n: tuple[Vec3, ...] | None = Field(
        default=None,
        description="N, per contact, frame world: forces whose largest share of friction is friction_share (min-max), "
        "|f_t| <= friction_share mu n'f at every contact of limited friction; null if not held",
    )
    minmax_load_n: float | None = Field(
        default=None,
        description="N, limit of the sum of all normal forces behind friction_share: 100 weights (with acceleration "
        "m |g + a|), or twice those of some forces that hold, where these are more; between facing walls the share "
        "falls towards 0 the harder the robot presses; null if not held",
    )
    certificate: tuple[float, float, float, float, float, float] | None = Field(
        default=None,
        description="when not held: twist (v, Om) about the origin of the frame with n'u >= mu |u_t| at every contact "
        "that lowers the CoM: the robot falls however the contacts push",
    )


class ComRequest(Request):
    """Asks where the centre of mass is: by kinematics and, with torques, by the forces under the feet."""

    schema_version: ClassVar[str] = "1.1"
    joints: PerJoint = Field(description="joint angles, rad, order of the robot description")
    base: BasePose = Field(default=LEVEL, description="pose of base_link")
    torque: PerJoint | None = Field(default=None, description="torques of the servos on the joints, Nm; null = unknown")
    touch: Annotated[tuple[bool, ...], Field(max_length=MAX_FEET)] | None = Field(
        default=None, description="per foot: on the ground, order of the robot description; null = all"
    )
    load_n: Annotated[tuple[float | None, ...], Field(max_length=MAX_FEET)] | None = Field(
        default=None,
        description="per foot: force along the ground's normal by a sensor under it, N (0 = below its "
        "range), fused with the torques; null = no sensor",
    )
    known_weight: bool = Field(
        default=False,
        description="true: the robot carries no load, so its weight shows the common factor of all torques",
    )
    tilt_sd_rad: float = Field(default=0.0, ge=0, le=1, description="rad, standard deviation of roll and pitch of base")
    robot: str | None = Field(
        default=None, min_length=1, max_length=64, description="name of the robot description; null = the service's own"
    )


class ComReply(Reply):
    """Position of the centre of mass by kinematics and by foot forces, and the factor that corrects the torques."""

    schema_version: ClassVar[str] = "1.1"
    com: Vec3 = Field(description="m, frame world: by kinematics")
    mass_kg: float = Field(gt=0, description="kg, mass of the robot description")
    com_measured: Vec2 | None = Field(description="m, frame world: by foot forces; null = no torques, or not observed")
    covariance: tuple[float, float, float, float] | None = Field(
        default=None, description="m^2, row-major 2x2 covariance of com_measured"
    )
    weight_n: float | None = Field(default=None, description="N, sum of the vertical foot forces")
    misfit: float | None = Field(
        default=None,
        description="chi-square with 3 degrees of freedom of what must vanish at rest; large = not at rest",
    )
    forces_n: tuple[Vec3, ...] | None = Field(
        default=None, description="N, ground on each foot, frame world, order of the legs; zero where not observed"
    )
    observed: Annotated[tuple[bool, ...], Field(max_length=MAX_FEET)] = Field(
        default=(), description="per foot: the torques determine the force in this posture, or a sensor does"
    )
    gain: float | None = Field(
        default=None, description="factor of all torques by the known weight; null = not asked, or not observed"
    )


class StabilityStatus(Message):
    """Static stability while the robot stands or walks.

    Frame ``level``: origin of base_link, z up by the estimated gravity, x along the heading of the trunk.
    """

    status: RegionStatus = Field(description="as in RegionReply; infeasible also when no foot touches")
    stance: Annotated[tuple[bool, ...], Field(max_length=MAX_FEET)] = Field(description="per foot: taken as a contact")
    region: Annotated[tuple[Vec2, ...], Field(max_length=MAX_DIRECTIONS)] = Field(
        description="inner polygon of the support region, frame level, m, counter-clockwise, not closed"
    )
    com_planned: Vec2 | None = Field(description="CoM by kinematics from the measured joints, frame level, m")
    com_measured: Vec2 | None = Field(description="CoM from foot forces, frame level, m; null = not measured")
    margin_planned: float | None = Field(description="m, signed distance of com_planned to the edge, positive inside")
    margin_measured: float | None = Field(description="m, the same for com_measured")
    weight_n: float | None = Field(default=None, description="N, sum of the measured foot forces; null = not measured")
    mu: float = Field(ge=0, description="friction coefficient taken for every foot, no unit")
    fresh: bool = Field(default=True, description="joints, contacts and tilt came within the last 100 ms")
