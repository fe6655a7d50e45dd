"""Late import of clarabel and the sparse matrices it reads: 0.1 s that ordinary queries do not need."""

# pyright: reportMissingImports=false
# (clarabel has no stubs)

from typing import Any


def clarabel_and_sparse() -> tuple[Any, Any]:
    """Return the modules `clarabel` and `scipy.sparse`, which are imported at the first call."""
    import clarabel
    from scipy import sparse

    return clarabel, sparse
