"""Rehearsal of the estimator with made-up samples: standing still, then walking on the spot."""

import numpy as np

from surefoot.geometry.constants import GRAVITY
from surefoot.robot.description import Robot

from .config import EstimatorConfig
from .feet.faulty import leg_faults
from .feet.mount import foot_mount
from .feet.slip import StanceSlip, feet_in_odom
from .filter.log import LogInputs
from .inputs.clock import RESYNC_AFTER
from .messages import odometry_message, velocity_message

WALK_SAMPLES = 24
"""Number of inertial samples after the start, 8 of them with joints: every foot lifts and comes down."""

LATER_NS, EARLIER_NS = 20_000_000_000, 10_000_000_000
"""`LATER_NS`: stamp of the first samples, ns; `EARLIER_NS`: stamp of joints by which their clock begins anew, ns."""


def rehearse(config: EstimatorConfig, robot: Robot, modes: tuple[str, ...]) -> None:
    """Run an estimator through start, stance, steps, messages and new clocks, so that every kernel is loaded.

    Args:
        config: settings of the service.
        robot: description of the robot.
        modes: names of the estimates that the service publishes.
    """
    estimator = config.estimator(robot)
    period, up = estimator.params.imu_period_ns, np.array([0.0, 0.0, GRAVITY])
    joints, every = robot.neutral.copy(), np.ones(len(robot.legs), dtype=np.bool_)
    mount = foot_mount(robot)
    slip, faults = StanceSlip(len(mount.radius), mount.radius), leg_faults(robot)
    rest = 2 * estimator.params.standstill_samples + 2  # so long until a rest shows the bias of the gyro
    for i in range(rest + WALK_SAMPLES):
        stamp, walking = LATER_NS + i * period, i >= rest
        wobble = 1e-3 * np.sin(i + np.arange(3.0))
        estimator.imu(stamp, wobble, up + wobble)
        if i % 3 == 0:
            swinging = np.arange(len(every)) % 2 == (i // 6) % 2
            estimator.joints(
                stamp, joints + 1e-3 * walking * np.sin(i + np.arange(joints.size)), every & ~(swinging & walking)
            )
        if walking:
            feet = feet_in_odom(mount, estimator.seen, estimator.pose())
            slip.update(every, *feet, faults.update(joints, stamp, every, slip.risen(feet[0])))
            odometry_message(estimator.pose(), estimator.initialised)
            for mode in modes:
                velocity_message(estimator.estimate(mode))
    for i in range(RESYNC_AFTER + 1):  # the clock of the joints begins anew, then that of the inertial unit
        estimator.joints(EARLIER_NS + i * period, joints, every)
    for i in range(RESYNC_AFTER + 1):
        estimator.imu(i * period, 1e-3 * np.sin(i + np.arange(3.0)), up)
    estimator.estimate()  # degraded inputs, in words


def rehearse_log(config: EstimatorConfig, robot: Robot) -> None:
    """Run a log of one row, to load the kernel for logs, which holds the whole filter; `surefoot estimate` uses it."""
    estimator, feet = config.estimator(robot), len(robot.legs)
    log = LogInputs(
        np.zeros(1, dtype=np.int64), np.zeros((1, 3)), np.array([[0.0, 0.0, GRAVITY]]), np.zeros(1, dtype=np.bool_),
        np.zeros(0, dtype=np.int64), np.zeros((0, feet, 3)), np.zeros((0, feet, 3, 3)),
        np.zeros((0, feet, estimator.switches)),
    )  # fmt: skip
    estimator.follow(log, np.zeros(1, dtype=np.int64), 0, 1)
