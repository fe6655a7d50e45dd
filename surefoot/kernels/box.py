# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUntypedBaseClass=false
# pyright: reportUntypedClassDecorator=false, reportUnknownVariableType=false
"""Container that passes many arrays to a compiled kernel as one pointer.

A call from Python takes about 0.1 us for each array of its arguments, several times as much when the caches are cold; a
filter that keeps sixty arrays spends more on that than on its arithmetic. A `KernelBox` shares the arrays and copies
the numbers of its parts. Each user compiles its own kernel that returns `KernelBox(parts)`: the cache files of a common
kernel would name the types of all users, and could not be read by a process without their modules.
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
