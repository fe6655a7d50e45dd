"""Robot description: dataclasses with the content of a `robots/<name>/robot.toml`.

All angles in rad, all positions in m, in the trunk frame `base_link` unless another frame is stated.
Arrays are C-contiguous float64; treat them as read-only (kernels are compiled for plain arrays).
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array, Ints
from surefoot.tables import TableError


class RobotError(TableError):
    """Error of a robot description that cannot be used, with `code`, dotted `field` and `message`."""


class RolledLegs(NamedTuple):
    """Geometry of L roll-pitch-pitch legs: the second and third axis are parallel, and perpendicular to the first.

    Hip frame, at joint angles zero: x along the first axis, y along the second. Signs and rest angles refer to it.
    """

    hip: Array  # (L, 3) m, point of the first axis that is abreast of the femur joint, base_link
    rot: Array  # (L, 3, 3) rot_base_from_hip
    offset: Array  # (L, 2) m, foot along y, femur joint along z
    segment: Array  # (L, 2) m, femur and tibia in the plane of x and z; NaN if the leg is of another kind
    rest: Array  # (L, 2) rad, femur from z towards x, tibia from the femur, at joint angle zero
    side: Array  # (L, 3) signs: foot along z, bend of the knee, third axis along y


class KinematicModel(NamedTuple):
    """Link tree of a robot as arrays for numba kernels; link 0 is the trunk, parents come before children."""

    parent: Ints  # (nl,) index of the parent link, -1 for the trunk
    joint: Ints  # (nl,) joint that moves the link, -1 = fixed to its parent; links may share one (one motor)
    origin_pos: Array  # (nl, 3) link frame in the parent frame at joint angle zero
    origin_rot: Array  # (nl, 3, 3) rot_parent_from_link at joint angle zero
    axis: Array  # (nl, 3) unit joint axis in the link frame
    mass: Array  # (nl,) kg
    com: Array  # (nl, 3) centre of mass in the link frame
    foot_link: Ints  # (L,) link that carries the foot
    foot_point: Array  # (L, 3) foot centre in that link
    leg_joints: Ints  # (L, n) joints of each leg, hip first; -1 pads shorter legs
    hip: Array  # (L, 4) hip position and leg heading (about z), of yaw-pitch-pitch legs
    segment: Array  # (L, 3) coxa, femur, tibia length of yaw-pitch-pitch legs; NaN for others
    rolled: RolledLegs  # roll-pitch-pitch legs
    lower: Array  # (nj,)
    upper: Array  # (nj,)
    neutral: Array  # (nj,) angles of the neutral stance


@dataclass(frozen=True, eq=False)
class Servo:
    """Parameters of a position servo: torque = kp (command - q) - kv dq/dt, clipped."""

    kp: float  # Nm/rad
    kv: float  # Nm s/rad
    max_torque: float  # Nm
    armature: float  # kg m2
    frictionloss: float  # Nm
    resolution: float = 0.0  # rad, step of the set-point, 0 = exact
    backlash: float = 0.0  # rad, free play of the output shaft, end to end
    latency: float = 0.0  # s, between a set-point's arrival and its effect


@dataclass(frozen=True, eq=False)
class Joint:
    """Hinge joint of a link: limits `lower` and `upper` and neutral angle, rad, and its servo."""

    name: str
    link: int  # that it moves; the first one where one motor moves several
    lower: float
    upper: float
    neutral: float
    servo: Servo


@dataclass(frozen=True, eq=False)
class Link:
    """One rigid body of the link tree: pose in its parent, mass, inertia; its frame lies on the joint axis."""

    name: str
    parent: int  # -1 for the trunk
    joint: int  # -1 = fixed
    position: Array  # (3,) in the parent frame
    quat_wxyz: Array  # (4,) rot_parent_from_link at joint angle zero
    axis: Array  # (3,) in the link frame
    mass: float
    com: Array  # (3,) in the link frame
    inertia_box: Array  # (3,) full size of the homogeneous box that has the link's inertia about its CM
    inertia_quat_wxyz: Array  # (4,) rot_link_from_principal, the axes of that box

    @property
    def inertia(self) -> Array:
        """Principal moments of inertia about the centre of mass, axes by `inertia_quat_wxyz`, (3,) kg m2."""
        sq = self.inertia_box**2
        return self.mass / 12.0 * (np.sum(sq) - sq)


@dataclass(frozen=True, eq=False)
class Foot:
    """Contact end of a leg: a centre and one or more spheres of one radius."""

    link: int
    position: Array  # (3,) foot centre in the link frame
    points: Array  # (k, 3) sphere centres in the link frame
    radius: float


@dataclass(frozen=True, eq=False)
class Leg:
    """A limb that ends in a foot: indices of its joints and links, hip position, foot."""

    name: str
    joints: tuple[int, ...]
    links: tuple[int, ...]
    hip: Array  # (3,)
    foot: Foot


@dataclass(frozen=True, eq=False)
class Trunk:
    """The floating base of the robot, link 0: mass, size, and spheres for contact of its underside with the ground."""

    mass: float
    com: Array  # (3,)
    box: Array  # (3,) full size, centred in base_link
    belly: Array  # (k, 4) spheres under the trunk: x, y, z, radius


@dataclass(frozen=True, eq=False)
class AxisNoise:
    """Noise of one kind of inertial axis, SI (rad/s or m/s2): resolution `lsb`, range, white noise, bias."""

    lsb: float
    limit: float  # clips at +- limit
    noise_density: float  # per root Hz; sigma of a window mean = density * sqrt(rate / 2)
    bias_turn_on: float  # standard deviation
    bias_in_run: float  # standard deviation of the Gauss-Markov process
    bias_time_s: float


@dataclass(frozen=True, eq=False)
class ImuProfile:
    """Noise of an inertial unit, from a named file in `robots/sensors`."""

    name: str
    gyro: AxisNoise
    accel: AxisNoise


@dataclass(frozen=True, eq=False)
class ImuMount:
    """Pose of the inertial unit in the trunk, and its noise."""

    position: Array  # (3,)
    quat_wxyz: Array  # (4,) rot_base_from_imu
    profile: ImuProfile


@dataclass(frozen=True, eq=False)
class ContactSensor:
    """Foot sensor: switches with hysteresis, or a force sensor with a range; forces in N."""

    kind: str  # "switch" | "force"
    switches: int  # per foot
    on_n: float  # N, touch begins at this normal force
    off_n: float  # N, touch ends below it
    min_n: float  # N, smallest force a force sensor reports; 0 for switches
    max_n: float  # N, saturation; inf for switches


@dataclass(frozen=True, eq=False)
class Encoder:
    """Joint position sensor: resolution, and standard deviation of its constant zero error."""

    resolution: float  # rad, 0 = exact
    zero_sigma: float  # rad, standard deviation of the zero error


@dataclass(frozen=True, eq=False)
class CurrentSensor:
    """Current sensor of a servo: torque per ampere, and noise."""

    torque_per_ampere: float  # Nm/A
    noise_ampere: float


@dataclass(frozen=True, eq=False)
class Robot:
    """A validated robot description; legs, links and joints in the order of the file."""

    name: str
    kind: str  # "hexapod" | "quadruped" | "biped"
    description: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    legs: tuple[Leg, ...]
    trunk: Trunk
    imu: ImuMount
    contacts: ContactSensor
    encoder: Encoder
    current: CurrentSensor
    gait: dict[str, float]
    sources: dict[str, str]
    model: KinematicModel
    hash: str  # sha256 of the content that changes behaviour (no sources, no comments)
    camera: str | None = None  # profile of the landmark camera in `robots/cameras`
    ranger: str | None = None  # profile of ultrasound and bumpers in `robots/rangers`
    other_names: dict[str, str] = field(default_factory=dict[str, str])  # of joints in other software, by name here
    joint_names: tuple[str, ...] = field(init=False)
    joint_lower: Array = field(init=False)  # (nj,)
    joint_upper: Array = field(init=False)  # (nj,)
    neutral: Array = field(init=False)  # (nj,)
    foot_radii: Array = field(init=False)  # (L,) m
    mass: float = field(init=False)  # kg

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "joint_names", tuple(j.name for j in self.joints))
        put(self, "joint_lower", np.array([j.lower for j in self.joints]))
        put(self, "joint_upper", np.array([j.upper for j in self.joints]))
        put(self, "neutral", np.array([j.neutral for j in self.joints]))
        put(self, "foot_radii", np.array([leg.foot.radius for leg in self.legs]))
        # one after another: the same bits in every version of Python, which the built-in sum has not
        put(self, "mass", float(np.cumsum([link.mass for link in self.links])[-1]))

    @property
    def nj(self) -> int:
        """Number of joints of the robot."""
        return len(self.joints)

    @property
    def nlegs(self) -> int:
        """Number of legs of the robot."""
        return len(self.legs)

    @property
    def leg_names(self) -> tuple[str, ...]:
        """Names of the robot's legs, in the order of its description."""
        return tuple(leg.name for leg in self.legs)

    @property
    def servo(self) -> Servo:
        """Servo of the robot's first joint, for robots whose joints have one type of servo."""
        return self.joints[0].servo

    @property
    def foot_radius(self) -> float:
        """Radius of the foot spheres of the robot's first leg, m."""
        return self.legs[0].foot.radius
