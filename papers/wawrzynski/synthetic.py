"""Seeded synthetic walks with exact truth, for tests, studies and the reproduction of Wawrzynski et al.

Their robot is a biped of 35 cm that walks 3.57 cm/s with steps of 0.5 s, IMU at 100 Hz, servo encoders of 0.293 deg
and foot switches at 30 Hz. Their Table I is not public: the legs are the six-joint chain of `bioloid_chains`.
The truth is kinematic: a sliding foot does not push the body.
"""

import math
from dataclasses import dataclass

import numpy as np

from surefoot.arrays import Array, Flags, Ints
from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.rotations import matrix_from_rotvec, matrix_from_rpy, rotvec_from_matrix
from surefoot.kernels.jit import kernel
from surefoot.lab.estimation.log import Log, TrueMotion

from .chain import Chain, chain_from_dh, descend, foot_pose

FINE = 1e-3  # s, grid of the truth
IMU_STEPS, KINEMATIC_STEPS = 10, 33  # of the fine grid
ANKLE = 0.032  # m, height of the ankle over the sole (assumed)
HIP_Y = 0.0385  # m, half the hip width
LEG = 0.0764 + 0.0764 + 0.04987  # m, ankle to pelvis, straight
CROUCH = 0.012  # m, the pelvis walks lower than straight legs by this
IMU_OVER_PELVIS = np.array([-0.03, 0.0, 0.06])  # m, box on the back
ENCODER = math.radians(0.293)  # rad, one step


@dataclass(frozen=True)
class WalkParams:
    """Settings of a made-up walk; the sizes of its disturbances are drawn from a seed."""

    duration_s: float = 20.0
    rest_s: float = 2.0
    speed: float = 0.0357  # m/s
    step_s: float = 0.5
    double_support: float = 0.25  # share of a step with both feet down
    feet: int = 2
    sway: float = 0.02  # m, sideways, peak
    bob: float = 0.003  # m, up and down
    tilt_deg: tuple[float, float] = (1.5, 2.5)  # amplitude of roll, pitch, yaw
    shock: float = 2.0  # m/s^2 at touchdown, 12 Hz, decays in 60 ms
    twist_deg: tuple[float, float] = (0.0, 0.0)  # feet turn per stance: range of the standard deviation
    yaw_rate: tuple[float, float] = (0.0, 0.0)  # rad/s of the path, random side
    slip: tuple[float, float] = (0.0, 0.0)  # m per sliding stance
    slip_share: tuple[float, float] = (0.0, 0.0)  # share of the stances that slide
    sigma_w: float = 0.0054  # rad/s per IMU sample
    sigma_q: float = 0.035  # m/s^2
    gyro_bias: float = 0.02  # rad/s, standard deviation
    acc_bias: float = 0.05  # m/s^2
    encoders: bool = True  # joints of the biped, quantised; otherwise foot positions with noise
    sigma_foot: float = 0.0003  # m, that noise
    backlash_deg: tuple[float, float] = (0.0, 0.0)  # free play of each joint, end to end
    edge_deg: tuple[float, float] = (0.0, 0.0)  # a foot rolls over an edge of its sole by so much
    edge_share: float = 0.0  # share of the stances that do
    false_share: float = 0.0  # share of the swings with a false contact
    false_s: float = 0.13  # its length


KINDS: dict[str, WalkParams] = {
    "plain": WalkParams(),
    "twist": WalkParams(twist_deg=(3.0, 10.0)),
    "turn": WalkParams(twist_deg=(3.0, 10.0), yaw_rate=(0.1, 0.3)),
    "slip": WalkParams(twist_deg=(3.0, 10.0), yaw_rate=(0.1, 0.3), slip=(0.003, 0.015), slip_share=(0.1, 0.5)),
    "edges": WalkParams(
        twist_deg=(3.0, 10.0), yaw_rate=(0.1, 0.3), slip=(0.003, 0.015), slip_share=(0.1, 0.5),
        backlash_deg=(0.3, 0.7), edge_deg=(0.5, 2.0), edge_share=0.5,
    ),
    "false": WalkParams(twist_deg=(3.0, 10.0), false_share=0.2),
}  # fmt: skip
"""Settings of synthetic walks by name: `edges` is `slip` with backlash and rolling over the edges of the soles, `false`
is `twist` with false contacts of 0.13 s in a fifth of the swings."""
SOLE = np.array([[0.0, 0.028, 0.055], [0.0, -0.028, 0.055], [0.0, 0.028, -0.035], [0.0, -0.028, -0.035]])
"""Corners of the sole relative to the ankle, axes of frame 1 (x up, z forward), (4, 3) m; x is minus the ankle's
height."""
SOLE[:, 0] = -ANKLE


