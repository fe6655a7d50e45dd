"""Reader of logs of other programs, CSV and NPZ files, as checked arrays by column name (docs/estimate.md)."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Ints
from surefoot.disk import regular_size
from surefoot.errors import SurefootError
from surefoot.nearest import did_you_mean, nearest
from surefoot.npz import BROKEN_NPZ, damage_of
from surefoot.record.columns import METADATA, SHAPES, Columns
from surefoot.record.csv_table import SHOWN, others_of_csv, read_csv
from surefoot.schemas.base import UNIT_WITHIN

ALIASES = {
    "time": "t", "w": "gyro", "a": "acc", "pf": "foot_position", "Rf": "foot_rotation", "fz": "force",
    "p": "true_position", "R": "true_rotation", "v": "true_velocity",
}  # fmt: skip
"""Name of a column in this project, by the alternative name that it may have in an NPZ file."""
NAMES = tuple(dict.fromkeys((*SHAPES, *METADATA, "joint_names", *ALIASES)))
"""Names of the arrays of an NPZ log that are read; others are left alone."""
FASTEST_S, SLOWEST_S = 5e-5, 0.5
"""`FASTEST_S`: shortest allowed median step between inertial rows of a log, s; `SLOWEST_S`: longest one, s; a log
outside of these is refused."""
LATEST_S = 9e9
"""Largest absolute stamp of a log, s, so that it fits into 64 bits as ns; a larger one is refused."""


def read_table(path: Path, sort: bool = False) -> Columns:
    """Return the arrays of a log in a CSV or NPZ file by name, after a check of their shapes and stamps.

    Args:
        path: the file; its suffix decides the format.
        sort: sort rows by their stamps; otherwise stamps that go back are refused.

    Returns:
        Arrays of `SHAPES`, with `stamp_ns` and `foot_stamp_ns` in place of seconds; CSV rows without any kinematic
        number are left out of the foot samples, `joint_names` holds the names of joint columns.

    Raises:
        SurefootError: the file cannot be read, or its content is no log.
    """
    if path.suffix.lower() == ".csv":
        columns = read_csv(path)
    elif path.suffix.lower() == ".npz":
        columns = _from_npz(path)
    else:
        raise SurefootError("invalid", f"{path}: got suffix {path.suffix!r}; known are .mcap, .csv, .npz", "log")
    return checked(columns, str(path), sort)


def checked(columns: Columns, name: str, sort: bool = False) -> Columns:
    """Check shapes and stamps of the arrays of a log; return them with stamps in ns in place of seconds.

    Args:
        columns: arrays by name; gyro and acc, with t (s) or stamp_ns, are needed.
        name: name of the log, for error messages.
        sort: sort rows by their stamps; otherwise stamps that go back are refused.

    Raises:
        SurefootError: columns are missing, or do not fit each other.
    """
    if "t" in columns and "stamp_ns" in columns:
        raise SurefootError("invalid", f"{name} has both 't' (s) and 'stamp_ns'; give one", "t")
    for need in ("gyro", "acc"):
        if need not in columns:
            raise SurefootError("invalid", f"{name} has no {need!r}; it has {', '.join(sorted(columns))}", need)
    if not ("t" in columns or "stamp_ns" in columns):
        raise SurefootError("invalid", f"{name} has no 't' (s) and no 'stamp_ns'", "t")
    if "force" in columns and columns["force"].ndim == 3 and columns["force"].shape[2] == 3:
        columns = {**columns, "force": np.linalg.norm(columns["force"], axis=2)}
    _check_shapes(columns, name)
    _check_quaternions(columns, name)
    out = {key: value for key, value in columns.items() if key not in ("t", "foot_t")}
    out["stamp_ns"] = _stamps(columns, "", name, sort)
    if any(key in columns for key in ("foot_position", "joints")):
        timed = "foot_t" in columns or "foot_stamp_ns" in columns
        out["foot_stamp_ns"] = (
            _stamps(columns, "foot_", name, sort, out["stamp_ns"]) if timed else out["stamp_ns"].copy()
        )
        feet = len(columns["foot_position"] if "foot_position" in columns else columns["joints"])
        if feet != len(out["foot_stamp_ns"]):
            raise SurefootError("invalid", f"{name}: {feet} foot samples and no 'foot_t' of their times", "foot_t")
    if any(key.startswith("external_") and key in SHAPES for key in columns):
        if "external_t" not in columns and "external_stamp_ns" not in columns:
            raise SurefootError("invalid", f"{name} has no 'external_t' of its external samples", "external_t")
        out["external_stamp_ns"] = _stamps(columns, "external_", name, sort, out["stamp_ns"])
        out.pop("external_t", None)
    return _ordered(out, columns) if sort else out


def _ordered(out: Columns, columns: Columns) -> Columns:
    """Return the columns with their rows in the order of their stamps."""
    n, m = len(out["stamp_ns"]), len(out.get("foot_stamp_ns", ()))
    timed = "foot_t" in columns or "foot_stamp_ns" in columns
    by_imu = np.argsort(out["stamp_ns"], kind="stable")
    by_external = np.argsort(out.get("external_stamp_ns", np.empty(0, dtype=np.int64)), kind="stable")
    by_feet = np.argsort(out["foot_stamp_ns"], kind="stable") if timed else by_imu
    for key in out:
        first = SHAPES.get(key, ("",))[0]
        if first == "n" and len(out[key]) == n:
            out[key] = out[key][by_imu]
        elif first == "m" and len(out[key]) == m:
            out[key] = out[key][by_feet]
        elif first == "e":
            out[key] = out[key][by_external]
    return out


def _check_shapes(columns: Columns, name: str) -> None:
    sizes: dict[str, tuple[int, str]] = {}
    for key, shape in SHAPES.items():
        if key not in columns:
            continue
        found = columns[key].shape
        if len(found) != len(shape):
            wanted = " x ".join(str(part) for part in shape)
            raise SurefootError("invalid", f"{name}: {key} has shape {found}, wanted is {wanted}", key)
        for part, size in zip(shape, found, strict=True):
            if isinstance(part, int):
                if part != size:
                    raise SurefootError("invalid", f"{name}: {key} has shape {found}; {part} numbers a row", key)
                continue
            known, first = sizes.setdefault(part, (size, key))
            if known != size:
                raise SurefootError("invalid", f"{name}: {key} has {size} of what {first} has {known} of", key)
    if sizes["n"][0] == 0:
        raise SurefootError("invalid", f"{name} has no rows", "t")
    if sizes["n"][0] == 1:
        raise SurefootError("invalid", f"{name} has one row; nothing can be estimated from it", "t")


def _check_quaternions(columns: Columns, name: str) -> None:
    """Refuse quaternions that are no rotation; rows with NaN are absent samples."""
    for key in (key for key in SHAPES if key.endswith("quat_wxyz") and key in columns):
        length = np.linalg.norm(np.asarray(columns[key], dtype=np.float64), axis=-1)
        bad = np.argwhere(np.abs(length - 1.0) > UNIT_WITHIN)
        if bad.size:
            row, text = bad[0], f"allowed is 1 within {UNIT_WITHIN:g}; {len(bad)} are so"
            raise SurefootError("invalid", f"{name} row {row[0]}: {key} has length {length[*row]:.3g}, {text}", key)


def _stamps(columns: Columns, prefix: str, name: str, sort: bool, imu: Ints | None = None) -> Ints:
    """Return the checked stamps of a log's rows, ns; those of feet are compared with those of `imu`, (n,) ns."""
    key = f"{prefix}stamp_ns" if f"{prefix}stamp_ns" in columns else f"{prefix}t"
    values = columns[key]
    if not np.issubdtype(values.dtype, np.integer):
        _finite(values, key, name)
    unit = 1e-9 if key.endswith("_ns") else 1.0
    if imu is None:
        _check_rate(unit * values, key, name)
    else:
        _check_range(unit * values, np.asarray(1e-9 * imu, dtype=np.float64), key, name)
    if key.endswith("_ns"):
        stamps = (values if np.issubdtype(values.dtype, np.integer) else np.round(values)).astype(np.int64)
    else:
        stamps = np.round(values.astype(np.float64) * 1e9).astype(np.int64)
    back = np.flatnonzero(np.diff(stamps) < 0)
    if back.size and not sort:
        row = int(back[0]) + 1
        raise SurefootError(
            "invalid", f"{name} row {row}: {key} goes back by {1e-9 * float(stamps[row - 1] - stamps[row]):.6g} s; "
            f"{back.size} rows do (--sort puts them in order)", key,
        )  # fmt: skip
    return stamps


