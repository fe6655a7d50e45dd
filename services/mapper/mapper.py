"""The map of one robot: odometry and depth images in, heights with variances out; refused images are counted."""

import math
from collections import Counter, deque
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array
from surefoot.errors import Refusal
from surefoot.geometry.linear import product
from surefoot.geometry.rotations import matrix_from_quat, matrix_from_rpy, rotvec_from_matrix, rpy_from_matrix

from .elevation import (
    GATE,
    SLOPE,
    Elevation,
    Grid,
    GroundMeans,
    GroundPoints,
    OdometryDrift,
    around,
    compared,
    empty,
    fuse,
    lay,
    means,
    moved,
    variances,
)
from .legs import TrunkOverFeet
from .turned import CameraError, scale_onto, turn_onto

NOWHERE = np.empty((0, 3))
"""Array of no points, (0, 3), the default where a function takes points under feet."""
LEAST_FEET = 3
"""Least number of points under standing feet for fitting a plane to them or comparing them with the map."""
FOOT = 0.003
"""Standard deviation of the ground's height in a cell about the point under a foot that stands in the cell, m."""
KEPT = 50
"""Number of newest poses that are kept, one each 10 ms, so that an older image finds the pose of its time."""
NEAR_NS = 20_000_000
"""Largest time between an image and the pose it is used with, ns; an image without so near a pose is refused."""
JUMP = 0.1
"""Change of a coordinate between two poses in a row, m, above which the odometry counts as begun anew."""
LAID = OdometryDrift(0.003, 0.003, 0.01)
"""Standard deviations of a pose given to a restarted odometry by the standing feet: z, x and y (m), yaw (rad)."""
MOST_BAD = 0.5
"""Fraction of impossible depths in an image above which the whole image is refused."""
FIX = 0.1
"""Fraction of its peak by which a variance of the pose has to fall to count as a fix; less is the filter's own play."""
TINY = 1e-18
"""Product of variances of a rotation (rad^2 for yaw, rad^4 for roll and pitch) below which it counts as known."""
LEAST_BOTH = 50
"""Least number of cells that map and image both show; with fewer the image is not refused for a contradiction."""
LEAST_ALIKE = 0.75
"""Fraction of the cells of map and image that has to agree in height; with less the image contradicts the map."""
MOST_DOUBTFUL = 10
"""Number of images in a row that may be refused for contradicting the map; at the next one the map begins anew."""
SURE_ALIKE = 0.9
"""Fraction of the common cells that has to agree after a correction of the camera for the correction to be accepted."""
SAME_TURN, SAME_SCALE = 0.01, 0.01
"""`SAME_TURN`: angle, rad; `SAME_SCALE`: fraction, up to which the errors of two images in a row count as one."""
UNKNOWN_TILT = 0.01**2
"""Variance of roll and of pitch, rad^2, assumed for an odometry message that gives none."""


@dataclass(frozen=True)
class MapParams:
    """Settings of the map: its size, and limits of the depths and images that it uses."""

    cell: float = 0.005
    """Edge length of a square cell of the elevation map, m."""
    cells: int = 201
    """Number of cells along an edge of the square map."""
    farthest: float = 1.2
    """Depth above which a point is not used, m: there its error exceeds the roughness of the ground."""
    late_s: float = 0.3
    """Age of an image above which it is refused, s."""
    start_deviation: float = 0.01
    """Standard deviation of unseen ground about the plane under the feet, with which the map starts, m."""
    start_margin: float = 0.08
    """Distance by which the plane under the feet extends beyond them at the start, m."""


