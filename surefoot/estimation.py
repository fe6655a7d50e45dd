"""Velocity, tilt and path of a legged robot from its IMU and its feet: sample by sample, or over a whole log.

estimator = estimation.estimator("ragno")
estimator.imu(stamp_ns, gyro, acc)
estimator.joints(stamp_ns, angles, contact)
estimator.estimate().velocity

estimation.run("log.npz").track.v
"""

from collections.abc import Iterable
from dataclasses import replace
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Literal, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from surefoot.arguments import (
    FARTHEST_FOOT,
    NO_NUMBERS,
    WIDEST_ANGLE,
    choice,
    file_path,
    flag,
    instance,
    number,
    shown,
    whole,
)
from surefoot.arrays import Array
from surefoot.errors import FieldError
from surefoot.robot.description import Robot
from surefoot.robot.reader import load_robot
from surefoot.services.estimator.feet.contact import contact_points
from surefoot.services.estimator.feet.mount import bare_mount, foot_mount
from surefoot.services.estimator.inputs.external import LARGEST, SHAPES, ExternalSample
from surefoot.services.estimator.inputs.results import InputResult
from surefoot.services.estimator.output import OdometryPose, VelocityAndTilt
from surefoot.services.estimator.params import EstimatorParams, at_rate
from surefoot.services.estimator.stream import BEST, NAMES, Estimator

if TYPE_CHECKING:
    from surefoot.lab.estimation.results import Result

__all__ = [
    "CountingEstimator", "Estimator", "ExternalSample", "InputResult", "OdometryPose", "StrictEstimator",
    "VelocityAndTilt", "estimator", "names", "run",
]  # fmt: skip

MOST_FEET = 16
UNSQUARE = 0.01
"""Largest difference of R R' of a foot's rotation R from the unit matrix, by element; a larger one is refused."""
ROUNDING = 1e-6
"""Tolerance of a contact probability below 0 and above 1, no unit; beyond it the contact is refused."""
_OF_STAMPS = (InputResult.DUPLICATE, InputResult.BACKWARD, InputResult.LATE, InputResult.AHEAD)
_UNITS = {"position": "m", "yaw": "rad", "velocity": "m/s"}
_ALLOWED = {
    InputResult.NONFINITE: "finite numbers",
    InputResult.DUPLICATE: "each stamp once",
    InputResult.BACKWARD: "stamps that rise, but for samples that are missing",
    InputResult.LATE: "stamps of the last half second",
    InputResult.AHEAD: "stamps near those before",
    InputResult.UNIT: "rad/s, m/s^2 (specific force: +9.81 along up at rest) and m",
    InputResult.COVARIANCE: "symmetric positive covariances",
    InputResult.FRAME: "a position together with a heading",
}


class CountingEstimator(Estimator):
    """An `Estimator` that returns the reason for each sample it refuses, and counts it; nothing raises but wrong types.

    A stamp, flag, name or sample of another type is an error of the program that feeds it: a FieldError (`type`).
    """

    def imu(self, stamp_ns: int, w: ArrayLike, q: ArrayLike, clipped: bool = False) -> InputResult:
        """Take angular rate w (3,) rad/s and specific force q (3,) m/s^2, IMU axes; return the result.

        `stamp_ns`: time of the sample, ns; `clipped`: True if an axis was at the end of its range.
        """
        beyond = flag(clipped, "clipped")
        return super().imu(whole(stamp_ns, "stamp_ns", "ns"), _real(w), _real(q), beyond)

    def joints(self, stamp_ns: int, q: ArrayLike, contact: ArrayLike | None = None) -> InputResult:
        """Take joint angles q (nj,) rad; return the result.

        `stamp_ns`: time of the sample, ns; `contact`: flag or probability of each foot, (L,), or switch, (L, S), None =
        unknown.
        """
        touch = None if contact is None else _real(contact)
        return super().joints(whole(stamp_ns, "stamp_ns", "ns"), _real(q), touch)

    def feet(self, stamp_ns: int, position: ArrayLike, rot: ArrayLike, contact: ArrayLike | None = None) -> InputResult:
        """Take foot centres (L, 3) m, IMU axes, and rot_imu_from_foot (L, 3, 3); return the result.

        `stamp_ns`: time of the sample, ns; `contact`: flag or probability of each foot, (L,), or switch, (L, S), None =
        unknown.
        """
        touch = None if contact is None else _real(contact)
        return super().feet(whole(stamp_ns, "stamp_ns", "ns"), _real(position), _real(rot), touch)

    def external(self, stamp_ns: int, sample: ExternalSample) -> InputResult:
        """Take a pose, heading or velocity of another source, which holds at `stamp_ns`, ns; return the result."""
        instance(sample, "external", ExternalSample, "an ExternalSample")
        return super().external(whole(stamp_ns, "stamp_ns", "ns"), sample)

    def estimate(self, name: str = BEST) -> VelocityAndTilt:
        """Return the present estimate of the estimator `name` (raises FieldError: none of that name runs)."""
        instance(name, "name", str, "the name of an estimator that runs")
        return super().estimate(name)


