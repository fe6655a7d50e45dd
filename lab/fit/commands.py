"""Command `surefoot fit`: parameters of a robot's navigation model from recordings of it."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..cli.output import Json, use_json, write, write_json, write_table
from ..cli.progress import Progress

if TYPE_CHECKING:
    from .result import Fitted

READING = 0.3
"""Share of the progress display, 0 to 1, for reading the recordings; the search for parameters has the rest."""

app = typer.Typer(name="fit", help="Numbers of a robot from recordings of it.", no_args_is_help=True)


@app.command("navigator")
def navigator(
    recordings: Annotated[list[Path], typer.Argument(help="MCAP files of runs with goals, a camera and landmarks.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="TOML file to write.")] = Path("fitted.toml"),
    params: Annotated[
        str, typer.Option("--params", help="Model to begin with: a shipped name or a .toml file.")
    ] = "nao",
    landmarks: Annotated[
        Path | None, typer.Option(help="Map of landmarks, of `surefoot map build` [that of the recordings].")
    ] = None,
    json: Json = False,
) -> None:
    """Fit motion noise, drift, durations, match probabilities and sight of a robot; ground truth is not used.

    Recordings with images need --landmarks, the map that vision used.
    """
    use_json(json)
    with Progress(f"fit of {len(recordings)} recordings", reads=recordings) as progress:
        from surefoot.services.navigator.belief.landmark_files import load as load_landmarks
        from surefoot.services.navigator.policy.params import load

        from .estimate import fit
        from .events import read_run
        from .output import check_out, write_model

        check_out(out, params)
        model = load(params)
        world = None if landmarks is None else load_landmarks(landmarks)
        runs = []
        for number, path in enumerate(recordings):
            progress.at(READING * number / len(recordings), f"reading {path.name}")
            runs.append(read_run(path, model, world))
        found = fit(runs, model, lambda share, step: progress.at(READING + (1.0 - READING) * share, step))
        write_model(found, params, [path.name for path in recordings], out)
    if json:
        write_json(
            {
                "out": str(out), "runs": found.runs, "sightings": found.sightings, "improvement": found.improvement,
                "values": {key: vars(value) for key, value in found.values.items()}, "undecided": found.undecided,
            }
        )  # fmt: skip
    else:
        _show(found, out)


def _show(found: "Fitted", out: Path) -> None:
    rows = [
        (key, f"{v.value:.4g}", f"{v.low:.4g} to {v.high:.4g}", str(v.count or "-")) for key, v in found.values.items()
    ]
    title = f"{found.runs} recordings, {found.sightings} sightings"
    write_table(("parameter", "value", "95 % interval", "samples"), rows, title, right=(1, 2, 3))
    if found.undecided:
        write(f"not decided by the recordings, left as in --params: {', '.join(found.undecided)}")
    write(f"wrote   {out}")
