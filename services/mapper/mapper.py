"""The map of one robot: odometry and depth images in, heights with variances out; bad images are counted."""

import math
from collections import Counter, deque
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.errors import Refusal
from surefoot.geometry.linear import product
from surefoot.geometry.rotations import matrix_from_quat

from .elevation import SLOPE, Elevation, Grid, GroundPoints, OdometryDrift, around, empty, fuse, lay, moved, variances

Array = NDArray[np.float64]

KEPT = 50
"""Poses that are kept, one each 10 ms: an image may be older."""
NEAR_NS = 20_000_000
"""Largest time between an image and the pose it is read with, ns."""
JUMP = 0.1
"""Way between two poses, m, beyond which the odometry has begun anew."""
MOST_BAD = 0.5
"""Share of impossible depths beyond which a whole image is refused."""
UNKNOWN_TILT = 0.01**2
"""rad^2, variance of roll and pitch of an odometry that states none."""


@dataclass(frozen=True)
class MapParams:
    """Size of the map and what is taken into it."""

    cell: float = 0.005
    """Edge of a cell, m."""
    cells: int = 201
    """Cells along an edge."""
    farthest: float = 1.2
    """Depths beyond are not used, m: a point there is less sure than the ground is rough."""
    late_s: float = 0.3
    """Age beyond which an image is refused, s."""
    start_deviation: float = 0.01
    """Deviation of the ground about the robot from the plane under its feet, before it has seen any, m."""
    start_margin: float = 0.08
    """Way by which that plane goes beyond the feet, m."""


class MapPose(NamedTuple):
    """Pose of base_link with its uncertainty."""

    stamp_ns: int
    position: Array
    """(3,) m."""
    rot: Array
    """(3, 3) rot_odom_from_base."""
    covariance: Array
    """(6, 6) since the start: x, y, z, m, and rotation about them, rad."""


class DepthView(NamedTuple):
    """Depths of an image."""

    stamp_ns: int
    depths: Array
    """(height, width) m along the optical axis; NaN = none."""
    focal: float
    """px."""
    center: tuple[float, float]
    """px."""
    sigma: float
    """m."""
    sigma_square: float
    """m per m2."""
    frame: str
    position: Array
    """(3,) m, base_link."""
    quat_wxyz: Array
    """rot_base_from_camera."""


