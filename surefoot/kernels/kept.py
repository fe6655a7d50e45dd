# pyright: basic, reportPrivateUsage=false, reportAttributeAccessIssue=false
"""Cache of compiled kernels on disk, and the processor that they are compiled for.

A kernel is searched for in numba's cache, beside its source or in the user's cache folder, and then beside its source
even if that folder cannot be written, as in an installed wheel or image that contains compiled kernels. Code is valid
for one text of the sources, one version of numba and of Python, and one processor; all x86-64 processors with AVX2 and
FMA count as one, so that code serves more than the machine that compiled it. Each file ends with a hash of its content:
damaged machine code would end the process, or compute other numbers.
"""

import contextlib
import logging
import os
import pickle
from hashlib import sha256
from pathlib import Path
from typing import Any

from numba.core import caching, config

from surefoot.kernels.processor import LEVEL, processor

DIGEST = sha256().digest_size
"""Length of the hash at the end of a file of the cache, bytes."""


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


class _Checked(caching.IndexDataCacheFile):
    """Files of one function in a cache: an index by argument types, and machine code, each with a hash of its content.

    A damaged file counts as absent; the first one is named in a warning of logger `surefoot`, once in a process.
    """

    _named = False

    def __init__(self, cache_path: str, filename_base: str, source_stamp: Any) -> None:
        super().__init__(cache_path, filename_base, source_stamp)
        self._version += " with hash"  # files without one are of another version, not damaged

    def _dump(self, obj: Any) -> bytes:
        data = super()._dump(obj)
        return data + sha256(data).digest()

    def _load_index(self) -> dict[Any, str]:
        try:
            return self._index()
        except FileNotFoundError:
            return {}
        except Exception as error:  # damaged bytes raise what they like
            return self._ignored(self._index_path, error) or {}

    def _index(self) -> dict[Any, str]:
        with open(self._index_path, "rb") as file:
            if pickle.load(file) != self._version:
                return {}
            stamp, overloads = _whole(file.read())
        return overloads if stamp == self._source_stamp else {}

    def _save_data(self, name: str, data: Any) -> None:
        super()._save_data(name, (self._source_stamp, name, data))

    def _load_data(self, name: str) -> Any:
        path = self._data_path(name)
        try:
            *origin, data = _whole(Path(path).read_bytes())
        except Exception as error:  # damaged bytes raise what they like
            return self._ignored(path, error)
        return data if origin == [self._source_stamp, name] else None  # else of other sources, or a copy of another

    @classmethod
    def _ignored(cls, path: str, error: Exception) -> None:
        """Name the first damaged file of this process in a warning; a file that cannot be read is none."""
        if not (cls._named or isinstance(error, OSError)):
            cls._named = True
            logging.getLogger("surefoot").warning(
                f"surefoot: {path} is damaged: it is not used, and its kernel is compiled anew"
            )


def _whole(content: bytes) -> Any:
    """Return the object in the content of a file that ends with its hash (raises ValueError: the hash is another)."""
    data, digest = content[:-DIGEST], content[-DIGEST:]
    if sha256(data).digest() != digest:
        raise ValueError("its hash is another")
    return pickle.loads(data)


class KeptCache(caching.FunctionCache):
    """Cache of the machine code of one function by argument types; it also reads files of the installation."""

    _impl_class = KeptImpl

    def __init__(self, py_func: Any) -> None:
        super().__init__(py_func)
        base, stamp = self._impl.filename_base, self._cache_file._source_stamp
        beside = _BesideSource(py_func, py_func.__code__.co_filename).get_cache_path()
        own, brought = _Checked(self._cache_path, base, stamp), _Checked(beside, base, stamp)
        self._cache_file = own
        self.files = (own,) if beside == self._cache_path else (own, brought)
        """Index files of the function on disk; the first is the one that is written."""

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        key = self._index_key(sig, target_context.codegen())
        for index in self.files if self._enabled else ():
            data = index.load(key)
            if data is not None:
                return self._impl.rebuild(target_context, data)
        return None

    def _save_overload(self, sig: Any, data: Any) -> None:
        """Store machine code; if the folder cannot be written or the disk is full, the next process compiles again."""
        with contextlib.suppress(OSError):
            super()._save_overload(sig, data)
