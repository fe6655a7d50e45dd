"""Hash of the source files on which the compiled code of a kernel depends.

numba reuses cached machine code until the file of the kernel itself changes. Functions that the kernel calls, and its
constants, may come from other files; without this hash a change of these files alone would leave the old code in use.
"""

import re
import sys
from functools import cache
from hashlib import sha256
from pathlib import Path

_IMPORT = re.compile(r"^(?:from\s+([\w.]+)\s+import\s+(\([^)]*\)|[^\n]*)|import\s+([\w.]+))", re.MULTILINE)


@cache
def fingerprint(module: str) -> str:
    """Return a hash of the source of a module and of all modules of `surefoot` or its own package that it imports."""
    packages = {"surefoot", module.partition(".")[0]}
    found, left = dict[str, str](), [module]
    while left:
        name = left.pop()
        if name not in found:
            found[name], imported = _source(name)
            left += [other for other in imported if other.partition(".")[0] in packages]
    return sha256("".join(f"{name}:{found[name]}\n" for name in sorted(found)).encode()).hexdigest()


@cache
def _source(module: str) -> tuple[str, tuple[str, ...]]:
    """Return a hash of the text of a module that is being, or has been, imported, and names of its imports."""
    path = getattr(sys.modules.get(module), "__file__", None)
    if path is None or not path.endswith(".py"):
        return "", ()
    content = Path(path).read_bytes()
    names: list[str] = []
    parents = (module if path.endswith("__init__.py") else module.rpartition(".")[0]).split(".")
    for origin, what, plain in _IMPORT.findall(content.decode("utf-8")):
        bare = origin.lstrip(".")
        if level := len(origin) - len(bare):  # relative: one point for the package itself
            origin = ".".join([*parents[: len(parents) + 1 - level], *filter(None, [bare])])
        names.append(origin or plain)
        names += [f"{origin}.{word}" for word in re.findall(r"\w+", what) if f"{origin}.{word}" in sys.modules]
    return sha256(content).hexdigest(), tuple(names)