@dataclass
class Mapper:
    """Map of a run.

    Attributes:
        params: its size and limits.
        refused: images refused, by reason, and single depths, as `depth`.
        images: number of images in the map.
    """

    params: MapParams = field(default_factory=MapParams)
    refused: Counter[str] = field(default_factory=Counter)
    images: int = 0

    def __post_init__(self) -> None:
        self._poses: deque[MapPose] = deque(maxlen=KEPT)
        self._drift, self._last_ns = OdometryDrift(), -(1 << 62)
        self.forget()

    def forget(self) -> None:
        """Drop what was seen."""
        self.layers: Elevation | None = None
        self.grid = Grid(self.params.cell, 0, 0)

    def moved(self, pose: MapPose) -> bool:
        """Take the pose of a tick, whose variances add to the drift; return False for a jump, which empties the map."""
        last = self._poses[-1] if self._poses else None
        jumped = last is not None and not np.abs(pose.position - last.position).max() <= JUMP
        if jumped:
            self._poses.clear()
            self.forget()
            self._drift, last = OdometryDrift(), None
        if last is not None:
            growth = np.maximum(np.diagonal(pose.covariance) - np.diagonal(last.covariance), 0.0)
            z, xy, yaw = self._drift
            self._drift = OdometryDrift(z + growth[2], xy + 0.5 * (growth[0] + growth[1]), yaw + growth[5])
        self._poses.append(pose)
        return not jumped

    def begin(self, feet: Array) -> None:
        """Take the ground about the robot for the plane under its feet, (n, 3) m, n >= 3, where nothing was seen."""
        pose, p = self._poses[-1], self.params
        layers = self._here(pose)
        x, y, z = feet.T
        mx, my, mz = x.mean(), y.mean(), z.mean()
        xx, xy, yy = ((x - mx) ** 2).sum(), ((x - mx) * (y - my)).sum(), ((y - my) ** 2).sum()
        xz, yz, area = ((x - mx) * (z - mz)).sum(), ((y - my) * (z - mz)).sum(), xx * yy - xy * xy
        gx, gy = ((xz * yy - yz * xy) / area, (yz * xx - xz * xy) / area) if area > 1e-8 else (0.0, 0.0)
        half = np.abs(feet[:, :2] - pose.position[:2]).max(axis=0) + p.start_margin
        lay(layers, self.grid, (mz - gx * mx - gy * my, gx, gy), half, p.start_deviation**2, self._drift)

    def look(self, view: DepthView, now_ns: int) -> int:
        """Take an image into the map; return the number of cells it shows.

        Raises:
            Refusal: why the whole image was left out.
        """
        points = self._points(view, self._pose_of(view, now_ns))
        self._last_ns = view.stamp_ns
        self.images += 1
        return fuse(self._here(self._poses[-1]), self.grid, points, self._drift)

    def heights(self) -> tuple[Array, Array] | None:
        """Return the heights, m, and their variances relative to the robot now, m^2; None = nothing was seen."""
        if self.layers is None or not self._poses:
            return None
        x, y, _ = self._poses[-1].position
        return self.layers.height, variances(self.layers, self.grid, self._drift, float(x), float(y))

    @property
    def origin(self) -> tuple[float, float]:
        """Centre of cell [0, 0], m."""
        return self.grid.col * self.grid.cell, self.grid.row * self.grid.cell

    def _here(self, pose: MapPose) -> Elevation:
        n = self.params.cells
        grid = around(self.grid, n, float(pose.position[0]), float(pose.position[1]))
        self.layers = empty(n) if self.layers is None else moved(self.layers, self.grid, grid)
        self.grid = grid
        return self.layers

    def _pose_of(self, view: DepthView, now_ns: int) -> MapPose:
        age = 1e-9 * (now_ns - view.stamp_ns)
        if view.frame != "base_link":
            raise Refusal("frame", f"depths in frame {view.frame[:64]!r}; they must be in 'base_link'")
        if view.stamp_ns <= self._last_ns:
            raise Refusal(
                "repeated", f"image of {1e-9 * view.stamp_ns:.3f} s after one of {1e-9 * self._last_ns:.3f} s"
            )
        if not 0.0 <= age <= self.params.late_s:
            raise Refusal("late", f"image {age:.3f} s old; 0 to {self.params.late_s:g} s are allowed")
        found = min(self._poses, key=lambda pose: abs(pose.stamp_ns - view.stamp_ns), default=None)
        if found is None or abs(found.stamp_ns - view.stamp_ns) > NEAR_NS:
            raise Refusal("no_odometry", f"no odometry within {1e-6 * NEAR_NS:g} ms of the image")
        size = float((view.quat_wxyz * view.quat_wxyz).sum())
        if not abs(size - 1.0) < 1e-3 or not np.abs(view.position).max() < 10.0:
            place = view.position.tolist(), view.quat_wxyz.tolist()
            raise Refusal("camera", f"camera at {place[0]} m, rotation {place[1]}: need a unit quaternion, within 10 m")
        return found

    def _points(self, view: DepthView, pose: MapPose) -> GroundPoints:
        z = view.depths.ravel()
        given = ~np.isnan(z)
        good = given & (z > 0.0) & (z < 1e3)
        bad = int(given.sum()) - int(good.sum())
        self.refused["depth"] += bad
        if bad > MOST_BAD * given.sum():
            worst = z[given & ~good][0]
            raise Refusal(
                "depths", f"{bad} of {given.sum()} depths are impossible, such as {worst:g} m; need 0 to 1000"
            )
        good &= z <= self.params.farthest
        if not good.any():
            raise Refusal("blind", f"no depth up to {self.params.farthest:g} m in the image")
        z = z[good]
        rows, cols = np.divmod(np.flatnonzero(good), view.depths.shape[1])
        ahead, look = np.ones_like(z), matrix_from_quat(view.quat_wxyz).T
        ray = np.stack(
            ((cols + 0.5 - view.center[0]) / view.focal, (rows + 0.5 - view.center[1]) / view.focal, ahead), 1
        )
        local = product(ray * z[:, None], look) + view.position
        arm = product(local, pose.rot.T)
        along = product(product(ray, look), pose.rot.T)
        sigma = view.sigma + view.sigma_square * z * z
        level2 = along[:, 0] ** 2 + along[:, 1] ** 2
        cell2 = (SLOPE * self.params.cell) ** 2 / 12.0
        variance = sigma * sigma * (along[:, 2] ** 2 + SLOPE * SLOPE * level2) + cell2
        tilt = max(0.5 * float(pose.covariance[3, 3] + pose.covariance[4, 4]), 0.0)
        common = math.sqrt(tilt) * np.sqrt(arm[:, 0] ** 2 + arm[:, 1] ** 2)
        return GroundPoints(arm + pose.position, variance, common)
