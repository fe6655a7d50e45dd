"""Logs of others as columns: CSV and NPZ, checked, with row and column of each error (docs/estimate.md).

A CSV has one number per cell; `gyro_x, gyro_y, gyro_z` become the column `gyro` (n, 3), `foot0_x` ... become
`foot_position` (n, F, 3). Empty cells and `nan` are NaN.
"""

import csv
import math
import re
import zipfile
import zlib
from array import array
from collections.abc import Iterable, Sequence
from itertools import product
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from surefoot.errors import SurefootError
from surefoot.record.columns import Columns

Ints = NDArray[np.int64]

XYZ = ("x", "y", "z")
WXYZ = ("qw", "qx", "qy", "qz")
ALIASES = {
    "time": "t", "w": "gyro", "a": "acc", "pf": "foot_position", "Rf": "foot_rotation", "fz": "force",
    "p": "true_position", "R": "true_rotation", "v": "true_velocity",
}  # fmt: skip
"""Other names of columns in NPZ files."""
SHAPES: dict[str, tuple[int | str, ...]] = {
    "t": ("n",), "stamp_ns": ("n",), "gyro": ("n", 3), "acc": ("n", 3), "saturated": ("n",), "foot_t": ("m",),
    "foot_stamp_ns": ("m",), "foot_position": ("m", "F", 3), "foot_rotation": ("m", "F", 3, 3),
    "foot_quat_wxyz": ("m", "F", 4), "contact": ("m", "F"), "touch": ("m", "F", "S"), "force": ("m", "F"),
    "joints": ("m", "J"), "true_position": ("n", 3), "true_rotation": ("n", 3, 3), "true_quat_wxyz": ("n", 4),
    "true_velocity": ("n", 3),
}  # fmt: skip
"""Columns and their shapes: n inertial rows, m foot samples, F feet, S switches, J joints."""
METADATA = ("feet", "foot_radius", "sole_size", "contact_on", "contact_off")
"""Statements on the feet: in NPZ files further arrays, in CSV files lines like `# sole_size = 0.2, 0.1` at the top."""
GROUPS: tuple[tuple[str, str, tuple[str, ...], tuple[str, ...]], ...] = (
    ("gyro", "gyro_{}", (), XYZ), ("acc", "acc_{}", (), XYZ), ("true_position", "true_p{}", (), XYZ),
    ("true_velocity", "true_v{}", (), XYZ), ("true_quat_wxyz", "true_{}", (), WXYZ),
    ("foot_position", "foot{}_{}", (r"foot(\d+)_x",), XYZ), ("foot_quat_wxyz", "foot{}_{}", (r"foot(\d+)_x",), WXYZ),
    ("contact", "contact{}", (r"contact(\d+)",), ()),
    ("touch", "contact{}_{}", (r"contact(\d+)_0", r"contact0_(\d+)"), ()), ("force", "force{}", (r"force(\d+)",), ()),
)  # fmt: skip
"""CSV columns that make one: its name, their template, patterns of those that are counted, labels of the last axis."""
NUMBER_WITH_COMMA = re.compile(r"^[+-]?\d+,\d+([eE][+-]?\d+)?$")
SEPARATORS = (",", ";", "\t")
"""Separators of CSV cells; the most frequent one of the first row counts."""
FASTEST_S, SLOWEST_S = 5e-5, 0.5
"""Shortest and longest usual step between inertial rows of a log, s."""
LATEST_S = 9e9
"""Latest stamp that fits into 64 bits of ns, s."""


def read_table(path: Path, sort: bool = False) -> Columns:
    """Read a CSV or NPZ file.

    Args:
        path: the file; by its suffix.
        sort: put rows into the order of their stamps instead of refusing others.

    Returns:
        Columns of `SHAPES`, with `stamp_ns` and `foot_stamp_ns` in place of seconds; CSV rows without any kinematic
        number are left out of the foot samples, `joint_names` holds the names of joint columns.

    Raises:
        SurefootError: the file cannot be read, or what is in it is no log.
    """
    if path.suffix.lower() == ".csv":
        columns = _from_csv(path)
    elif path.suffix.lower() == ".npz":
        columns = _from_npz(path)
    else:
        raise SurefootError("invalid", f"{path}: got suffix {path.suffix!r}; known are .mcap, .csv, .npz", "log")
    return checked(columns, str(path), sort)


