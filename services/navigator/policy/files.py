"""Policy files: arrays and provenance in one .npz without pickles, checked when read."""

import hashlib
import io
import json
import zipfile
from collections.abc import Callable, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.disk import whole
from surefoot.errors import Refusal
from surefoot.files import FileError, read_regular

from .choose import NUMBERS, PolicyTables
from .decider import KIND_NAMES, Policy
from .grids import D_MIN, GRID, LAYER_MIN

VERSION = 2
"""Version of the policy file format; files of another version are refused."""
MAX_BYTES = 64 * 1024 * 1024
MEMBERS = ("version", "kind", "actions", "numbers", "table", "grid", "shown", "provenance", "digest")
KINDS_BY_NAME = {name: kind for kind, name in KIND_NAMES.items()}


def content_of(policy: Policy) -> bytes:
    """Return the bytes of a policy file; equal policies give equal bytes. Tables are kept in single precision."""
    tables = policy.tables
    held: dict[str, NDArray[Any]] = {
        "version": np.array(VERSION),
        "kind": np.array(KIND_NAMES[tables.kind]),
        "actions": np.array(policy.actions),
        "numbers": tables.numbers,
        "table": tables.table.astype(np.float32),
        "grid": tables.grid,
        "shown": tables.shown,
        "provenance": np.array(json.dumps(dict(policy.provenance), sort_keys=True)),
    }
    buffer = io.BytesIO()
    held["digest"] = np.array(digest_of(held))
    np.savez_compressed(buffer, allow_pickle=False, **held)
    return buffer.getvalue()


def digest_of(held: Mapping[str, NDArray[Any]]) -> str:
    """Return the sha256 of all members of a policy file but its digest, which reveals a change by hand.

    `held`: arrays by the name of the member, of any shape and unit.
    """
    digest = hashlib.sha256()
    for member in MEMBERS[:-1]:
        array = held[member]
        digest.update(f"{member} {array.dtype.str} {array.shape} ".encode() + array.tobytes())
    return digest.hexdigest()


def save(policy: Policy, path: Path) -> str:
    """Write a policy file atomically, and return its sha256."""
    content = content_of(policy)
    with whole(path) as part:
        part.write_bytes(content)
    return hashlib.sha256(content).hexdigest()


def load_policy(path: Path, actions: tuple[str, ...] | None = None) -> Policy:
    """Return the policy stored in a file.

    Args:
        path: the file.
        actions: names that its actions must have, in this order; None = any.

    Raises:
        Refusal: the file cannot be read, is truncated, holds pickles, NaN or arrays of wrong shape, is of another
            version or for other actions; the message quotes what was received and what is allowed.
    """
    try:
        content = read_regular(path, MAX_BYTES)
    except FileError as error:
        code = "policy_unreadable" if error.code == "not_found" else "policy_invalid"
        raise Refusal(code, str(error), "policy") from None
    return parse(content, path.stem, str(path), actions)


def parse(content: bytes, name: str, where: str, actions: tuple[str, ...] | None = None) -> Policy:
    """Return the policy in the bytes of a policy file.

    Args:
        content: bytes of the file.
        name: name of the policy, where the file has none.
        where: path or source, for the message of an error.
        actions: names that its actions must have, in this order; None = any.

    Raises:
        Refusal: the bytes are truncated, hold pickles, NaN or arrays of wrong shape, are of another version or for
            other actions; the message names `where`.
    """

    def refuse(message: str) -> Refusal:
        return Refusal("policy_invalid", f"{where}: {message}", "policy")

    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            size = sum(info.file_size for info in archive.infolist())
        if size > MAX_BYTES:
            raise refuse(f"unpacks to {size} bytes, allowed are {MAX_BYTES}")
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            missing = [member for member in MEMBERS if member not in file.files]
            if missing:
                raise refuse(f"lacks {', '.join(missing)}; a policy file has {', '.join(MEMBERS)}")
            held = {member: file[member] for member in MEMBERS}
        version, kind, digest = int(held["version"]), str(held["kind"]), str(held["digest"])
        names = tuple(str(each) for each in held["actions"].reshape(-1))
        provenance = json.loads(str(held["provenance"]))
    except Refusal:
        raise
    except Exception as error:  # zip, zlib, numpy, struct and json each have their own
        raise refuse(f"is no policy file or is damaged ({type(error).__name__}: {str(error)[:120]})") from None
    if version != VERSION:
        raise refuse(f"is of version {version}, allowed is {VERSION}")
    if digest != (own := digest_of(held)):
        raise refuse(f"is not as it was written: its digest is {digest[:12]!r}, its content has {own[:12]!r}")
    if kind not in KINDS_BY_NAME:
        raise refuse(f"has kind {kind!r}, allowed are {', '.join(KINDS_BY_NAME)}")
    if actions is not None and names != actions:
        raise Refusal("policy_actions", f"{where}: is for actions {names}, allowed are {actions}", "policy")
    if not isinstance(provenance, dict):
        raise refuse(f"has the provenance {str(provenance)[:80]!r}, allowed is an object")
    numbers, table, grid, shown = _checked(held, len(names), refuse)
    words = {str(key): str(value) for key, value in provenance.items()}  # pyright: ignore[reportUnknownVariableType]
    tables = PolicyTables(KINDS_BY_NAME[kind], numbers, table, grid, shown)
    return Policy(words.get("name", name), names, tables, words, hashlib.sha256(content).hexdigest())


def _checked(
    held: Mapping[str, NDArray[np.generic]], count: int, refuse: Callable[[str], Refusal]
) -> list[NDArray[np.float64]]:
    shapes = {"numbers": (NUMBERS,), "table": (None, None, None, count), "grid": (GRID,), "shown": (3, 3)}
    out: list[NDArray[np.float64]] = []
    for member, shape in shapes.items():
        array = held[member]
        fits = len(array.shape) == len(shape) and all(w in (None, g) for w, g in zip(shape, array.shape, strict=True))
        if not fits or array.size == 0 or array.dtype.kind != "f":
            raise refuse(f"{member} has shape {array.shape} of {array.dtype}, allowed is {shape} of floats")
        if not np.isfinite(array).all():
            raise refuse(f"{member} holds NaN or infinity, allowed are finite numbers")
        out.append(np.ascontiguousarray(array, dtype=np.float64))
    for low, size, axis in ((D_MIN, out[1].shape[1], "distance"), (LAYER_MIN, out[1].shape[0], "layer")):
        if size > 1 and not out[2][low] < out[2][low + 1]:  # no cell of such an axis can be found
            raise refuse(f"grid has the {axis} from {out[2][low]:g} to {out[2][low + 1]:g}, allowed is a rising axis")
    if not (np.allclose(out[3], out[3].T) and (np.diag(out[3]) > 0.0).all()):
        raise refuse("shown is no covariance, allowed is a symmetric matrix with a positive diagonal")
    return out


def shipped() -> dict[str, Path]:
    """Return the paths of the policy files that come with the package, by name."""
    folder = Path(str(resources.files("surefoot.services.navigator"))) / "policy" / "shipped"
    return {path.stem: path for path in sorted(folder.glob("*.npz"))}
