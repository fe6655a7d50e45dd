"""Commands `surefoot map build|update|merge|show|check`: landmark maps from recordings, and checks of map files."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from surefoot.errors import InvalidField

from ..cli.output import EXIT_CHECK, Json, use_json, write, write_json, write_table
from ..cli.progress import Progress

if TYPE_CHECKING:
    from .build import BuiltMap
    from .summary import Summary
    from .update import MapChange

app = typer.Typer(name="map", help="Maps: landmarks from a recording, occupancy of map_server.", no_args_is_help=True)
File = Annotated[Path, typer.Argument(help="Landmark map (.npz), or the YAML of a map_server map.")]
Radius = Annotated[float, typer.Option(min=0.0, help="Radius of the robot, m, for occupancy.")]


@app.command()
def build(
    recording: Annotated[
        Path, typer.Argument(help="MCAP recording of a robot that sees landmarks or images, or a picture of the floor.")
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="Landmark map to write.")] = Path("landmarks.npz"),
    least: Annotated[int, typer.Option(min=1, help="Detections of a landmark that is kept.")] = 3,
    features: Annotated[str, typer.Option(help="Features of images: orb or sift.")] = "orb",
    poses: Annotated[
        str | None, typer.Option(help="Poses of images: state/pose, state/odometry; sim/truth is taken as exact.")
    ] = None,
    width: Annotated[float | None, typer.Option(min=0.05, help="Width of a picture on the floor, m.")] = None,
    json: Json = False,
) -> None:
    """Make a map of the landmarks that a robot saw, from its detections or images and its odometry.

    Images count where the recording has them. Truth is not read unless --poses asks for it.
    """
    use_json(json)
    with Progress(f"map of {recording.name}", reads=[recording]) as progress:
        from .images import holds_images

        if width is not None or holds_images(recording):
            _build_features(recording, out, least, features, poses, width, json)
            return
        from surefoot.services.navigator.belief.landmark_files import save

        from .build import build_map
        from .equations import BuildOptions
        from .sightings import read_sightings

        progress.at(0.0)
        seen = read_sightings(recording, progress.part(0.0, 0.5))
        made = build_map(seen, BuildOptions(least=least), f"{recording.name}, {seen.source}")
        path = save(made.world, out)
    facts = _facts(made)
    if json:
        write_json({"file": str(path), **facts})
        return
    write(f"{path}: {len(made.world)} landmarks from {made.used} of {made.detections} detections")
    write_table(("quantity", "value"), [(name.replace("_", " "), _shown(value)) for name, value in facts.items()])


def _build_features(
    source: Path, out: Path, least: int, features: str, poses: str | None, width: float | None, json: bool
) -> None:
    from surefoot.services.vision.feature_map import save

    from .images import map_of_source

    world = map_of_source(source, features, poses, width, least)
    path = save(world, out)
    facts = {"features": len(world), "kind": world.kind, "seen_each": float(world.seen.mean()), "camera": world.camera,
             "place_sd_m": float(world.sd.mean()), "drift_m": world.drift}  # fmt: skip
    if json:
        write_json({"file": str(path), **facts})
        return
    write(f"{path}: {len(world)} features; SUREFOOT_VISION_MAP and SUREFOOT_NAVIGATOR_LANDMARKS take this file")
    write_table(("quantity", "value"), [(name.replace("_", " "), _shown(value)) for name, value in facts.items()])


@app.command()
def update(
    recordings: Annotated[list[Path], typer.Argument(help="MCAP recordings of a robot that navigated by the map.")],
    world: Annotated[Path, typer.Option("--map", "-m", help="Landmark map (.npz) that is compared with them.")],
    out: Annotated[Path | None, typer.Option("--write", "-w", help="New map to write; without it none is.")] = None,
    replace: Annotated[bool, typer.Option("--replace", help="--write may replace a file, as the map itself.")] = False,
    place_sd: Annotated[
        float, typer.Option(min=0.001, help="Largest standard deviation of a pose that counts, m.")
    ] = 0.1,
    certain: Annotated[
        float, typer.Option(min=0.5, max=1.0, help="Probability from which on a change is listed.")
    ] = 0.99,
    json: Json = False,
) -> None:
    """List the landmarks of a map that vanished or moved, and new ones, by what a robot saw that knew where it was.

    The poses are those of state/pose; truth is not read.
    """
    use_json(json)
    if out is not None and out.with_suffix(".npz").exists() and not replace:
        raise InvalidField("write", f"{out.with_suffix('.npz')} exists; --replace allows to replace it")
    with Progress(f"changes of {world.name}", reads=recordings) as progress:
        from surefoot.services.navigator.belief.landmark_files import load, save
        from surefoot.services.vision.feature_map import has_features

        from .sightings import read_sure
        from .update import changes_of

        old = load(world)
        if has_features(world):
            text = f"{world} is a map of image features; build one of the new recording and merge them"
            raise InvalidField("map", text)
        seen = read_sure(recordings, place_sd, progress.part(0.0, 0.9))
        found = changes_of(old, seen, f"{world.name}, {', '.join(path.name for path in recordings)}", certain)
        path = None if out is None else save(found.world, out)
    if json:
        write_json({
            "map": str(world), "file": None if path is None else str(path), "landmarks": len(old),
            "looked_at": found.looked_at, "changes": [vars(change) for change in found.changes],
        })  # fmt: skip
        return
    if found.changes:
        write_table(
            ("change", "landmark", "x, m", "y, m", "sd, m", "looks", "seen", "probability"),
            [_row(change) for change in found.changes],
        )
    write(f"{len(found.changes)} changes; {found.looked_at} of {len(old)} landmarks were looked at often enough")
    if path is not None:
        write(f"{path}: {len(found.world)} landmarks, version {found.world.version}")


def _row(change: "MapChange") -> tuple[str, ...]:
    """Return the row of a change in the table of `surefoot map update`."""
    sd = "" if change.covariance is None else f"{(0.5 * (change.covariance[0] + change.covariance[3])) ** 0.5:.3f}"
    return (
        change.kind, "" if change.landmark is None else str(change.landmark), f"{change.place[0]:.3f}",
        f"{change.place[1]:.3f}", sd, str(change.looks), str(change.seen), f"{change.probability:.4f}",
    )  # fmt: skip


@app.command()
def merge(
    first: File,
    second: File,
    out: Annotated[Path, typer.Option("--out", "-o", help="Map to write.")] = Path("merged.npz"),
    json: Json = False,
) -> None:
    """Unite two maps of features of one frame; what both saw becomes one feature."""
    use_json(json)
    with Progress(out.name):
        from surefoot.services.vision.feature_map import load, merged, save

        a, b = load(first), load(second)
        world = merged(a, b)
        path = save(world, out)
    if json:
        write_json({"file": str(path), "features": len(world), "both": len(a) + len(b) - len(world)})
    else:
        write(f"{path}: {len(world)} features, {len(a) + len(b) - len(world)} in both")


@app.command()
def show(file: File, radius: Radius = 0.15, json: Json = False) -> None:
    """Show what is in a map file."""
    use_json(json)
    found = _summary(file, radius)
    if json:
        write_json({"file": str(file), **found.facts})
        return
    write_table(("quantity", "value"), [(name.replace("_", " "), _shown(value)) for name, value in found.facts.items()])


@app.command()
def check(file: File, radius: Radius = 0.15, json: Json = False) -> None:
    """Read a map file and report problems of its use. Exit code 1: there are some; 2: it is no map."""
    use_json(json)
    found = _summary(file, radius)
    if json:
        write_json({"file": str(file), "ok": not found.problems, "problems": found.problems})
    else:
        write(f"{file}: {'; '.join(found.problems) or 'ok'}")
    if found.problems:
        raise typer.Exit(EXIT_CHECK)


def _summary(file: Path, radius: float) -> "Summary":
    with Progress(f"summary of {file.name}"):
        from .summary import summary_of

        return summary_of(file, radius)


def _facts(made: "BuiltMap") -> dict[str, Any]:
    import numpy as np

    return {
        "landmarks": len(made.world), "left_out": made.dropped, "detections": made.detections, "used": made.used,
        "detections_each": float(np.median(made.seen)), "place_sd_m": float(np.median(made.sd)),
        "drift_m": made.drift,
        "range_rms": made.range_rms, "bearing_rms_rad": made.bearing_rms, "look_sd": made.look_sd,
        "largest_correction_of_odometry_m": made.shift,
    }  # fmt: skip


def _shown(value: Any) -> str:
    if isinstance(value, list):
        return " ".join(_shown(part) for part in value)
    return f"{value:.4g}" if isinstance(value, float) else str(value)
