"""Whole logs by one kernel: what samples one by one give, to the bit."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.lab.estimation.faults import delayed, shuffled, with_losses
from surefoot.lab.estimation.track import track
from surefoot.papers.wawrzynski.synthetic import KINDS, synthesize
from surefoot.services.estimator.filter.log import FLAGS, LogInputs
from surefoot.services.estimator.stream import BEST
from tests.services.estimator.test_stream import make, walk


def damaged(log):
    """Everything at once: NaN, saturation, doubles, a clock that begins anew, dead encoders, a frozen unit."""
    w, stamp, foot_ns = log.w.copy(), log.stamp_ns.copy(), log.foot_ns.copy()
    position, rot, clipped = log.foot_position.copy(), log.foot_rot.copy(), np.zeros(len(w), dtype=bool)
    w[300:320, 1], clipped[350:355], stamp[400], w[500:570] = np.nan, True, stamp[399], w[500]
    again = np.searchsorted(foot_ns, stamp[650])
    stamp[650:] -= 6_000_000_000
    foot_ns[again:] -= 6_000_000_000
    position[120, 0], rot[130, 1] = np.nan, np.inf
    return replace(
        log, w=w, stamp_ns=stamp, foot_ns=foot_ns, foot_position=position, foot_rot=rot, saturated=clipped,
        order=log.arrival(),
    )  # fmt: skip


LOGS = {
    "clean": lambda log: log, "late": lambda log: delayed(log, 0.25), "shuffled": lambda log: shuffled(log, 0.1, 0),
    "lost": lambda log: with_losses(log, 0.2, 0), "damaged": damaged,
}  # fmt: skip


@pytest.mark.parametrize("kind", LOGS)
def test_a_log_gives_the_bits_of_its_samples_one_by_one(kind):
    log = LOGS[kind](walk())
    one, whole, n, order = make(names=(BEST,)), make(names=(BEST,)), len(log.stamp_ns), log.arrival()
    clipped = np.zeros(n, dtype=bool) if log.saturated is None else log.saturated
    contact = log.contact[..., None].astype(float)
    inputs = LogInputs(log.stamp_ns, log.w, log.q, clipped, log.foot_ns, log.foot_position, log.foot_rot, contact)
    cut = int(np.flatnonzero(order < n)[n // 2])  # in two pieces
    rows = [whole.follow(inputs, part, 0, n) for part in (order[:cut], order[cut:])]
    compared = 0
    for i, at in enumerate(order.tolist()):
        if at < n:
            one.imu(int(log.stamp_ns[at]), log.w[at], log.q[at], bool(clipped[at]))
            row = at
        else:
            f = at - n
            one.feet(int(log.foot_ns[f]), log.foot_position[f], log.foot_rot[f], log.contact[f])
        if i + 1 < len(order) and order[i + 1] >= n:
            continue
        e, pose, found = one.estimate(), one.pose(), rows[i >= cut]
        for a, b in (
            (found.vectors[row, 1], e.velocity_imu), (found.vectors[row, 2], pose.position), (found.yaw[row], pose.yaw),
            (found.vectors[row, 3], pose.velocity), (found.vectors[row, 4], e.gyro_bias),
            (found.more[row, 4:], e.sliding), (found.covariance[row], e.covariance),
            (found.flags[row], [getattr(e, flag) for flag in FLAGS]),
        ):  # fmt: skip
            np.testing.assert_array_equal(a, b)
        compared += 1
    assert compared > 0.7 * n
    assert whole.check.counts == one.check.counts
    assert (kind == "damaged") == ("imu_restart" in one.check.counts)


@pytest.mark.parametrize("seconds", [0.05, 0.25])
def test_late_feet_are_no_reason_to_refuse_the_gyro(seconds):
    log = delayed(synthesize(KINDS["twist"], 41), seconds)
    assert not track(BEST, log).refused
