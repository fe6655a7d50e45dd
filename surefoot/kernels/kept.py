# pyright: basic, reportPrivateUsage=false, reportAttributeAccessIssue=false
"""Cache of compiled kernels on disk, and the processor that they are compiled for.

A kernel is searched for in numba's cache, beside its source or in the user's cache folder, and then beside its source
even if that folder cannot be written, as in an installed wheel or image that contains compiled kernels. Code is valid
for one text of the sources, one version of numba and of Python, and one processor; all x86-64 processors with AVX2 and
FMA count as one, so that code serves more than the machine that compiled it.
"""

import contextlib
import os
import pickle
from typing import Any

from numba.core import caching, config

from surefoot.kernels.processor import LEVEL, processor


def choose_processor() -> None:
    """Let numba compile for `processor.LEVEL` if the processor supports it and the environment does not choose another.

    The variables are NUMBA_CPU_NAME and NUMBA_CPU_FEATURES.
    """
    if processor() == LEVEL and not {"NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES"} & set(os.environ):
        config.CPU_NAME, config.CPU_FEATURES = LEVEL, ""


class _BesideSource(caching.InTreeCacheLocator):
    """Locator of a read-only cache beside the source, for installations whose folders cannot be written."""

    def ensure_cache_path(self) -> None:
        """Do nothing where numba makes the cache's folder: the files are read only."""


class KeptImpl(caching.CompileResultCacheImpl):
    """Storage of compiled kernels in the folders that numba uses and, read only, beside the kernels' source."""

    _locator_classes = (*caching.CompileResultCacheImpl._locator_classes, _BesideSource)


class KeptCache(caching.FunctionCache):
    """Cache of the machine code of one function by argument types; it also reads files of the installation."""

    _impl_class = KeptImpl

    def __init__(self, py_func: Any) -> None:
        super().__init__(py_func)
        own = self._cache_file
        beside = _BesideSource(py_func, py_func.__code__.co_filename).get_cache_path()
        brought = caching.IndexDataCacheFile(beside, self._impl.filename_base, own._source_stamp)
        self.files = (own,) if beside == self._cache_path else (own, brought)
        """Index files of the function on disk; the first is the one that is written."""

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        key = self._index_key(sig, target_context.codegen())
        for index in self.files if self._enabled else ():
            data = None
            with contextlib.suppress(OSError, EOFError, ValueError, pickle.UnpicklingError):  # torn or not to be read
                data = index.load(key)
            if data is not None:
                return self._impl.rebuild(target_context, data)
        return None

    def _save_overload(self, sig: Any, data: Any) -> None:
        """Store machine code; if the folder cannot be written or the disk is full, the next process compiles again."""
        with contextlib.suppress(OSError):
            super()._save_overload(sig, data)
