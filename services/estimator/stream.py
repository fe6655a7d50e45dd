"""Estimator of a robot or a log: takes raw samples, checks them, feeds every filter, returns estimates."""

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surefoot.arguments import shown
from surefoot.arrays import Array, Flags
from surefoot.errors import FieldError
from surefoot.geometry.rotations import wrap_angle
from surefoot.robot.description import Robot

from .feet.contact import BestGeometry, ContactPoints, at_switches, contact_points, point_feet
from .feet.mount import FootMount, FootSample, feet_in_imu, foot_mount, known_feet
from .filter.best import BestFilter, BestOutput, ExternalUse
from .filter.hypotheses import modes_of
from .filter.intake import NOW_NS
from .filter.log import LogInputs, LogRows, new_rows
from .filter.setting import best_limits, best_noise
from .health import STANDING, Condition, flags, reasons
from .inputs.clock import bounded
from .inputs.counters import InputCheck
from .inputs.external import ExternalSample
from .inputs.results import RESULTS, InputResult
from .output import OdometryPose, VelocityAndTilt, summary
from .paper.bank import PaperEstimators, PaperOutput
from .paper.estimators import ESTIMATORS
from .params import EstimatorParams, StartPose, paper_params

BEST, PAPER = "best", "paper"
NAMES = (BEST, *ESTIMATORS, PAPER)
"""Names of all estimators: `best`, the four of Wawrzynski et al. with improvements, and `paper`, their own filter."""


class NotRunning(FieldError, KeyError):
    """Error for the name of an estimator that does not run."""

    def __str__(self) -> str:
        return f"{self.field}: {self.message}"  # of a KeyError it would be quoted