class MapPose(NamedTuple):
    """Pose of base_link with its covariance, in the frame of the odometry or, by `Mapper.placed`, of the map."""

    stamp_ns: int
    position: Array
    """Position of base_link, (3,) m, frame of the pose: of the odometry or, by `Mapper.placed`, of the map."""
    rot: Array
    """Rotation matrix from axes of base_link to axes of the pose's frame, (3, 3)."""
    covariance: Array
    """Covariance of the pose, grown since the start, (6, 6): of x, y, z, m, and of rotations about these axes, rad."""

    @property
    def tilt(self) -> float:
        """Variance of the tilt about a level axis, rad^2."""
        return max(0.5 * float(self.covariance[3, 3] + self.covariance[4, 4]), 0.0)

    def free(self) -> Array:
        """Return the variances of z and of x, y, m^2, as if the rotation were known, and that of yaw, rad^2, (3,).

        With c = P_zr (2,) the covariance of z with roll and pitch and P_rr that of these, the variance of z is
        P_zz - c P_rr^-1 c; likewise of x, y with yaw. Errors of rotation are left out: they turn the whole map about
        the robot.
        """
        p = self.covariance
        a, b, c, u, w = p[3, 3], p[3, 4], p[4, 4], p[2, 3], p[2, 4]
        area = a * c - b * b
        by_tilt = (u * u * c - 2.0 * u * w * b + w * w * a) / area if area > TINY else 0.0
        by_yaw = (p[0, 5] ** 2 + p[1, 5] ** 2) / p[5, 5] if p[5, 5] > TINY else 0.0
        return np.maximum((p[2, 2] - by_tilt, 0.5 * (p[0, 0] + p[1, 1] - by_yaw), p[5, 5]), 0.0)


class DepthView(NamedTuple):
    """One image of the depth camera, with the camera's intrinsics, noise and pose."""

    stamp_ns: int
    depths: Array
    """Depths along the optical axis, (height, width) m; NaN = no measurement."""
    focal: float
    """Focal length of the depth camera, px."""
    center: tuple[float, float]
    """Column and row of the image at the optical axis, px."""
    sigma: float
    """Constant part of the standard deviation of a depth, m."""
    sigma_square: float
    """Coefficient of the standard deviation of a depth by the square of the depth, m per m^2."""
    frame: str
    """Name of the frame of `position` and `quat_wxyz`; an image in another frame than base_link is refused."""
    position: Array
    """Position of the depth camera, (3,) m, frame base_link."""
    quat_wxyz: Array
    """Rotation from the camera's frame to base_link as a unit quaternion w, x, y, z, (4,)."""


