"""Names of the types of arrays, as annotations use them, and records of numbers with names."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]

Record = Any
"""Numbers that kernels and Python read and write by name, as in `action.forward`; records of a kind make an array."""


def named(*names: str) -> np.dtype[Any]:
    """Return the type of a record of numbers with these names, each text one or more of them."""
    return np.dtype((np.record, [(name, np.float64) for some in names for name in some.split()]))


def record(kind: np.dtype[Any]) -> Record:
    """Return a record of zeros."""
    return np.zeros(1, kind)[0]