def bioloid_chains() -> tuple[Chain, Chain]:
    """Return left and right leg, ankle to IMU: roll, pitch, knee, pitch, roll, yaw (reconstruction of Table I).

    At zero angles the leg is straight and IMU axes are x forward, y left, z up.
    """
    half = math.pi / 2.0
    a = np.array([0.0, 0.0764, 0.0764, 0.0, 0.0, 0.0])
    alpha = np.array([half, 0.0, 0.0, -half, half, 0.0])
    d = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.04987])
    offset = np.array([0.0, 0.0, 0.0, 0.0, half, 0.0])
    # frame 1 at the ankle: x up, z forward
    axes_of_foot = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])  # rot_level_from_frame_1
    bare = chain_from_dh(a, alpha, d, offset, np.zeros(3), np.eye(3))
    state = descend(bare, np.zeros(6), np.zeros(6), np.zeros(3))
    rot = state.imu_axes  # rot_frame_1_from_last
    chains = []
    for side in (1.0, -1.0):
        imu = np.array([0.0, -side * HIP_Y, LEG]) + IMU_OVER_PELVIS  # over the ankle, level axes
        in_last = rot.T @ (axes_of_foot.T @ imu - state.p_1)
        chains.append(chain_from_dh(a, alpha, d, offset, in_last, rot.T @ axes_of_foot.T))
    return chains[0], chains[1]


@kernel
def solve_chain(chain: Chain, theta: Array, position: Array, rot: Array) -> Array:
    """Return joint angles (6,) rad that put the foot at position (3,) m, rot (3, 3), IMU axes, by Newton's method.

    `theta` (6,) rad: first guess.
    """
    theta = theta.copy()
    zero, step = np.zeros(theta.size), 1e-7
    for _ in range(8):
        error = _pose_error(chain, theta, zero, position, rot)
        if np.max(np.abs(error)) < 1e-12:
            break
        jac = np.empty((6, theta.size))
        for i in range(theta.size):
            moved = theta.copy()
            moved[i] += step
            jac[:, i] = (_pose_error(chain, moved, zero, position, rot) - error) / step
        theta -= np.linalg.solve(jac, error)
    return theta


@kernel
def _pose_error(chain: Chain, theta: Array, zero: Array, position: Array, rot: Array) -> Array:
    state = descend(chain, theta, zero, np.zeros(3))
    p, r = foot_pose(state)
    error = np.empty(6)
    error[:3] = p - position
    error[3:] = rotvec_from_matrix(r @ rot.T)
    return error


def _smooth(u: Array) -> Array:
    """Return a course from 0 to 1 with no speed at the ends, u (n,) clipped to [0, 1]."""
    u = np.clip(u, 0.0, 1.0)
    return u * u * u * (10.0 - 15.0 * u + 6.0 * u * u)


@dataclass(frozen=True, eq=False)
class _Path:
    """Path of a synthetic walk on the fine time grid of N samples: time s, distance m, heading rad, x and y m."""

    t: Array
    way: Array  # (N,) m
    heading: Array  # (N,) rad
    xy: Array  # (N, 2) m

    def at(self, t: float) -> tuple[Array, float]:
        k = min(len(self.t) - 1, max(0, round(t / FINE)))
        return self.xy[k], float(self.heading[k])


def _path(walk: WalkParams, rng: np.random.Generator) -> _Path:
    t = np.arange(round(walk.duration_s / FINE) + 1, dtype=np.float64) * FINE
    go = _smooth((t - walk.rest_s) / walk.step_s)
    rate = rng.uniform(*walk.yaw_rate) * rng.choice([-1.0, 1.0])
    way = np.concatenate([[0.0], np.cumsum(0.5 * (go[1:] + go[:-1])) * FINE * walk.speed])
    heading = np.concatenate([[0.0], np.cumsum(0.5 * (go[1:] + go[:-1])) * FINE * rate])
    step = np.diff(way)[:, None] * np.stack([np.cos(heading), np.sin(heading)], 1)[1:]
    return _Path(t, way, heading, np.concatenate([np.zeros((1, 2)), np.cumsum(step, axis=0)]))