class StrictEstimator(CountingEstimator):
    """An `Estimator` that raises a FieldError for each sample it refuses; the next samples are used as usual."""

    def reset(self, stated: bool = True) -> None:
        """Drop all state and counters, and begin again as before the first sample.

        Args:
            stated: True if start pose and level ground still hold; False after a restart in the middle of a walk.

        Raises:
            FieldError: `stated` is no flag.
        """
        super().reset(flag(stated, "stated"))

    def imu(self, stamp_ns: int, w: ArrayLike, q: ArrayLike, clipped: bool = False) -> InputResult:
        """Take angular rate w (3,) rad/s and specific force q (3,) m/s^2, IMU axes; raise FieldError if refused.

        `stamp_ns`: time of the sample, ns; `clipped`: True if an axis was at the end of its range.
        """
        result = super().imu(stamp_ns, w, q, clipped)
        if result is InputResult.SHAPE:
            _refuse("imu", result, f"w {_form(w)} and q {_form(q)}", "w (3,) rad/s and q (3,) m/s^2")
        if result is InputResult.SATURATED:
            most = self.params.max_gyro, self.params.max_acc
            beyond = _reaches("w", w, most[0]) or _reaches("q", q, most[1]) or "clipped = True"
            _refuse("imu", result, beyond, f"w within +-{most[0]:.4g} rad/s and q within +-{most[1]:.4g} m/s^2")
        return _accepted("imu", result, stamp_ns, (w, q))

    def joints(self, stamp_ns: int, q: ArrayLike, contact: ArrayLike | None = None) -> InputResult:
        """Take joint angles q (nj,) rad, and `contact` by foot (L,) or switch (L, S), None = unknown.

        `stamp_ns`: time of the sample, ns.

        Raises:
            FieldError: the sample is refused, an angle is out of range, or the estimator has no robot.
        """
        model = self._mount.model
        if model is None:
            raise FieldError("unsupported", "joints", "got joint angles, expected feet: no robot was named")
        if wrong := _outside("q", q, -WIDEST_ANGLE, WIDEST_ANGLE):
            text = f"got {wrong}, allowed are q within +-{WIDEST_ANGLE:g} rad, NaN = unknown"
            raise FieldError("range", "joints", text)
        _check_contact("joints", contact)
        try:
            result = super().joints(stamp_ns, q, contact)
        except FieldError as error:
            if error.field != "feet":
                raise
            result = InputResult(error.code)  # the angles become feet
        if result is InputResult.SHAPE:
            form = f"q (nj,) = {model.lower.shape} and {self._contact_form}"
            _refuse("joints", result, f"q {_form(q)} and contact {_form(contact)}", form)
        return _accepted("joints", result, stamp_ns, (q, contact))

    def feet(self, stamp_ns: int, position: ArrayLike, rot: ArrayLike, contact: ArrayLike | None = None) -> InputResult:
        """Take poses and contacts of the feet, for logs without joint angles; raise an error if refused.

        Args:
            stamp_ns: their time, ns.
            position: foot centres, (L, 3) m, IMU axes.
            rot: rot_imu_from_foot, (L, 3, 3).
            contact: flag or probability of each foot, (L,), or of each switch, (L, S); None = no sensor.

        Raises:
            FieldError: they are refused, also a foot more than 10 m away, or a matrix that is no rotation.
        """
        _check_contact("feet", contact)
        if wrong := _outside("position", position, -FARTHEST_FOOT, FARTHEST_FOOT):
            text = f"got {wrong} m, allowed are positions within +-{FARTHEST_FOOT:g} m; are these millimetres?"
            raise FieldError("range", "feet", text)
        _check_rotations(rot)
        result = super().feet(stamp_ns, position, rot, contact)
        if result is InputResult.SHAPE:
            got = f"position {_form(position)}, rot {_form(rot)} and contact {_form(contact)}"
            _refuse("feet", result, got, f"position (L, 3), rot (L, 3, 3) and {self._contact_form}")
        return _accepted("feet", result, stamp_ns, position)

    @property
    def _contact_form(self) -> str:
        return f"contact (L,) or (L, S), L = {self._feet}"

    def external(self, stamp_ns: int, sample: ExternalSample) -> InputResult:
        """Take a pose, heading or velocity of another source, such as a camera, and raise an error if it is refused.

        `stamp_ns`: time at which it holds, ns.

        Raises:
            FieldError: it is refused.
        """
        result = super().external(stamp_ns, sample)
        if not result.accepted:
            _refuse("external", result, *_wrong_part(sample, stamp_ns, result))
        return result


