"""Functions of the ground coefficients, of which a slip model is a weighted sum.

    P(u) = sum_q c_q phi_q(u)                                                        (Walas & Belter 2011, Eq. 6)

u are scaled inputs, (n, d). The terms are Gaussians (15) with lambda >= 0; the printed (15) has no minus sign and would
grow without bound. The elementary functions (11)-(13) are in `papers/walas`.
"""

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from surefoot.arrays import Array


class Basis(Protocol):
    """Terms of a slip model, functions phi_q of its inputs, with their parameters."""

    def columns(self, u: Array) -> Array:
        """Return the values of the m terms at n points u of d scaled inputs, (n, d): an array (n, m), no unit."""
        ...


@dataclass(frozen=True, eq=False)
class Gaussians:
    """Gaussian terms phi_q = exp(-sum_i lambda_iq (u_i - a_iq)^2) of inputs u, and a constant if wanted.

    a: centres, lambda: rates; (15) of Walas & Belter.
    """

    centres: Array
    """Centres a of m Gaussians over d scaled inputs, (m, d), no unit."""
    widths: Array
    """Rates lambda >= 0 of m Gaussians over d scaled inputs, (m, d); with 0 a term ignores that input."""
    constant: bool = False
    """True appends a column of ones to the values of the Gaussians, False does not."""

    def columns(self, u: Array) -> Array:
        """Return the values of the m Gaussians at inputs u (n, d), (n, m), or (n, m + 1) with a constant, no unit."""
        power = np.zeros((len(u), len(self.centres)))
        for seen, centre, width in zip(u.T, self.centres.T, self.widths.T, strict=True):  # each input
            away = seen[:, None] - centre
            power += width * away * away
        found = np.exp(-power)
        return np.column_stack((found, np.ones(len(u)))) if self.constant else found


Warp = Literal["identity", "log", "asinh"]


def warped(u: Array, warps: tuple[Warp, ...], scales: Array) -> Array:
    """Return inputs after one monotone map each: u / s, log(u / s) or asinh(u / s), (n, d), no unit.

    Args:
        u: inputs, (n, d).
        warps: map of each input.
        scales: s, (d,), > 0.

    Raises:
        ValueError: a logarithm of an input that is not positive.
    """
    out = u / scales
    for i, warp in enumerate(warps):
        if warp == "log":
            if (out[:, i] <= 0.0).any():
                raise ValueError(f"warp 'log' of input {i} needs positive values, got {u[:, i].min()!r}")
            out[:, i] = np.log(out[:, i])
        elif warp == "asinh":
            out[:, i] = np.arcsinh(out[:, i])
    return out
