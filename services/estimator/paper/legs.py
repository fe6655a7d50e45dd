"""Velocity by the legs from the stream of foot samples: which feet stand, which of them slide."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..feet.kinematics import FootSample, leg_velocity
from ..params import EstimatorParams

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

MAX_INTERVAL = 3.5  # kinematic periods; feet that far apart in time are not compared


@dataclass(frozen=True, eq=False)
class LegVelocity:
    """Velocity of the IMU by the stance feet, mean over the interval, IMU axes."""

    stamp_ns: int  # end of the interval
    interval_s: float
    v_kg: Array  # (3,) m/s, kinematics and gyro, (14)
    feet_kg: int  # feet in v_kg; 0: no measurement
    v_k: Array  # (3,) m/s, kinematics only, (10)
    feet_k: int  # feet in v_k; 0: no measurement
    stance: Flags  # (L,) in contact at both samples
    slipping: Flags  # (L,) left out, or (one or two stance feet) doubtful


class LegTracker:
    """Remembers the last foot sample and compares the next with it."""

    def __init__(self, feet: int, radius: Array, params: EstimatorParams) -> None:
        self._params = params
        self._radius = radius if params.rolling else np.zeros(feet)
        self._longest = MAX_INTERVAL * params.kinematics_period_ns
        self.reset()

    def reset(self) -> None:
        """Forget the last sample."""
        self.last: FootSample | None = None
        self._support = -1

    def step(self, sample: FootSample, w: Array, up: Array, v_now: Array) -> LegVelocity | None:
        """Compare with the sample before; None for the first one and after a gap.

        A foot counts if it is in contact at BOTH samples.

        Args:
            sample: the feet now.
            w: mean gyro since the last sample (or the latest one, as in the paper), (3,) rad/s, bias removed.
            up: upward unit vector, IMU axes, (3,).
            v_now: velocity by the filter, (3,) m/s, to cast doubt on one or two feet that cannot be compared.
        """
        last, self.last = self.last, sample
        if last is None or not 0 < sample.stamp_ns - last.stamp_ns <= self._longest:
            self._support = -1
            return None
        d = 1e-9 * (sample.stamp_ns - last.stamp_ns)
        stance = last.contact & sample.contact
        used = self._one(stance) if self._params.feet == "one" else stance
        v_kg, feet_kg, v_k, feet_k, slipping = leg_velocity(
            last.position, sample.position, last.rot, sample.rot, used, w, up, self._radius, d,
            self._params.slip_speed, v_now,
        )  # fmt: skip
        return LegVelocity(sample.stamp_ns, d, v_kg, feet_kg, v_k, feet_k, stance, slipping)

    def _one(self, stance: Flags) -> Flags:
        """Keep the earlier foot until it lifts, then the first that stands: the paper's double support."""
        if self._support < 0 or not stance[self._support]:
            standing = np.flatnonzero(stance)
            self._support = int(standing[0]) if len(standing) else -1
        used = np.zeros_like(stance)
        if self._support >= 0:
            used[self._support] = True
        return used
