"""Neutral posture and gait parameters of an imported robot, from its leg lengths, masses and joint limits."""

import itertools
import math

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.rotations import wrap_angle
from surefoot.robot.damped_legs import damped_ik
from surefoot.robot.description import Robot
from surefoot.robot.kinematics import foot_positions, forward
from surefoot.services.walker.biped.ik import leg_geometry

from .anatomy import SAME_M

LEG_JOINTS = 3
"""Least number of joints with which a leg can place its foot at any point within its reach."""
EXTENSION = 0.72
"""Distance from a leg's second joint to its foot in a generated neutral posture, as a share of the leg length."""
BENT = (0.45, 0.93)
"""Range of the distance from second joint to foot, share of the leg length; outside it a posture is generated."""
CHOSEN, UPRIGHT = 0.3, 0.97
"""Least downward share of the vector from second joint to foot; below it a posture is generated. `CHOSEN`: for a
posture named in the file; `UPRIGHT`: for the middle of the joint limits."""
ONE_SIDE, LEAST_DOWN, ALONG = 0.8, 0.3, 0.9
"""`ONE_SIDE`: length of the mean unit vector from second joint to foot above which that vector counts as down;
`LEAST_DOWN`: its share along -z below which a warning on the axes is given; `ALONG`: share of a joint axis along x, y
or z above which the axis counts as parallel to it."""
OUTWARD = 0.46
"""Level distance from second joint to foot in a generated posture of a leg whose first axis is vertical, as a share of
the leg length: a foot close to that axis cannot follow a trunk that leans. Of crabs with six kinds of legs none walks
worse with it than with 0.35 or 0.42."""
TURNED = 0.4
"""Largest angle of the first joint of an insect's leg from the middle of its range, as a share of half of that range,
in a generated posture of a robot with four legs."""
TRIES = 64
"""Number of random start postures of the inverse kinematics that searches a standing posture of a leg."""
MOST_TORQUE = 4.0
"""Largest plausible servo torque, in multiples of (robot weight x leg length); larger values count as placeholders."""
SIZE_M, PERIOD_S, LEAN_S = 0.42, 1.0, 0.4
"""`SIZE_M`: leg length of the reference robot Lupo, m; `PERIOD_S`: its gait period, s; `LEAN_S`: duration of its lean
before a step, s. Durations of other robots scale with the square root of the leg length."""
STRIDE, MOST_STRIDE, CLEARANCE = 0.45, 0.55, 0.12
"""Gait of a quadruped as shares of the leg length: `STRIDE`: distance that the trunk travels per gait cycle;
`MOST_STRIDE`: largest such distance; `CLEARANCE`: step height."""
SPRAWLED_STRIDE, INSECT_STRIDE = 0.22, 0.3
"""Distance that the trunk travels per gait cycle, as a share of the leg length, on six legs; on four of an insect."""
NAO_LEG_M = 0.203
NAO_WAYS = {
    "step_m": 0.05, "max_step_m": 0.06, "quick_m": 0.03, "lift_m": 0.02, "zmp_x_m": 0.01, "zmp_y_m": 0.006,
    "close_m": 0.003,
}  # fmt: skip
NAO_TIMES = {"step_s": 0.9, "quick_s": 0.4, "start_s": 1.0}
"""`NAO_LEG_M`: leg length of Nao, m; `NAO_WAYS`, m, and `NAO_TIMES`, s: its gait, scaled for other bipeds."""
LEAN_SHARE = 0.55
"""Stability margin required before a foot lifts, as a share of the radius of the circle inscribed in the other feet."""
MOST_LEAN, INSECT_LEAN = 0.17, 0.13
"""Largest such margin, as a share of the leg length: legs that stand far apart do not reach further; those that turn
about the vertical first (`INSECT_LEAN`) less far."""
SWAY = 0.36
"""Largest displacement of the zero-moment point by the trunk's acceleration, as a share of the stability margin."""


def can_stand(robot: Robot) -> bool:
    """Return True if the robot has more than two legs, each with at least `LEG_JOINTS` joints, else False."""
    return robot.nlegs > 2 and all(len(leg.joints) >= LEG_JOINTS for leg in robot.legs)


def leg_length(robot: Robot) -> float:
    """Return the leg length, m: length of the links from the second joint to the foot, mean over the legs."""
    _, pos = forward(robot.model, robot.neutral)
    feet, total = foot_positions(robot.model, robot.neutral), 0.0
    for leg, foot in zip(robot.legs, feet, strict=True):
        way = [*(pos[robot.joints[j].link] for j in leg.joints[1:]), foot]
        total += sum(float(np.linalg.norm(b - a)) for a, b in itertools.pairwise(way))
    return total / robot.nlegs


