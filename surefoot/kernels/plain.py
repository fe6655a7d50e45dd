# pyright: basic, reportPrivateUsage=false, reportAttributeAccessIssue=false
"""Kernels compiled in numba's own way, for versions of numba that `surefoot.kernels.linking` does not support."""

from typing import Any

from numba.core import types
from numba.core.registry import CPUDispatcher

from surefoot.kernels.kept import KeptCache


class PlainKernel(CPUDispatcher):
    """A compiled function that Python and other kernels call; constant arguments make no own specialisation."""

    def enable_caching(self) -> None:
        self._cache = KeptCache(self.py_func)

    def cache_files(self) -> tuple[Any, ...]:
        """Return the index files of this kernel's compiled code in the cache on disk."""
        return self._cache.files

    def set_aside(self) -> None:
        """Do nothing: the list of signatures in use is not cleared, so counts of kernels are upper bounds."""

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return numba's template of a call from another kernel, constants as variables; args, kws: types."""
        plain = {name: types.unliteral(value) for name, value in kws.items()}
        return super().get_call_template(tuple(types.unliteral(value) for value in args), plain)
