"""Reader of logs in CSV files as named arrays, whose errors name row and column.

A CSV has one number per cell; `gyro_x, gyro_y, gyro_z` become the array `gyro` (n, 3), `foot0_x` ... become
`foot_position` (n, F, 3). Empty cells and `nan` are NaN.
"""

import csv
import math
import re
from array import array
from collections.abc import Iterable, Sequence
from itertools import product
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from surefoot.disk import regular_size
from surefoot.errors import SurefootError
from surefoot.record.columns import METADATA, SHAPES, Columns

XYZ = ("x", "y", "z")
WXYZ = ("qw", "qx", "qy", "qz")
GROUPS: tuple[tuple[str, str, tuple[str, ...], tuple[str, ...]], ...] = (
    ("gyro", "gyro_{}", (), XYZ), ("acc", "acc_{}", (), XYZ), ("true_position", "true_p{}", (), XYZ),
    ("true_velocity", "true_v{}", (), XYZ), ("true_quat_wxyz", "true_{}", (), WXYZ),
    ("foot_position", "foot{}_{}", (r"foot(\d+)_x",), XYZ), ("foot_quat_wxyz", "foot{}_{}", (r"foot(\d+)_x",), WXYZ),
    ("external_position", "external_{}", (), XYZ), ("external_velocity", "external_v{}", (), XYZ),
    ("external_quat_wxyz", "external_{}", (), WXYZ), ("contact", "contact{}", (r"contact(\d+)",), ()),
    ("touch", "contact{}_{}", (r"contact(\d+)_0", r"contact0_(\d+)"), ()), ("force", "force{}", (r"force(\d+)",), ()),
)  # fmt: skip
"""Groups of CSV columns that form one array: name of the array, column template, patterns of the counted indices,
labels of the last axis."""
NUMBER_WITH_COMMA = re.compile(r"^[+-]?\d+,\d+([eE][+-]?\d+)?$")
WHOLE = re.compile(r"\s*-?([0-8]?\d{1,18})\s*")
"""Pattern of an integer stamp, ns, that fits into 64 bits."""
SEPARATORS = (",", ";", "\t")
"""Characters that are recognised as separators of CSV cells; the most frequent one in the header row is used."""


SINGLE = ("t", "stamp_ns", "saturated", "external_yaw")
"""CSV columns that are an array each; `time` is another name of `t`."""
SHOWN = 12
"""Largest number of column names of a CSV file that an error message lists."""


