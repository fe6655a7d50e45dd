"""Compiling the numeric kernels ahead of time, once per installation and version."""

import hashlib
import importlib
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from subprocess import PIPE
from tempfile import TemporaryFile

from surefoot.errors import SurefootError

HOME = Path(__file__).parents[1]
"""The package `surefoot`; its services and lab are links to folders beside it in a checkout."""
_MARK = "\ndef warm() -> None:"


def kernel_modules() -> tuple[str, ...]:
    """Return the modules that offer `warm`, the shared ones first; found by their text, nothing is imported."""
    marked = [path for path in _sources() if _MARK in path.read_text(encoding="utf-8")]
    return tuple(".".join(path.relative_to(HOME.parent).with_suffix("").parts) for path in marked)


def _sources() -> list[Path]:
    """Return all source files, the shared ones first."""
    floors = ("services", "lab")
    shared = [path for path in HOME.rglob("*.py") if path.relative_to(HOME).parts[0] not in floors]
    return sorted(shared) + [path for floor in floors for path in sorted((HOME / floor).rglob("*.py"))]


def signature() -> str:
    """Return a hash of everything compiled code depends on: sources, Python, numba, processor."""
    from importlib.metadata import version

    digest = hashlib.sha256(f"{sys.version}|{version('numba')}|{os.uname().machine}|{HOME}".encode())
    for path in _sources():
        content = path.read_bytes()
        if b"njit" in content or b"kernel" in content:
            digest.update(content)
    return digest.hexdigest()


def is_cold() -> bool:
    """Tell whether kernels have to be compiled before a system starts quickly."""
    return not (_stamps() / signature()).exists()


def warm_if_cold(tell: Callable[[str], None]) -> None:
    """Compile all kernels unless that was done before."""
    if is_cold():
        warm_all(tell)


def warm_all(tell: Callable[[str], None] = lambda text: None) -> dict[str, float]:
    """Compile all kernels in two steps: the shared ones, then those of the services side by side.

    Returns:
        Seconds by module.
    """
    modules = kernel_modules()
    progress = _Progress(len(modules), tell)
    own = [module for module in modules if module.startswith(("surefoot.services.", "surefoot.lab."))]
    shared = [module for module in modules if module not in own]
    services = sorted({module.split(".")[2] for module in own})
    groups = [shared, *([module for module in own if module.split(".")[2] == name] for name in services)]
    took = _warm_apart(groups[0], progress)
    with ThreadPoolExecutor(max_workers=os.cpu_count() or 1) as pool:
        for result in pool.map(partial(_warm_apart, progress=progress), groups[1:]):
            took |= result
    stamps = _stamps()
    try:
        stamps.mkdir(parents=True, exist_ok=True)
        (stamps / signature()).touch()
    except OSError as error:
        tell(f"  nothing can be kept in {stamps}: {error.strerror}; kernels are compiled again at each start")
    return took


class _Progress:
    """Says how far it is, each time another eighth of the modules is done; called from several threads."""

    def __init__(self, total: int, tell: Callable[[str], None]) -> None:
        self._total, self._done, self._tell, self._began = total, 0, tell, time.monotonic()
        self._lock = threading.Lock()
        tell(f"compiling numeric kernels: {total} modules, takes a minute or two, only this once")

    def another(self) -> None:
        """A module is done."""
        with self._lock:
            self._done += 1
            if self._done * 8 // self._total > (self._done - 1) * 8 // self._total:
                self._tell(f"  {self._done} of {self._total} after {time.monotonic() - self._began:.0f} s")


def _warm_apart(modules: list[str], progress: _Progress) -> dict[str, float]:
    """Compile in a process of its own: compilers are neither thread-safe nor small."""
    command = [sys.executable, "-m", "surefoot.kernels.warming", *modules]
    took: dict[str, float] = {}
    with TemporaryFile("w+") as errors, subprocess.Popen(command, stdout=PIPE, stderr=errors, text=True) as process:
        for line in process.stdout or ():
            took |= json.loads(line)
            progress.another()
        if process.wait() != 0:
            errors.seek(0)
            words = errors.read().strip().splitlines()[-1:] or [f"exit code {process.returncode}"]
            raise SurefootError("warm", f"the kernels of {', '.join(modules)} could not be compiled: {words[0]}")
    return took


def _warm(modules: list[str]) -> None:
    for name in modules:
        began = time.monotonic()
        importlib.import_module(name).warm()
        sys.stdout.write(json.dumps({name: round(time.monotonic() - began, 3)}) + "\n")
        sys.stdout.flush()


def _stamps() -> Path:
    base = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(base) if os.path.isabs(base) else Path.home() / ".cache") / "surefoot" / "warm"


if __name__ == "__main__":
    _warm(sys.argv[1:])
