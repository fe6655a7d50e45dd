"""Write a log in the layouts that `surefoot estimate` reads."""

from pathlib import Path

import numpy as np

from surefoot.geometry.rotations import quat_from_matrix

from .log import Log


def save_npz(log: Log, path: Path) -> Path:
    """Write a log as NPZ and return its path; fields that the log does not have are left out."""
    columns = {
        "stamp_ns": log.stamp_ns, "gyro": log.w, "acc": log.q, "foot_stamp_ns": log.foot_ns,
        "foot_position": log.foot_position, "foot_rotation": log.foot_rot, "contact": log.contact,
        "touch": log.touch, "force": log.force, "joints": log.joints, "saturated": log.saturated,
    }  # fmt: skip
    if log.truth is not None:
        truth = log.truth
        columns |= {"true_position": truth.position, "true_rotation": truth.rot, "true_velocity": truth.v_world}
    np.savez(path, **{key: value for key, value in columns.items() if value is not None})  # type: ignore[arg-type]
    return path


def save_csv(log: Log, path: Path, separator: str = ",") -> Path:
    """Write a log as CSV, a row per stamp of inertial rows and foot samples; absent values are empty cells."""
    feet = range(log.feet_count)
    names = ["t", *(f"gyro_{a}" for a in "xyz"), *(f"acc_{a}" for a in "xyz")]
    kinematic = [f"foot{f}_{part}" for f in feet for part in ("x", "y", "z", "qw", "qx", "qy", "qz")]
    kinematic += [f"contact{f}" for f in feet]
    rows: dict[int, list[str]] = {}
    imu = np.hstack([log.w, log.q])
    for stamp, row in zip(log.stamp_ns.tolist(), imu.tolist(), strict=True):
        rows[stamp] = [repr(x) for x in row] + [""] * len(kinematic)
    for k, stamp in enumerate(log.foot_ns.tolist()):
        numbers: list[float] = []
        for f in feet:
            numbers += [*log.foot_position[k, f], *quat_from_matrix(np.ascontiguousarray(log.foot_rot[k, f]))]
        row = rows.setdefault(stamp, [""] * 6 + [""] * len(kinematic))
        row[6:] = [repr(float(x)) for x in (*numbers, *log.contact[k])]
    with path.open("w") as file:
        file.write(separator.join(names + kinematic) + "\n")
        for stamp in sorted(rows):
            file.write(separator.join([f"{stamp // 10**9}.{stamp % 10**9:09d}", *rows[stamp]]) + "\n")
    return path
