"""Command `surefoot estimate`: velocity, tilt and path of a log."""

import math
from dataclasses import replace
from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..cli.completion import robots
from ..cli.output import Json, refuse_existing, use_json, write, write_json, write_table
from ..cli.progress import Progress

if TYPE_CHECKING:
    from .files import Opened
    from .log import Log
    from .results import Result
    from .scores import Score

app = typer.Typer()


@app.command()
def estimate(
    log: Annotated[Path, typer.Argument(help="Recording (.mcap), or a log of others (.csv, .npz); docs/estimate.md.")],
    estimator: Annotated[
        str | None, typer.Option(help="Estimator or referee: best, ekf, imu, kinematics, inekf ...")
    ] = None,
    robot: Annotated[
        str | None, typer.Option(help="Robot description, for logs with joint angles.", autocompletion=robots)
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder for estimates, plots and trajectories.")
    ] = None,
    csv: Annotated[bool, typer.Option("--csv", help="Write the estimates as CSV as well.")] = False,
    sort: Annotated[bool, typer.Option("--sort", help="Put rows into the order of their stamps.")] = False,
    gyro_noise: Annotated[float | None, typer.Option(min=1e-9, help="Of a row, rad/s [of the quiet part].")] = None,
    acc_noise: Annotated[float | None, typer.Option(min=1e-9, help="Of a row, m/s^2 [of the quiet part].")] = None,
    feet: Annotated[str | None, typer.Option(help="Feet of a log without robot: point, sole, line.")] = None,
    radius: Annotated[float | None, typer.Option(min=0.0, max=1.0, help="Radius of round feet, m.")] = None,
    sole: Annotated[str | None, typer.Option(help="LENGTH,WIDTH of the soles, or LENGTH of lines, m.")] = None,
    contact_on: Annotated[float | None, typer.Option(min=0.0, help="Force from which a foot stands, N.")] = None,
    contact_off: Annotated[float | None, typer.Option(min=0.0, help="Force below which it stands no more, N.")] = None,
    score_from: Annotated[float | None, typer.Option(min=0.0, help="Begin of scores after the start, s.")] = None,
    align: Annotated[bool, typer.Option("--align", help="Align the truth with the sensors before scoring.")] = False,
    calibrate: Annotated[bool, typer.Option("--calibrate", help="Report legs, mounting, offset in time.")] = False,
    calibrated: Annotated[bool, typer.Option("--calibrated", help="Correct what it proves, then estimate.")] = False,
    smooth: Annotated[bool, typer.Option("--smooth", help="Forward and backward over the whole log.")] = False,
    json: Json = False,
) -> None:
    """Estimate velocity, tilt and path from a log, with covariance and flags; errors where the log has truth."""
    use_json(json)
    if out is not None:
        if calibrate:
            raise typer.BadParameter("--calibrate only reports, and writes no files", param_hint="--out")
        refuse_existing(out, force=True, folder=True)
    with Progress(f"estimate of {log.name}", reads=[log]) as progress:
        from .calibration_report import checked, show
        from .feet import FeetOptions
        from .files import open_log
        from .track import check_name, default

        check_name(chosen := estimator or default())
        sizes = None if sole is None else sole.split(",")
        limits = {"contact_on": contact_on, "contact_off": contact_off}
        stated = FeetOptions.of({"feet": feet, "foot_radius": radius, "sole_size": sizes, **limits})
        known = {"sigma_w": gyro_noise, "sigma_q": acc_noise}
        opened = open_log(log, robot, sort, stated, align, **{k: v for k, v in known.items() if v is not None})
        if calibrate:
            return show(opened.log, opened.notes, json)
        opened = checked(opened, calibrated)
        data = _scored(opened.log, score_from)
        report, score = _estimated(replace(opened, log=data), chosen, out, csv, smooth, progress)
    if json:
        return write_json(report)
    _show(report, score)


def _estimated(
    opened: "Opened", name: str, out: Path | None, csv: bool, smooth: bool, progress: Progress
) -> tuple[dict[str, Any], "Score | None"]:
    """Run an estimator and write its files to `out`, all of them or none; return the report and the score."""
    from .results import SUMMARY, Scratch, plain, written
    from .results import estimate as run

    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
    with Scratch(out) as folder:
        result = run(opened.log, name, folder, smooth, progress.part(0.0, 0.8))
        made = [] if out is None else _write_files(result, folder, csv)
        files = [] if out is None else [*(out / path.name for path in made), out / SUMMARY]
        report: dict[str, Any] = {**result.summary, "notes": list(opened.notes), "files": [str(path) for path in files]}
        if opened.alignment is not None:
            report["alignment"] = plain(opened.alignment.report())
        if out is not None:
            (folder / SUMMARY).write_text(dumps(report, indent=1, allow_nan=False) + "\n")
            before = written(out)
            for path in files:
                (folder / path.name).replace(path)
            for name in before - {path.name for path in files}:  # of another log, perhaps: `estimate.tum` is not its
                (out / name).unlink(missing_ok=True)
    return report, result.score


def _scored(log: "Log", score_from: float | None) -> "Log":
    """Return a log whose scores begin `score_from` s after its start; None = at the time that the log states."""
    if score_from is None:
        return log
    if score_from >= log.seconds[-1]:
        raise typer.BadParameter(f"got {score_from:g}, the log has {log.seconds[-1]:g} s", param_hint="--score-from")
    return replace(log, begin_s=score_from)


