"""Products of elementary functions of one input each, equations (10) to (13) of Walas & Belter (2011)."""

from dataclasses import dataclass

import numpy as np

from surefoot.arrays import Array, Ints

POWER, SINE, DECAY = 0, 1, 2
MAX_POWER = 4
"""Largest exponent n in equation (11) of Walas & Belter, of scaled inputs."""
LARGEST = 1e12
"""Largest magnitude of a term: a larger power, far outside its data, is clipped, so that it does not end a search."""


@dataclass(frozen=True, eq=False)
class Elementary:
    """Elementary terms of a slip model, equation (10) of Walas & Belter: phi_q = prod_i f_iq(u_i).

    f is one of (u - a)^round(lambda), sin(lambda u - a), exp(-lambda u). a of the sine is a phase, not a centre; in the
    exponential it would only scale c, so it is left out.
    """

    kinds: Ints
    """Kind of each function, `POWER`, `SINE` or `DECAY`, for m terms of d inputs, (m, d)."""
    centres: Array
    """Centres a of each function, in scaled inputs (phase of a sine, rad), for m terms of d inputs, (m, d)."""
    rates: Array
    """Rates lambda of each function (rounded: exponent of a power), for m terms of d inputs, (m, d), no unit."""

    def columns(self, u: Array) -> Array:
        """Return the m terms phi_q at inputs u (n, d), each clipped to +-LARGEST, (n, m), no unit."""
        x, a, rate = u[:, None, :], self.centres[None], self.rates[None]
        n = np.clip(np.rint(rate), 0.0, MAX_POWER)
        with np.errstate(over="ignore", invalid="ignore"):
            power = np.where(n == 0.0, 1.0, (x - a) ** n)
            decay = np.exp(np.clip(-rate * x, -60.0, 60.0))
            sine = np.sin(rate * x - a)
            each = np.where(self.kinds == POWER, power, np.where(self.kinds == SINE, sine, decay))
            found = each.prod(axis=2)
        return np.clip(np.nan_to_num(found, nan=LARGEST, posinf=LARGEST, neginf=-LARGEST), -LARGEST, LARGEST)