def checked(columns: Columns, name: str, sort: bool = False) -> Columns:
    """Check shapes and stamps of columns; see `read_table`."""
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
    return _ordered(out, columns) if sort else out


def _ordered(out: Columns, columns: Columns) -> Columns:
    """Return the columns with their rows in the order of their stamps."""
    n, m = len(out["stamp_ns"]), len(out.get("foot_stamp_ns", ()))
    timed = "foot_t" in columns or "foot_stamp_ns" in columns
    by_imu = np.argsort(out["stamp_ns"], kind="stable")
    by_feet = np.argsort(out["foot_stamp_ns"], kind="stable") if timed else by_imu
    for key in out:
        first = SHAPES.get(key, ("",))[0]
        if first == "n" and len(out[key]) == n:
            out[key] = out[key][by_imu]
        elif first == "m" and len(out[key]) == m:
            out[key] = out[key][by_feet]
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


def _stamps(columns: Columns, prefix: str, name: str, sort: bool, imu: Ints | None = None) -> Ints:
    """Return checked stamps, ns; those of feet are compared with those of the inertial rows, `imu` (n,) ns."""
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
    """Return factors to the unit of a column of stamps, with the unit that each is of."""
    if key.endswith("_ns"):
        return (1e3, "us"), (1e6, "ms"), (1e9, "s")
    return (1e-3, "ms"), (1e-6, "us"), (1e-9, "ns")


def _check_rate(seconds: NDArray[np.float64], key: str, name: str) -> None:
    """Check that the usual step between rows is that of an inertial unit; the error names other units of time."""
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
    """Check that most times of foot samples (m,) s lie among those of the inertial rows (n,) s."""
    low, high = float(imu.min()) - SLOWEST_S, float(imu.max()) + SLOWEST_S

    def inside(factor: float) -> float:
        return float(np.mean((factor * feet >= low) & (factor * feet <= high)))

    if not len(feet) or inside(1.0) >= 0.5:
        return
    text = f"{name}: {key} goes from {feet.min():.6g} to {feet.max():.6g} s, the inertial rows from {imu.min():.6g}"
    text += f" to {imu.max():.6g} s"
    for factor, unit in _units(key):
        if inside(factor) >= 0.5 and factor * float(np.ptp(feet)) > 0.1 * float(np.ptp(imu)):
            raise SurefootError("invalid", f"{text}: the stamps of the feet are in {unit}, multiply by {factor:g}", key)
    raise SurefootError("invalid", f"{text}: another clock", key)


def _from_npz(path: Path) -> Columns:
    try:
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
    except OSError as error:
        if error.strerror is None:
            raise SurefootError("malformed", f"{path} is no NPZ file", "log") from None
        raise SurefootError("unreadable", f"{path}: {error.strerror}") from None
    except (zipfile.BadZipFile, ValueError, EOFError, KeyError, zlib.error, AttributeError, TypeError) as error:
        raise SurefootError("malformed", f"{path} is cut off or no NPZ file ({str(error)[:80]})", "log") from None
    for name, values in columns.items():
        if name not in SHAPES:
            continue
        if not (np.issubdtype(values.dtype, np.number) or values.dtype == np.bool_):
            raise SurefootError("invalid", f"{path}: {name} holds {values.dtype}, wanted are numbers", name)
    return columns


