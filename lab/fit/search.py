"""Maximum-likelihood search for parameters of a navigation model, with their intervals."""

import itertools
import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from scipy.optimize import brentq, minimize

from surefoot.arrays import Array

from ..statistics import Z95
from .events import Run
from .likelihood import minus_log_likelihoods
from .merged import merged

STEP = 1e-3
"""Step of the finite differences for gradient and curvature of -ln L, in the unit of the search coordinate (the
parameter, or its natural logarithm if it is positive)."""
IMPOSSIBLE = 1e12
"""Negative log-likelihood, nats, assigned to parameters under which the filter fails numerically."""
LOWEST, HIGHEST = math.log(1e-5), 3.0
"""`LOWEST`, `HIGHEST`: bounds of the search in the natural logarithm of a positive parameter (SI units)."""
FACTOR = 10.0
"""Ratio of a positive value to an end of its 95 % interval above which the value counts as not determined."""
ENOUGH = 0.5 * Z95**2
"""Drop of the log-likelihood from its maximum at the ends of a 95 % interval, nats."""
EVALUATIONS, MOST_SHOWN = 270, 0.95
"""`EVALUATIONS`: typical number of gradient evaluations of a search; `MOST_SHOWN`: largest share of progress, 0 to 1,
that is reported before the search has ended."""
CENTRE = 0.41
"""Ratio of fitted value to upper 95 % bound for a noise that may be zero, as mean to bound of a half-normal density."""


@dataclass(frozen=True)
class Parameter:
    """Parameter of the likelihood that is fitted: index, model keys, unit factor and bounds."""

    index: int
    """Index of the parameter in the vector of the likelihood, 0 to 20."""
    keys: tuple[str, ...]
    """Dotted keys of the navigation model that get the value of this parameter."""
    factor: float = 1.0
    """Factor from SI units to the unit in which the navigation model states the parameter."""
    bounds: tuple[float, float] | None = None
    """Bounds of the search, SI units; None = the parameter is positive and searched by its logarithm."""
    as_commanded: float | None = None
    """Value of the parameter for a robot that moves exactly as commanded; None = not a distance or turn factor."""

    @property
    def positive(self) -> bool:
        """True: the parameter is positive and searched by its logarithm; False: it is searched within its bounds."""
        return self.bounds is None


@dataclass(frozen=True)
class FittedParameter:
    """Fitted parameter and the ends of its 95 % interval, SI units."""

    value: float
    low: float
    high: float


class Likelihood:
    """Negative log-likelihood -ln L of all recordings under many parameter sets at once, computed on all cores.

    A context manager, which ends the threads on exit.

    Args:
        runs: motions, sightings and times of each recording.
        actions: forward (m), turn (rad), group (0 on the spot, 1 straight, 2 arc) of each action, (A, 3).
        sd_start: standard deviations of position (m) and heading (rad) at the start, (2,).
        height: height of the camera above the ground, m.
        fades: time constants of tilt and sway errors, s, (2,).
    """

    def __init__(self, runs: Sequence[Run], actions: Array, sd_start: Array, height: float, fades: Array) -> None:
        self._runs = [(merged(run.events), np.array(run.start, dtype=np.float64)) for run in runs]
        self._actions, self._sd, self._height, self._fades = actions, sd_start, height, fades
        self._cores = os.cpu_count() or 1
        self._pool = ThreadPoolExecutor(self._cores)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(cancel_futures=True)

    def __call__(self, thetas: Array) -> Array:
        """Return the sums of -ln L over the recordings, nats, (m,), for m sets of parameters (m, 21), SI."""
        return self.each(thetas).sum(axis=0)

    def each(self, thetas: Array) -> Array:
        """Return -ln L of each of R recordings, nats, (R, m), under m sets of parameters `thetas` (m, 21), SI."""
        parts = np.array_split(thetas, min(len(thetas), math.ceil(self._cores / len(self._runs))))
        jobs = [[self._pool.submit(self._one, run, part) for part in parts] for run in self._runs]
        values = np.array([np.concatenate([job.result() for job in row]) for row in jobs])
        return np.where(np.isfinite(values), values, IMPOSSIBLE)

    def _one(self, run: tuple[Array, Array], thetas: Array) -> Array:
        events, start = run
        return minus_log_likelihoods(events, self._actions, start, self._sd, thetas, self._height, self._fades)


