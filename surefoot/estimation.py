"""Velocity, tilt and path of a legged robot from its IMU and its feet: sample by sample, or over a whole log.

estimator = estimation.estimator("ragno")
estimator.imu(stamp_ns, gyro, acc)
estimator.joints(stamp_ns, angles, contact)
estimator.estimate().velocity

estimation.run("log.npz").track.v
"""

from collections.abc import Iterable
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Literal, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from surefoot.arguments import choice, file_path, instance, number, shown, whole
from surefoot.errors import FieldError
from surefoot.robot.description import Robot
from surefoot.robot.reader import load_robot
from surefoot.services.estimator.feet.contact import contact_points
from surefoot.services.estimator.feet.mount import bare_mount, foot_mount
from surefoot.services.estimator.inputs.external import ExternalSample
from surefoot.services.estimator.inputs.results import InputResult
from surefoot.services.estimator.output import OdometryPose, VelocityAndTilt
from surefoot.services.estimator.params import EstimatorParams
from surefoot.services.estimator.stream import BEST, NAMES, Estimator

if TYPE_CHECKING:
    from surefoot.lab.estimation.results import Result

__all__ = [
    "Estimator", "ExternalSample", "InputResult", "OdometryPose", "StrictEstimator", "VelocityAndTilt", "estimator",
    "names", "run",
]  # fmt: skip

MOST_FEET = 16
_ALLOWED = {
    InputResult.NONFINITE: "finite numbers",
    InputResult.SHAPE: "gyro and acc (3,), joints (nj,), positions (L, 3), rotations (L, 3, 3), contact (L,) or (L, S)",
    InputResult.DUPLICATE: "each stamp once",
    InputResult.LATE: "stamps of the last half second",
    InputResult.AHEAD: "stamps near those before",
    InputResult.SATURATED: "values within the range of the sensor",
    InputResult.UNIT: "rad/s, m/s^2 (specific force: +9.81 along up at rest) and m",
    InputResult.COVARIANCE: "symmetric positive covariances",
    InputResult.FRAME: "a position together with a heading",
}


class StrictEstimator(Estimator):
    """An `Estimator` that raises a FieldError for each sample it refuses; the next samples are used as usual."""

    def imu(self, stamp_ns: int, w: ArrayLike, q: ArrayLike, clipped: bool = False) -> InputResult:
        """Take angular rate w (3,) rad/s and specific force q (3,) m/s^2, IMU axes; raise FieldError if refused."""
        return _accepted("imu", super().imu(whole(stamp_ns, "stamp_ns", "ns"), w, q, clipped), (w, q))

    def joints(self, stamp_ns: int, q: ArrayLike, contact: ArrayLike | None = None) -> InputResult:
        """Take joint angles (nj,) rad and contacts by foot (L,) or switch (L, S), None = unknown; raise if refused."""
        if self._mount.model is None:
            raise FieldError("unsupported", "joints", "got joint angles, expected feet: no robot was named")
        try:
            return _accepted("joints", super().joints(whole(stamp_ns, "stamp_ns", "ns"), q, contact), (q, contact))
        except FieldError as error:
            if error.field == "feet":  # which they become
                _refuse("joints", InputResult(error.code), (q, contact))
            raise

    def feet(self, stamp_ns: int, position: ArrayLike, rot: ArrayLike, contact: ArrayLike | None = None) -> InputResult:
        """Take poses and contacts of the feet, for logs without joint angles; raise an error if refused.

        Args:
            stamp_ns: their time, ns.
            position: foot centres, (L, 3) m, IMU axes.
            rot: rot_imu_from_foot, (L, 3, 3).
            contact: flag or probability of each foot, (L,), or of each switch, (L, S); None = no sensor.

        Raises:
            FieldError: they are refused.
        """
        return _accepted("feet", super().feet(whole(stamp_ns, "stamp_ns", "ns"), position, rot, contact), position)

    def external(self, stamp_ns: int, sample: ExternalSample) -> InputResult:
        """Take a pose, heading or velocity of another source, such as a camera, and raise an error if it is refused.

        `stamp_ns`: time at which it holds, ns.

        Raises:
            FieldError: it is refused.
        """
        instance(sample, "external", ExternalSample, "an ExternalSample")
        return _accepted("external", super().external(whole(stamp_ns, "stamp_ns", "ns"), sample), sample)


def estimator(
    robot: str | Robot | None = None,
    *,
    feet: int | None = None,
    refused: Literal["raise", "count"] = "raise",
    names: Iterable[str] = (BEST,),
) -> Estimator:
    """Return an estimator that is fed sample by sample.

    Args:
        robot: name, path or description; None for feet that are given as positions.
        feet: their number, without a robot.
        refused: policy for a sample that cannot be used: raise a FieldError, or return the reason, count it and go on.
        names: estimators that run, of `names()`.

    Raises:
        FieldError: unknown names, or neither robot nor feet.
    """
    kind = StrictEstimator if choice(refused, "refused", ("raise", "count")) == "raise" else Estimator
    if not np.iterable(names) or not (listed := tuple(names)):
        raise FieldError("missing", "names", f"got {shown(names)}, expected names of estimators")
    chosen = tuple(choice(name, "names", NAMES) for name in listed)
    if (robot is None) == (feet is None):
        raise FieldError("missing", "robot, feet", f"got {shown(robot)} and {shown(feet)}, expected one of both")
    if robot is None:
        mount = bare_mount(whole(feet, "feet", low=1, high=MOST_FEET))
        return kind(mount, EstimatorParams(), names=chosen)
    known = robot if isinstance(robot, Robot) else load_robot(robot)
    params = EstimatorParams.from_robot(known)
    return kind(foot_mount(known), params, names=chosen, points=contact_points(known) if params.soles else None)


def run(
    log: str | PathLike[str], name: str = BEST, *, robot: str | None = None, smooth: bool = False, **sensors: float
) -> "Result":
    """Estimate over a whole log: `track` holds arrays with a row per inertial sample, `score` the errors against truth.

    Args:
        log: recording (.mcap), or a log of another program (.csv, .npz).
        name: estimator, of `names()`.
        robot: description, for logs with joint angles.
        smooth: estimate forward and backward over the whole log.
        sensors: known parameters of the sensors, such as the noise `sigma_w` in rad/s and `sigma_q` in m/s^2.

    Raises:
        SurefootError: the log, the robot, the name or a statement on the sensors cannot be used.
    """
    from surefoot.lab.estimation.files import open_log
    from surefoot.lab.estimation.results import estimate
    from surefoot.lab.estimation.track import names as known_names

    choice(name, "name", known_names())
    for key in sensors:
        if key not in EstimatorParams.__dataclass_fields__:
            raise FieldError(
                "unknown_key", key, f"got {shown(sensors[key])}, known are fields of EstimatorParams: sigma_w ..."
            )
    known: dict[str, Any] = {name: number(value, name) for name, value in sensors.items()}
    opened = open_log(file_path(log, "log"), robot, **known)
    with TemporaryDirectory() as folder:
        return estimate(opened.log, name, Path(folder), smooth)


def names() -> tuple[str, ...]:
    """Return the names of all estimators that `run` accepts, including those only for comparison."""
    from surefoot.lab.estimation.track import names

    return names()


def _accepted(field: str, result: InputResult, given: Any) -> InputResult:
    if not result.accepted:
        _refuse(field, result, given)
    return result


def _refuse(field: str, result: InputResult, given: Any) -> NoReturn:
    raise FieldError(result.value, field, f"got {shown(given)}, allowed are {_ALLOWED[result]}")
