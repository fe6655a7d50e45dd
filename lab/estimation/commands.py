"""`surefoot estimate`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..cli.output import Json, use_json, write, write_json, write_table

if TYPE_CHECKING:
    from .scores import Score

app = typer.Typer()


@app.command()
def estimate(
    log: Annotated[Path, typer.Argument(help="Recording (.mcap), or a log of others (.csv, .npz); docs/estimate.md.")],
    estimator: Annotated[str | None, typer.Option(help="Estimator: best, ekf, paper, imu, kinematics ...")] = None,
    robot: Annotated[str | None, typer.Option(help="Robot description, for logs with joint angles.")] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Folder for estimates and plots.")] = None,
    csv: Annotated[bool, typer.Option("--csv", help="Write the estimates as CSV as well.")] = False,
    sort: Annotated[bool, typer.Option("--sort", help="Put rows into the order of their stamps.")] = False,
    gyro_noise: Annotated[float | None, typer.Option(help="Gyro noise of a row, rad/s [of the quiet part].")] = None,
    acc_noise: Annotated[float | None, typer.Option(help="Accelerometer noise of a row, m/s^2 [likewise].")] = None,
    json: Json = False,
) -> None:
    """Estimate velocity, tilt and path from a log, with covariance and flags; errors where the log has truth."""
    from surefoot.tables import did_you_mean

    from .files import open_log
    from .results import Scratch, pack, write_csv
    from .results import estimate as run
    from .track import default, names

    use_json(json)
    chosen = estimator or default()
    if chosen not in names():
        from surefoot.errors import SurefootError

        hint = did_you_mean(chosen, names())
        raise SurefootError("invalid", f"got {chosen!r}{hint}; known are {', '.join(names())}", "estimator")
    known = {"sigma_w": gyro_noise, "sigma_q": acc_noise}
    opened = open_log(log, robot, sort, **{key: value for key, value in known.items() if value is not None})
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
    files: list[Path] = []
    with Scratch(out) as folder:
        result = run(opened.log, chosen, folder)
        if out is not None:
            from .plots import draw

            files.append(draw(result, out / "estimates.svg"))
            if csv:
                files.append(write_csv(result, out / "estimates.csv"))
            files.insert(0, pack(folder, out / "estimates.npz"))
    told: dict[str, Any] = {**result.summary, "notes": list(opened.notes), "files": [str(path) for path in files]}
    if json:
        write_json(told)
        return
    _show(told, result.score)


def _show(told: dict[str, Any], score: "Score | None") -> None:
    rows = [
        (key.replace("_", " "), _words(value)) for key, value in told.items() if key not in ("errors", "files", "notes")
    ]
    write_table(("quantity", "value"), rows)
    if score is not None:
        unit = {
            "velocity, row by row": f"{100 * score.rmse:.2f} cm/s",
            "velocity over 0.5 s": f"{100 * score.smooth:.2f} cm/s",
            "average along the track": f"{100 * score.average:+.1f} %", "drift": f"{100 * score.drift:.3f} cm/s",
            "NEES of v (3 = ideal)": f"{score.nees:.1f}", "tilt": f"{score.tilt_deg:.2f} deg",
            "displacement per net metre": f"{100 * score.odometry:.2f} % of {score.way:.2f} m",
            "height": f"{1e3 * score.height:.1f} mm", "heading at the end": f"{score.heading_deg:+.2f} deg",
        }  # fmt: skip
        write_table(("error", "value"), list(unit.items()))
    for note in told["notes"]:
        write(f"note  {note}")
    for path in told["files"]:
        write(f"file  {path}")


def _words(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list):
        return " ".join(_words(part) for part in value)
    if isinstance(value, dict):
        return ", ".join(f"{key} {_words(part)}" for key, part in value.items()) or "none"
    return "-" if value is None else str(value)