def _write_files(result: "Result", folder: Path, csv: bool) -> list[Path]:
    """Write plots and trajectories of a result into `folder`, and pack its estimates; return the paths."""
    from .plots import draw
    from .results import pack, write_csv, write_tum

    more = [draw(result, folder / "estimates.svg"), *write_tum(result, folder)]
    if csv:
        more.append(write_csv(result, folder / "estimates.csv"))
    return [pack(folder, folder / "estimates.npz"), *more]


@app.command()
def compare(
    a: Annotated[Path, typer.Argument(help="Folder or NPZ of `surefoot estimate -o`, or a recording (.mcap).")],
    b: Annotated[Path, typer.Argument(help="Another one of the same time.")],
    json: Json = False,
) -> None:
    """Compare two estimates of one log: differences in velocity, tilt, position and heading, and both scores."""
    use_json(json)
    with Progress(f"comparison of {a.name} and {b.name}", reads=[a, b]) as progress:
        from .differences import departures, load_estimated

        one = load_estimated(a)
        progress.at(0.5)
        other = load_estimated(b)
        found = departures(one, other)
    if json:
        sides = {
            name: {"path": str(each.path), "errors": each.errors, "notes": each.notes}
            for name, each in (("a", one), ("b", other))
        }
        write_json({"differences": {name: part._asdict() for name, part in found.items()}, **sides})
        return
    units = {"velocity": (100.0, "cm/s"), "tilt": (1.0, "deg"), "position": (1e3, "mm"), "heading": (1.0, "deg")}
    rows: list[tuple[str, ...]] = []
    for name, (rms, most, at) in found.items():
        factor, unit = units[name]
        rows.append((f"{name}, {unit}", f"{factor * rms:.3f}", f"{factor * most:.3f}", f"{at:.2f} s"))
    write_table(("difference", "rms", "largest", "at"), rows)
    names = [key for key in {**one.errors, **other.errors} if one.errors and other.errors]
    if names:
        scores = [(key, _text(one.errors.get(key)), _text(other.errors.get(key))) for key in names]
        write_table(("error", str(a), str(b)), scores)
    else:
        write("note  no scores: not both have a truth")
    for note in (*one.notes, *other.notes):
        write(f"note  {note}")


def _show(report: dict[str, Any], score: "Score | None") -> None:
    rows = [
        (key.replace("_", " "), _text(value))
        for key, value in report.items()
        if key not in ("alignment", "errors", "files", "notes")
    ]
    write_table(("quantity", "value"), rows)
    if "alignment" in report:
        write_table(("truth by the sensors", "value", "within (95 %)"), _alignment(report["alignment"]))
    if score is not None:
        write_table(("error", "value"), [(name, _text(*value)) for name, value in _errors(score)])
    for note in report["notes"]:
        write(f"note  {note}")
    for path in report["files"]:
        write(f"file  {path}")


def _alignment(found: dict[str, Any]) -> list[tuple[str, str, str]]:
    names = {"offset_s": "late, s", "rotation_deg": "turned, deg", "lever_m": "point from the IMU, m", "scale": "scale"}
    rows: list[tuple[str, str, str]] = []
    for key, name in names.items():
        value, within = ("not observable" if found[k] is None else _text(found[k]) for k in (key, f"{key}_within"))
        rows.append((name if key in found["applied"] else f"{name} (not applied)", value, within))
    return rows


def _errors(s: "Score") -> list[tuple[str, tuple[float, str]]]:
    """Return the name of each error with its value and the text around it."""
    over = f"over {s.rpe_m:g} m" if math.isfinite(s.rpe_m) else "over 1 m"
    return [
        ("velocity, row by row", (100 * s.rmse, "{:.2f} cm/s")),
        ("velocity over 0.5 s", (100 * s.smooth, "{:.2f} cm/s")),
        ("average along the track", (100 * s.average, "{:+.1f} %")),
        ("drift", (100 * s.drift, "{:.3f} cm/s")),
        ("NEES of v per degree of freedom (1 = ideal)", (s.nees / 3.0, "{:.2f}")),
        ("rows inside the 95 % region of v", (100 * s.inside, "{:.1f} %")),
        ("tilt", (s.tilt_deg, "{:.2f} deg")),
        (f"relative pose error {over}", (100 * s.rpe, "{:.2f} %")),
        ("relative pose error over 1 s", (1e3 * s.rpe_1s, "{:.1f} mm")),
        ("absolute trajectory error", (1e3 * s.ate, f"{{:.1f}} mm on a path of {s.path:.2f} m")),
        ("displacement per net metre", (100 * s.odometry, f"{{:.2f}} % of {s.way:.2f} m")),
        (f"height {over}", (1e3 * s.climb, "{:.1f} mm/m")),
        ("height, largest", (1e3 * s.height, "{:.1f} mm")),
        ("NEES of the position per degree of freedom", (s.position_nees / 3.0, "{:.2f}")),
        ("NEES of the heading", (s.heading_nees, "{:.2f}")),
        ("heading at the end", (s.heading_deg, "{:+.2f} deg")),
        ("heading per minute", (s.heading_deg_min, "{:.2f} deg/min")),
        ("heading, rms after alignment", (s.heading_rms_deg, "{:.2f} deg")),
    ]


def _text(value: Any, form: str = "{:.4g}") -> str:
    if isinstance(value, float):
        return form.format(value) if math.isfinite(value) else "-"
    if isinstance(value, list):
        return " ".join(_text(part) for part in value)
    if isinstance(value, dict):
        return ", ".join(f"{key} {_text(part)}" for key, part in value.items()) or "none"
    return "-" if value is None else str(value)