def _finite(values: NDArray[np.float64], key: str, name: str) -> None:
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise SurefootError("invalid", f"{name} row {bad[0]}: {key} is {values[bad[0]]}; {bad.size} rows are so", key)


def _units(key: str) -> tuple[tuple[float, str], ...]:
    """Return factor and name of the units in which stamps of column `key` may wrongly be; factor: to its own unit."""
    if key.endswith("_ns"):
        return (1e3, "us"), (1e6, "ms"), (1e9, "s")
    return (1e-3, "ms"), (1e-6, "us"), (1e-9, "ns")


def _check_rate(seconds: NDArray[np.float64], key: str, name: str) -> None:
    """Check that the usual step between rows, `seconds` (n,), is that of an inertial unit.

    Raises:
        SurefootError: it is not; names other units of time that would fit.
    """
    step = float(np.median(np.abs(np.diff(np.sort(seconds)))))
    if FASTEST_S <= step <= SLOWEST_S:
        if np.abs(seconds).max() > LATEST_S:
            raise SurefootError("invalid", f"{name}: {key} reaches {np.abs(seconds).max():.3g} s", key)
        return
    text = f"{name}: {step:.3g} s between rows; {FASTEST_S:g} to {SLOWEST_S:g} s are allowed"
    for factor, unit in _units(key):
        if FASTEST_S <= step * factor <= SLOWEST_S:
            raise SurefootError("invalid", f"{text}: the stamps are in {unit}, multiply by {factor:g}", key)
    raise SurefootError("invalid", text, key)


