"""Type names of arrays for annotations, and NumPy records whose fields are float64 numbers."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]

Record = Any
"""Type of a NumPy record whose float64 fields kernels and Python read and write by name, as in `action.forward`."""


def named(*names: str) -> np.dtype[Any]:
    """Return the NumPy dtype of a record with one float64 field per name; a text may hold several names, by spaces."""
    return np.dtype((np.record, [(name, np.float64) for some in names for name in some.split()]))


def record(kind: np.dtype[Any]) -> Record:
    """Return one record of the dtype `kind`, with all fields zero."""
    return np.zeros(1, kind)[0]
