"""Typed ways to compile a numeric kernel."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba  # pyright: ignore[reportMissingTypeStubs]

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile `function` with numba on its first call and keep the machine code on disk.

    The compiled object is given the type of the plain function, so that a type checker sees the signature.
    """
    compiled: Any = numba.njit(cache=True)(function)  # pyright: ignore[reportUnknownMemberType]
    return cast(F, compiled)


def row_kernel(function: F) -> F:
    """Like `kernel`, with divisions as in numpy (x / 0 = inf or NaN, no exception), so that loops become vectors."""
    compiled: Any = numba.njit(cache=True, error_model="numpy")(function)  # pyright: ignore[reportUnknownMemberType]
    return cast(F, compiled)
