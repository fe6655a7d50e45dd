"""Strain of the map, turn of the camera, displacement of the robot, estimated from the landmarks of each frame.

Five cases are weighed,

    right     the map fits the floor, the camera looks where it is stated to look, both apart from small errors
    strained  the map is stretched or sheared: a landmark at d in it lies at (1 - E) d, E symmetric (2, 2)
    tilted    the camera is pitched by p and rolled by q from where it is stated to be (see `common_errors`)
    aside     it is turned to the side: bearings are s too large
    displaced as right, but the robot was put down elsewhere: (x, y, theta) is large; that begins at some frame

Each case has a Kalman filter of

    u = (E_xx, E_yy, E_xy, p, q, s, p', q', w, x, y, theta)

with p', q', w the tilt and sway that fade (`common_errors`), and x, y, theta the true pose less the believed one.
Cases differ in what they expect of E, of p, q and of s. With d the landmark from the believed pose and z the sighting,
both in heading axes, and g the gains of `common_errors`,

    d - z = R^T (E R d + (x, y)) + theta J d - (g_r, r g_a) (p + p', q + q', w) - (0, r s) + noise

along the ray and across it. A believed displacement v of the robot adds theta J v to (x, y): that separates
theta from s. The probability of a case grows by the likelihood of what is seen; a share of wrong matches is part of it.
What was learned fades, so that an error heals.
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.rotations import matrix_from_rotvec
from surefoot.kernels.jit import row_kernel

from .common_errors import NEAREST, CommonErrors, fill_gain
from .landmarks import FloorLandmarks
from .matching import Detections, MatchLimits, SightNoise, match
from .ukf import Pose

Turn = tuple[float, float, float]

STRAIN, TURN, COMMON, POSE, STATES = 0, 3, 6, 9, 12
"""Index of the first element of a part of the state u; `STRAIN`: map strain; `TURN`: camera turn; `COMMON`: fading
errors; `POSE`: pose; `STATES`: length of u."""
RIGHT, STRAINED, TILTED, ASIDE, DISPLACED = 0, 1, 2, 3, 4
NOTABLE = 2.0
"""Least camera turn that is corrected, in standard deviations of an aligned camera; a smaller one is left."""
LEAST, MOST = 2, 20
"""`LEAST`: number of matches below which a frame is ignored; `MOST`: largest number of matches of a frame that are
used."""


@dataclass(frozen=True)
class StrainModel:
    """Expected strain of the map, turn of the camera and displacement of the robot, and limits of belief in them.

    E: strain of the map, symmetric (2, 2); p, q, s: pitch, roll and sideways turn of the camera, rad.
    """

    small: tuple[float, float, float] = (0.01, math.radians(0.25), math.radians(0.5))
    """Standard deviations if map and camera are right: of each element of the map's strain, no unit, of the pitch and
    roll of the camera, rad, and of its sideways turn, rad."""
    large: tuple[float, float, float] = (0.10, math.radians(4.0), math.radians(5.0))
    """Standard deviations if map or camera is wrong: of each element of the map's strain, no unit, of the pitch and
    roll of the camera, rad, and of its sideways turn, rad."""
    prior: float = 0.02
    """Prior probability of each case in which map, camera or pose is wrong."""
    wrong: float = 0.05
    """Share of the matches of detections with landmarks that are false."""
    width: float = 0.6
    """Width of the strip in which the residuals of false matches are uniformly distributed, m."""
    wider: tuple[float, float] = (0.10, 0.05)
    """Standard deviations added to the matching noise, so that landmarks of a strained map match: of the range, as a
    part of it, and of the bearing, rad."""
    displaced: tuple[float, float] = (0.4, math.radians(25.0))
    """Standard deviations of x and y, m, and of the heading, rad, of a robot that was put down elsewhere."""
    displacement_rate: float = 1e-3
    """Rate at which a robot is put down elsewhere, 1/s."""
    displaced_fade_s: float = 20.0
    """Time constant with which the log odds of a displaced robot decay to their long-run value, s."""
    fade_s: float = 60.0
    """Time constant with which learned strain and camera turn fade, s."""
    known_sd: float = math.radians(2.0)
    """Standard deviation of a camera turn, rad, above which it is not corrected."""
    sure: float = 0.9
    """Probability from which on a map counts as strained or a robot as displaced."""
    turn_sure: float = 0.99
    """Probability from which on a camera turn is corrected: a false correction would hide a strained map."""


class Case(NamedTuple):
    """Kalman filter of one hypothesis about map and camera.

    Its 12 states u: strain E_xx, E_yy, E_xy of the map; pitch, roll, sideways turn of the camera that stay, rad; pitch,
    roll, rad, and sway, m, that fade; x, y, m, and heading, rad, of the true pose less the believed one.
    """

    mean: Array
    """Mean of the 12 states u (strain, turn, fading errors, pose), (12,)."""
    cov: Array
    """Covariance of the 12 states u (strain, turn, fading errors, pose), (12, 12)."""


class FrameLines(NamedTuple):
    """Linear equations off = rows u + noise by which the matches of one frame show strain, turn, displacement (u)."""

    rows: Array
    """Coefficients of the 12 states u in each equation, (n, 12)."""
    off: Array
    """Mapped landmark minus its detected position, (n,) m, along the ray (even rows) or across it (odd rows)."""
    variance: Array
    """Noise variance of each equation, (n,) m^2."""


@row_kernel
def lines_of(places: Array, rays: Array, pose: Array, noise: SightNoise, height: float, lines: FrameLines) -> None:
    """Write the linear equations by which the k matches of a frame show strain, turn and displacement.

    Args:
        places: places of the landmarks, (k, 2) m, frame map.
        rays: range, m, and bearing, rad, left of the heading positive, at which each is seen, (k, 2).
        pose: believed x, y, m, and heading, rad, frame map, (3,).
        noise, height: noise of the camera; its height above the floor, m.
        lines: written: 2 k equations, along (2 i) and across (2 i + 1) the ray of match i.
    """
    c, s, gain = math.cos(pose[2]), math.sin(pose[2]), np.zeros((2, 3))
    for k in range(places.shape[0]):
        x, y = places[k, 0] - pose[0], places[k, 1] - pose[1]
        far = math.sqrt(x * x + y * y)
        ahead, left = c * x + s * y, c * y - s * x
        bearing = math.atan2(left, ahead)
        fill_gain(far, bearing, height, gain)
        zx, zy = rays[k, 0] * math.cos(rays[k, 1]), rays[k, 0] * math.sin(rays[k, 1])
        for across in range(2):
            i = 2 * k + across
            ux, uy = math.cos(bearing), math.sin(bearing)  # direction of the equation, heading axes
            if across:
                ux, uy = -uy, ux
            mx, my = c * ux - s * uy, s * ux + c * uy  # the same in the map's
            row = lines.rows[i]
            row[0], row[1], row[2] = mx * x, my * y, mx * y + my * x
            size = far if across else 1.0
            for j in range(3):
                row[COMMON + j] = -size * gain[across, j]
            row[TURN], row[TURN + 1] = row[COMMON], row[COMMON + 1]
            row[TURN + 2] = -far if across else 0.0
            row[POSE], row[POSE + 1], row[POSE + 2] = mx, my, uy * ahead - ux * left
            lines.off[i] = ux * (ahead - zx) + uy * (left - zy)
            own = (
                noise.bearing_sd * max(far, NEAREST)
                if across
                else math.sqrt(noise.range_sd**2 + (noise.range_share * max(far, NEAREST)) ** 2)
            )
            lines.variance[i] = own * own


@row_kernel
def passed(mean: Array, cov: Array, centre: Array, sds: Array, keeps: Array) -> None:
    """Let the states `mean` and their covariance `cov` decay, in place, towards their long-run values.

    Args:
        mean: strain (3, no unit), turn of the camera (3, rad), errors that fade (rad, rad, m), pose (m, m, rad), (12,).
        cov: covariance of `mean`, (12, 12).
        centre, sds: means and standard deviations in the long run, (12,), units of `mean`.
        keeps: share of each state that stays, (12,), 0 to 1.
    """
    n = mean.size
    for i in range(n):
        mean[i] = centre[i] + keeps[i] * (mean[i] - centre[i])
        for j in range(n):
            cov[i, j] *= keeps[i] * keeps[j]
        cov[i, i] += (1.0 - keeps[i] * keeps[i]) * sds[i] * sds[i]


@row_kernel
def carried(mean: Array, cov: Array, x: float, y: float) -> None:
    """Add what an error of heading does to the position over a motion x, y m (frame map) to `mean` and `cov`, in place.

    `mean` (12,), `cov` (12, 12): the last three states are x, y, m, and heading, rad, of the true less the believed
    pose.
    """
    n, heading = mean.size, mean[POSE + 2]
    mean[POSE] -= y * heading
    mean[POSE + 1] += x * heading
    for i in range(n):
        cov[POSE, i] -= y * cov[POSE + 2, i]
        cov[POSE + 1, i] += x * cov[POSE + 2, i]
    for i in range(n):
        cov[i, POSE] -= y * cov[i, POSE + 2]
        cov[i, POSE + 1] += x * cov[i, POSE + 2]


@row_kernel
def taken(mean: Array, cov: Array, lines: FrameLines, wrong: float, width: float) -> float:
    """Correct a filter, mean (12,), cov (12, 12), with the equations of a frame, in place; return their log likelihood.

    An equation is weighted with the probability that its match is right. The share `wrong` of matches is wrong, with
    residuals spread evenly over `width` m.
    """
    n, total = mean.size, 0.0
    reach = np.empty(n)
    for i in range(lines.off.size):
        row, v, s = lines.rows[i], lines.off[i], lines.variance[i]
        for a in range(n):
            reach[a] = 0.0
            for b in range(n):
                reach[a] += cov[a, b] * row[b]
        for a in range(n):
            v -= row[a] * mean[a]
            s += row[a] * reach[a]
        right = (1.0 - wrong) * math.exp(-0.5 * v * v / s) / math.sqrt(2.0 * math.pi * s)
        density = right + wrong / width
        total += math.log(density)
        share = right / density
        for a in range(n):
            gain = share * reach[a] / s
            mean[a] += gain * v
            for b in range(a + 1):
                cov[a, b] -= gain * reach[b]
                cov[b, a] = cov[a, b]
    return total


@dataclass
class MapStrain:
    """Check whether the map is strained, the camera tilted or turned aside, the robot displaced, or none of these.

    `shared`: errors that the landmarks of a frame share, whose tilt fades; `model`: what the cases expect.
    """

    shared: CommonErrors
    model: StrainModel = field(default_factory=StrainModel)

    def __post_init__(self) -> None:
        m, common = self.model, self.shared.array().tolist()
        self._centre = np.zeros(STATES)
        self._centre[COMMON] = self.shared.pitch
        self._sds: list[Array] = []
        for wrong in (None, 0, 1, 2, None):
            strain, tilt, aside = (m.large[i] if i == wrong else m.small[i] for i in range(3))
            self._sds.append(np.array([strain] * 3 + [tilt] * 2 + [aside] + common + [0.0] * 3))
        right = math.log(1.0 - 3.0 * m.prior)
        self._prior = np.array([right] + [math.log(m.prior)] * 3 + [right])
        self.begin()

    def begin(self) -> None:
        """Discard all frames of landmarks: every case restarts from its prior."""
        self._cases = [Case(self._centre.copy(), np.diag(sds * sds)) for sds in self._sds]
        self._logs, self._at, self._placed = np.array([0.0] * 4 + [-math.inf]), 0.0, False

    def place(self) -> None:
        """Record that the pose was stated or found: no displacement, with the covariance of the believed pose."""
        self._placed, self._logs[DISPLACED] = False, -math.inf

    def moved(self, way: tuple[float, float], along: float, heading: float) -> None:
        """Predict all cases over a motion of the robot.

        Args:
            way: displacement along x and y, m, frame map.
            along, heading: variances that the motion adds: of the position along each axis, m^2; of the heading, rad^2.
        """
        for case in self._cases:
            carried(case.mean, case.cov, way[0], way[1])
            case.cov[POSE, POSE] += along
            case.cov[POSE + 1, POSE + 1] += along
            case.cov[POSE + 2, POSE + 2] += heading

    def corrected(self, change: Array) -> None:
        """Subtract a correction of the believed pose, x, y (m), heading (rad), (3,), map, from all displacements."""
        for case in self._cases:
            case.mean[POSE:] -= change

    def look(
        self, seen: Detections, world: FloorLandmarks, pose: Pose, cov: Array, noise: SightNoise, time: float
    ) -> None:
        """Update the probabilities with one frame of the camera; one with fewer than two matches is ignored.

        Args:
            seen: landmarks detected in it.
            world: landmarks of the map.
            pose, cov: believed x, y, m, and heading, rad, frame map; its covariance, (3, 3) or larger.
            noise: noise of the camera, with the common errors.
            time: time of the frame, s.
        """
        far, aside = self.model.wider
        share, bearing = math.hypot(noise.range_share, far), math.hypot(noise.bearing_sd, aside)
        wide = noise._replace(range_share=share, bearing_sd=bearing)
        found = match(np.array(pose), cov, seen, world, wide, MatchLimits(most=MOST), seed=0)
        k = len(found.detections)
        if k < LEAST:
            return
        rays = np.stack((seen.ranges[found.detections], seen.bearings[found.detections]), 1)
        lines = FrameLines(np.zeros((2 * k, STATES)), np.zeros(2 * k), np.zeros(2 * k))
        lines_of(world.positions[found.landmarks], rays, np.array(pose), noise, self.shared.height, lines)
        lines.variance[:] += np.repeat(world.sd[found.landmarks] ** 2, 2)
        dt, self._at = max(0.0, time - self._at), time
        long = math.exp(-dt / self.model.fade_s)
        keeps = np.array([long] * 6 + list(self.shared.kept(dt)) + [1.0] * 3)
        displaced = self._logs[DISPLACED] - self._logs[RIGHT]
        self._logs *= long
        rare, stays = self._rare(dt), math.exp(-dt / self.model.displaced_fade_s)
        if displaced > rare:
            displaced = rare + stays * (displaced - rare)
        self._logs[DISPLACED] = self._logs[RIGHT] + displaced
        for case, expected in zip(self._cases, self._sds, strict=True):
            if not self._placed:
                case.mean[POSE:], case.cov[POSE:], case.cov[:, POSE:] = 0.0, 0.0, 0.0
                case.cov[POSE:, POSE:] = cov[:3, :3]
            passed(case.mean, case.cov, self._centre, expected, keeps)
        self._displace(dt)
        for number, case in enumerate(self._cases):
            self._logs[number] += taken(case.mean, case.cov, lines, self.model.wrong, self.model.width)
        self._placed = True

    def _rare(self, dt: float) -> float:
        """Return the log of the probability that a robot is displaced within dt, s."""
        return math.log(self.model.displacement_rate * min(max(dt, 0.01), 10.0))

    def _displace(self, dt: float) -> None:
        """Let the case of a displaced robot begin now if that is more probable than an earlier begin."""
        now = self._logs[RIGHT] + self._rare(dt)
        if now > self._logs[DISPLACED]:
            place, heading = self.model.displaced
            right, case = self._cases[RIGHT], self._cases[DISPLACED]
            case.mean[:], case.cov[:] = right.mean, right.cov
            case.cov[range(POSE, STATES), range(POSE, STATES)] += (place**2, place**2, heading**2)
            self._logs[DISPLACED] = now

    @property
    def probabilities(self) -> tuple[float, ...]:
        """Probabilities of the cases: right, strained map, camera tilted, camera aside, displaced robot, (5,)."""
        logs = (self._logs + self._prior).tolist()
        most = max(logs)
        weights = [math.exp(value - most) for value in logs]
        return tuple(weight / math.fsum(weights) for weight in weights)

    @property
    def strain(self) -> tuple[float, float, float]:
        """Strain E_xx, E_yy, E_xy of the map, no unit, given that it is strained: 0.1 = 10 % too long."""
        xx, yy, xy = self._cases[STRAINED].mean[:TURN].tolist()
        return (xx, yy, xy)

    @property
    def sure_turn(self) -> Turn | None:
        """Pitch, roll and sideways turn of the camera, rad, 0 for each that is small or uncertain; None = all are."""
        probabilities, found = self.probabilities, [0.0, 0.0, 0.0]
        for number, parts, small in ((TILTED, (0, 1), self.model.small[1]), (ASIDE, (2,), self.model.small[2])):
            case = self._cases[number]
            for i in parts if probabilities[number] >= self.model.turn_sure else ():
                if case.cov[TURN + i, TURN + i] < self.model.known_sd**2:
                    found[i] = float(case.mean[TURN + i])
            if math.hypot(*(found[i] for i in parts)) < NOTABLE * small:
                for i in parts:
                    found[i] = 0.0
        return (found[0], found[1], found[2]) if any(found) else None

    @property
    def reason(self) -> str:
        """Text on the strain of the map or the displacement of the robot if either is probable, else empty."""
        strained, displaced = self.probabilities[STRAINED], self.probabilities[DISPLACED]
        return self.words if strained >= self.model.sure else self.way if displaced >= self.model.sure else ""

    @property
    def way(self) -> str:
        """Text on the displacement of the robot, whatever its probability."""
        x, y, heading = self._cases[DISPLACED].mean[POSE:].tolist()
        off = f"{math.hypot(x, y):.2f} m and {math.degrees(abs(heading)):.0f} deg"
        return f"the landmarks seen lie together as seen from {off} beside the believed pose"

    @property
    def words(self) -> str:
        """Text on the strain of the map, whatever its probability."""
        xx, yy, xy = self.strain
        middle, half = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
        along = math.degrees(0.5 * math.atan2(2.0 * xy, xx - yy)) + (0.0 if middle >= 0.0 else 90.0)
        most = middle + math.copysign(half, middle)
        size = "longer" if most > 0.0 else "shorter"
        return f"the map is strained: ways in it are {100.0 * abs(most):.0f} % {size} than seen, along {along:.0f} deg"


def turned_back(seen: Detections, turn: Turn, height: float) -> Detections:
    """Return the detections of a turned camera as they would be with the camera at its stated mounting.

    `turn`: its pitch, roll and sideways turn, rad; `height`: of the camera above the floor, m.
    """
    if turn == (0.0, 0.0, 0.0) or not len(seen):
        return seen
    back = matrix_from_rotvec(np.array([-turn[1], turn[0], 0.0])).tolist()
    ranges, bearings = np.empty_like(seen.ranges), np.empty_like(seen.bearings)
    for i, (r, a) in enumerate(zip(seen.ranges.tolist(), seen.bearings.tolist(), strict=True)):
        a -= turn[2]
        ray = (r * math.cos(a), r * math.sin(a), -height) if math.isfinite(r + a) else (math.nan, math.nan, -height)
        x, y, z = (row[0] * ray[0] + row[1] * ray[1] + row[2] * ray[2] for row in back)
        scale = height / max(-z, 1e-3 * height)
        ranges[i], bearings[i] = scale * math.hypot(x, y), math.atan2(y, x)
    return Detections(ranges, bearings, seen.looks)