def estimator(
    robot: str | Robot | None = None,
    *,
    feet: int | None = None,
    refused: Literal["raise", "count"] = "raise",
    names: Iterable[str] = (BEST,),
    imu_hz: float = 100.0,
) -> Estimator:
    """Return an estimator that is fed sample by sample.

    Args:
        robot: name, path or description; None for feet that are given as positions.
        feet: their number, without a robot.
        refused: policy for a sample that cannot be used: raise a FieldError, or return the reason, count it and go on.
        names: estimators that run: those of `names()` that work sample by sample; its last ones need a whole log and
            are accepted by `run` only.
        imu_hz: samples of the inertial unit per second, 10 to 10 000: gaps and rests are found by it.

    Raises:
        FieldError: unknown names, names of `run` alone, another rate, or neither robot nor feet.
    """
    rate = number(imu_hz, "imu_hz", "Hz", low=10.0, high=10_000.0)
    kind = StrictEstimator if choice(refused, "refused", ("raise", "count")) == "raise" else CountingEstimator
    if not np.iterable(names) or not (listed := tuple(names)):
        raise FieldError("missing", "names", f"got {shown(names)}, expected names of estimators")
    chosen = tuple(_live(name) for name in listed)
    if (robot is None) == (feet is None):
        raise FieldError("missing", "robot, feet", f"got {shown(robot)} and {shown(feet)}, expected one of both")
    if robot is None:
        mount = bare_mount(whole(feet, "feet", low=1, high=MOST_FEET))
        return kind(mount, at_rate(EstimatorParams(), rate), names=chosen)
    known = robot if isinstance(robot, Robot) else load_robot(robot)
    params = at_rate(EstimatorParams.from_robot(known), rate)
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
    both_ways = flag(smooth, "smooth")
    for key in sensors:
        if key not in EstimatorParams.__dataclass_fields__:
            raise FieldError(
                "unknown_key", key, f"got {shown(sensors[key])}, known are fields of EstimatorParams: sigma_w ..."
            )
    known: dict[str, Any] = {name: number(value, name, low=0.0) for name, value in sensors.items()}
    opened = open_log(file_path(log, "log"), robot, **known)
    with TemporaryDirectory() as folder:
        return estimate(opened.log, name, Path(folder), both_ways)


def names() -> tuple[str, ...]:
    """Return the names of all estimators that `run` accepts: those of `estimator`, then those of `run` alone."""
    from surefoot.lab.estimation.track import names

    return names()


def _live(name: Any) -> str:
    """Return the name of an estimator that runs sample by sample (raises FieldError: another name)."""
    if isinstance(name, str) and name not in NAMES and name in names():
        only = f"got {name!r}, which only `estimation.run` has, known here are {', '.join(NAMES)}"
        raise FieldError("unknown_name", "names", only)
    return choice(name, "names", NAMES)


def _accepted(field: str, result: InputResult, stamp_ns: int, given: Any) -> InputResult:
    if not result.accepted:
        _refuse(field, result, f"stamp_ns = {stamp_ns}" if result in _OF_STAMPS else shown(given))
    return result


def _refuse(field: str, result: InputResult, got: str, allowed: str = "") -> NoReturn:
    raise FieldError(result.value, field, f"got {got}, allowed are {allowed or _ALLOWED[result]}")