def _from_csv(path: Path) -> Columns:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            stated, header = _metadata(file)
            names, values = _cells(header, file, str(path))
    except OSError as error:
        raise SurefootError("unreadable", f"{path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise SurefootError("malformed", f"{path} is not UTF-8 text", "log") from None
    return _grouped(names, values, str(path)) | stated


def _metadata(file: TextIO) -> tuple[Columns, str]:
    """Return the statements of the lines `# name = value` at the top of a CSV, and the line after them."""
    stated: Columns = {}
    while (line := file.readline().rstrip("\r\n")).startswith("#"):
        key, _, value = (part.strip() for part in line[1:].partition("="))
        if key in METADATA:
            stated[key] = np.array(value if key == "feet" else value.split(","))
    return stated, line


def _cells(header: str, file: TextIO, name: str) -> tuple[list[str], NDArray[np.float64]]:
    """Return header and numbers (n, columns) of a CSV."""
    if not header.strip():
        raise SurefootError("malformed", f"{name} is empty", "log")
    separator = max(SEPARATORS, key=header.count)
    names = [cell.strip() for cell in header.split(separator)]
    if all(_number(cell) is not None for cell in names):
        raise SurefootError("malformed", f"{name} begins with numbers; the first row names the columns", "log")
    twice = sorted({cell for cell in names if names.count(cell) > 1})
    if twice:
        raise SurefootError(
            "invalid", f"{name}: column {', '.join(map(repr, twice))} is there more than once", twice[0]
        )
    numbers = array("d")
    for row, cells in enumerate(csv.reader(file, delimiter=separator), 1):
        if not cells:
            continue
        if len(cells) != len(names):
            raise _wrong_length(cells, names, row, separator, name)
        try:
            numbers.extend([float(cell) if cell else math.nan for cell in cells])
        except ValueError:
            raise _no_number(cells, names, row, name) from None
    return names, np.array(numbers, dtype=np.float64).reshape(-1, len(names))


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


def _wrong_length(cells: Sequence[str], names: Sequence[str], row: int, separator: str, name: str) -> SurefootError:
    hint = ""
    if separator == "," and len(cells) >= 2 * len(names) - 1:
        hint = "; are these decimal commas? Numbers have points here"
    elif len(cells) < len(names):
        hint = "; cut off?"
    return SurefootError("malformed", f"{name} row {row}: {len(cells)} cells under {len(names)} names{hint}", "log")


def _no_number(cells: Sequence[str], names: Sequence[str], row: int, name: str) -> SurefootError:
    at = next(i for i, cell in enumerate(cells) if cell and _number(cell) is None)
    hint = "; write the decimal comma as a point" if NUMBER_WITH_COMMA.match(cells[at].strip()) else ""
    return SurefootError(
        "malformed", f"{name} row {row}, column {names[at]!r}: {cells[at][:40]!r} is no number{hint}", names[at]
    )


def _grouped(names: Sequence[str], values: NDArray[np.float64], name: str) -> Columns:
    """Return columns from single ones; rows without any kinematic number carry no foot sample."""
    at = {column: i for i, column in enumerate(names)}
    out: Columns = {key: values[:, at[key]] for key in ("t", "stamp_ns", "saturated") if key in at}
    if "time" in at:
        out.setdefault("t", values[:, at["time"]])
    for key, template, counted, labels in GROUPS:
        counts = [range(_count(pattern, names, name)) for pattern in counted]
        parts = [template.format(*cell) for cell in product(*counts, *([labels] if labels else []))]
        there = [part for part in parts if part in at]
        missing = [part for part in parts if part not in at]
        if there and missing:
            text = f"{name} has {there[0]!r} but no {', '.join(map(repr, missing))}"
            raise SurefootError("invalid", text, missing[0])
        if there:
            sizes = [len(each) for each in counts] + ([len(labels)] if labels else [])
            out[key] = values[:, [at[part] for part in parts]].reshape(len(values), *sizes)
    joints = [column for column in names if column.startswith("joint_")]
    if joints:
        out["joints"] = values[:, [at[part] for part in joints]]
    return _without_empty(out, joints)


def _without_empty(out: Columns, joints: Sequence[str]) -> Columns:
    kinematic = [key for key in out if SHAPES[key][0] == "m"]
    if not kinematic or not len(out[kinematic[0]]):
        return out
    filled = np.any([np.isfinite(out[key]).reshape(len(out[key]), -1).any(axis=1) for key in kinematic], axis=0)
    stamp = "stamp_ns" if "stamp_ns" in out else "t"
    for key in kinematic:
        out[key] = out[key][filled]
    if stamp in out:
        out[f"foot_{stamp}"] = out[stamp][filled]
    if "gyro" in out and "acc" in out:  # rows of the feet alone are no inertial rows
        bare = np.isnan(out["gyro"]).all(axis=1) & np.isnan(out["acc"]).all(axis=1) & filled
        for key in [key for key in out if SHAPES[key][0] == "n"]:
            out[key] = out[key][~bare]
    if joints:
        out["joint_names"] = np.array([column.removeprefix("joint_") for column in joints])
    return out


def _count(pattern: str, names: Iterable[str], name: str) -> int:
    """Return the number of columns like `foot0_x, foot1_x`, which must count from 0 without a gap."""
    found = sorted(int(match[1]) for column in names if (match := re.fullmatch(pattern, column)))
    if found != list(range(len(found))):
        raise SurefootError(
            "invalid", f"{name}: columns {pattern!r} are numbered {found}, wanted is 0, 1, 2 ...", "log"
        )
    return len(found)