def standing(robot: Robot, chosen: bool) -> Array:
    """Return joint angles (nj,) rad of a stance on bent legs: the neutral posture if all legs are bent in it.

    Else each foot is placed below the second joint of its leg, or, where the first axis is vertical, below and outside
    of it. Of the postures found, those with the third joint behind the second are preferred for legs that swing along
    the trunk, then the one with the smallest angles.

    Args:
        robot: robot for which `can_stand` is True.
        chosen: True: the neutral posture is named in the imported file; False: it is the middle of the joint limits.
    """
    length, least = leg_length(robot), CHOSEN if chosen else UPRIGHT
    arms = [_arm(robot, robot.neutral, i) for i in range(robot.nlegs)]
    sizes = [float(np.linalg.norm(arm)) for arm in arms]
    if all(BENT[0] <= s / length <= BENT[1] and -a[2] > least * s for a, s in zip(arms, sizes, strict=True)):
        return robot.neutral
    angles = robot.neutral.copy()
    for i, leg in enumerate(robot.legs):
        found = _under(robot, i, length)
        if found is not None:
            angles[list(leg.joints)] = found
    return angles


def doubts_of_axes(robot: Robot) -> list[str]:
    """Return warnings on evidence against a trunk with x forward and z up in the neutral posture; empty: none.

    Feet that all lie to one side of the hips indicate where down is. The knees of legs whose first axis is level
    should turn about the axis that points left, y.

    Args:
        robot: robot for which `can_stand` is True, with the neutral posture of the imported file.
    """
    rot, _ = forward(robot.model, robot.neutral)
    arms = np.array([_arm(robot, robot.neutral, i) for i in range(robot.nlegs)])
    sizes = np.linalg.norm(arms, axis=1)
    apart = sizes > SAME_M  # a foot at the joint has no direction
    down = (arms[apart] / sizes[apart, None]).sum(axis=0) / max(int(apart.sum()), 1)
    found, advice = list[str](), "better: a trunk with x forward and z up in a copy of the file"
    if np.linalg.norm(down) > ONE_SIDE and -down[2] < LEAST_DOWN * np.linalg.norm(down):
        k = int(np.abs(down).argmax())
        found.append(f"axes of the trunk: z is up, but the feet lie along {'-+'[int(down[k] > 0)]}{'xyz'[k]}; {advice}")
    links = [[robot.joints[leg.joints[k]].link for leg in robot.legs] for k in (0, 2)]
    first, knee = (np.mean([np.abs(rot[i] @ robot.links[i].axis) for i in each], axis=0) for each in links)
    if first[2] < ALONG and knee.argmax() != 1 and knee.max() > ALONG:
        found.append(f"axes of the trunk: y is left, but the knees turn about {'xyz'[int(knee.argmax())]}; {advice}")
    return found


def turns_first(robot: Robot, leg: int) -> bool:
    """Return True if the first axis of a leg is vertical in the neutral posture, as of a yaw-pitch-pitch leg."""
    link = robot.joints[robot.legs[leg].joints[0]].link
    return abs(float((forward(robot.model, robot.neutral)[0][link] @ robot.links[link].axis)[2])) > ALONG


def _outward(robot: Robot, leg: int, q: Array) -> Array:
    """Return the level direction in which an insect's leg stands out, (2,); q: joint angles, (n,) rad.

    That is the direction from the first to the second joint; of a robot with four legs that to its corner, so that feet
    make a square, or the nearest to it that leaves the first joint most of its range on either side.
    """
    rot, pos = forward(robot.model, q)
    joint = robot.legs[leg].joints[0]
    link = robot.joints[joint].link
    first, arm = pos[link, :2], pos[robot.joints[robot.legs[leg].joints[1]].link, :2] - pos[link, :2]
    long = np.linalg.norm(arm) > SAME_M
    way = arm if robot.nlegs != 4 and long else np.sign(first) if robot.nlegs == 4 else first
    if robot.nlegs == 4 and long:
        sense = math.copysign(1.0, (rot[link] @ robot.links[link].axis)[2])
        now, wanted = math.atan2(arm[1], arm[0]), math.atan2(way[1], way[0])
        lower, upper = robot.joint_lower[joint], robot.joint_upper[joint]
        middle, most = 0.5 * (lower + upper), 0.5 * TURNED * (upper - lower)
        turned = np.clip(q[joint] + sense * wrap_angle(wanted - now), middle - most, middle + most)
        angle = now + sense * (turned - q[joint])
        way = np.array([math.cos(angle), math.sin(angle)])
    return way / max(float(np.linalg.norm(way)), SAME_M)


def _arm(robot: Robot, q: Array, leg: int) -> Array:
    """Return the vector from a leg's second joint to its foot, (3,) m, base_link, at joint angles q (n,) rad."""
    second = robot.joints[robot.legs[leg].joints[1]].link
    return foot_positions(robot.model, q)[leg] - forward(robot.model, q)[1][second]