def _numbers(values: Any) -> Array:
    """Return values as an array of numbers in their shape, empty if they are no numbers."""
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return np.empty(0)


def _real(values: Any) -> ArrayLike:
    """Return values as they are, masked ones as NaN = unknown, and text, times and complex numbers as no numbers."""
    if np.ma.isMaskedArray(values):
        values = np.ma.filled(values.astype(np.float64), np.nan) if values.dtype.kind in "biuf" else np.empty(0)
    try:
        return np.empty(0) if np.asarray(values).dtype.kind in NO_NUMBERS else values
    except ValueError:  # rows of unequal length
        return np.empty(0)


def _form(values: Any) -> str:
    """Return the shape of an array of numbers as text; for other values a shortened text of the value."""
    found = _numbers(values)
    return str(found.shape) if found.size and values is not None else shown(values)


def _reaches(name: str, values: Any, most: float) -> str:
    """Return the first of the values that reaches +-`most`, with its name and index; empty = none does."""
    within = float(np.nextafter(most, 0.0))
    return _outside(name, values, -within, within)


def _outside(name: str, values: Any, low: float, high: float) -> str:
    """Return the first of the values below `low` or above `high`, with its name and index; empty = none is."""
    found = _numbers(values)
    for at in np.argwhere((found < low) | (found > high)).tolist():
        return f"{name}{at if at else ''} = {float(found[tuple(at)]):g}"
    return ""


def _check_contact(field: str, contact: Any) -> None:
    """Raise FieldError (`range`) if contact flags or probabilities are more than `ROUNDING` outside 0 to 1."""
    if wrong := _outside("contact", contact, -ROUNDING, 1.0 + ROUNDING):
        text = f"got {wrong}, allowed are flags or probabilities, 0 to 1, NaN = unknown"
        raise FieldError("range", field, text)


def _check_rotations(rot: Any) -> None:
    """Raise FieldError (`rotation`) if one of the matrices (L, 3, 3) is no rotation; unknown ones are NaN."""
    found = _numbers(rot)
    if found.ndim != 3 or found.shape[1:] != (3, 3):
        return  # refused by its shape
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.abs((found[:, :, None] * found[:, None]).sum(axis=-1) - np.eye(3)).max(axis=(1, 2))
        turned = (np.cross(found[:, 0], found[:, 1]) * found[:, 2]).sum(axis=1)
    for i in np.flatnonzero((off > UNSQUARE) | (turned < 0.0)).tolist():
        text = f"got rot[{i}] = {found[i].tolist()}, allowed are rotations: rows of length 1 at right angles, no mirror"
        raise FieldError("rotation", "feet", text)


def _wrong_part(sample: ExternalSample, stamp_ns: int, result: InputResult) -> tuple[str, str]:
    """Return a text on the wrong part of a refused pose, heading or velocity, and one on what is allowed there."""
    given = {name: getattr(sample, name) for name, _ in SHAPES if getattr(sample, name) is not None}
    if not given:
        return "a sample without a value", "position, yaw or velocity, with its covariance or variance"
    if result is InputResult.FRAME:
        return f"position = {shown(sample.position)} and yaw = None", _ALLOWED[result]
    for name, size in SHAPES:
        key = f"{name}_covariance" if size > 1 else f"{name}_variance"
        part = {name: given.get(name), key: getattr(sample, key)}
        alone = replace(ExternalSample(yaw=0.0, yaw_variance=1.0), **part)
        if name not in given or alone.row()[1] is not result:
            continue
        value, spread = _numbers(part[name]), _numbers(part[key])
        if result is InputResult.SHAPE:
            forms = f"{name} {(size,) if size > 1 else '()'}", f"{key} {'(3, 3) or (9,)' if size > 1 else '()'}"
            return f"{name} {_form(part[name])} and {key} {_form(part[key])}", " and ".join(forms)
        if result is InputResult.UNIT:
            return f"{name} = {shown(part[name])}", f"numbers within +-{LARGEST[name]:g} {_UNITS[name]}"
        wrong = key if result is InputResult.COVARIANCE or np.isfinite(value).all() else name
        allowed = "numbers above 0" if wrong == "yaw_variance" and np.isfinite(spread).all() else _ALLOWED[result]
        return f"{wrong} = {shown(part[wrong])}", allowed
    return f"stamp_ns = {stamp_ns}", _ALLOWED[result]