@dataclass
class Mapper:
    """Elevation map built from depth images and odometry, with counts of images used and refused.

    Attributes:
        params: size and limits of the map.
        refused: number of images refused, by reason; under `depth` the number of single depths.
        images: number of images fused into the map.
        error: estimated turn and scale of the camera; images are corrected by it.
    """

    params: MapParams = field(default_factory=MapParams)
    refused: Counter[str] = field(default_factory=Counter)
    images: int = 0

    def __post_init__(self) -> None:
        self._poses: deque[MapPose] = deque(maxlen=KEPT)
        self._drift, self._top, self._last_ns = OdometryDrift(), np.zeros(3), -(1 << 62)
        self._offset: tuple[Array, Array] | None = None
        self.error = self._shown = CameraError(np.eye(3), 1.0)
        self.forget()

    def forget(self) -> None:
        """Drop the height map, as after a jump of the pose or where the map proves wrong."""
        self._data, self._doubtful = b"", 0
        self.layers: Elevation | None = None
        self.grid = Grid(self.params.cell, 0, 0)

    @property
    def pose(self) -> MapPose | None:
        """Newest pose of base_link, frame of the map; None before the first."""
        return self._poses[-1] if self._poses else None

    def placed(self, pose: MapPose) -> MapPose:
        """Return a pose of the odometry as a pose in the frame of the map.

        The two frames differ once the odometry has begun anew.
        """
        if self._offset is None:
            return pose
        turn, shift = self._offset
        return pose._replace(position=product(turn, pose.position) + shift, rot=product(turn, pose.rot))

    def lay(self, pose: MapPose, trunk: TrunkOverFeet) -> None:
        """Align the frame of an odometry that has restarted with the map, so that base_link is where `trunk` puts it.

        The variances of the map grow by the uncertainty of this alignment.

        Args:
            pose: pose of base_link now, in the new frame of the odometry.
            trunk: pose of base_link by the standing feet since the odometry was lost, frame of the map.
        """
        turn = matrix_from_rpy(0.0, 0.0, trunk.yaw - float(rpy_from_matrix(pose.rot)[2]))
        self._offset = turn, trunk.position - product(turn, pose.position)
        self._drift = OdometryDrift(*(a + b * b for a, b in zip(self._drift, LAID, strict=True)))
        self._top = pose.free()

    def moved(self, pose: MapPose) -> bool:
        """Record the pose of a tick; return False for a jump by more than 10 cm in x, y or z, which empties the map."""
        pose, last = self.placed(pose), self.pose
        jumped = last is not None and not np.abs(pose.position - last.position).max() <= JUMP
        if jumped:
            self._poses.clear()
            self.forget()
            self._drift, last = OdometryDrift(), None
        found = pose.free()
        if last is not None:
            self._drift = OdometryDrift(*(np.array(self._drift) + np.maximum(found - self._top, 0.0)).tolist())
        anew = (found > self._top) | (found < (1.0 - FIX) * self._top)
        self._top = found if last is None else np.where(anew, found, self._top)
        self._poses.append(pose)
        return not jumped

    def begin(self, feet: Array) -> None:
        """Fill unseen cells about the robot with the plane through its feet, (n, 3) m, n >= 3, frame of the map."""
        pose, p = self._poses[-1], self.params
        layers = self._here(pose)
        x, y, z = feet.T
        mx, my, mz = x.mean(), y.mean(), z.mean()
        xx, xy, yy = ((x - mx) ** 2).sum(), ((x - mx) * (y - my)).sum(), ((y - my) ** 2).sum()
        xz, yz, area = ((x - mx) * (z - mz)).sum(), ((y - my) * (z - mz)).sum(), xx * yy - xy * xy
        gx, gy = ((xz * yy - yz * xy) / area, (yz * xx - xz * xy) / area) if area > 1e-8 else (0.0, 0.0)
        half = np.abs(feet[:, :2] - pose.position[:2]).max(axis=0) + p.start_margin
        lay(layers, self.grid, (mz - gx * mx - gy * my, gx, gy), half, p.start_deviation**2, self._drift)

    def look(self, view: DepthView, now_ns: int, feet: Array = NOWHERE) -> int:
        """Fuse an image into the map; return the number of cells it shows.

        An image that contradicts the map is refused, unless it and the image before show the same turn of the camera,
        or the same scale of its depths while the ground under the feet agrees with the map. Images are corrected by
        that turn or scale from then on. Where the feet contradict the map, too, or ten images in a row were refused,
        the map begins anew.

        Args:
            view: the image.
            now_ns: time of the tick, ns.
            feet: points of the ground under standing feet, (n, 3) m, frame of the map.

        Raises:
            Refusal: the whole image was left out; its text is the reason.
        """
        pose = self._pose_of(view, now_ns)
        data = view.depths.tobytes()
        if data == self._data:
            raise Refusal(
                "frozen", f"depths of {1e-9 * view.stamp_ns:.3f} s equal those of the image before to the bit"
            )
        points = self._points(view, pose, self.error)
        layers = self._here(self._poses[-1])
        found = means(self.params.cells, self.grid, points)
        self._last_ns, self._data = view.stamp_ns, data
        both, alike = compared(layers, found, self._drift)
        doubtful = both >= LEAST_BOTH and alike < LEAST_ALIKE * both
        carries = self._carries(feet) if doubtful else None
        back = self._set_right(view, pose, points, layers, scaled=carries is True) if doubtful else None
        if back is not None:
            found, doubtful = back, False
        self._doubtful = self._doubtful + 1 if doubtful else 0
        if doubtful:
            if self._doubtful <= MOST_DOUBTFUL and carries is not False:
                raise Refusal(
                    "shifted", f"{both - alike} of {both} cells that were seen before lie elsewhere; a quarter may"
                )
            self.forget()
            if len(feet) >= LEAST_FEET:
                self.begin(feet)
            layers = self._here(self._poses[-1])
        self.images += 1
        return fuse(layers, found, self._drift)

    def _set_right(
        self, view: DepthView, pose: MapPose, points: GroundPoints, layers: Elevation, *, scaled: bool
    ) -> GroundMeans | None:
        """Return the means of an image corrected for the camera's error; None if no error explains it, or not yet.

        `points`: of the ground in the image; `layers`: the map; `scaled`: True if a scale may be estimated, as the feet
        agree with the map; else the ground may lie lower.
        """
        camera = pose.position + product(view.position[None], pose.rot.T)[0]
        turn = turn_onto(layers.height, self.grid, points.place, camera)
        turn = product(product(product(np.ascontiguousarray(pose.rot.T), turn), pose.rot), self.error.turn)
        scale = self.error.scale / scale_onto(layers.height, self.grid, points.place, camera)
        before, self._shown = self._shown, CameraError(turn, scale)
        if not self._doubtful:
            return None
        best, most = None, SURE_ALIKE
        for error, alike in (
            (
                CameraError(turn, self.error.scale),
                _angle(product(np.ascontiguousarray(before.turn.T), turn)) <= SAME_TURN,
            ),
            (CameraError(self.error.turn, scale), scaled and abs(scale / before.scale - 1.0) <= SAME_SCALE),
        ):
            found = means(self.params.cells, self.grid, self._points(view, pose, error)) if alike else None
            both, same = compared(layers, found, self._drift) if found is not None else (0, 0)
            if both >= LEAST_BOTH and same >= most * both:
                best, most, self.error = found, same / both, error
        return best

    @property
    def turned(self) -> float:
        """Angle by which the camera is turned from its stated orientation, rad."""
        return _angle(self.error.turn)

    def heights(self) -> tuple[Array, Array] | None:
        """Return the heights (n, n) m, frame of the map, and their variances relative to the robot, m^2, or None."""
        if self.layers is None or not self._poses:
            return None
        pose = self._poses[-1]
        robot = float(pose.position[0]), float(pose.position[1]), pose.tilt
        return self.layers.height, variances(self.layers, self.grid, self._drift, robot)

    def _carries(self, feet: Array) -> bool | None:
        """Return True if the map agrees with points under feet (n, 3) m, frame of the map; None: too few are known."""
        seen = self.heights()
        if seen is None or not len(feet):
            return None
        at = np.floor(feet[:, :2] / self.grid.cell + 0.5).astype(np.int64) - (self.grid.col, self.grid.row)
        known = ((at >= 0) & (at < self.params.cells)).all(axis=1)
        rows, cols = at[known, 1], at[known, 0]
        off, variance = np.abs(seen[0][rows, cols] - feet[known, 2]), seen[1][rows, cols] + FOOT**2
        apart = (off > GATE * np.sqrt(variance))[np.isfinite(off)]
        return None if len(apart) < LEAST_FEET else bool(apart.mean() <= 0.5)

    @property
    def origin(self) -> tuple[float, float]:
        """Coordinates x and y of the centre of cell [0, 0], m, frame of the map."""
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

    def _points(self, view: DepthView, pose: MapPose, error: CameraError) -> GroundPoints:
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
        z = z / error.scale
        good &= z <= self.params.farthest
        if not good.any():
            raise Refusal("blind", f"no depth up to {self.params.farthest:g} m in the image")
        z = z[good]
        rows, cols = np.divmod(np.flatnonzero(good), view.depths.shape[1])
        ahead, look = np.ones_like(z), product(error.turn, matrix_from_quat(view.quat_wxyz)).T
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
        common = math.sqrt(pose.tilt) * np.sqrt(arm[:, 0] ** 2 + arm[:, 1] ** 2)
        return GroundPoints(arm + pose.position, variance, common)


def _angle(rot: Array) -> float:
    """Return the angle of a rotation matrix (3, 3), rad."""
    return math.sqrt(float((rotvec_from_matrix(rot) ** 2).sum()))