class Estimator:
    """Velocity, gravity and pose of a legged robot from inertial samples and its feet; no bus, no clock.

        estimator = Estimator.for_robot(load_robot("ragno"))
        estimator.imu(stamp_ns, gyro, acc)
        estimator.joints(stamp_ns, angles, contact)
        print(estimator.estimate().velocity, estimator.pose().position)

    Args:
        mount: kinematic model, mounting of the IMU and radii of the feet.
        params: noises, limits and switches.
        start: pose at the start; None = at the origin.
        names: estimators to run.
        points: contact points on the feet; None = one for each foot.
        hypotheses: True: contact points may slide; False: they never do.
    """

    def __init__(
        self,
        mount: FootMount,
        params: EstimatorParams,
        start: StartPose | None = None,
        names: Iterable[str] = (BEST, *ESTIMATORS),
        points: ContactPoints | None = None,
        hypotheses: bool = True,
    ) -> None:
        self.params = params
        self._mount, self._start, self._hypotheses = mount, start or StartPose(), hypotheses
        self._feet = len(mount.radius)
        self._points = point_feet(mount.radius if params.rolling else 0.0 * mount.radius) if points is None else points
        self._rot_base_from_imu = np.ascontiguousarray(mount.rot_imu_from_base.T)
        chosen = tuple(names)
        self.switches = self._points.switches.shape[1]
        """Number S of switches of a foot whose positions are known; 1: one switch for the whole foot."""
        self._geometry = BestGeometry(*self._points, self._rot_base_from_imu, mount.imu_position)
        self._groups: list[tuple[tuple[str, ...], PaperEstimators]] = []
        ours = tuple(name for name in chosen if name in ESTIMATORS)
        if ours:
            with_leader = ours if {"ekf", "imu"} & set(ours) else (*ours, "ekf")
            self._groups.append((ours, PaperEstimators(mount, params, with_leader)))
        if PAPER in chosen:
            own = replace(
                paper_params(params), remove_gyro_bias=params.remove_gyro_bias, refine_gyro_bias=params.refine_gyro_bias
            )
            self._groups.append(((PAPER,), PaperEstimators(mount, own, ("ekf",))))
        self.reset()

    @classmethod
    def for_robot(
        cls,
        robot: Robot,
        start: StartPose | None = None,
        names: Iterable[str] = (BEST, *ESTIMATORS),
        **changes: object,
    ) -> "Estimator":
        """Return an estimator with sensors and feet of a robot.

        Args:
            robot: description.
            start: pose at the start, if it is known.
            names: estimators that run side by side.
            changes: parameters that differ from those of the robot, by name, as `sigma_w` (gyro noise of a row, rad/s).
        """
        params = EstimatorParams.from_robot(robot, **changes)
        return cls(foot_mount(robot), params, start, names, contact_points(robot) if params.soles else None)

    def reset(self, stated: bool = True) -> None:
        """Drop all state and counters, and begin again as before the first sample.

        Args:
            stated: True if start pose and level ground still hold; False after a restart in the middle of a walk, which
                begins again at the start pose with the covariance of an unknown pose.
        """
        params, hypotheses = self.params, self._hypotheses
        self.check = InputCheck(params, self._feet, len(self._points.foot))
        noise = best_noise(params, bool(modes_of(self._feet)))
        limits = best_limits(params, self._start, stated, hypotheses)
        self._best = BestFilter(self._geometry, noise, limits, self.check)
        for _, group in self._groups:
            group.reset(stated)
        self.seen: tuple[Array, Array] = np.zeros((self._feet, 3)), np.zeros((self._feet, 3, 3))
        """Foot centres from the IMU, IMU axes, (L, 3) m, and rot_imu_from_foot (L, 3, 3), of the last joint angles."""
        self.silent: dict[str, float] = {}
        """Time for which inputs are silent, s, by name, set by the caller: flags and reasons depend on it."""

    # inputs

    def imu(self, stamp_ns: int, w: ArrayLike, q: ArrayLike, clipped: bool = False) -> InputResult:
        """Take an inertial sample; return its result.

        Args:
            stamp_ns: its time, ns; one of the last half second is put where it belongs.
            w: mean gyro since the last sample, (3,) rad/s, IMU axes.
            q: mean specific force since the last sample, (3,) m/s^2, IMU axes; at rest it points up.
            clipped: True if an axis was at the end of its range.

        Returns:
            The result: accepted, or the reason of a refusal; nothing raises.
        """
        w, q = _plain(w), _plain(q)
        if w.shape != (3,) or q.shape != (3,):
            return self._refuse_shape("imu", stamp_ns)
        result = RESULTS[self._best.imu(bounded(stamp_ns), w, q, clipped)]
        if result.accepted:
            self._restart_groups(result)
            for _, group in self._groups:
                group.on_imu(stamp_ns, w, q)
        return result

    def joints(self, stamp_ns: int, q: ArrayLike, contact: ArrayLike | None = None) -> InputResult:
        """Take joint angles, from which the positions of the feet follow; return their result.

        Args:
            stamp_ns: their time, ns; a sample of the last half second is put where it belongs.
            q: angles in the order of the robot's joints, (nj,) rad.
            contact: flag or probability of each foot, (L,), or at each of its S switches, (L, S); None or NaN: no
                sensor, decided by the height of the feet.

        Returns:
            The result: accepted, or the reason of a refusal; nothing raises.
        """
        model, q = self._mount.model, _plain(q)
        if model is None or q.shape != model.lower.shape:
            return self._refuse_shape("kinematics", stamp_ns)
        self.seen = feet_in_imu(self._mount, q)
        return self.feet(stamp_ns, *self.seen, contact)

    def feet(self, stamp_ns: int, position: ArrayLike, rot: ArrayLike, contact: ArrayLike | None = None) -> InputResult:
        """Take positions and rotations of the feet, as logs have them; return their result.

        Args:
            stamp_ns: their time, ns; a sample of the last half second is put where it belongs.
            position: foot centres from the IMU, (L, 3) m, IMU axes.
            rot: rot_imu_from_foot, (L, 3, 3).
            contact: flag or probability of each foot, (L,), or at each of its S switches, (L, S), those of a sole in
                the order of its corners; None or NaN: no sensor, decided by the height of the feet.

        Returns:
            The result: accepted, or the reason of a refusal; nothing raises.
        """
        feet, position, rot = self._feet, _plain(position), _plain(rot)
        known = np.full(feet, np.nan) if contact is None else _plain(contact)
        known = known[:, None] if known.ndim == 1 else known
        if position.shape != (feet, 3) or rot.shape != (feet, 3, 3) or known.shape[:-1] != (feet,) or not known.size:
            return self._refuse_shape("kinematics", stamp_ns)
        known = at_switches(known, self.switches)
        result = RESULTS[self._best.feet(bounded(stamp_ns), position, rot, known)]
        if result.accepted and self._groups:
            self._restart_groups(result)
            position, rot, contacts, _, _ = known_feet(position, rot, known)
            sample = FootSample(stamp_ns, position, rot, ~(contacts < 0.5))
            for _, group in self._groups:
                group.on_feet(sample)
        return result

    def external(self, stamp_ns: int, sample: ExternalSample) -> InputResult:
        """Take a pose, heading or velocity of another source, e.g. a camera; return its result.

        Args:
            stamp_ns: time at which it holds, ns, not that of its arrival; one of the last half second is put where it
                belongs.
            sample: pose, heading or velocity, with its own covariances.

        Returns:
            The result; nothing raises. One that contradicts the estimate is accepted, left out and counted.
        """
        row, result = sample.row()
        if result.accepted:
            result = RESULTS[self._best.external(bounded(stamp_ns), row)]
        if not result.accepted:
            self.check.external[f"external_{result}"] += 1
        return result

    @property
    def externals(self) -> ExternalUse:
        """Counts of poses and velocities of other sources, used and left out; turn of their frame against odom."""
        return self._best.externals

    def _refuse_shape(self, source: str, stamp_ns: int) -> InputResult:
        self._best.outdate()
        return self.check.count(source, InputResult.SHAPE, stamp_ns)

    def _restart_groups(self, result: InputResult) -> None:
        if result in (InputResult.RESTART, InputResult.STEPPED):
            for _, group in self._groups:
                group.restart_clock()

    def follow(self, log: LogInputs, order: NDArray[np.int64], first: int, n: int, joint: bool = False) -> LogRows:
        """Run the `best` filter over a log; equal to the bit to calls of `imu`, `feet` and `external` one by one.

        Args:
            log: all inertial rows, samples of the feet and of another source, SI, IMU axes.
            order: inputs to take in their order of arrival, (k,): the index of an inertial row; number of inertial rows
                + index of a sample of the feet; or number of both + index of a sample of another source.
            first: inertial row of the first estimate.
            n: number of estimates.
            joint: True includes the covariance of g, v and biases.

        Returns:
            The estimate after each inertial row and the feet that follow it; rows that did not arrive are zero.
        """
        rows = new_rows(n, self._feet, joint)
        if len(log.external_ns):
            self._best.frame()
        self._best.follow(log, order, rows, first)
        return rows

    # outputs

    @property
    def stamp_ns(self) -> int:
        """Stamp of the newest inertial sample, ns."""
        return int(self._best.parts.clock.stamps[NOW_NS])

    @property
    def best(self) -> BestOutput:
        """Estimate of the `best` filter at the newest inertial sample."""
        return self._best.output

    @property
    def wrong_legs(self) -> Flags:
        """True for feet of which `best` has found a sensor wrong, (L,)."""
        if self.best.quiet:
            return np.zeros(self._feet, dtype=np.bool_)
        legs = self._best.condition.legs
        bits = legs.left_out | legs.switches | legs.jumping | legs.still | legs.swapped
        return (bits >> np.arange(self._feet)) & 1 > 0 if bits else np.zeros(self._feet, dtype=np.bool_)

    @property
    def initialised(self) -> bool:
        """True if `best` has started and its estimates can be used, else False."""
        return self.best.settled

    def estimate(self, name: str = BEST) -> VelocityAndTilt:
        """Return the present estimate of one estimator: velocity, tilt, biases, flags and reasons.

        Raises:
            NotRunning: no estimator of this name runs; it is a KeyError too.
        """
        e = self._estimate_of_best() if name == BEST else self._estimate_of_paper(name)
        return e._replace(inputs_ok=False, sensors_ok=False) if self.silent else e

    def _estimate_of_best(self) -> VelocityAndTilt:
        best = self.best
        velocity, heading, turn, up, (roll, pitch, _) = best.expressed
        texts = self._reasons(None if best.quiet else self._best.condition, best.slipping, best.standing)
        return VelocityAndTilt(
            BEST, self.stamp_ns, velocity, best.v, heading, turn, up, float(roll), float(pitch), best.gyro_bias,
            best.acc_bias, best.covariance, best.settled, best.standing, *best.flags, best.slipping, best.sliding,
            best.nis if math.isfinite(best.nis) else None, self.check.refused, texts,
        )  # fmt: skip

    def _estimate_of_paper(self, name: str) -> VelocityAndTilt:
        names, group = next((pair for pair in self._groups if name in pair[0]), ((), None))
        if group is None:
            running = ", ".join((BEST, *(n for some, _ in self._groups for n in some)))
            raise NotRunning("unknown_name", "name", f"got {shown(name)}, running are {running}")
        out: PaperOutput = group.output("ekf" if names == (PAPER,) else name)
        covariance = out.covariance.copy()
        for i in range(3):
            covariance[i, i] += out.hidden
        w, mount = self._best.parts.clock.w, self._mount
        rows, good = summary(out.g, out.v, covariance, w, group.bias, self._rot_base_from_imu, mount.imu_position)
        velocity, heading, turn, up, (roll, pitch, _) = rows
        c = self._best.condition._replace(
            initialised=group.initialised, standing=group.standstill.standing, healthy=good, nis=out.nis_mean,
            slipping=bool(group.slipping.any()), excess=1.0, since_velocity_s=1e-9 * out.since_velocity_ns,
        )  # fmt: skip
        return VelocityAndTilt(
            name, self.stamp_ns, velocity, out.v, heading, turn, up, float(roll), float(pitch), group.bias,
            group.acc_bias, covariance, c.initialised, c.standing, *flags(c), group.slipping,
            np.where(group.slipping, 1.0, 0.0), None if out.nis is None or not math.isfinite(out.nis) else out.nis,
            self.check.refused, self._reasons(c, group.slipping, c.standing),
        )  # fmt: skip

    def _reasons(self, condition: Condition | None, slipping: Flags, standing: bool) -> tuple[str, ...]:
        """Return the reasons of an estimate's flags in words.

        Args:
            condition: numbers from which they follow; None: there is nothing to report but standing.
            slipping: which feet slide, (L,).
            standing: the robot is at rest.
        """
        check, unit = self.check, self.check.unit
        if condition is None:
            if not (unit or self.silent):
                return STANDING if standing else ()
            condition = self._best.condition
        return reasons(condition, self.silent, unit, check.last_bad, slipping)

    def pose(self) -> OdometryPose:
        """Return pose and velocity of base_link in odom at the last inertial sample, by `best`."""
        best = self.best
        yaw = self._best.parts.clock.yaw
        yaw[0] += wrap_angle(best.yaw - float(yaw[0]))
        return OdometryPose(best.position, best.quat_wxyz, float(yaw[0]), best.v_odom, best.pose_covariance)


def _plain(values: ArrayLike) -> Array:
    """Return values as a writable float64 array of their shape in C order, as kernels need; empty if not numbers."""
    try:
        return np.array(values, dtype=np.float64, order="C")
    except (TypeError, ValueError, OverflowError):
        return np.empty(0)
