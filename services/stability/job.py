"""The calibration as a job of the service: collect poses while the robot moves its trunk, then fit."""

import numpy as np

from surefoot.arrays import Array, Flags
from surefoot.geometry.linear import norm
from surefoot.robot.description import Robot
from surefoot.schemas.calibration import CalibrateReply, CalibrateRequest

from .programs.contacts import StabilityError
from .sensing.calibration import APART_SD, Calibration, PoseCollector, SweptPose, calibrate

MAX_COLLECTED = 256


class CalibrationJob:
    """Calibration of joint torques: collects poses and fits gains; starts and ends at given ticks, so runs repeat."""

    def __init__(self, robot: Robot, torque_variance: float) -> None:
        self.robot, self.variance = robot, torque_variance
        self.collector: PoseCollector | None = None
        self.result: Calibration | None = None
        self.gain: Array | None = None
        """Factors in use by which reported joint torques are multiplied, (nj,); None = torques as reported."""
        self._planned: list[tuple[int, CalibrateRequest]] = []
        self._tick = -1

    def answer(self, request: CalibrateRequest) -> CalibrateReply:
        """Carry out an action of a calibration (start, finish, cancel, fit), or plan it for a later tick.

        Raises:
            StabilityError: poses of the request that cannot be used.
        """
        if request.action == "fit":
            return self._reply(calibrate(self.robot, self._poses(request), self.variance, _apart(request)), "done")
        if request.action in ("start", "finish") and request.at_tick is not None:
            if request.at_tick <= self._tick:
                reason = f"at_tick {request.at_tick} has passed; the next tick is {self._tick + 1}"
                return self._reply(self.result, self._state(), reason, accepted=False)
            self._planned.append((request.at_tick, request))
            return self._reply(self.result, self._state())
        return self._do(request)

    def on_tick(self, tick: int) -> str:
        """Carry out the actions planned for a tick; return a line for the log, empty if there is none."""
        self._tick = tick
        report = ""
        for item in [item for item in self._planned if item[0] <= tick]:
            self._planned.remove(item)
            report = self._do(item[1]).reason
        return report

    def sample(self, joints: Array, torque: Array, g_up: Array, stance: Flags) -> None:
        """Add a sample of the standing robot to the poses, while a calibration collects them.

        Args:
            joints: angles, (nj,) rad.
            torque: joint torques as reported, (nj,) Nm.
            g_up: upward specific force at rest, base_link, (3,) m/s^2.
            stance: True for feet on the ground, (L,).
        """
        if self.collector is not None and len(self.collector.poses) < MAX_COLLECTED:
            self.collector.add(joints, torque, g_up, stance)

    def _do(self, request: CalibrateRequest) -> CalibrateReply:
        match request.action:
            case "start":
                self.collector, self.result = PoseCollector(), None
            case "cancel":
                self.collector = None
            case "finish":
                return self._finish(request)
            case _:
                pass
        return self._reply(self.result, self._state(), "" if self.result is None else self._words(self.result))

    def _finish(self, request: CalibrateRequest) -> CalibrateReply:
        if self.collector is None:
            return self._reply(self.result, self._state(), "no calibration has been started", accepted=False)
        try:
            self.result = calibrate(self.robot, self.collector.poses, self.variance, _apart(request))
        except StabilityError as error:
            return self._reply(None, "collecting", f"not fitted: {error}", accepted=False)
        self.collector = None
        if request.apply:
            self.gain = self.result.gain
        found = self.result
        return self._reply(found, "done", self._words(found))

    def _words(self, found: Calibration) -> str:
        constant = self.robot.current.torque_per_ampere * found.common
        factor = f"torques of the servos x {found.common:.4f} +- {found.common_sd:.4f}"
        return f"{factor}, {constant:.4f} Nm/A, {found.poses} poses"

    def _poses(self, request: CalibrateRequest) -> list[SweptPose]:
        legs, nj, out = len(self.robot.legs), self.robot.nj, list[SweptPose]()
        for i, pose in enumerate(request.poses):
            stance = np.ones(legs, dtype=np.bool_) if pose.touch is None else np.array(pose.touch)
            up = np.array(pose.g_up)
            for name, size, wanted in (
                ("joints", len(pose.joints), nj),
                ("torque", len(pose.torque), nj),
                ("touch", stance.size, legs),
            ):
                if size != wanted:
                    raise StabilityError("shape", f"poses.{i}.{name}", f"got {size} values, expected {wanted}")
            if norm(up) < 1.0 or abs(up[0]) > 0.99 * norm(up):
                raise StabilityError("zero_direction", f"poses.{i}.g_up", f"got {pose.g_up}, must point up")
            out.append(SweptPose(np.array(pose.joints), np.array(pose.torque), up, stance))
        return out

    def _state(self) -> str:
        return "collecting" if self.collector is not None else "idle" if self.result is None else "done"

    def _reply(
        self, found: Calibration | None, state: str, reason: str = "", *, accepted: bool = True
    ) -> CalibrateReply:
        count = found.poses if found is not None else 0 if self.collector is None else len(self.collector.poses)
        if found is None:
            return CalibrateReply.model_validate(
                {"accepted": accepted, "reason": reason, "state": state, "poses": count}
            )
        return CalibrateReply.model_validate(
            {
                "accepted": accepted,
                "reason": reason,
                "state": state,
                "poses": count,
                "gain": found.common,
                "gain_sd": found.common_sd,
                "joint_gain": tuple(found.gain.tolist()),
                "torque_per_ampere": self.robot.current.torque_per_ampere * found.common,
                "offset": tuple(found.offset.tolist()),
                "residual_n": found.residual,
            }
        )


def _apart(request: CalibrateRequest) -> float:
    return APART_SD if request.per_joint else 0.0
