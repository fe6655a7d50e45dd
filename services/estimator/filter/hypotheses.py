"""Hypotheses about which feet slide, carried through time, each with a state of its own.

A foot that slides by 9 mm within a step moves by as much as the encoders err between two samples: a single sample
hardly shows it, a disagreement with the inertial unit that lasts for several does. An interacting-multiple-model filter
(Blom & Bar-Shalom 1988) keeps one state for each set of feet that slide, bit f of its number for foot f. Before a
sample of the feet the states are mixed by the probabilities T that a foot begins to slide, or stops,

    mu_t^- = sum_s T_st mu_s,   x_t^- = sum_s T_st mu_s x_s/mu_t^-,   P_t^- = sum_s T_st mu_s (P_s + d_s d_s^T)/mu_t^-,

with d_s the distance of x_s from the mean; after it mu_t ~ mu_t^- L_t with the likelihood L_t of the sample. What is
published is the same mean over all of them. Sets of little probability are left out, so that a robot that stands
firmly runs one or two. With more than two feet the others show at once which of them slides: each point is then mixed
by itself (`point.observe`).
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.geometry.linear_kernels import times_transposed, turned
from surefoot.geometry.rotations import rotvec_from_matrix
from surefoot.kernels.jit import kernel

from .layout import E, M, P, X
from .noise import FIXED, BestNoise
from .point import retract
from .state import BestState, rotation

Feet = NDArray[np.int64]

OWN = (
    *range(M.last_gyro, M.last_gyro + 3), *range(M.last_acc, M.last_acc + 3), M.phase, M.rest, M.age, M.slide_product,
    M.slide_square, *range(M.own_bias, M.parting + 1), M.framed, M.jumps, M.left_out, M.externals, M.externals_out,
    M.frames, *range(M.pose_extra, M.levelled + 1),
)  # fmt: skip
"""Indices of `BestState.memory` whose values the state keeps as its own, so that no hypothesis overwrites them."""
MEAN = (M.excess, M.innovation, M.innovation + 1, M.innovation + 2, M.lag, M.lag + 1, M.lag + 2)
"""Indices of `BestState.memory` averaged over the hypotheses; other values come from the most probable one."""


def modes_of(feet: int) -> int:
    """Return the number of hypotheses about which feet slide: 2^feet for one or two feet, else 0.

    With more feet each contact point is weighted by itself, staying against sliding.
    """
    return 1 << feet if feet <= FIXED.most_feet else 0


@kernel
def mode(state: BestState, h: int) -> BestState:
    """Return hypothesis h (bit f set: foot f slides) as a state without hypotheses that shares arrays with `state`."""
    return BestState(
        state.mode_x[h], state.mode_cov[h], state.mode_points[h], state.mode_turn[h], state.mode_memory[h],
        state.mode_x, state.mode_cov, state.mode_points, state.mode_turn, state.mode_memory, state.weight[:0],
        state.sensors,
    )  # fmt: skip


@kernel
def likeliest(state: BestState) -> int:
    """Return the index of the hypothesis about sliding feet with the largest weight, -1 if there are none."""
    best = -1
    for h in range(state.weight.size):
        if state.weight[h] > 0.0 and (best < 0 or state.weight[h] > state.weight[best]):
            best = h
    return best


@kernel
def _distance(a: BestState, b: BestState, out: Array) -> None:
    """Write the error of state `a` if `b` were true into `out`; `retract` of it from `a` gives `b`.

    `out`: (15 + 3 K,) in the order of `ErrorLayout`, with four more numbers if the states hold the frame of another
    source.
    """
    rot = times_transposed(rotation(a.x), rotation(b.x))
    out[:] = 0.0
    out[E.rot : E.rot + 3] = rotvec_from_matrix(rot)
    v = turned(rot, b.x[X.vel : X.vel + 3])
    for i in range(3):
        out[E.vel + i] = a.x[X.vel + i] - v[i]
        out[E.gyro_bias + i] = a.x[X.gyro_bias + i] - b.x[X.gyro_bias + i]
        out[E.acc_bias + i] = a.x[X.acc_bias + i] - b.x[X.acc_bias + i]
        out[E.pos + i] = a.x[X.pos + i] - b.x[X.pos + i]
    for k in range(a.points.shape[0]):
        if a.points[k, P.down] > 0.0:
            at = X.points + 3 * k
            r = turned(rot, b.x[at : at + 3])
            for i in range(3):
                out[E.points + 3 * k + i] = a.x[at + i] - r[i]
    end = 3 * a.points.shape[0]
    for i in range(a.x.size - X.points - end):
        out[E.points + end + i] = a.x[X.points + end + i] - b.x[X.points + end + i]


@kernel
def _copy(source: BestState, target: BestState) -> None:
    """Copy state, covariance, points, rotations of feet and memory of `source` into those of `target`, in place."""
    target.x[:], target.cov[:], target.points[:] = source.x, source.cov, source.points
    target.turn[:], target.memory[:] = source.turn, source.memory


@kernel
def mean_of(state: BestState, shares: Array, out: BestState) -> None:
    """Write mean and covariance of the hypotheses into the state `out`, in place.

    Shares need not sum to 1. Flags of `out` are those of the hypothesis with the largest share.

    Args:
        state: state of the filter, with its hypotheses.
        shares: weight of each hypothesis, (H,), no unit.
        out: state that is overwritten; it may be `state` itself.
    """
    best, most, total = int(np.argmax(shares)), np.max(shares), 0.0
    for h in range(shares.size):
        total += shares[h]
    first = mode(state, best)
    _copy(first, out)
    if most >= (1.0 - FIXED.no_share) * total:
        return
    share, n = np.zeros(shares.size), out.cov.shape[0]
    for h in range(shares.size):
        share[h] = shares[h] if shares[h] >= FIXED.no_share * total else 0.0
    share /= np.sum(share)
    apart, mean = np.zeros((shares.size, n)), np.zeros(n)
    for h in range(shares.size):
        if share[h] > 0.0 and h != best:
            _distance(first, mode(state, h), apart[h])
            for i in range(n):
                mean[i] += share[h] * apart[h, i]
    out.cov[:] = 0.0
    for i in MEAN:
        out.memory[i] = 0.0
    for h in range(shares.size):
        if share[h] == 0.0:
            continue
        cov, memory = state.mode_cov[h], state.mode_memory[h]
        for i in range(n):
            for j in range(i + 1):
                out.cov[i, j] += share[h] * (cov[i, j] + (apart[h, i] - mean[i]) * (apart[h, j] - mean[j]))
        for i in MEAN:
            out.memory[i] += share[h] * memory[i]
    for i in range(n):
        for j in range(i):
            out.cov[j, i] = out.cov[i, j]
    retract(out, mean)


@kernel
def publish_mean(state: BestState, foot: Feet) -> None:
    """Write the mean of the hypotheses, and the probability that each foot slides, into the state itself, in place.

    `foot`: index of the foot of each contact point, (K,).
    """
    if likeliest(state) < 0:
        return
    kept = state.memory.copy()
    mean_of(state, state.weight, state)
    for i in OWN:
        state.memory[i] = kept[i]
    for k in range(state.points.shape[0]):
        seen = 0.0
        for h in range(state.weight.size):
            if (h >> foot[k]) & 1:
                seen += state.weight[h]
        state.points[k, P.seen] = seen


@kernel
def collapse(state: BestState, foot: Feet) -> None:
    """Replace the hypotheses about sliding feet by their mean, in place; `foot`: foot of each contact point, (K,)."""
    publish_mean(state, foot)
    state.weight[:] = 0.0


@kernel
def mix(state: BestState, contact: Array, foot: Feet, noise: BestNoise) -> None:
    """Mix the hypotheses before a sample of the feet, in place: a foot may have begun or stopped sliding meanwhile.

    Args:
        state: state of the filter, changed; without hypotheses it becomes the one in which nothing slides.
        contact: probability that each point touches the ground, (K,).
        foot: index of the foot of each point, (K,).
        noise: noises and rates of the filter, with the probabilities that a slide begins, or goes on.
    """
    count, weight = state.weight.size, state.weight
    if likeliest(state) < 0:
        weight[0] = 1.0
        _copy(state, mode(state, 0))
    now, before = np.zeros(count), np.zeros(count)  # by foot, of which there are fewer
    best = likeliest(state)
    for k in range(foot.size):
        now[foot[k]] = max(now[foot[k]], contact[k])
        before[foot[k]] = max(before[foot[k]], state.mode_points[best, k, P.down])
    shares = np.zeros((count, count))  # [t, s]
    for t in range(count):
        for s in range(count):
            share, f = weight[s], 0
            while (1 << f) < count:
                slides = 0.0  # probability that foot f slides now, if it did (not) in s
                if now[f] >= 0.5:
                    slides = (
                        noise.slip_landing if before[f] == 0.0 else
                        noise.go_on if (s >> f) & 1 else 1.0 - now[f] * (1.0 - noise.slip_begin)
                    )  # fmt: skip
                share *= slides if (t >> f) & 1 else 1.0 - slides
                f += 1
            shares[t, s] = share
    x, cov, points = np.empty_like(state.mode_x), np.empty_like(state.mode_cov), np.empty_like(state.mode_points)
    turn, memory, empty = np.empty_like(state.mode_turn), np.empty_like(state.mode_memory), mode(state, 0)
    prior = np.zeros(count)
    for t in range(count):
        prior[t] = np.sum(shares[t])
    most = np.max(prior)
    own = np.zeros(count, dtype=np.bool_)  # goes on as it is
    for t in range(count):
        if prior[t] < FIXED.least_prior and prior[t] < most:
            prior[t] = 0.0
        own[t] = shares[t, t] >= (1.0 - FIXED.no_share) * prior[t]
        if prior[t] > 0.0 and not own[t]:
            one = BestState(
                x[t], cov[t], points[t], turn[t], memory[t], empty.mode_x, empty.mode_cov, empty.mode_points,
                empty.mode_turn, empty.mode_memory, empty.weight, empty.sensors,
            )  # fmt: skip
            mean_of(state, shares[t], one)
    for t in range(count):
        weight[t] = prior[t]
        if prior[t] > 0.0 and not own[t]:
            state.mode_x[t], state.mode_cov[t], state.mode_points[t] = x[t], cov[t], points[t]
            state.mode_turn[t], state.mode_memory[t] = turn[t], memory[t]


@kernel
def weigh(state: BestState, likely: Array) -> None:
    """Multiply the weight of each hypothesis by its likelihood, in place, and scale all to sum 1; drop unlikely ones.

    Args:
        state: state of the filter; weights (H,) are changed.
        likely: logarithms of the likelihoods up to a common constant, (H,).
    """
    weight, most, total = state.weight, -math.inf, 0.0
    for h in range(weight.size):
        if weight[h] > 0.0:
            most = max(most, likely[h])
    for h in range(weight.size):
        weight[h] *= math.exp(likely[h] - most) if weight[h] > 0.0 else 0.0
        total += weight[h]
    kept = 0.0
    for h in range(weight.size):
        weight[h] = weight[h] / total if weight[h] >= FIXED.least_weight * total else 0.0
        kept += weight[h]
    for h in range(weight.size):
        weight[h] /= kept
