"""Results of an estimator over a log of any length: estimates written to files piece by piece, and a summary."""

import json
import math
import shutil
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter
from typing import Any, TextIO

import numpy as np
from numpy.lib.format import open_memmap
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from surefoot.disk import whole

from .log import Log
from .scores import Score, base_pose, base_rot, score
from .smooth import smooth
from .track import FLAGS, Track, follow
from .track import track as track_of

Array = NDArray[Any]

ROWS_EACH = 50_000
SUMMARY = "summary.json"
MADE = {"estimates.npz", "estimates.svg", "estimate.tum", "truth.tum", "estimates.csv", SUMMARY}
"""Names of all files that an estimate may write into its folder."""
"""Name of the file that holds the report of a run beside its estimates."""
SCORED_ROWS = 2_000_000  # logs with truth that are longer are scored on their first rows
NIS_BAND = (0.22, 9.35)  # 95 % of chi^2 with 3 degrees of freedom
PARTS = (
    "v", "g", "p", "position", "yaw", "v_odom", "nis", "gyro_bias", "acc_bias", "pose", "slipping", "contact",
)  # fmt: skip
"""Fields of a track (estimates per inertial row) that are written to files, beside its flags."""
FILE_NAMES = {
    "v": "velocity_imu", "g": "g_up_imu", "p": "covariance", "pose": "pose_covariance",
    "v_odom": "velocity_odom", "slipping": "slipping",
    "contact": "contact_probability",
}  # fmt: skip
"""Name in the result file by field of a track; default: the name of the field."""


@dataclass(frozen=True)
class Result:
    """Result of an estimator over a whole log: estimates, on disk or mapped from it, summary and score."""

    log: Log
    track: Track
    summary: Mapping[str, Any]
    score: Score | None


def estimate(
    log: Log,
    name: str,
    folder: Path,
    smoothed: bool = False,
    progress: Callable[[float], None] = lambda share: None,
    **options: Any,
) -> Result:
    """Run an estimator over a log, and return estimates (in files of a folder), summary and score.

    Args:
        log: what to run over.
        name: name of an estimator of the service or of a referee.
        folder: gets one file per quantity, so that memory does not grow with the log.
        smoothed: True = forward and backward, in one piece; memory holds both passes.
        progress: gets the share of the rows that is done.
        options: changes of the estimator's parameters.
    """
    n = len(log.stamp_ns)
    few = log.with_imu(np.arange(min(2, n))).with_feet(np.arange(min(2, len(log.foot_ns))))
    track_of(name, few, **options)  # loads the kernels, which is no time of a row
    spent, begun = 0.0, perf_counter()
    folder.mkdir(parents=True, exist_ok=True)
    kept: dict[str, Array] = {}
    refused: Mapping[str, int] = {}
    externals = None
    in_order = log.order is None or bool((np.diff(log.order[log.order < n]) > 0).all())
    pieces = (
        iter([(slice(0, n), smooth(name, log, **options))])
        if smoothed
        else follow(name, log, ROWS_EACH if in_order else None, **options)
    )
    for rows, piece in pieces:
        spent += perf_counter() - begun
        _keep(kept, folder, n, rows, piece)
        progress(rows.stop / n)
        refused, externals, begun = piece.refused, piece.externals, perf_counter()
    kept["stamp_ns"] = open_memmap(folder / "stamp_ns.npy", mode="w+", dtype=np.int64, shape=(n,))
    kept["stamp_ns"][:] = log.stamp_ns
    track = Track(
        name, v=kept["v"], g=kept["g"], p=kept["p"], position=kept["position"], yaw=kept["yaw"],
        v_odom=kept["v_odom"], flags={f: kept[f] for f in FLAGS}, nis=kept["nis"], refused=refused,
        slipping=kept.get("slipping"), contact=kept.get("contact"), gyro_bias=kept.get("gyro_bias"),
        acc_bias=kept.get("acc_bias"), externals=externals, pose=kept.get("pose"),
    )  # fmt: skip
    found = None
    if log.truth is not None and track.flags["initialised"].any() and n <= SCORED_ROWS and log.scored.sum() > 1:
        found = score(log, track)
    return Result(
        log, track, plain({**summary(log, track, found), "smoothed": smoothed, "us_per_row": 1e6 * spent / n}), found
    )


def _keep(kept: dict[str, Array], folder: Path, n: int, rows: slice, piece: Track) -> None:
    """Write the rows of a piece to one .npy file of `n` rows per quantity; `kept`: files that are open, by key."""
    for key in (*PARTS, *FLAGS):
        values = piece.flags[key] if key in FLAGS else getattr(piece, key)
        if values is None:
            continue
        if key not in kept:
            path = folder / f"{FILE_NAMES.get(key, key)}.npy"
            kept[key] = open_memmap(path, mode="w+", dtype=values.dtype, shape=(n, *values.shape[1:]))
        kept[key][rows] = values