def _check_range(feet: NDArray[np.float64], imu: NDArray[np.float64], key: str, name: str) -> None:
    """Raise SurefootError if stamps of feet (m,) s seem to be in another unit or on another clock than `imu` (n,) s."""
    low, high, length = float(imu.min()) - SLOWEST_S, float(imu.max()) + SLOWEST_S, float(np.ptp(imu))
    if not len(feet):
        return

    def inside(factor: float) -> bool:
        share = float(np.mean((factor * feet >= low) & (factor * feet <= high)))
        return share >= 0.5 and (len(feet) < 10 or factor * float(np.ptp(feet)) > 0.1 * length)

    text = f"{name}: {key} goes from {feet.min():.6g} to {feet.max():.6g} s, the inertial rows from {imu.min():.6g}"
    text += f" to {imu.max():.6g} s"
    for factor, unit in () if inside(1.0) else _units(key):
        if inside(factor):
            raise SurefootError("invalid", f"{text}: these stamps are in {unit}, multiply by {factor:g}", key)
    if feet.max() < low or feet.min() > high:
        raise SurefootError("invalid", f"{text}: another clock", key)


def unread(path: Path) -> str:
    """Return a note on what of a readable NPZ or CSV log is not read, with near names and those that are known.

    Empty: all arrays and columns are read, or the file is neither.
    """
    if path.suffix.lower() == ".csv":
        (others, known), read = others_of_csv(path), "known columns: docs/estimate.md"
    elif path.suffix.lower() == ".npz":
        with np.load(path, allow_pickle=False) as file:
            others, known = [key for key in file.files if key not in NAMES], list(NAMES)
        read = f"read are {', '.join(NAMES)}"
    else:
        return ""
    if not others:
        return ""
    shown = ", ".join(f"{key[:60]!r}{did_you_mean(key, known)}" for key in others[:SHOWN])
    more = ", ..." if len(others) > SHOWN else ""
    return f"not read of {path.name}: {shown}{more}; {read}"


def _from_npz(path: Path) -> Columns:
    try:
        regular_size(path)
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            columns: Columns = {}
            for key in file.files:
                name = ALIASES.get(key, key)
                if name in columns:
                    raise SurefootError("invalid", f"{path} has {name!r} twice, once as {key!r}", name)
                if name in SHAPES or name in METADATA or name == "joint_names":
                    values = file[key]
                    named = name == "joints" and values.dtype.kind in "US"  # some logs call their names so
                    columns["joint_names" if named else name] = values
            if "gyro" not in columns:
                near = nearest("gyro", file.files)
                hint = f" (is it {near!r}?)" if near else ""
                text = f"{path} has no gyro{hint}; it has {', '.join(file.files) or 'nothing'}"
                text = f"{text[:900]}. Known names: docs/estimate.md"
                raise SurefootError("invalid", text, "gyro")
    except OSError as error:
        if error.strerror is None:
            raise SurefootError("malformed", f"{path} {damage_of(path)}", "log") from None
        raise SurefootError("unreadable", f"{path}: {error.strerror}") from None
    except BROKEN_NPZ:
        raise SurefootError("malformed", f"{path} {damage_of(path)}", "log") from None
    for name, values in columns.items():
        if name not in SHAPES:
            continue
        if not (np.issubdtype(values.dtype, np.number) or values.dtype == np.bool_):
            raise SurefootError("invalid", f"{path}: {name} holds {values.dtype}, wanted are numbers", name)
    return columns