def _body(walk: WalkParams, path: _Path, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return the true IMU position (N, 3) m, world, and rot_world_from_imu (N, 3, 3) of a walk."""
    t, stride = path.t, 2.0 * walk.step_s
    go = _smooth((t - walk.rest_s) / stride)
    phase = 2.0 * math.pi * (t - walk.rest_s) / stride
    amplitude = np.radians(rng.uniform(*walk.tilt_deg, size=3))
    shift = rng.uniform(0.0, 2.0 * math.pi, size=3)
    tilt = go[:, None] * amplitude * np.sin(phase[:, None] * np.array([1.0, 2.0, 1.0]) + shift)
    rot = np.stack([matrix_from_rpy(r, p, y + h) for (r, p, y), h in zip(tilt, path.heading, strict=True)])
    side = np.stack([-np.sin(path.heading), np.cos(path.heading)], 1)
    position = np.zeros((len(t), 3))
    position[:, :2] = path.xy + side * (go * walk.sway * np.sin(phase))[:, None]
    position[:, 2] = ANKLE + LEG - CROUCH - walk.bob * go * (1.0 - np.cos(2.0 * phase)) / 2.0
    position += np.einsum("nij,j->ni", rot, IMU_OVER_PELVIS)
    for down in np.arange(walk.rest_s + walk.step_s, walk.duration_s, walk.step_s):
        since = np.maximum(t - down, 0.0)
        pulse = (1.0 - np.exp(-since / 0.008)) * np.exp(-since / 0.06) * np.sin(2.0 * math.pi * 12.0 * since)
        direction = rng.normal(size=3) * np.array([0.5, 0.3, 1.0])
        position += (walk.shock / (2.0 * math.pi * 12.0) ** 2) * pulse[:, None] * direction
    return position, rot


@dataclass(frozen=True, eq=False)
class _Ankles:
    """True motion of the ankles of a synthetic walk, N samples on the grid that all sensors are sampled from."""

    position: Array  # (L, N, 3) m, world
    yaw: Array  # (L, N) rad
    contact: Flags  # (L, N)
    lean: Array  # (L, N, 3) rad, rotation over an edge of the sole, foot heading axes
    load: Array  # (L, N) -1 .. 1, side of the play on which the joints lie


def _feet(walk: WalkParams, path: _Path, rng: np.random.Generator) -> _Ankles:
    """Return ankles that swing in two alternating groups and stand still in between, but for twist and slip."""
    t, count = path.t, walk.feet
    n = len(t)
    out = _Ankles(
        np.zeros((count, n, 3)), np.zeros((count, n)), np.ones((count, n), dtype=np.bool_), np.zeros((count, n, 3)),
        np.ones((count, n)),
    )  # fmt: skip
    twist_sd = math.radians(rng.uniform(*walk.twist_deg))
    share = rng.uniform(*walk.slip_share)
    for f in range(count):
        offset = _foot_offset(walk, f)
        swings = walk.rest_s + walk.step_s * np.arange(_group(f, count), 10**6, 2)
        swings = swings[swings < walk.duration_s]
        air = walk.step_s * (1.0 - walk.double_support)
        begin, place, yaw = 0.0, offset, 0.0  # of the present stance
        for k, lift in enumerate([*swings, walk.duration_s + 1.0]):
            turn = rng.normal() * twist_sd if begin > 0.0 else 0.0
            slide = np.zeros(2)
            if begin > 0.0 and rng.random() < share:
                slide = rng.uniform(*walk.slip) * _unit(rng.uniform(0.0, 2.0 * math.pi))
            stand = (t >= begin) & (t < lift)
            part = _smooth((t[stand] - begin) / (lift - begin))
            out.position[f, stand, :2] = place + part[:, None] * slide
            out.position[f, stand, 2] = ANKLE
            out.yaw[f, stand] = yaw + part * turn
            if k == len(swings):
                break
            landing = lift + air
            centre, heading = path.at(landing + 0.5 * (2.0 * walk.step_s - air))  # under the hip in mid-stance
            rot = np.array([[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]])
            target, from_place, from_yaw = centre + rot @ offset, place + slide, yaw + turn
            fly = (t >= lift) & (t < landing)
            u = (t[fly] - lift) / air
            out.position[f, fly, :2] = from_place + _smooth(u)[:, None] * (target - from_place)
            out.position[f, fly, 2] = ANKLE + 0.015 * np.sin(math.pi * u) ** 2
            out.yaw[f, fly] = from_yaw + _smooth(u) * (heading - from_yaw)
            out.contact[f, fly] = False
            begin, place, yaw = landing, target, heading
    return out


EDGES = ((0.055, 0.0), (-0.035, 0.0), (0.0, 0.028), (0.0, -0.028))  # m, places of the edges from the ankle


def _roll_over_edges(walk: WalkParams, feet: _Ankles, rng: np.random.Generator) -> None:
    """Roll some stances over an edge of the sole and back; the ankle goes along."""
    size = math.radians(rng.uniform(*walk.edge_deg))
    for f, first, last in _stances(feet):
        if first == 0 or rng.random() >= walk.edge_share:
            continue
        edge = np.array([*EDGES[rng.integers(len(EDGES))], -ANKLE])
        axis = np.cross([0.0, 0.0, 1.0], edge) / np.hypot(edge[0], edge[1])  # a turn about it lowers the edge
        u = np.linspace(0.0, 1.0, last - first)
        angle = size * rng.uniform(0.5, 1.5) * np.sin(math.pi * _smooth(u)) ** 2
        for k in range(first, last):
            yaw = matrix_from_rpy(0.0, 0.0, feet.yaw[f, k])
            feet.lean[f, k] = angle[k - first] * axis
            feet.position[f, k] += yaw @ (edge - matrix_from_rotvec(feet.lean[f, k]) @ edge)


def _stances(feet: _Ankles) -> list[tuple[int, int, int]]:
    """Return foot, first row and row after the last of every stance."""
    out: list[tuple[int, int, int]] = []
    for f, contact in enumerate(feet.contact):
        change = np.flatnonzero(np.diff(np.concatenate([[False], contact, [False]]).astype(np.int8)))
        out += [(f, int(a), int(b)) for a, b in zip(change[::2], change[1::2], strict=True)]
    return out


def _lie_of_joints(feet: _Ankles) -> None:
    """Set the side to which joint play lies, in place: one for a loaded leg, the other in the air, 40 ms in between."""
    for f, contact in enumerate(feet.contact):
        side = np.where(contact, 1.0, -1.0)
        width = round(0.04 / FINE)
        padded = np.concatenate([np.full(width - 1, side[0]), side])
        total = np.cumsum(np.concatenate([[0.0], padded]))
        feet.load[f] = (total[width:] - total[:-width]) / width


def _false_contacts(walk: WalkParams, feet: _Ankles, rng: np.random.Generator) -> None:
    """Close the switch of a foot in the air for `walk.false_s` s, in a share `walk.false_share` of its swings."""
    for contact in feet.contact:
        air = np.flatnonzero(np.diff(np.concatenate([[False], ~contact, [False]]).astype(np.int8)))
        for first, last in zip(air[::2], air[1::2], strict=True):
            if rng.random() < walk.false_share:
                at = first + int(rng.uniform(0.2, 0.5) * (last - first))
                contact[at : min(last, at + round(walk.false_s / FINE))] = True


def _group(foot: int, count: int) -> int:
    """Return the group, 0 or 1, that a foot swings with: neighbours on a side and opposite feet alternate."""
    return foot % 2 if count == 2 else (foot // 2 + foot % 2) % 2


def _foot_offset(walk: WalkParams, foot: int) -> Array:
    """Return the horizontal position of a foot under the body, (2,) m: pairs left and right, front to back."""
    pairs = (walk.feet + 1) // 2
    x = 0.0 if pairs == 1 else 0.1 * (1.0 - 2.0 * (foot // 2) / (pairs - 1))
    half = HIP_Y if walk.feet == 2 else 0.12
    return np.array([x, half if foot % 2 == 0 else -half])


def _unit(angle: float) -> Array:
    return np.array([math.cos(angle), math.sin(angle)])


def synthesize(walk: WalkParams, seed: int) -> Log:
    """Return the log of a made-up walk of a biped, with truth.

    Args:
        walk: settings of the walk; `KINDS` holds those that have a name.
        seed: of all random draws.
    """
    rng = np.random.default_rng(seed)
    path = _path(walk, rng)
    position, rot = _body(walk, path, rng)
    feet = _feet(walk, path, rng)
    more = np.random.default_rng([seed, 1])  # leaves the draws of the kinds without these disturbances as they are
    if walk.edge_share > 0.0:
        _roll_over_edges(walk, feet, more)
    _lie_of_joints(feet)
    play = math.radians(more.uniform(*walk.backlash_deg)) * more.choice([-0.5, 0.5], size=(walk.feet, 6))
    if walk.false_share > 0.0:
        _false_contacts(walk, feet, more)
    v_world = np.gradient(position, FINE, axis=0)
    ends = np.arange(IMU_STEPS, len(path.t), IMU_STEPS)
    begins, middles = ends - IMU_STEPS, ends - IMU_STEPS // 2
    w = np.stack([rotvec_from_matrix(rot[b].T @ rot[e]) for b, e in zip(begins, ends, strict=True)]) / (
        IMU_STEPS * FINE
    )
    force = (v_world[ends] - v_world[begins]) / (IMU_STEPS * FINE) + np.array([0.0, 0.0, GRAVITY])
    q = np.einsum("nji,nj->ni", rot[middles], force)
    w += rng.normal(size=3) * walk.gyro_bias + rng.normal(size=w.shape) * walk.sigma_w
    q += rng.normal(size=3) * walk.acc_bias + rng.normal(size=q.shape) * walk.sigma_q
    truth = TrueMotion(position[ends], rot[ends], v_world[ends])
    rows = np.arange(KINEMATIC_STEPS, len(path.t), KINEMATIC_STEPS)
    seen, turned = _seen_feet(walk, rows, position, rot, feet, play, rng)
    return Log(
        f"synthetic {seed}", ends * round(FINE * 1e9), w, q, rows * round(FINE * 1e9), seen, turned,
        np.ascontiguousarray(feet.contact[:, rows].T), truth,
        points=np.repeat(SOLE[None], walk.feet, axis=0) if walk.encoders else None,
        rest=(0, round(walk.rest_s / FINE) // IMU_STEPS - 1), begin_s=walk.rest_s + 0.5,
        sensors={"sigma_w": walk.sigma_w, "sigma_q": walk.sigma_q},
    )  # fmt: skip


def _seen_feet(
    walk: WalkParams, rows: Ints, position: Array, rot: Array, feet: _Ankles, play: Array, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Return feet every 33 ms through quantised encoders with play, or with noise: (m, L, 3) m and (m, L, 3, 3)."""
    chains = bioloid_chains()
    theta = [np.array([0.0, 0.3, -0.6, 0.3, 0.0, 0.0])] * 2
    seen, turned = np.empty((len(rows), walk.feet, 3)), np.empty((len(rows), walk.feet, 3, 3))
    for i, k in enumerate(rows):
        for f in range(walk.feet):
            seen[i, f] = rot[k].T @ (feet.position[f, k] - position[k])
            # foot axes as the chain's frame 1: x up, z forward
            yaw = matrix_from_rpy(0.0, 0.0, feet.yaw[f, k])
            turned[i, f] = rot[k].T @ yaw @ matrix_from_rotvec(feet.lean[f, k]) @ FOOT_AXES
            if walk.encoders:
                theta[f] = solve_chain(chains[f], theta[f], seen[i, f], np.ascontiguousarray(turned[i, f]))
                rounded = np.round((theta[f] + feet.load[f, k] * play[f]) / ENCODER) * ENCODER
                seen[i, f], turned[i, f] = foot_pose(descend(chains[f], rounded, np.zeros(6), np.zeros(3)))
            else:
                seen[i, f] += rng.normal(size=3) * walk.sigma_foot
    return seen, turned


FOOT_AXES = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])  # rot_level_from_foot