def read_csv(path: Path) -> Columns:
    """Return the arrays of a log in a CSV file by name; `surefoot.record.tables` checks their shapes and stamps."""
    try:
        regular_size(path)
        with path.open(encoding="utf-8-sig", newline="") as file:
            stated, header = _metadata(file)
            names, values, stamps = _cells(header, file, str(path))
    except OSError as error:
        raise SurefootError("unreadable", f"{path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise SurefootError("malformed", f"{path} is not UTF-8 text", "log") from None
    columns = _grouped(names, values, stamps, str(path)) | stated
    if "gyro" not in columns:
        shown = ", ".join(names[:SHOWN]) + (", ..." if len(names) > SHOWN else "")
        text = f"{path} has no gyro_x, gyro_y, gyro_z; it has {shown}. Known columns: docs/estimate.md"
        raise SurefootError("invalid", text, "gyro")
    return columns


def others_of_csv(path: Path) -> tuple[list[str], list[str]]:
    """Return the columns and the statements above the header of a readable CSV log that are not read, and known names.

    Known are the names of columns for as many feet as there are (at least one), and of statements.
    """
    with path.open(encoding="utf-8-sig", newline="") as file:
        keys = list[str]()
        while (line := file.readline().rstrip("\r\n")).startswith("#"):
            key, stated, _ = line[1:].partition("=")
            keys += [key.strip()] if stated else []
    names = [cell.strip() for cell in line.split(max(SEPARATORS, key=line.count))]
    known = [*SINGLE, "time"]
    for _, template, counted, labels in GROUPS:
        counts = [range(max(1, _count(pattern, names, str(path)))) for pattern in counted]
        known += _parts(template, counts, labels)
    joints = [column for column in names if column.startswith("joint_")]
    known += [*joints, *(f"torque_{column.removeprefix('joint_')}" for column in joints)]
    known = list(dict.fromkeys([*known, *METADATA]))
    others = [name for name in names if name and name not in known] + [key for key in keys if key not in METADATA]
    return others, known


def _parts(template: str, counts: Sequence[range], labels: tuple[str, ...]) -> list[str]:
    """Return the names of the columns of one array, by its column template, counted indices and last labels."""
    return [template.format(*cell) for cell in product(*counts, *([labels] if labels else []))]


def _metadata(file: TextIO) -> tuple[Columns, str]:
    """Return the statements of the lines `# name = value` at the top of a CSV, and the line after them."""
    stated: Columns = {}
    while (line := file.readline().rstrip("\r\n")).startswith("#"):
        key, _, value = (part.strip() for part in line[1:].partition("="))
        if key in METADATA:
            stated[key] = np.array(value if key == "feet" else value.split(","))
    return stated, line


def _cells(header: str, file: TextIO, name: str) -> tuple[list[str], NDArray[np.float64], NDArray[np.int64] | None]:
    """Return header, numbers (n, columns) and whole `stamp_ns` (n,) of a CSV; ns since 1970 are no exact floats."""
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
    numbers, whole = array("d"), array("q")
    stamped = names.index("stamp_ns") if "stamp_ns" in names else -1
    for row, cells in enumerate(csv.reader(file, delimiter=separator), 1):
        if not cells:
            continue
        if len(cells) != len(names):
            raise _wrong_length(cells, names, row, separator, name)
        try:
            numbers.extend([float(cell) if cell else math.nan for cell in cells])
        except ValueError:
            raise _no_number(cells, names, row, name) from None
        if stamped >= 0 and WHOLE.fullmatch(cells[stamped]):
            whole.append(int(cells[stamped]))
    values = np.array(numbers, dtype=np.float64).reshape(-1, len(names))
    return names, values, np.array(whole, dtype=np.int64) if len(whole) == len(values) and len(whole) else None


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


def _grouped(names: Sequence[str], values: NDArray[np.float64], stamps: NDArray[np.int64] | None, name: str) -> Columns:
    """Return arrays made from single columns; rows without any kinematic number are left out of the foot samples.

    `values` (rows, names); `stamps` (rows,) ns; `name` of the file, for errors.
    """
    at = {column: i for i, column in enumerate(names)}
    out: Columns = {key: values[:, at[key]] for key in SINGLE if key in at}
    if stamps is not None:
        out["stamp_ns"] = stamps
    if "time" in at:
        out.setdefault("t", values[:, at["time"]])
    for key, template, counted, labels in GROUPS:
        counts = [range(_count(pattern, names, name)) for pattern in counted]
        parts = _parts(template, counts, labels)
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
    torques = [f"torque_{column.removeprefix('joint_')}" for column in joints]
    there = [column for column in torques if column in at]
    if there and len(there) < len(torques):
        missing = next(column for column in torques if column not in at)
        raise SurefootError("invalid", f"{name} has {there[0]!r} but no {missing!r}", missing)
    if there:
        out["torque"] = values[:, [at[part] for part in torques]]
    return _without_empty(out, joints)


def _split_external(out: Columns) -> Columns:
    """Return the columns with external samples in rows of their own, with the stamp of the row that held each."""
    external = [key for key in out if SHAPES[key][0] == "e"]
    stamp = "stamp_ns" if "stamp_ns" in out else "t"
    if not external or stamp not in out:
        return out
    filled = np.any([np.isfinite(out[key]).reshape(len(out[key]), -1).any(axis=1) for key in external], axis=0)
    inertial = [key for key in ("gyro", "acc") if key in out]
    bare = filled & np.all([np.isnan(out[key]).all(axis=1) for key in inertial], axis=0) if inertial else ~filled
    kinematic = [key for key in out if SHAPES[key][0] == "m"]
    for key in kinematic:  # a row of a sample from elsewhere alone is no other row
        bare = bare & np.isnan(out[key]).reshape(len(out[key]), -1).all(axis=1)
    stamps = out[stamp][filled]
    out = {key: values[filled] if key in external else values[~bare] for key, values in out.items()}
    return out | {f"external_{stamp}": stamps}


def _without_empty(out: Columns, joints: Sequence[str]) -> Columns:
    out = _split_external(out)
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
