"""Errors that all landmarks of a frame have in common and that fade from frame to frame: tilt and sway.

Three states behind the drift: errors p of pitch and q of roll that the camera does not know, rad, and w, how far to the
left of its path the body sways, m. A landmark at distance r and bearing a, seen from height h, is taken for one at

    r + (h^2 + r^2)/h (p cos a + q sin a) - w sin a   and   a + h/r (q cos a - p sin a) - w cos a / r,

to first order. Each is first-order Gauss-Markov: after a time t the share exp(-t / fade) of it is left, and noise is
added that keeps its variance. So frames that share an error do not count as independent measurements.
"""

import math
from dataclasses import dataclass

import numpy as np

from surefoot.arrays import Array
from surefoot.kernels.jit import row_kernel

from .matching import SightNoise
from .ukf import NUISANCE

TYPICAL = 0.75
"""Typical distance of a landmark along the floor, m, for which the effect of a camera tilt on a sighting is
computed."""
ERRORS = 3
"""Number of filter states for errors that all landmarks of a frame share: pitch and roll of the camera, sway."""
NEAREST = 0.1
"""Least distance of a landmark in the error model, m; nearer landmarks count as this far, as bearings diverge at 0."""


@dataclass(frozen=True)
class CommonErrors:
    """Errors that all landmarks of a frame share: unknown tilt of the camera, sway of the body beside its path."""

    tilt: float = 0.0
    """Standard deviation of the unknown pitch and of the unknown roll of the camera, rad; 0 = the tilt is known."""
    pitch: float = 0.0
    """Mean pitch error of the camera, rad: a walking robot leans."""
    sway: float = 0.0
    """Standard deviation of the body's sideways distance from its path, m; 0 = the sway is measured."""
    tilt_fade: float = 0.3
    """Time constant with which the camera's pitch and roll error decays, s."""
    sway_fade: float = 0.3
    """Time constant with which the body's sideways distance from its path decays, s."""
    height: float = 0.45
    """Height of the camera above the floor, m."""
    standing_tilt_fade: float | None = None
    """Time constant of the camera's pitch and roll error while the robot stands, s; None = that of a moving robot."""

    @property
    def any(self) -> bool:
        """True if any error common to the landmarks of a frame is modelled, False if all deviations are 0."""
        return self.tilt > 0.0 or self.sway > 0.0

    def array(self) -> Array:
        """Standard deviations of pitch and roll of the camera, rad, and of the body beside its path, m, (3,)."""
        return np.array([self.tilt, self.tilt, self.sway])

    def kept(self, dt: float, *, standing: bool = False) -> tuple[float, float, float]:
        """Return the shares, 0 to 1, of the errors of pitch, roll and sway left after dt s, moving or standing."""
        long = self.tilt_fade if self.standing_tilt_fade is None or not standing else self.standing_tilt_fade
        tilt, sway = (math.exp(-dt / fade) if fade > 0.0 else 0.0 for fade in (long, self.sway_fade))
        return (tilt, tilt, sway)

    def widen(self, noise: SightNoise) -> SightNoise:
        """Return the noise of single detections with the shared errors, as they act on a landmark 0.75 m away."""
        if not self.any:
            return noise
        h = self.height
        along = self.tilt * (h * h + TYPICAL**2) / h
        across = math.hypot(self.tilt * h / TYPICAL, self.sway / TYPICAL)
        return noise._replace(common_range_sd=along, common_bearing_sd=across)


@row_kernel
def fade(mean: Array, cov: Array, keeps: Array, sds: Array, pitch: float) -> None:
    """Predict the errors common to all sightings of a frame: a share of each stays, noise is added; changed in place.

    Args:
        mean: x, y (m), heading (rad), drift (rad per m), pitch, roll (rad), sway (m), (n,), n = 7.
        cov: covariance, (n, n).
        keeps: shares of pitch, roll and sway that stay, (3,), 0 to 1.
        sds: standard deviations that they tend to, (3,), rad, rad, m.
        pitch: mean error of pitch, rad; the means of roll and sway are 0.
    """
    n = mean.size
    for i in range(NUISANCE, n):
        centre, keep = (pitch if i == NUISANCE else 0.0), keeps[i - NUISANCE]
        mean[i] = centre + keep * (mean[i] - centre)
        for j in range(n):
            cov[i, j] *= keep
        for j in range(n):
            cov[j, i] *= keep
        cov[i, i] += (1.0 - keep * keep) * sds[i - NUISANCE] ** 2


@row_kernel
def fill_gain(range_: float, bearing: float, height: float, gain: Array) -> None:
    """Write how tilt of the camera and sway of the body change range (row 0) and bearing (row 1) of a landmark.

    Args:
        range_: distance of the landmark along the floor, m.
        bearing: direction of the landmark, rad, left of the heading positive.
        height: height of the camera above the floor, m.
        gain: written, (2, 3): columns pitch, roll (m/rad; rad/rad) and sway (m/m; rad/m); (2, 0) stays empty.
    """
    if gain.shape[1] == 0:
        return
    far = max(range_, NEAREST)
    stretch, swing = (height * height + range_ * range_) / height, height / far
    c, s = math.cos(bearing), math.sin(bearing)
    gain[0, 0], gain[0, 1], gain[0, 2] = stretch * c, stretch * s, -s
    gain[1, 0], gain[1, 1], gain[1, 2] = -swing * s, swing * c, -c / far