def summary(log: Log, track: Track, found: Score | None) -> dict[str, Any]:
    """Return the summary of a track (estimates over a log) as plain numbers, with its errors if `found` is not None."""
    n, started = len(log.stamp_ns), track.flags["initialised"]
    duration = float(log.seconds[-1])
    first = int(np.argmax(started)) if started.any() else None
    out: dict[str, Any] = {
        "log": log.name, "estimator": track.name, "robot": log.robot_name, "rows": n, "foot_samples": len(log.foot_ns),
        "feet": log.feet_count, "duration_s": duration, "imu_hz": _rate(log.stamp_ns), "feet_hz": _rate(log.foot_ns),
        "started_after_s": None if first is None else float(log.seconds[first]), "refused": dict(track.refused),
    }  # fmt: skip
    if first is None:
        out["warning"] = "never started: no standstill of half a second with the feet at rest was found"
        return out
    rows = slice(first, n)
    nis = np.asarray(track.nis[rows])
    nis = nis[np.isfinite(nis)]
    out["share"] = {flag: float(track.flags[flag][rows].mean()) for flag in FLAGS[1:]}
    out["nis_mean"] = float(nis.mean()) if nis.size else None
    out["nis_inside_95"] = float(np.mean((nis > NIS_BAND[0]) & (nis < NIS_BAND[1]))) if nis.size else None
    if track.slipping is not None:
        sliding = np.asarray(track.slipping[rows])  # NaN: the foot does not stand
        known = np.isfinite(sliding)
        out["slipping"] = [
            float(row[good].mean()) if good.any() else None for row, good in zip(sliding.T, known.T, strict=True)
        ]
    if track.externals is not None:
        out["external"] = track.externals._asdict()
    if track.gyro_bias is not None and track.acc_bias is not None:
        out["gyro_bias_rad_s"] = [float(x) for x in track.gyro_bias[-1]]
        out["acc_bias_m_s2"] = [float(x) for x in track.acc_bias[-1]]
    moved = track.position[-1] - track.position[first]
    out["displacement_m"] = [float(x) for x in moved]
    out["heading_rad"] = float(track.yaw[-1] - track.yaw[first])
    out["unobservable"] = "position and heading are dead-reckoned: they drift without bound"
    if found is not None:
        out["errors"] = asdict(found) | {"nees_per_dof": found.nees / 3.0}
    return out


def plain(value: Any) -> Any:
    """Return nested data with plain numbers for JSON, and None for those that are not finite."""
    if isinstance(value, Mapping):
        return {key: plain(part) for key, part in value.items()}
    if isinstance(value, list):
        return [plain(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _rate(stamps: NDArray[np.int64]) -> float | None:
    return float(1e9 / np.median(np.diff(stamps))) if len(stamps) > 1 and stamps[-1] > stamps[0] else None


def pack(folder: Path, out: Path) -> Path:
    """Put the single files of a result into one NPZ, remove them, and return the path of the NPZ."""
    with whole(out) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED, True, compresslevel=1) as archive:
        for path in sorted(folder.glob("*.npy")):
            archive.write(path, path.name)
            path.unlink()
    return out


def write_csv(result: Result, out: Path) -> Path:
    """Write stamps, velocity, gravity, pose, standard deviations, NIS and flags as CSV, a line per inertial row."""
    track, feet = result.track, result.log.feet_count
    names = ["stamp_ns"]
    for name in ("velocity_imu", "velocity_odom", "g_up_imu", "position", "velocity_sd"):
        names += [f"{name}_{axis}" for axis in "xyz"]
    names += ["yaw", "nis", *FLAGS, *(f"slipping{f}" for f in range(feet))]
    with out.open("w") as file:
        file.write(",".join(names) + "\n")
        for first in range(0, len(track.v), ROWS_EACH):
            rows = slice(first, first + ROWS_EACH)
            sd = np.sqrt(np.diagonal(track.p[rows, 3:, 3:], axis1=1, axis2=2))
            numbers = np.hstack(
                [track.v[rows], track.v_odom[rows], track.g[rows], track.position[rows], sd, track.yaw[rows, None],
                 track.nis[rows, None], *(track.flags[f][rows, None] for f in FLAGS),
                 np.zeros((len(sd), feet)) if track.slipping is None else track.slipping[rows]]
            )  # fmt: skip
            for stamp, row in zip(result.log.stamp_ns[rows].tolist(), numbers.tolist(), strict=True):
                file.write(f"{stamp}," + ",".join(f"{x:.9g}" for x in row) + "\n")
    return out


def write_tum(result: Result, out: Path) -> list[Path]:
    """Write trajectories of base_link for `evo`: `estimate.tum`, and `truth.tum` of a log that is scored.

    A line per inertial row holds time s, position m and orientation qx qy qz qw; that of the estimate follows from its
    heading and its direction of gravity.
    """
    log, track = result.log, result.track
    files = [out / "estimate.tum"]
    with files[0].open("w") as file:
        for first in range(0, len(track.v), ROWS_EACH):
            rows = slice(first, first + ROWS_EACH)
            quats = Rotation.from_matrix(base_rot(log, track, rows)).as_quat()
            _write_rows(file, log.stamp_ns[rows], track.position[rows], quats)
    if result.score is not None:
        files.append(out / "truth.tum")
        rot = Rotation.from_matrix(log.rot @ log.rot_base_from_imu.T)
        with files[1].open("w") as file:
            _write_rows(file, log.stamp_ns, base_pose(log)[0], rot.as_quat())
    return files


def _write_rows(file: TextIO, stamp_ns: Array, position: Array, quats: Array) -> None:
    np.savetxt(file, np.column_stack([1e-9 * stamp_ns, position, quats]), fmt="%.9f")


def written(folder: Path) -> set[str]:
    """Return the names of the files that an earlier estimate wrote into a folder, by its summary; empty = none."""
    try:
        listed = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))["files"]
        return MADE & {Path(name).name for name in listed}
    except (OSError, ValueError, KeyError, TypeError):
        return set()


class Scratch:
    """Context manager that yields a temporary folder for the single files of a result, and removes it on exit."""

    def __init__(self, beside: Path | None) -> None:
        self.path = Path(tempfile.mkdtemp(prefix=".estimates-", dir=beside))

    def __enter__(self) -> Path:
        return self.path

    def __exit__(self, *_: object) -> None:
        shutil.rmtree(self.path, ignore_errors=True)