def _under(robot: Robot, leg: int, length: float) -> Array | None:
    """Return joint angles of a leg of `length` m in a bent stance, rad; None if none were found."""
    joints, q = list(robot.legs[leg].joints), robot.neutral.copy()
    q[joints[0]] = min(max(0.0, robot.joint_lower[joints[0]]), robot.joint_upper[joints[0]])
    second, third = (robot.joints[j].link for j in joints[1:3])
    _, pos = forward(robot.model, q)
    if turns_first(robot, leg):
        way, first = _outward(robot, leg, q), pos[robot.joints[joints[0]].link]
        away = OUTWARD * length + float(np.linalg.norm(pos[second, :2] - first[:2]))
        below = math.sqrt(EXTENSION**2 - OUTWARD**2) * length
        target = np.array([*(first[:2] + away * way), pos[second, 2] - below])
    else:
        target = pos[second] + np.array([0.0, _arm(robot, q, leg)[1], -EXTENSION * length])
    lower, upper = robot.joint_lower[joints], robot.joint_upper[joints]
    random, found = np.random.default_rng(leg), list[tuple[bool, float, Array]]()
    for _ in range(TRIES):
        q[joints] = random.uniform(np.maximum(lower, -math.pi), np.minimum(upper, math.pi))
        angles, reached = damped_ik(robot.model._replace(neutral=q), leg, target)
        turned = angles - 2.0 * math.pi * np.round(angles / (2.0 * math.pi))
        angles = np.where((turned >= lower) & (turned <= upper), turned, angles)
        if reached:
            q[joints] = angles
            _, pos = forward(robot.model, q)
            ahead = not turns_first(robot, leg) and bool(pos[third][0] > pos[second][0])
            found.append((ahead, round(float(np.abs(angles).sum()), 6), angles))
    return min(found, key=lambda each: each[:2])[2] if found else None


def gait_numbers(robot: Robot) -> dict[str, float]:
    """Return the parameters of the table `[gait]` in robot.toml, by name, scaled by leg length and neutral posture."""
    length, feet = leg_length(robot), foot_positions(robot.model, robot.neutral)
    height = float(-feet[:, 2].mean()) + robot.foot_radius
    slower = math.sqrt(length / SIZE_M)
    numbers = {
        "period_s": PERIOD_S * slower, "hip_height_m": height, "clearance_m": CLEARANCE * length, "overlap": 0.1,
        "level_gain": 0.025, "level_limit_rad": 0.25, "stride_m": SPRAWLED_STRIDE * length,
        "max_stride_m": 1.4 * SPRAWLED_STRIDE * length,
    }  # fmt: skip
    if robot.kind == "quadruped":
        margin = LEAN_SHARE * min(_inner_circle(np.delete(feet[:, :2], i, axis=0)) for i in range(robot.nlegs))
        insect = all(turns_first(robot, i) for i in range(robot.nlegs))
        margin = min(margin, (INSECT_LEAN if insect else MOST_LEAN) * length)
        stride, most = (INSECT_STRIDE, 1.4 * INSECT_STRIDE) if insect else (STRIDE, MOST_STRIDE)
        numbers |= {
            "stride_m": stride * length, "max_stride_m": most * length, "lean_margin_m": margin,
            "lean_s": LEAN_S * slower, "lean_acceleration": SWAY * margin * GRAVITY / height,
        }  # fmt: skip
    return {name: round(value, 4) for name, value in numbers.items()}


def gait_on_two(robot: Robot) -> dict[str, float]:
    """Return the parameters of the table `[gait]` of a robot with two legs, by name: those of Nao scaled by leg length.

    Ways grow with the length, durations with its square root.

    Raises:
        RobotError: the legs are not of the kind that walks.
    """
    geometry = leg_geometry(robot)
    scale = (geometry.thigh + geometry.shin) / NAO_LEG_M
    numbers = {name: value * scale for name, value in NAO_WAYS.items()}
    numbers |= {name: value * math.sqrt(scale) for name, value in NAO_TIMES.items()}
    ahead = float(np.mean([leg.foot.position[0] for leg in robot.legs]))
    numbers |= {"zmp_x_m": min(numbers["zmp_x_m"], max(ahead, 0.0)), "crouch": 0.9}
    return {name: round(value, 4) for name, value in numbers.items()}


def _inner_circle(corners: Array) -> float:
    """Return the radius, m, of the inscribed circle of a triangle with `corners` (3, 2) m."""
    a, b = corners[1] - corners[0], corners[2] - corners[0]
    around = float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).sum())
    return abs(float(a[0] * b[1] - a[1] * b[0])) / around


def torque_limit(robot: Robot) -> float:
    """Return the torque of the robot's whole weight at a lever of its leg length, Nm."""
    return robot.mass * GRAVITY * leg_length(robot)
