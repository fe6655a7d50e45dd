"""Tests of the filters' covariances against their errors and innovations: NEES and NIS.

Bar-Shalom, Li, Kirubarajan: Estimation with Applications to Tracking and Navigation, 5.4: both are chi-square
distributed with as many degrees of freedom as they have components if the filter is consistent.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from surefoot.arrays import Array

from ..statistics import nees
from . import judge
from .traces import Traces

NIS = "NIS of the velocity filter, a slide of each foot allowed for"
"""Title of the velocity filter's NIS; its covariance allows for slides, so feet that stand firmly stay far below 1."""
BOUND = 0.95
"""Probability with which a normalised square (NEES or NIS) of a consistent filter lies below the bound in its chart."""
OVERCONFIDENT, CAUTIOUS = 1.5, 0.5
"""`OVERCONFIDENT`: mean of the normalised squares over their degrees of freedom above which a filter is overconfident;
`CAUTIOUS`: mean below which it is cautious; in between it is consistent."""


@dataclass(frozen=True)
class ConsistencyTest:
    """Normalised squares (NEES of errors, or NIS of innovations) of one quantity over time.

    Attributes:
        name: the quantity.
        dof: degrees of freedom.
        rows: time, s, and value, (n, 2).
    """

    name: str
    dof: int
    rows: Array

    @property
    def bound(self) -> float:
        """Value below which 95 % of the normalised squares lie if the filter is consistent."""
        return float(chdtri(self.dof, 1.0 - BOUND))

    @property
    def mean(self) -> float:
        """Mean of the normalised squares divided by the degrees of freedom; about 1 if the filter is consistent."""
        return float(self.rows[:, 1].mean() / self.dof)

    @property
    def verdict(self) -> str:
        """Verdict `overconfident` (errors larger than the covariance states), `cautious` (smaller) or `consistent`."""
        return "overconfident" if self.mean > OVERCONFIDENT else "cautious" if self.mean < CAUTIOUS else "consistent"

    @property
    def text(self) -> str:
        """Sentence on the filter's consistency, with its verdict and numbers."""
        over = 100.0 * float((self.rows[:, 1] > self.bound).mean())
        mean = f"mean per degree of freedom {self.mean:.2g} (1 is right)"
        return f"{self.verdict}: {mean}, {over:.0f} % above the 95 % bound"


def consistency(traces: Traces) -> list[ConsistencyTest]:
    """Return the NEES and NIS tests that the traces have data for; those of errors need the truth."""
    found: list[ConsistencyTest] = []
    velocity, truth = traces.series("state/velocity"), traces.series("sim/truth")
    if len(velocity):
        rows = velocity[(velocity[:, 4] > 0.5) & np.isfinite(velocity[:, 8])]
        found.append(ConsistencyTest(NIS, 3, rows[:, [0, 8]]))
        error = judge.velocity_error(truth, velocity)
        if len(error):
            sigma = velocity[velocity[:, 4] > 0.5][:, [0, 5, 6, 7]]
            _, here, there = np.intersect1d(judge.stamps(error), judge.stamps(sigma), return_indices=True)
            squares = np.square(error[here, 1:] / np.maximum(sigma[there, 1:], 1e-9)).sum(axis=1)
            rows = np.column_stack((error[here, 0], squares))
            found.append(ConsistencyTest("NEES of the velocity, axes apart", 3, rows))
    error, cov = judge.pose_error(truth, traces.series("state/pose"))
    if len(error):
        rows = np.column_stack((error[:, 0], nees(error[:, 1:], cov)))
        found.append(ConsistencyTest("NEES of the pose in the map", 3, rows))
    return [test for test in found if len(test.rows)]