class _Surface:
    """Negative log-likelihood over P search coordinates: the logarithm of a positive parameter, else the parameter."""

    def __init__(self, likelihood: Likelihood, theta: Array, wanted: Sequence[Parameter]) -> None:
        self.likelihood, self.theta, self.wanted = likelihood, theta, wanted

    def coordinates(self) -> Array:
        """Return the searched entries of the parameter vector `theta` as search coordinates, (P,)."""
        return np.array([math.log(self.theta[i.index]) if i.positive else self.theta[i.index] for i in self.wanted])

    def full(self, x: Array) -> Array:
        """Return the parameter vectors (m, 21), SI, at search coordinates `x` (m, P)."""
        out = np.tile(self.theta, (len(x), 1))
        for column, item in zip(x.T, self.wanted, strict=True):
            out[:, item.index] = np.exp(np.clip(column, LOWEST - 1.0, HIGHEST + 1.0)) if item.positive else column
        return out

    def values(self, x: Array) -> Array:
        """Return -ln L, nats, (n,), at n points `x` (n, P): logarithms of positive parameters, others as they are."""
        return self.likelihood(self.full(x))

    def slopes(self, x: Array) -> Array:
        """Return the gradient (R, P) of -ln L of each of R recordings at coordinates x (P,) by central differences."""
        steps = STEP * np.eye(len(x))
        ends = self.likelihood.each(self.full(np.concatenate([x + steps, x - steps])))
        return (ends[:, : len(x)] - ends[:, len(x) :]) / (2.0 * STEP)

    def with_slope(self, x: Array) -> tuple[float, Array]:
        """Return -ln L, nats, and its gradient (P,) at coordinates x (P,) by central differences."""
        steps = STEP * np.eye(len(x))
        all_of = self.values(np.concatenate([x[None], x + steps, x - steps]))
        return float(all_of[0]), (all_of[1 : len(x) + 1] - all_of[len(x) + 1 :]) / (2.0 * STEP)

    def curvature(self, x: Array) -> Array:
        """Return the Hessian (P, P) of -ln L at coordinates x (P,) by central differences."""
        n, e = len(x), STEP * np.eye(len(x))
        pairs = [(i, j) for i in range(n) for j in range(i + 1)]
        signs = ((1, 1), (1, -1), (-1, 1), (-1, -1))
        points = np.array([x + a * e[i] + b * e[j] for i, j in pairs for a, b in signs])
        v = self.values(points).reshape(-1, 4)
        out = np.zeros((n, n))
        for (i, j), second in zip(pairs, (v[:, 0] - v[:, 1] - v[:, 2] + v[:, 3]) / (4.0 * STEP**2), strict=True):
            out[i, j] = out[j, i] = second
        return out


def estimate(
    likelihood: Likelihood,
    theta: Array,
    wanted: Sequence[Parameter],
    sightings: int,
    progress: Callable[[float], None] = lambda share: None,
) -> tuple[dict[int, FittedParameter], float]:
    """Return the maximum-likelihood parameters by index, and the gain of the log-likelihood over `theta`, nats.

    A noise that is not known within a factor of 10, and a distance or turn whose interval includes the commanded one,
    are set back to `theta` and left out of the result; the search is repeated with the rest. The interval of a noise
    that does not differ from zero begins at zero. For a noise without a maximum of the likelihood, but below `theta`,
    the interval ends where the log-likelihood is 1.92 nats below its maximum.

    Args:
        likelihood: negative log-likelihood of all recordings.
        theta: initial parameter vector of the search, (21,), SI.
        wanted: parameters that are searched; all others keep their value in `theta`.
        sightings: number of sightings, by which -ln L is divided for the line search.
        progress: called with the share that is done, 0 to 1, estimated by the usual number of evaluations.
    """
    before = float(likelihood(theta[None])[0])
    first, small, searched = theta.copy(), dict[int, FittedParameter](), list(wanted)
    theta, evaluated = theta.copy(), itertools.count(1)

    def note() -> None:
        progress(min(MOST_SHOWN, next(evaluated) / EVALUATIONS))

    while True:
        surface = _Surface(likelihood, theta, searched)
        best, value = _minimum(surface, max(1, sightings), note)
        sigmas = deviations(surface.curvature(best), surface.slopes(best))
        theta = surface.full(best[None])[0]
        unknown = [k for k, item in enumerate(searched) if not _known(item, best[k], sigmas[k])]
        if not unknown:
            break
        for k in unknown:
            item = searched[k]
            end = _upper_end(surface, best, value, k, first[item.index]) if item.positive else None
            if end is not None:
                small[item.index] = FittedParameter(CENTRE * end, 0.0, end)
            theta[item.index] = first[item.index] if end is None else CENTRE * end
        searched = [item for k, item in enumerate(searched) if k not in unknown]
        if not searched:
            break
    found = dict(small)
    for k, item in enumerate(searched):
        x, half = float(best[k]), Z95 * float(sigmas[k])
        if item.positive:
            zero = _rise(surface, best, value, k, LOWEST) < ENOUGH
            found[item.index] = FittedParameter(math.exp(x), 0.0 if zero else math.exp(x - half), math.exp(x + half))
        else:
            found[item.index] = FittedParameter(x, x - half, x + half)
    return found, before - float(likelihood(theta[None])[0])


