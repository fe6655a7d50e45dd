# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUntypedBaseClass=false
# pyright: reportUntypedClassDecorator=false, reportUnknownVariableType=false
"""Arguments that stay with the compiled code: a kernel is handed one pointer instead of one array after the other.

A call from Python takes about 0.1 us for each array of its arguments, several times as much when the caches are cold; a
filter that keeps sixty arrays spends more on that than on its arithmetic. A box shares the arrays and copies the
numbers of what is put into it. Whoever needs one compiles a kernel of their own that returns `Box(parts)`: the files
of a kernel that all had in common would name the types of each, and be of no use to a process without their modules.
"""

from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

from numba.core import types
from numba.experimental import structref

T = TypeVar("T", bound=NamedTuple)

if TYPE_CHECKING:

    class KernelBox(Generic[T]):
        """Tuple of kernel arguments behind one reference, which kernels make and read as `parts`."""

        parts: T

        def __init__(self, parts: T) -> None: ...

else:

    @structref.register
    class _BoxType(types.StructRef):
        """Type of a box to the compiler."""

    class KernelBox(structref.StructRefProxy):
        """Tuple of kernel arguments behind one reference, which kernels make and read as `parts`."""

        def __class_getitem__(cls, _: Any) -> type:
            return cls

    structref.define_proxy(KernelBox, _BoxType, ["parts"])
