"""Motion of soles that do not slide: they give way, and rock about the edge or the corner on which they stand."""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.geometry.linear_kernels import add_outer, turned
from surefoot.kernels.jit import kernel

from ..feet.contact import BestGeometry
from .layout import E, P, X
from .noise import FIXED, BestNoise
from .state import BestState

Feet = NDArray[np.int64]


@kernel
def turn_soles(state: BestState, geometry: BestGeometry, noise: BestNoise, dt: float) -> None:
    """Add the turning of standing soles about their middle over dt s to the covariance of their points, in place.

    The weight holds a sole down: along its length by a long lever, across by a short one, against twisting by friction
    alone.

    Args:
        state: state of the filter; its covariance is changed.
        geometry: contact points and axes of the soles.
        noise: rates at which a sole rolls, pitches and twists, rad/sqrt(s).
        dt: time since the last sample of the feet, s.
    """
    x, cov, points, foot = state.x, state.cov, state.points, geometry.foot
    count = points.shape[0]
    arm, way = np.zeros((count, 3)), np.zeros((count, 3))
    for k in range(count):
        together = 0
        for m in range(count):
            if foot[m] == foot[k] and points[m, P.down] > 0.0:
                together += 1
                for i in range(3):
                    arm[k, i] += x[X.points + 3 * m + i]
        for i in range(3):
            stands = points[k, P.down] > 0.0 and together > 1
            arm[k, i] = x[X.points + 3 * k + i] - arm[k, i] / together if stands else 0.0
    for axis in range(3):
        rate = noise.roll if axis == 0 else noise.pitch if axis == 1 else noise.twist
        for k in range(count):
            along = turned(state.turn[k], geometry.axes[foot[k], :, axis])
            for i in range(3):
                a, b = (i + 1) % 3, (i + 2) % 3
                way[k, i] = along[a] * arm[k, b] - along[b] * arm[k, a]
        push = rate**2 * dt * way
        for k in range(count):
            for m in range(count):
                if foot[m] == foot[k]:
                    add_outer(cov, E.points + 3 * k, E.points + 3 * m, push[k], way[m])


@kernel
def _turn_sole(state: BestState, geometry: BestGeometry, f: int, pivot: Array, axis: Array, variance: float) -> None:
    """Add the turning of one sole about an axis to the covariance of its points, in place.

    Args:
        state: state of the filter; its covariance is changed.
        geometry: contact points of the feet.
        f: index of the foot.
        pivot: a place on the axis, from the foot's centre, foot axes, (3,) m.
        axis: unit vector of the axis, odom axes, (3,).
        variance: variance of the turn, rad^2.
    """
    cov, points, foot = state.cov, state.points, geometry.foot
    way = np.zeros((foot.size, 3))
    for k in range(foot.size):
        if foot[k] == f and points[k, P.down] > 0.0:
            lever = turned(state.turn[k], geometry.place[k] - pivot)
            for i in range(3):
                a, b = (i + 1) % 3, (i + 2) % 3
                way[k, i] = axis[a] * lever[b] - axis[b] * lever[a]
    push = variance * way
    for k in range(foot.size):
        for m in range(foot.size):
            if foot[k] == f and foot[m] == f:
                add_outer(cov, E.points + 3 * k, E.points + 3 * m, push[k], way[m])


@kernel
def rock_soles(state: BestState, closed: Feet, geometry: BestGeometry, variance: float) -> int:
    """Let soles turn about the edge or the corner on which they stand, in place; return the feet that rock.

    A foot that lands on its heel or on the outer edge comes down flat in the samples that follow: its middle sinks by
    millimetres, which would else lift the robot at each step. What stays is where switches were closed at the last
    sample and are closed now: three hold the sole, two are an edge, about which it tips, one is a corner, about which
    it tips in any direction, like one of which no switch stayed closed. Neither an edge nor a corner keeps it from
    twisting.

    Args:
        state: state of the filter; its covariance is changed, and the switches are remembered in it.
        closed: switches of each foot that are closed, (L,), bit s for switch s.
        geometry: contact points and switches of the feet; feet with fewer than three switches are flat.
        variance: variance of the turn about each axis, rad^2.

    Returns:
        The feet that rock, bit f for foot f.
    """
    points, foot, switches, rocking, last = state.points, geometry.foot, geometry.switches, 0, -1
    for k in range(foot.size):
        f = foot[k]
        now, stayed = int(closed[f]), int(closed[f]) & int(points[k, P.closed])
        points[k, P.closed] = now
        if f == last or points[k, P.down] == 0.0 or switches.shape[1] < FIXED.firm:
            continue
        last = f
        pivot, edge, count = np.zeros(3), np.zeros(3), 0
        for s in range(switches.shape[1]):
            if ((stayed if stayed > 0 else now) >> s) & 1:
                count += 1
                for i in range(3):
                    pivot[i] += switches[f, s, i]
                    edge[i] = switches[f, s, i] - edge[i]
        if count == 0 or (stayed > 0 and count >= FIXED.firm):
            continue
        rocking |= 1 << f
        pivot /= count
        edge = turned(state.turn[k], edge)
        length = math.sqrt(edge[0] ** 2 + edge[1] ** 2 + edge[2] ** 2)
        if stayed > 0 and count == 2 and length > 0.0:
            _turn_sole(state, geometry, f, pivot, edge / length, variance)
            _turn_sole(state, geometry, f, pivot, np.array([0.0, 0.0, 1.0]), variance)
        else:
            for i in range(3):
                edge[:] = 0.0
                edge[i] = 1.0
                _turn_sole(state, geometry, f, pivot, edge, variance)
    return rocking
