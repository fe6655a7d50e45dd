"""Velocity and tilt without a bus: `python examples/estimate/offline.py log.npz` (columns: docs/estimate.md)."""

import sys

import numpy as np

from surefoot.services.estimator.feet.mount import bare_mount
from surefoot.services.estimator.params import EstimatorParams
from surefoot.services.estimator.stream import Estimator

log = dict(np.load(sys.argv[1]))
feet = zip(log["foot_stamp_ns"].tolist(), log["foot_position"], log["foot_rotation"], log["contact"], strict=True)
estimator, sample = Estimator(bare_mount(log["contact"].shape[1]), EstimatorParams()), next(feet)
for stamp, w, q in zip(log["stamp_ns"].tolist(), log["gyro"], log["acc"], strict=True):
    estimator.imu(stamp, w, q)  # rad/s and m/s^2, IMU axes
    while sample is not None and sample[0] <= stamp:
        estimator.feet(*sample)  # positions, orientations and contacts of all feet, IMU axes
        sample = next(feet, None)
e = estimator.estimate()
print(f"v = {e.velocity_imu.round(3)} m/s  up = {(e.g_up / 9.81).round(3)}  tilt known: {e.initialised}")
