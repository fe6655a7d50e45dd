"""A log run backward in time: t' = -t.

The rate of turn and the velocity change sign, specific force, feet and contacts stay. An inertial row is the mean over
the interval that ends at its stamp; backward it is the mean over the same interval, which then ends where it began.
"""

from dataclasses import replace

import numpy as np

from surefoot.arrays import Flags, Ints
from surefoot.services.estimator.filter.samples import EX

from .external import Externals
from .log import Log

GAP = 1.5
"""Time between two inertial rows, in periods, above which rows are missing, so that the later one averages one
period only."""


def begins(log: Log) -> Ints:
    """Return the start of the interval over which each inertial row is a mean, (n,) ns."""
    step = np.diff(log.stamp_ns)
    period = int(np.median(step)) if step.size else 0
    step = np.concatenate([[period], step])
    return log.stamp_ns - np.where(step > GAP * period, period, step)


def centre(log: Log) -> int:
    """Return the sum of the stamps of any instant in a log and in the reversed log, which is constant, ns."""
    return int(begins(log)[0] + log.stamp_ns[-1])


def follows(log: Log) -> Flags:
    """Return True for each inertial row k whose stamp is that of row n - 2 - k of the reversed log, (n,)."""
    return np.append(begins(log)[1:] == log.stamp_ns[:-1], False)


def _backward(found: Externals, total: int) -> Externals:
    """Return the external samples (camera, GNSS) of a reversed log: velocities change sign, none arrives late.

    `total`: sum of a stamp in the log and that of the instant in the reversed log, ns.
    """
    stamps, rows = total + 1 - found.stamp_ns[::-1], found.rows[::-1].copy()
    rows[:, EX.velocity : EX.velocity + 3] *= -1.0
    return Externals(stamps, stamps, rows)


def reversed_log(log: Log) -> Log:
    """Return a log run backward, without truth, order of arrival, or standstill at its beginning.

    A foot sample at the stamp of an inertial row is 1 ns later in the reversed log, so that the backward estimate at
    that row uses only later samples of both sensors, and none that the forward estimate uses.
    """
    total = centre(log)
    back = {name: getattr(log, name) for name in ("touch", "force", "joints", "chance")}
    return replace(
        log,
        stamp_ns=total - begins(log)[::-1],
        w=-log.w[::-1],
        q=log.q[::-1].copy(),
        foot_ns=total + 1 - log.foot_ns[::-1],
        foot_position=log.foot_position[::-1].copy(),
        foot_rot=log.foot_rot[::-1].copy(),
        contact=log.contact[::-1].copy(),
        saturated=None if log.saturated is None else log.saturated[::-1].copy(),
        truth=None,
        order=None,
        rest=(0, 0),
        external=None if log.external is None else _backward(log.external, total),
        **{name: None if values is None else values[::-1].copy() for name, values in back.items()},
    )