def _minimum(surface: _Surface, scale: int, note: Callable[[], None]) -> tuple[Array, float]:
    def scaled(x: Array) -> tuple[float, Array]:
        note()
        value, slope = surface.with_slope(x)
        return value / scale, slope / scale

    result: Any = minimize(
        scaled, surface.coordinates(), jac=True, method="L-BFGS-B",
        bounds=[(LOWEST, HIGHEST) if item.bounds is None else item.bounds for item in surface.wanted],
        options={"maxiter": 200, "ftol": 1e-8, "gtol": 1e-5},
    )  # fmt: skip
    return result.x, float(result.fun) * scale


def _known(item: Parameter, x: float, sigma: float) -> bool:
    """Return True if search coordinate x with standard deviation `sigma` is determined: a noise within a factor of 10.

    A distance or turn is determined if its 95 % interval excludes the commanded one, another bounded parameter if it is
    inside its bounds and its interval is narrower than they are.
    """
    if item.bounds is None:
        return Z95 * sigma <= math.log(FACTOR) and x > LOWEST + STEP
    low, high = item.bounds
    if item.as_commanded is not None:
        return abs(x - item.as_commanded) > Z95 * sigma
    return low + STEP < x < high - STEP and Z95 * sigma <= 0.5 * (high - low)


def _rise(surface: _Surface, best: Array, value: float, k: int, x: float) -> float:
    """Return the increase of -ln L over `value`, nats, if coordinate k of the point `best` (P,) is set to x."""
    point = best.copy()
    point[k] = x
    return float(surface.values(point[None])[0]) - value


def _upper_end(surface: _Surface, best: Array, value: float, k: int, first: float) -> float | None:
    """Return the value of a positive parameter at which ln L is 1.92 nats below its maximum; None if beyond `first`.

    `best` (P,): coordinates of the maximum; `value`: -ln L there; `k`: index of the parameter's coordinate; `first`:
    initial value of the parameter, SI.
    """

    def above(x: float) -> float:
        return _rise(surface, best, value, k, x) - ENOUGH

    top = math.log(first)
    if best[k] >= top or above(float(best[k])) >= 0.0 or above(top) <= 0.0:
        return None
    return math.exp(float(brentq(above, float(best[k]), top, xtol=1e-3)))  # pyright: ignore[reportArgumentType]


def deviations(curvature: Array, slopes: Array) -> Array:
    """Return the standard deviations of the maximum-likelihood coordinates, (P,), the larger of two estimates.

    Covariances are H^-1, valid if the model is correct, and R / (R - 1) H^-1 (sum_r g_r g_r^T) H^-1, which includes
    differences between recordings that the model does not describe (White 1982, one cluster per recording).
    Eigenvalues of H are at least 0.04, so that a direction without information has a standard deviation of 5.

    Args:
        curvature: H, Hessian of -ln L, (P, P).
        slopes: g_r, gradient of -ln L of each recording at the minimum, (R, P).
    """
    values, vectors = np.linalg.eigh(0.5 * (curvature + curvature.T))
    inverse = (vectors / np.maximum(values, 0.04)) @ vectors.T
    variances = np.diag(inverse)
    runs = len(slopes)
    if runs > 1:
        between = inverse @ (slopes.T @ slopes) @ inverse * runs / (runs - 1)
        variances = np.maximum(variances, np.diag(between))
    return np.sqrt(variances)
