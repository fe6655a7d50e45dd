# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUntypedBaseClass=false
# pyright: reportUntypedClassDecorator=false, reportUnknownVariableType=false
"""Arguments that stay with the compiled code: a kernel is handed one pointer instead of one array after the other.

A call from Python takes about 0.1 us for each array of its arguments, several times as much when the caches are cold; a
filter that keeps sixty arrays spends more on that than on its arithmetic.
"""

from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

from numba.core import types
from numba.experimental import structref

from surefoot.kernels.jit import kernel

T = TypeVar("T", bound=NamedTuple)

if TYPE_CHECKING:

    class Box(Generic[T]):
        """Arguments in a box; kernels read `parts`."""

        parts: T

else:

    @structref.register
    class _BoxType(types.StructRef):
        """Type of a box to the compiler."""

    class Box(structref.StructRefProxy):
        """Arguments in a box; kernels read `parts`."""

        def __class_getitem__(cls, _: Any) -> type:
            return cls

    structref.define_proxy(Box, _BoxType, ["parts"])


@kernel
def boxed(parts: T) -> "Box[T]":
    """Return a box that shares the arrays of `parts`; its numbers are copied."""
    return Box(parts)  # pyright: ignore[reportCallIssue] - made by the compiler
